#!/usr/bin/env python3
"""Measures the tables of tests/MEASURED.md and writes them into it.

    tests/measured.py DIR [--views VIEWS] [--meshes MESHES] [--runs RUNS] [--only NAME ...]
    tests/measured.py --check

DIR is a collection in ModelNet40's layout, with pairs_models.h5 and pairs_categories.h5 in it (drawn with
`host-train pairs` where they are missing). VIEWS has pairs of single views, NAME.h5 with their truths in NAME.json, and
sequences of them, clouds/SCENE_FRAME_OBJECT.ply and models/OBJECT.ply; MESHES has
meshes that no training saw. RUNS holds training runs; those that are missing are trained, which takes hours. A table
stands between `<!-- measured.py NAME -->` and `<!-- end -->`; times are of one thread, and good for something where
nothing else runs. The first page repeats some rows: `--check` says whether they are still the same. Needs Python 3.9 and
`cargo build --release`.
"""

import argparse
import json
import re
import statistics
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FIRST, MEASURED, TRIED_PAGE = ROOT / "README.md", ROOT / "tests/MEASURED.md", ROOT / "tests/TRIED.md"
HOST = ROOT / "target/release/host-train"
WEIGHTS = [ROOT / "core/weights" / f"{name}.rgw" for name in ("reagent", "reagent-int8", "reagent-compact-int8")]
VIEW_WEIGHTS = [*WEIGHTS, "views", "views-compact"]
SEEDS = range(1, 6)
# 97.5 % quantile of Student's t for n - 1 degrees of freedom.
STUDENT = {2: 12.706, 3: 4.303, 4: 3.182, 5: 2.776, 6: 2.571, 7: 2.447, 8: 2.365}

LABELS = {
    "init": "initial",
    "icp": "ICP",
    "icp-plane": "ICP to planes",
    "icp-trimmed": "ICP to planes, trimmed",
    "fgr": "FGR as in Open3D",
    "fgr-gnc": "FGR, graduated, normals outward",
    "fgr+icp-plane": "FGR as in Open3D, then ICP to planes",
    "init+verify": "verified without a policy",
}
POLICIES = {
    "reagent": "bundled policy",
    "reagent-int8": "the same in int8",
    "reagent-compact-int8": "compact, int8",
    "views": "policy for views, int8",
    "views-compact": "policy for views, compact, int8",
}
ENDS = {"": "", "+icp": ", then ICP to planes", "+polish": ", polished", "+verify": ", verified"}

COMPACT = ["--shape", "compact"]
DESIGN = {
    "expert": ("without the stochastic policy: the expert's actions", ["--follow", "expert"]),
    "argmax": ("without the stochastic policy: the likeliest actions", ["--follow", "argmax"]),
    "plain": ("without augmentation", ["--no-augmentation"]),
    "greedy": ("greedy expert", ["--expert", "greedy"]),
    "deep": ("deep embedding, narrow heads", ["--shape", "deep"]),
    "basic": ("basic accumulation", ["--accumulation", "basic"]),
    "local": ("local rotations", ["--accumulation", "local"]),
    "wide": ("ours: stochastic, augmented, steady, wide, global", []),
}

# One change at a time to six epochs of reinforcement after the same pre-training.
COSINE = ["--anneal", "cosine"]
HALVED = ["--anneal", "halve", "--halve-every", 2]
TRIED = {
    "ours-1": ("annealed along a cosine, 6 epochs", COSINE),
    "ours-2": ("the same, another seed", [*COSINE, "--seed", 2]),
    "ours-3": ("the same, a third seed", [*COSINE, "--seed", 3]),
    "long": ("18 epochs", [*COSINE, "--epochs", 18]),
    "halved": ("learning rate halved every second epoch", HALVED),
    "average": ("halved, and averaged weights (`--average 0.999`)", [*HALVED, "--average", 0.999]),
    "batch": ("mini-batches of 128 instead of 32", [*COSINE, "--mini-batch", 128]),
    "greedy": ("greedy expert", [*COSINE, "--expert", "greedy"]),
    "alpha": ("less reinforcement (`--alpha 0.1`)", [*COSINE, "--alpha", 0.1]),
    "normalised": ("normalised advantages", [*COSINE, "--normalise-advantages"]),
    "clipped": ("clipped values", [*COSINE, "--clip-values"]),
    "bootstrap": ("value of the last state in the returns", [*COSINE, "--bootstrap"]),
    "crops": ("half of the sources cropped and cluttered", [*COSINE, "--min-overlap", 0.7, "--max-outliers", 0.1]),
}


