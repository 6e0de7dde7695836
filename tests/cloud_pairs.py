#!/usr/bin/env python3
"""Pairs of test clouds under conditions that robots meet: what verification finds, and what it is told to be.

    python3 -m venv venv && venv/bin/pip install numpy scipy trimesh h5py
    cargo build --release -p host-train
    venv/bin/python tests/cloud_pairs.py DIR

DIR is a collection in ModelNet40's layout. From each of its test clouds (2048 points and normals, in units of the radius) four
pairs are drawn, with noise of .01 on each coordinate, starts up to 45 degrees about each axis and .5 radii along each off:

- no shared point: one half of the points against the other;
- both cropped: the same, each half cut to 70 % by a random plane of its own;
- cluttered view: of one half, the points that face a camera four radii away; 15 % of them are replaced by a plane beneath
  and a neighbour beside. The camera's place is given;
- any rotation: as the first, turned at random, without a start.

"Right" is within 5 degrees and .05 radii of the truth. "Right up to what is named": or of a pose, turn or shift that the answer says to fit as well.
ADI is the mean distance of the cloud's points under the pose from the nearest one under the truth. The truth fits better if its
points lie nearer, by the mean of d² / (d² + .02²) over both clouds and both ways.
"""

import argparse
import tempfile
from pathlib import Path

import h5py
import numpy as np
from random_pairs import apply, cut, full, is_near, named, register, rigid, unit
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

NOISE = 0.01
KEPT = 0.7
CLUTTER = 0.15
EYE = 4.0
SCALE = 0.02


def noisy(points, rng):
    return points + np.clip(rng.normal(size=points.shape) * NOISE, -0.05, 0.05)


def draw(kind, cloud, normals, neighbour, rng):
    """Source in the model's frame, target, the camera's place or None, and the pose of the source."""
    order = rng.permutation(len(cloud))
    one, other = order[: len(order) // 2], order[len(order) // 2 :]
    source, target, eye = cloud[one], cloud[other], None
    if kind == "both cropped":
        source, target = cut(source, KEPT, rng), cut(target, KEPT, rng)
    if kind == "cluttered view":
        eye = EYE * unit(rng)
        seen = np.einsum("ij,ij->i", normals[one], eye - source) > 0
        source = source[seen]
        count = int(CLUTTER * len(source) / (1 - CLUTTER))
        lowest = cloud[:, 2].min()
        plane = np.column_stack([rng.uniform(-1.2, 1.2, size=(count // 2, 2)), np.full(count // 2, lowest)])
        beside = neighbour[rng.permutation(len(neighbour))[: count - len(plane)]] * 0.7
        aside = unit(rng) * [1, 1, 0]
        source = np.vstack([source, plane, beside + 1.5 * aside / np.linalg.norm(aside)])
    if kind == "any rotation":
        turn = Rotation.random(random_state=int(rng.integers(1 << 31))).as_matrix()
    else:
        turn = Rotation.from_euler("XYZ", rng.uniform(0, 45, 3), degrees=True).as_matrix()
    pose = rigid(turn, rng.uniform(-0.5, 0.5, 3))
    return noisy(source, rng), noisy(target, rng), eye, pose


KINDS = ("no shared point", "both cropped", "cluttered view", "any rotation")


def loss(source, target, pose):
    """How far apart two clouds are under a pose, both ways."""
    moved = apply(pose, source)
    squares = [cKDTree(b).query(a)[0] ** 2 for a, b in ((moved, target), (target, moved))]
    return np.mean([np.mean(d / (d + SCALE**2)) for d in squares])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--seed", type=int, default=5)
    args = parser.parse_args()
    clouds, normals = [], []
    for path in sorted(args.data.glob("ply_data_test*.h5")):
        with h5py.File(path) as file:
            clouds.append(file["data"][:].astype(float))
            normals.append(file["normal"][:].astype(float))
    clouds, normals = np.concatenate(clouds), np.concatenate(normals)
    chosen = np.random.default_rng(args.seed).permutation(len(clouds))[: args.count]

    print("| pairs | right | right up to what is named | ADI below .02 diameters | below .05 | wrong though the truth fits better | wrong, called right |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for number, kind in enumerate(KINDS):
        pairs = []
        for place in chosen:
            rng = np.random.default_rng([args.seed, number, int(place)])
            neighbour = clouds[int(rng.integers(len(clouds)))]
            pairs.append((clouds[place], *draw(kind, clouds[place], normals[place], neighbour, rng)))
        has_start = kind != "any rotation"
        asked = [
            {
                "has_start": has_start,
                "clouds": (apply(pose, source), target),
                "eye": None if eye is None else apply(pose, eye),
            }
            for _, source, target, eye, pose in pairs
        ]
        with tempfile.TemporaryDirectory() as folder:
            answers = register(asked, Path(folder))
        counts = np.zeros(6)
        for (cloud, source, target, _, pose), answer in zip(pairs, answers, strict=True):
            truth = np.linalg.inv(pose)
            found = full(answer["target_from_source"])
            at = pose[:3, 3]
            right = is_near(found, truth, at)
            up_to = any(is_near(one, truth, at) for one in named(answer, truth, at))
            diameter = 2 * np.linalg.norm(cloud - cloud.mean(0), axis=1).max()
            adi = cKDTree(cloud).query(apply(found, apply(pose, cloud)))[0].mean() / diameter
            wrong = not up_to and adi >= 0.02
            moved = apply(pose, source)
            better = wrong and loss(moved, target, truth) < loss(moved, target, found)
            counts += [right, up_to, adi < 0.02, adi < 0.05, better, wrong and answer["verdict"] == "converged"]
        shares = [f"{100 * count / len(pairs):.1f}" for count in counts]
        print(f"| {kind} | " + " | ".join(shares) + " |", flush=True)


if __name__ == "__main__":
    main()
