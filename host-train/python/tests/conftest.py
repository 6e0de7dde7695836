"""Clouds of built-in shapes, and the command line where it is built."""

import pathlib
import subprocess

import numpy
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[3]
# Corners of the boxes that a bracket is made of.
BOXES = [((-2, -1, 0), (2, 1, 0.3)), ((-2, -1, 0), (-1.6, 1, 2)), ((0.5, -0.2, 0), (1.5, 0.6, 0.9))]


def bracket(seed, count):
    """Points of a bracket's surface: (count, 3), float64, the same on every machine."""
    rng = numpy.random.default_rng(seed)
    low, high = numpy.array(BOXES, float).transpose(1, 0, 2)
    box = rng.integers(len(BOXES), size=count)
    points = low[box] + rng.random((count, 3)) * (high - low)[box]
    axis = rng.integers(3, size=count)
    side = numpy.where(rng.random(count) < 0.5, low[box, axis], high[box, axis])
    points[numpy.arange(count), axis] = side
    return points


def pose(cosine=0.96, sine=0.28, translation=(0.1, -0.2, 0.05)):
    """A turn about z, and a shift: (4, 4), float64."""
    matrix = numpy.eye(4)
    matrix[:2, :2] = [[cosine, -sine], [sine, cosine]]
    matrix[:3, 3] = translation
    return matrix


def moved(matrix, points):
    """The points after a rigid transform."""
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def apart(matrix, truth):
    """How far two poses are apart: degrees, units of length."""
    turn = matrix[:3, :3].T @ truth[:3, :3]
    angle = numpy.degrees(numpy.arccos(numpy.clip((numpy.trace(turn) - 1) / 2, -1, 1)))
    return angle, numpy.linalg.norm(matrix[:3, 3] - truth[:3, 3])


@pytest.fixture(scope="session")
def pair():
    """Two samples of one bracket, and the true pose between them."""
    truth = pose()
    return bracket(1, 900), moved(truth, bracket(2, 1000)), truth


@pytest.fixture(scope="session")
def command_line():
    """Runs host-train in a folder."""
    program = ROOT / "target/release/host-train"
    if not program.exists():
        pytest.skip(f"{program} is not built: cargo build --release -p host-train")

    def run(folder, *arguments):
        done = subprocess.run(
            [program, *map(str, arguments)], cwd=folder, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run
