#!/usr/bin/env python3
"""Random pairs of meshes as users might bring them: how many wrong poses are held right, and right ones wrong?

    python3 -m venv venv && venv/bin/pip install numpy scipy trimesh embreex
    cargo build --release -p host-train
    venv/bin/python tests/random_pairs.py MESHES --count 3000 --seed 5

MESHES is a folder of meshes, `CATEGORY/NAME.ply`, that no training and no fit of probabilities saw. Each pair is drawn from it
anew: as it is, cut, with few or repeated points, in another unit, far from the origin, with marks of invalid points, among
clutter, as a single view, mirrored, or of another object. Clouds share no point. Two in five have no start; the other starts are
up to 45 degrees and half a radius off.

A pose is right within 5 degrees and .05 radii of the truth or of what is named as undetermined, or if it cannot be told from the
truth: 4,000 points of the surface then lie within .02 diameters of it in the mean. Of a mirrored part no pose is right, unless
its image cannot be told from it. Pairs in other units and of other objects have no right pose.
"""

import argparse
import json
import subprocess
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

HOST = Path(__file__).resolve().parent.parent / "target/release/host-train"
KINDS = {
    "as it is": 3,
    "source cut": 1,
    "both cut": 1,
    "another unit": 2,
    "4 to 149 points": 1,
    "1 to 99 points, repeated": 1,
    "marks of invalid points": 1,
    "5,400 km from the origin": 1,
    "among clutter": 1,
    "single view": 2,
    "mirrored": 2,
    "another object": 2,
    "another object, cut": 1,
    "view of another object": 1,
}
# What is in these may be too little to tell.
SPARSE = ("4 to 149 points", "1 to 99 points, repeated")
UNITS = (25.4, 39.37, 100, 304.8, 1000)
FAR = np.array([5e5, 5.4e6, 100.0])
INDISTINGUISHABLE = 0.02


def load(path):
    """A mesh with its mean at the origin and a radius of 1."""
    mesh = trimesh.load(path, force="mesh", process=False)
    points = sample(mesh, 4000, np.random.default_rng(0))
    centre = points.mean(0)
    mesh.vertices = (mesh.vertices - centre) / np.linalg.norm(points - centre, axis=1).max()
    return mesh


def sample(mesh, count, rng):
    areas = np.cumsum(mesh.area_faces)
    faces = np.minimum(np.searchsorted(areas, rng.random(count) * areas[-1]), len(areas) - 1)
    a, b, c = np.moveaxis(mesh.triangles[faces], 1, 0)
    u, v = rng.random((2, count, 1))
    beyond = u + v > 1
    u, v = np.where(beyond, 1 - u, u), np.where(beyond, 1 - v, v)
    return a + u * (b - a) + v * (c - a)


def view(mesh, eye, count, rng):
    """What a camera of 90 by 90 pixels sees."""
    ahead = -eye / np.linalg.norm(eye)
    up = np.cross(ahead, [0.3, 0.8, 0.5])
    up /= np.linalg.norm(up)
    across = (np.arange(90) + 0.5) / 45 - 1
    half = np.tan(np.arcsin(min(0.98, 1.05 / np.linalg.norm(eye))))
    x, y = (grid.reshape(-1, 1) for grid in np.meshgrid(across, across))
    rays = ahead + half * (x * np.cross(ahead, up) + y * up)
    points, _, _ = mesh.ray.intersects_location(np.tile(eye, (len(rays), 1)), rays, multiple_hits=False)
    return points[rng.permutation(len(points))[:count]]


def cut(points, kept, rng):
    heights = points @ rng.normal(size=3)
    return points[heights <= np.quantile(heights, kept)]


def rigid(rotation, translation):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    return pose


def apply(pose, points):
    return points @ pose[:3, :3].T + pose[:3, 3]


