#!/usr/bin/env python3
"""Makes part.ply, scan.ply and the picture of the first page; needs `cargo build --release -p host-train`.

part.ply is a built-in shape, a bracket of 228 mm. scan.ply is what a scanner sees of it: 800 points of its surface with
0.3 mm of noise, the part turned by 40 degrees and moved by 65 mm. The picture shows their registration.
"""

import json
import math
import random
import struct
import subprocess
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent.parent
HOST = ROOT / "target/release/host-train"
POINTS, NOISE_MM, ANGLE, AXIS, MOVED = 800, 0.3, math.radians(40), (1, 2, 3), (30, -20, 55)


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def read_mesh(path):
    head, body = path.read_bytes().split(b"end_header\n", 1)
    count = lambda what: int(head.decode().split(f"element {what} ")[1].split()[0])
    vertices = [struct.unpack_from("<3f", body, 12 * i) for i in range(count("vertex"))]
    faces = [struct.unpack_from("<3i", body, 12 * len(vertices) + 13 * i + 1) for i in range(count("face"))]
    return vertices, faces


def sample(vertices, faces, rng):
    """Points drawn evenly from the surface."""
    sides = lambda face: [[b - a for a, b in zip(vertices[face[0]], vertices[k])] for k in face[1:]]
    area = lambda face: math.hypot(*cross(*sides(face)))
    for face in rng.choices(faces, [area(face) for face in faces], k=POINTS):
        s, t = rng.random(), rng.random()
        s, t = (s, t) if s + t < 1 else (1 - s, 1 - t)
        yield [a + s * u + t * v for a, u, v in zip(vertices[face[0]], *sides(face))]


def turn(point):
    """Rodrigues' formula."""
    axis = [x / math.hypot(*AXIS) for x in AXIS]
    along = dot(axis, point) * (1 - math.cos(ANGLE))
    return [
        math.cos(ANGLE) * p + math.sin(ANGLE) * c + along * a for p, c, a in zip(point, cross(axis, point), axis)
    ]


def write_cloud(path, points):
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    path.write_bytes(head.encode() + b"".join(struct.pack("<3f", *point) for point in points))


def moved(rows, point):
    return [dot(row[:3], point) + row[3] for row in rows]


def dots(points, centre, colour):
    """A round dot for each point, seen from above and the side."""
    marks = []
    for x, y, z in points:
        right, up = 0.8 * x + 0.6 * z, 0.9 * y - 0.26 * x + 0.35 * z
        marks.append(f"M{centre + 0.95 * right:.0f} {92 - 0.95 * up:.0f}h0")
    return f'<path d="{"".join(dict.fromkeys(marks))}" stroke="{colour}"/>'


def picture(trace, answer):
    lines = [json.loads(line) for line in trace.read_text().splitlines()]
    start, steps = lines[0]["registration"], lines[1:]
    columns = [("start", start["initial"])]
    columns += [(f"after step {n}", steps[n - 1]["target_from_source"]) for n in (1, 3)]
    columns.append(("pose given out", answer))
    drawn = []
    for k, (title, pose) in enumerate(columns):
        centre = 100 + 200 * k
        drawn.append(dots(start["target"][::6], centre, "#9aa3ab"))
        drawn.append(dots([moved(pose, point) for point in start["source"][::4]], centre, "#d4452a"))
        drawn.append(f'<text x="{centre}" y="188">{title}</text>')
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 810 200" font-family="sans-serif" font-size="14" '
        'text-anchor="middle"><rect width="810" height="200" fill="#fff"/>'
        '<g fill="none" stroke-width="2" stroke-linecap="round">'
        + "".join(mark for mark in drawn if mark.startswith("<path"))
        + '</g><g fill="#333">'
        + "".join(mark for mark in drawn if mark.startswith("<text"))
        + "</g></svg>\n"
    )


def main():
    run = lambda *words: subprocess.run([HOST, *map(str, words)], check=True, stdout=subprocess.DEVNULL)
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        run("bop-synth", "--models", "procedural", "--objects", 3, "--scenes", 1, "--images", 1, "--seed", 1, "--out", folder / "synth")
        part = folder / "synth/models_eval/obj_000003.ply"
        (HERE / "part.ply").write_bytes(part.read_bytes())
        rng = random.Random(1)
        points = [turn([x + rng.gauss(0, NOISE_MM) for x in point]) for point in sample(*read_mesh(part), rng)]
        write_cloud(HERE / "scan.ply", [[x + d for x, d in zip(point, MOVED)] for point in points])
        trace, pose = folder / "trace.jsonl", folder / "pose.json"
        run("register", HERE / "scan.ply", HERE / "part.ply", "--trace", trace, "--json", pose)
        found = json.loads(pose.read_text())["target_from_source"]
        (ROOT / ".github/registration.svg").write_text(picture(trace, found))


if __name__ == "__main__":
    main()
