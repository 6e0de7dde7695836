"""The same numbers as the command line, bit by bit."""

import json

import numpy
import pytest
from conftest import ROOT, bracket, moved, pose

import reagent

POLICIES = [None, "reagent", "int8", "compact", "views", "views-compact"]
SOURCE, TARGET = bracket(1, 900), moved(pose(), bracket(2, 1000))
FAR = numpy.array([483221.0, 5456871.0, 310.0])
START = pose(0.8, 0.6, (0.3, 0.1, -0.2))
FLIPPED = numpy.diag([1.0, -1.0, -1.0, 1.0])


def rows(matrix):
    return ",".join(map(repr, matrix[:3].ravel().tolist()))


CASES = {
    "float64": (SOURCE, TARGET, {}, []),
    "float32": (SOURCE.astype("f4"), TARGET.astype("f4"), {}, []),
    "fortran": (numpy.asfortranarray(SOURCE), TARGET, {}, []),
    "far": (SOURCE + FAR, TARGET + FAR, {}, []),
    "large": (bracket(3, 6000), bracket(4, 5000), {}, []),
    "with NaN": (numpy.insert(SOURCE, 5, numpy.nan, axis=0), TARGET, {}, []),
    "fast": (SOURCE, TARGET, {"mode": "fast", "steps": 7}, ["--mode", "fast", "--steps", 7]),
    "polish": (SOURCE, TARGET, {"mode": "polish"}, ["--mode", "polish"]),
    "refine": (SOURCE, TARGET, {"mode": "refine", "init": START}, ["--mode", "refine", "--init", rows(START)]),
    "start": (SOURCE, TARGET, {"init": START[:3]}, ["--init", rows(START)]),
    "anywhere": (SOURCE, TARGET, {"init": "anywhere"}, ["--init", "none"]),
    "view": (SOURCE[SOURCE[:, 2] > 0.2], TARGET, {"viewpoint": [0.5, 0, 9]}, ["--view", "0.5,0,9"]),
    "starts": (SOURCE, TARGET, {"init": [FLIPPED, START]}, ["--init", rows(FLIPPED), "--init", rows(START)]),
    "words among starts": (
        SOURCE,
        TARGET,
        {"init": ["identity", FLIPPED], "mode": "refine"},
        ["--mode", "refine", "--init", "identity", "--init", rows(FLIPPED)],
    ),
    "best": (SOURCE, TARGET, {"best": 3}, ["--best", 3]),
    "points": (SOURCE, TARGET, {"points": 256, "dense": "always"}, ["--points", 256, "--dense", "always"]),
}


def same(ours, theirs, path=""):
    """JSON has the shortest digits of single precision; poses have all of double precision."""
    if isinstance(theirs, dict):
        assert ours.keys() == theirs.keys(), path
        for key in theirs.keys() - {"ms"}:
            same(ours[key], theirs[key], f"{path}.{key}")
    elif isinstance(theirs, list):
        assert len(ours) == len(theirs), path
        for i, (one, other) in enumerate(zip(ours, theirs)):
            same(one, other, f"{path}[{i}]")
    elif isinstance(theirs, float) and "target_from_source" not in path:
        assert ours == theirs or numpy.float32(ours) == numpy.float32(theirs), path
    else:
        assert ours == theirs, path


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("case", CASES)
def test_registrations(command_line, tmp_path, policy, case):
    source, target, options, arguments = CASES[case]
    numpy.save(tmp_path / "source.npy", source)
    numpy.save(tmp_path / "target.npy", target)
    if policy:
        file = ROOT / "core/weights/reagent-int8.rgw" if policy == "int8" else policy
        # Refinement alone takes no policy.
        if options.get("mode") != "refine":
            arguments = [*arguments, "--weights", file]
    command_line(tmp_path, "register", "source.npy", "target.npy", "--json", "found.json", *arguments)
    theirs = json.loads((tmp_path / "found.json").read_text())
    registrar = reagent.Registrar(reagent.Policy.pretrained(policy)) if policy else reagent
    same(registrar.register(source, target, **options).to_dict(), theirs)


def test_steps(command_line, tmp_path):
    numpy.save(tmp_path / "source.npy", SOURCE)
    numpy.save(tmp_path / "target.npy", TARGET)
    command_line(tmp_path, "register", "source.npy", "target.npy", "--trace", "steps.jsonl")
    lines = map(json.loads, (tmp_path / "steps.jsonl").read_text().splitlines())
    theirs = [line for line in lines if "step" in line]
    ours = reagent.register(SOURCE, TARGET).steps
    assert len(ours) == len(theirs)
    for one, other in zip(ours, theirs):
        assert one.number == other["step"] and list(one.translation_id) == other["translation_id"]
        assert list(one.rotation_id) == other["rotation_id"]
        for name in ["translation", "rotation_rad", "translation_probability", "rotation_probability"]:
            assert (getattr(one, name).astype("f4") == numpy.array(other[name], "f4")).all(), name
        numpy.testing.assert_allclose(one.target_from_source[:3], other["target_from_source"], atol=1e-6)


def test_refusals_have_the_same_words(tmp_path):
    with pytest.raises(reagent.CloudError, match="source: no points but 1 invalid one "):
        reagent.register(numpy.full((1, 3), numpy.nan), TARGET)


def test_evaluation(command_line, tmp_path):
    h5py = pytest.importorskip("h5py")
    arguments = ["--data", "procedural", "--protocol", "m40-models", "--count", 5, "--out", "pairs.h5"]
    command_line(tmp_path, "pairs", *arguments)
    arguments = ["--pairs", "pairs.h5", "--methods", "icp,init", "--poses", "poses.h5", "--json", "errors.json"]
    command_line(tmp_path, "eval", *arguments)
    theirs = json.loads((tmp_path / "errors.json").read_text())["methods"]
    with h5py.File(tmp_path / "pairs.h5") as pairs, h5py.File(tmp_path / "poses.h5") as poses:
        clouds = (pairs["source"][:], pairs["target"][:])
        raw = pairs["raw"][:] if "raw" in pairs else None
        for method, expected in theirs.items():
            ours = reagent.evaluate(poses[method][:], pairs["transform_gt"][:], *clouds, raw=raw)
            assert ours.pop("pairs") == 5
            for key, value in ours.items():
                assert value == expected[key], (method, key)