def draw(kind, meshes, rng):
    """A pair, or None for a mesh that is not seen well enough."""
    of, other = rng.choice(len(meshes), 2, replace=False)
    count, target_count = int(rng.choice([500, 1000, 2000, 3000])), int(rng.choice([1000, 2000, 3000]))
    noise = float(rng.choice([0, 0.003, 0.01]))
    mesh = meshes[of]
    seen = meshes[other] if "another object" in kind else mesh
    eye = None
    if "view" in kind:
        eye = rng.normal(size=3)
        eye *= rng.uniform(2.5, 5) / np.linalg.norm(eye)
        source = view(seen, eye, min(count, 2000), rng)
        noise = min(noise, 0.003)
        if len(source) < 80:
            return None
    elif kind in SPARSE:
        source = sample(seen, int(rng.integers(4, 150) if kind == SPARSE[0] else rng.integers(1, 100)), rng)
    else:
        source = sample(seen, count, rng)
    target = sample(mesh, target_count, rng)
    if kind in ("source cut", "another object, cut"):
        source = cut(source, rng.uniform(0.5, 0.9), rng)
    if kind == "both cut":
        source, target = (cut(cloud, rng.uniform(0.65, 0.9), rng) for cloud in (source, target))
    model = np.diag([-1.0, 1.0, 1.0, 1.0]) if kind == "mirrored" else np.eye(4)
    source = apply(model, source)
    source, target = (cloud + rng.normal(size=cloud.shape) * noise for cloud in (source, target))
    if kind == SPARSE[1]:
        source = source[rng.integers(len(source), size=800)]
    if kind == "among clutter":
        clutter = rng.uniform(-1.2, 1.2, size=(int(len(source) * rng.uniform(0.1, 0.35)), 3))
        source = np.vstack([source, clutter])

    has_start = rng.random() < 0.6
    size, shift = np.exp(rng.uniform(-3, 4)), rng.normal(size=3)
    if has_start:
        turn = Rotation.from_rotvec(np.radians(rng.uniform(0, 45)) * unit(rng)).as_matrix()
        shift *= rng.uniform(0, 0.5) / np.linalg.norm(shift)
    else:
        turn, shift = Rotation.random(random_state=int(rng.integers(1 << 31))).as_matrix(), 3 * shift
    middle = 2 * size * rng.normal(size=3)
    source_from_model = rigid(size * turn, middle + size * shift)
    target_from_model = rigid(size * np.eye(3), middle)
    scale = 1.0
    if kind == "another unit":
        scale = float(rng.choice(UNITS)) ** rng.choice([-1, 1])
    if kind == "5,400 km from the origin":
        for pose in (source_from_model, target_from_model):
            pose[:3, 3] += FAR
    source, target = scale * apply(source_from_model, source), apply(target_from_model, target)
    if kind == "marks of invalid points":
        source = mark(source, rng)
    shows_eye = eye is not None and rng.random() < 0.6
    return {
        "kind": kind,
        "has_start": bool(has_start),
        "clouds": (source, target),
        "eye": apply(source_from_model, eye) if shows_eye else None,
        "mesh": mesh,
        "size": size,
        "source_from_model": source_from_model @ model,
        "target_from_model": target_from_model,
        "has_truth": scale == 1 and seen is mesh,
    }


def unit(rng):
    direction = rng.normal(size=3)
    return direction / np.linalg.norm(direction)