def run(*words):
    print("host-train", *words, flush=True)
    subprocess.run([HOST, *map(str, words)], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def measure(*words):
    """What a command writes as JSON."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "numbers.json"
        run(*words, "--json", path)
        return json.loads(path.read_text())


def between(page, name):
    """What stands before, between and after the marks of a table."""
    begin, end = f"<!-- measured.py {name} -->\n", "<!-- end -->"
    text = page.read_text()
    if begin not in text:
        raise SystemExit(f"{page} has no place for {name}")
    before, _, rest = text.partition(begin)
    table, _, after = rest.partition(end)
    return before + begin, table, end + after


def label(method):
    if method in LABELS:
        return LABELS[method]
    name, plus, end = method.partition("+")
    return POLICIES.get(name, name) + ENDS[plus + end]


def ordered(found):
    """The same methods in the order of the tables above; those of one policy together."""
    names = [*LABELS, *(policy + end for policy in POLICIES for end in ENDS)]
    place = lambda name: names.index(name) if name in names else len(names)
    return {name: found[name] for name in sorted(found, key=place)}


def short(value, digits):
    """A number without the zero before its point."""
    return re.sub(r"^0\.", ".", f"{value:.{digits}f}")


def accuracy(m):
    """ISO R mean / median / ISO t / ADI AUC / recall."""
    return (
        f"{m['r_iso_deg']:.2f} / {m['r_iso_median_deg']:.2f} / {short(m['t_iso'], 3)} / "
        f"{m['adi_auc_pct']:.1f} / {100 * m['recall_r5_t005']:.0f} %"
    )


def milliseconds(m):
    if m["ms_median"] == 0:
        return ""
    p95 = f", p95 {m['ms_p95']:.1f}" if m["ms_p95"] > 1.5 * m["ms_median"] else ""
    return f"{m['ms_median']:.1f}{p95}"


def table(head, rows):
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def pairs(data, name):
    path = data / f"pairs_{name}.h5"
    if not path.exists():
        run("pairs", "--data", data, "--protocol", f"m40-{name}", "--count", 100, "--out", path)
    return path


# The paper's rule: the most likely step of each axis.
LIKELY = ["--decide", "most-likely"]


def both_halves(data, *words):
    """The same on both files of pairs."""
    return [measure("eval", "--pairs", pairs(data, name), *words)["methods"] for name in ("models", "categories")]


def builtin(args):
    methods = "init,icp,icp-plane,fgr-gnc,fgr+icp-plane,policy,policy+icp,policy+verify"
    found = measure("eval", "--data", "procedural", "--protocol", "m40-models", "--count", 300, "--methods", methods)
    rows = [[label(name), accuracy(m), short(m["chamfer_mod"], 4), milliseconds(m)] for name, m in ordered(found["methods"]).items()]
    return table(["method", "ISO R / median / ISO t / ADI AUC / recall", "modified CD", "ms"], rows)


def halves(args):
    methods = "init,icp,icp-plane,icp-trimmed,fgr,fgr-gnc,fgr+icp-plane,init+verify,policy,policy+icp,policy+polish,policy+verify"
    first, second = both_halves(args.data, "--weights", *WEIGHTS, "--methods", methods)
    rows = [[label(name), accuracy(first[name]), accuracy(second[name]), milliseconds(first[name])] for name in ordered(first)]
    for rule, words in ((", one way", ["--decide", "mean"]), (", most likely steps", LIKELY)):
        first, second = both_halves(args.data, "--weights", *WEIGHTS, "--methods", "policy", *words)
        rows += [[label(name) + rule, accuracy(first[name]), accuracy(second[name]), ""] for name in ordered(first)]
    return table(["method", "first half: ISO R / median / ISO t / ADI AUC / recall", "second half, same", "ms"], rows)


# Keys of the JSON, factors and decimals.
INT8 = {
    "ISO R mean, deg": ("r_iso_deg", 1, 3),
    "ISO R median, deg": ("r_iso_median_deg", 1, 3),
    "MAE R, deg": ("r_mae_deg", 1, 3),
    "ISO t": ("t_iso", 1, 4),
    "ISO t median": ("t_iso_median", 1, 4),
    "MAE t": ("t_mae", 1, 4),
    "ADI AUC, %": ("adi_auc_pct", 1, 2),
    "ADD AUC, %": ("add_auc_pct", 1, 2),
    "modified CD x 1e-4": ("chamfer_mod", 1e4, 2),
    "modified CD median x 1e-4": ("chamfer_mod_median", 1e4, 2),
    "recall, %": ("recall_r5_t005", 100, 2),
}


def int8(args):
    """Means over four sets of 1000 pairs, and of medians their mean too."""
    words = ["--count", 1000, "--weights", *WEIGHTS[:2], "--methods", "policy", "--agreement", "--threads", args.threads]
    sets = [
        measure("eval", "--data", args.data, "--protocol", f"m40-{name}", "--seed", seed, *words)
        for name in ("models", "categories")
        for seed in (1, 2)
    ]
    change = lambda exact, found: f"{100 * (found / exact - 1):+.1f}".replace("-0.0", "0.0").replace("+0.0", "0.0")
    rows = []
    for what, (key, factor, digits) in INT8.items():
        exact, found = ([factor * s["methods"][name][key] for s in sets] for name in ("reagent", "reagent-int8"))
        means = statistics.mean(exact), statistics.mean(found)
        single = ", ".join(map(change, exact, found))
        rows.append([what, *(short(mean, digits) for mean in means), change(*means) + " %", single])
    equal = zip(*(s["agreement"]["reagent-int8"]["equal"] for s in sets))
    equal = [100 * statistics.mean(step) for step in equal]
    text = table(["4,000 pairs", "f32", "int8", "int8 to f32", "in the single sets, %"], rows)
    cells = [f"{share:.0f}" for share in equal]
    head = ["step", *map(str, range(1, len(cells) + 1)), "all"]
    return text + "\n" + table(head, [["equal actions, % of axes", *cells, f"{statistics.mean(equal):.0f}"]])


def steps(args):
    found = measure("eval", "--pairs", pairs(args.data, "models"), "--methods", "policy", "--per-step")
    found = found["per_step"]["reagent"]
    row = lambda what, cell: [what, *map(cell, found)]
    rows = [
        row("ISO R mean, deg", lambda m: f"{m['r_iso_deg']:.2f}"),
        row("ISO R median, deg", lambda m: f"{m['r_iso_median_deg']:.2f}"),
        row("ISO t mean", lambda m: short(m["t_iso"], 3)),
    ]
    return table(["step", *(str(m["step"]) for m in found)], rows)


def scans(args):
    words = ["--data", args.data / "real_scans", "--protocol", "scan", "--weights", *WEIGHTS]
    found = measure("eval", *words, "--methods", "icp-plane,policy,policy+polish,policy+verify")
    rows = [[label(name), accuracy(m)] for name, m in ordered(found["methods"]).items()]
    return table([f"{found['pairs']} scans", "ISO R / median / ISO t / ADI AUC / recall"], rows)


def sweeps(args):
    methods = "policy,policy+verify,icp-plane,fgr-gnc,fgr+icp-plane"
    words = ["--data", args.data, "--protocol", "m40-models", "--vary", "all", "--count", 100, "--threads", args.threads]
    rows, head = [], []
    for varied in measure("sweep", *words, "--methods", methods)["sweep"]:
        found = ordered(varied["methods"])
        head = list(found)
        for at in zip(*found.values()):
            cells = [f"{m['summary']['r_iso_median_deg']:.2f} / {100 * m['summary']['recall_r5_t005']:.0f}" for m in at]
            rows.append([varied["vary"], f"{at[0]['value']:g}", *cells])
    return table(["varied", "value", *map(label, head)], rows)


def verdict(args):
    words = ["--meshes", args.meshes.parent] if args.meshes else []
    found = measure("calibrate", "--data", args.data, *words, "--count", 1000, "--seed", 7)["quality"]
    rows = []
    for line in found:
        fitted, left_out, built_in = line["fitted"], line["left_out"], line["built_in"]
        number = lambda value: "" if value is None else short(value, 3)
        share = lambda value: "" if value is None else f"{100 * value:.0f} %"
        held = [share(built_in[f"{which}_held_right"]) for which in ("right", "wrong")]
        numbers = [*held, number(built_in["auc"]), number(built_in["ece"]), number(left_out["ece"])]
        mode, pairs = line["pairs"].split(" ", 1)
        rows.append([f"{mode.lower()}, {pairs.lower()}", str(fitted["count"]), f"{100 * fitted['right']:.0f} %", *numbers])
    head = ["mode, pairs", "pairs", "right", "right held right", "wrong held right", "AUC", "ECE", "ECE of a fit without this kind"]
    return table(head, rows)


def trained(args, name, *words):
    """The run of this name, trained if it is not there."""
    path = args.runs / name
    if not (path / "last.safetensors").exists():
        run("train", "--data", args.data, *words, "--out", path)
    return path


def protocol(args):
    pre = trained(args, "pre", "--stage", "pretrain")
    ilrl = trained(args, "ilrl", "--stage", "ilrl", "--init", pre)
    rows = []
    files = [("pretrain", pre / "last.safetensors"), ("ilrl, best on validation", ilrl), ("ilrl, last", ilrl / "last.safetensors")]
    kept = ROOT / "core/weights/protocol-int8.rgw"
    for what, path in [*files, ("ilrl, last, in int8: `protocol-int8.rgw`", kept)]:
        runs = [("most likely steps", "policy", LIKELY), ("both ways", "policy", ["--decide", "both-ways"])]
        if path == kept:
            runs.append(("verified", "policy+verify", []))
        for how, methods, words in runs:
            first, second = both_halves(args.data, "--weights", path, "--methods", methods, *words)
            rows += [[f"{what}, {how}", accuracy(first[name]), accuracy(second[name])] for name in first]
    return table(["run", "first half: ISO R / median / ISO t / ADI AUC / recall", "second half, held out, same"], rows)


def interval(values, digits):
    """Mean and 95 % confidence interval."""
    half = STUDENT[len(values)] * statistics.stdev(values) / len(values) ** 0.5
    return f"{short(statistics.mean(values), digits)} ± {short(half, digits)}"


def seeds(args):
    pre = trained(args, "pre", "--stage", "pretrain")
    rows = []
    for stage in ("il", "ilrl"):
        rules = ("most-likely", "both-ways")
        found = {(name, rule): [] for name in ("m40-models", "m40-categories") for rule in rules}
        for seed in SEEDS:
            path = trained(args, f"{stage}-{seed}", "--stage", stage, "--init", pre, "--epochs", 4, "--seed", seed)
            for (name, rule), values in found.items():
                words = ["--data", args.data, "--protocol", name, "--count", 300, "--seed", 1, "--threads", args.threads]
                words += ["--decide", rule, "--weights", path / "last.safetensors"]
                values.append(measure("eval", *words)["methods"]["last"])
        for (name, rule), values in found.items():
            column = lambda key, factor, digits: interval([factor * v[key] for v in values], digits)
            half = "first half" if name == "m40-models" else "second half, held out"
            rows.append([
                f"{stage}, {half}, {rule.replace('-', ' ')}",
                column("r_iso_deg", 1, 2),
                column("r_iso_median_deg", 1, 2),
                column("t_iso", 1, 4),
                column("chamfer_mod", 1e4, 1),
                column("recall_r5_t005", 100, 1),
            ])
    return table(["stage, 5 seeds", "ISO R mean", "median", "ISO t", "modified CD x 1e-4", "recall, %"], rows)


def design(args):
    rows = []
    for name, (what, words) in DESIGN.items():
        schedule = ["--stage", "pretrain", "--epochs", 10, "--anneal", "cosine"]
        path = trained(args, f"design-{name}", *schedule, *words)
        row = [what]
        for drawn in ("m40-clean", "m40-categories"):
            words = ["--data", args.data, "--protocol", drawn, "--count", 300, "--seed", 1, "--threads", args.threads, *LIKELY]
            m = measure("eval", *words, "--weights", path / "last.safetensors")["methods"]["last"]
            row += [f"{1e4 * m['chamfer_mod']:.2f}", f"{m['r_iso_deg']:.2f} / {m['r_iso_median_deg']:.2f}"]
        rows.append(row)
    head = ["design", "clean: modified CD x 1e-4", "ISO R / median", "held-out categories, noisy: modified CD x 1e-4", "ISO R / median"]
    return table(head, rows)


def tried(args):
    schedule = ["--stage", "pretrain", *COMPACT, "--epochs", 20, "--learning-rate", 1e-3, *COSINE]
    pre = trained(args, "tried-pre", *schedule)
    rows = []
    for name, (what, words) in TRIED.items():
        defaults = {"--epochs": 6, "--seed": 1}
        words = words + [word for key, value in defaults.items() if key not in words for word in (key, value)]
        common = ["--stage", "ilrl", *COMPACT, "--init", pre, "--learning-rate", 3e-4]
        path = trained(args, f"tried-{name}", *common, *words)
        cells = []
        for rule in ("most-likely", "both-ways"):
            words = ["--data", "procedural", "--protocol", "m40-models", "--count", 600, "--seed", 5, "--threads", args.threads]
            m = measure("eval", *words, "--decide", rule, "--weights", path / "last.safetensors")["methods"]["last"]
            cells.append(f"{m['r_iso_deg']:.2f} / {m['r_iso_median_deg']:.2f} / {100 * m['recall_r5_t005']:.0f} %")
        rows.append([what, *cells])
    return table(["tried", "most likely steps: ISO R / median / recall", "both ways, same"], rows)


def deviations(m):
    """Shares of poses with AD below .10 / .05 / .02 diameters, in percent."""
    return " / ".join(f"{m[key]:.0f}" for key in ("ad10_pct", "ad05_pct", "ad02_pct"))


VIEW_METHODS = ["--methods", "init,icp-trimmed,icp-plane,fgr+icp-plane,init+verify,policy,policy+verify"]


def views(args):
    """Real views and scans that overlap in part."""
    names = ("ycbv", "ycbv_far", "bunny")
    found = [measure("eval", "--pairs", args.views / f"{name}.h5", "--weights", *VIEW_WEIGHTS, *VIEW_METHODS)["methods"] for name in names]
    rows = [[label(name), *(deviations(of[name]) for of in found), milliseconds(found[0][name])] for name in ordered(found[0])]
    return table(["method, % below .10 / .05 / .02 d", *names, "ms"], rows)


def heldout(args):
    """Scenes of thirty meshes, generated once."""
    scenes = args.runs / "heldout"
    if not scenes.exists():
        run("bop-synth", "--models", args.meshes, "--objects", 30, "--scenes", 20, "--train-scenes", 1, "--seed", 11, "--out", scenes)
    words = ["--data", scenes, "--protocol", "bop", "--estimates", scenes / "estimates.csv", "--weights", *VIEW_WEIGHTS, *VIEW_METHODS]
    found = measure("eval", *words)["methods"]
    rows = [[label(name), deviations(m), milliseconds(m)] for name, m in ordered(found).items()]
    return table(["method", "% below .10 / .05 / .02 d", "ms"], rows)


def sequences(views):
    """Of each object in each scene of real views: its model, its clouds in order, and those of the scene's next object."""
    clouds = {}
    for path in sorted((views / "clouds").glob("[0-9]*.ply")):
        scene, _, name = path.stem.split("_", 2)
        clouds.setdefault(scene, {}).setdefault(name, []).append(path)
    for objects in clouds.values():
        names = list(objects)
        for name, other in zip(names, names[1:] + names[:1]):
            yield views / "models" / f"{name}.ply", objects[name], objects[other]


def tracking(args):
    """Real sequences there and back, another object in its place, and there and back again."""
    kinds = {}
    for model, seen, others in sequences(args.views):
        there_and_back = [*seen, *reversed(seen)]
        clouds = [*there_and_back, *others, *there_and_back]
        words = ["track", model, *clouds, "--view", "origin", "--init", "none"]
        lines = subprocess.run([HOST, *map(str, words)], check=True, capture_output=True, text=True).stdout
        for cloud, line in zip(clouds, map(json.loads, lines.splitlines())):
            of = "the object" if cloud in seen else "another object"
            kinds.setdefault((of, line["state"], line["mode"]), []).append(line["ms"])
    kinds = dict(sorted(kinds.items(), reverse=True))
    every = [ms for times in kinds.values() for ms in times]
    rows = []
    for kind, times in [*kinds.items(), (("all", "", ""), every)]:
        places = statistics.quantiles(times * 2, n=100, method="inclusive")
        rows.append([*kind, str(len(times)), *(f"{places[q - 1]:.1f}" for q in (50, 95, 99)), f"{max(times):.1f}"])
    return table(["cloud of", "state", "done last", "clouds", "ms, median", "p95", "p99", "most"], rows)


# Rows of the first page, as the table of halves calls them.
CHOSEN = (
    "ICP to planes",
    "FGR as in Open3D, then ICP to planes",
    "verified without a policy",
    "bundled policy",
    "bundled policy, verified",
    "the same in int8, verified",
    "compact, int8, verified",
)


def rows_of(name):
    """The cells of a table in MEASURED.md, by the first cell of each row."""
    lines = between(MEASURED, name)[1].splitlines()
    rows = ([cell.strip() for cell in line.split("|")[1:-1]] for line in lines)
    return {cells[0]: cells[1:] for cells in rows if len(cells) > 1}


def first():
    """The first page's table of whole clouds, from that of halves."""
    cells = rows_of("halves")
    rows = []
    for name in CHOSEN:
        errors, _, ms = cells[name]
        rotation, median, translation, _, recall = errors.split(" / ")
        rows.append([name, rotation, median, translation, recall, ms.partition(",")[0]])
    return table(["method", "rotation, mean", "median", "translation", "within 5 degrees and .05", "ms"], rows)


def seen():
    """The first page's table of single views, from that of held-out meshes."""
    cells = {name: row[0] for name, row in rows_of("heldout").items()}
    share = lambda name: int(cells[name].rpartition("/")[2])
    chosen = {
        "start": "initial",
        "the best ICP": max(("ICP to planes", "ICP to planes, trimmed"), key=share),
        "`views` alone, int8": "policy for views, int8",
        "verified without a policy": "verified without a policy",
        "`views`, int8, verified": "policy for views, int8, verified",
    }
    rows = [[name, *cells[of].split(" / ")] for name, of in chosen.items()]
    return table(["% of poses", "within .10 diameters", ".05", ".02"], rows)


REPEATED = [first, seen]
TABLES = [builtin, halves, scans, views, heldout, tracking, verdict, sweeps, steps, int8, protocol, seeds, design, tried]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, nargs="?")
    parser.add_argument("--views", type=Path, help="without it there is no table of views")
    parser.add_argument("--meshes", type=Path, help="without it there is no table of held-out meshes")
    parser.add_argument("--runs", type=Path, default=Path("runs"))
    parser.add_argument("--threads", type=int, default=1, help="where times are not measured")
    parser.add_argument("--only", nargs="+", choices=[t.__name__ for t in TABLES])
    parser.add_argument("--check", action="store_true", help="measure nothing; fail where the first page says something else")
    args = parser.parse_args()
    if args.check:
        for make in REPEATED:
            if between(FIRST, make.__name__)[1] != make():
                parser.error(f"the table {make.__name__} of README.md repeats other numbers than tests/MEASURED.md has")
        return
    if not HOST.exists():
        parser.error("target/release/host-train is not there: cargo build --release --locked")
    chosen = [make for make in TABLES if not args.only or make.__name__ in args.only]
    if not args.only:
        missing = {views: args.views, tracking: args.views, heldout: args.meshes}
        chosen = [make for make in chosen if missing.get(make, True)]
    if args.data is None and any(make not in (builtin, views, heldout, tracking) for make in chosen):
        parser.error("give DIR, the collection")
    for make in chosen:
        page = TRIED_PAGE if make == tried else MEASURED
        before, _, after = between(page, make.__name__)
        text = make(args)
        page.write_text(before + "\n" + text + "\n" + after)
        print(text, flush=True)
    for make in REPEATED:
        before, _, after = between(FIRST, make.__name__)
        FIRST.write_text(before + make() + after)


if __name__ == "__main__":
    main()