def mark(source, rng):
    source = source.copy()
    kind = rng.integers(4)
    if kind == 0:
        source[rng.integers(len(source))] = 3.4e38
    elif kind == 1:
        source[rng.integers(len(source), size=20)] = np.nan
    elif kind == 2:
        source = np.vstack([source, np.zeros((len(source) // 5, 3))])
    else:
        source[rng.integers(len(source), size=5)] = 1e15
    return source


def register(pairs, folder):
    """The answers to all pairs, in order."""
    answers = [None] * len(pairs)
    for has_start in (True, False):
        lines, places = [], []
        for place, pair in enumerate(pairs):
            if pair["has_start"] != has_start:
                continue
            names = [f"{place}_source.npy", f"{place}_target.npy"]
            for name, cloud in zip(names, pair["clouds"]):
                np.save(folder / name, cloud)
            eye = [] if pair["eye"] is None else [f"{x:.9g}" for x in pair["eye"]]
            lines.append("\t".join(names + eye))
            places.append(place)
        if not places:
            continue
        (folder / "list").write_text("\n".join(lines) + "\n")
        start = [] if has_start else ["--init", "none"]
        # Its exit status says that some pairs have no pose, such as those of one point.
        subprocess.run(
            [HOST, "register", "--pairs", folder / "list", *start, "--json", folder / "answers"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )
        answered = map(json.loads, (folder / "answers").read_text().splitlines())
        for place, answer in zip(places, answered, strict=True):
            answers[place] = answer
    return answers


def turned(pose, axis, angle):
    point = np.array(axis["point"])
    turn = Rotation.from_rotvec(angle * np.array(axis["direction"])).as_matrix()
    return rigid(turn, point - turn @ point) @ pose


def named(answer, truth, at):
    """The pose given out and those that are named as fitting as well; `at` is where the model's centre is in the source."""
    opened = answer.get("undetermined") or {}
    poses = [full(pose) for pose in (answer["target_from_source"], *opened.get("poses", ()))]
    if fold := opened.get("fold"):
        turns = 2 * np.pi * np.arange(1, fold["order"]) / fold["order"]
        poses += [turned(pose, fold, turn) for pose in poses for turn in turns]
    if axis := opened.get("axis"):
        least, most = np.radians(axis["range_deg"])
        turns = np.linspace(least, most, max(2, int(np.degrees(most - least)) + 1))
        poses += [turned(pose, axis, turn) for pose in poses for turn in turns]
    if opened.get("any_rotation"):
        given = poses[0]
        rotation = truth[:3, :3]
        poses.append(rigid(rotation, apply(given, at) - rotation @ at))
    if slide := opened.get("slide"):
        direction, (least, most) = np.array(slide["direction"]), slide["range"]
        for pose in list(poses):
            along = np.clip((apply(truth, at) - apply(pose, at)) @ direction, least, most)
            poses.append(rigid(np.eye(3), along * direction) @ pose)
    return poses


def full(pose):
    """A pose as a 4x4 matrix."""
    return np.vstack([np.array(pose)[:3], [0, 0, 0, 1]])


def is_near(pose, truth, at, size=1.0):
    """Whether a pose is within 5 degrees and .05 radii of the truth; `at` is where the model's centre is in the source."""
    turn = Rotation.from_matrix(pose[:3, :3] @ truth[:3, :3].T).magnitude()
    return np.degrees(turn) <= 5 and np.linalg.norm(apply(pose, at) - apply(truth, at)) <= 0.05 * size


def is_right(pair, answer):
    if not pair["has_truth"]:
        return False
    truth = pair["target_from_model"] @ np.linalg.inv(pair["source_from_model"])
    at = pair["source_from_model"][:3, 3]
    poses = named(answer, truth, at) if pair["kind"] != "mirrored" else []
    return any(is_near(pose, truth, at, pair["size"]) for pose in poses) or off_surface(pair, np.array(answer["target_from_source"])) < INDISTINGUISHABLE


def off_surface(pair, pose):
    """How far the model lies off the target's surface under a pose, in diameters, less what sampling causes."""
    rng = np.random.default_rng(5)
    surface, points = cKDTree(sample(pair["mesh"], 40_000, rng)), sample(pair["mesh"], 4000, rng)
    moved = apply(pose, apply(pair["source_from_model"], points))
    back = (moved - pair["target_from_model"][:3, 3]) / pair["size"]
    return (surface.query(back)[0].mean() - surface.query(points)[0].mean()) / 2


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", type=Path)
    parser.add_argument("--count", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=5)
    args = parser.parse_args()
    meshes = [load(path) for path in sorted(args.meshes.rglob("*.ply"))]
    kinds = [kind for kind, share in KINDS.items() for _ in range(share)]
    pairs = []
    while len(pairs) < args.count:
        rng = np.random.default_rng([args.seed, len(pairs)])
        drawn = None
        while drawn is None:
            drawn = draw(kinds[len(pairs) % len(kinds)], meshes, rng)
        pairs.append(drawn)
    with tempfile.TemporaryDirectory() as folder:
        answers = register(pairs, Path(folder))

    counts = Counter()
    for pair, answer in zip(pairs, answers):
        kind = pair["kind"]
        if "error" in answer:
            counts[kind, "refused"] += 1
            continue
        truth = "right" if is_right(pair, answer) else "wrong"
        counts[kind, truth] += 1
        counts[kind, truth, answer["verdict"]] += 1
    print("| pairs | right poses | of these held right | wrong poses | of these held right | mirrored | no pose |")
    print("| --- | --- | --- | --- | --- | --- | --- |")

    def row(name, kinds):
        total = lambda *key: sum(counts[(kind, *key)] for kind in kinds)
        mirrored = total("right", "mirrored") + total("wrong", "mirrored")
        held = [total(truth, "converged") for truth in ("right", "wrong")]
        numbers = [total("right"), held[0], total("wrong"), held[1], mirrored, total("refused")]
        print(f"| {name} | " + " | ".join(str(number or "") for number in numbers) + " |")

    for kind in KINDS:
        row(kind, [kind])
    row("all", KINDS)
    row("all without few points and mirrored ones", [kind for kind in KINDS if kind not in (*SPARSE, "mirrored")])


if __name__ == "__main__":
    main()
