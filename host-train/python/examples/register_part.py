"""Registers two samples of a part, prints what can be said about the pose, and draws the clouds before and after.

python register_part.py [PICTURE.png]    # the picture needs matplotlib
"""

import sys

import numpy

import reagent


def part(rng, count):
    """Points of the surface of an L-shaped part with a foot on one side."""
    boxes = numpy.array([[(0, 0, 0), (4, 2, 0.3)], [(0, 0, 0), (0.4, 2, 2)], [(2.5, 0.8, 0), (3.5, 1.6, 0.9)]])
    low, high = boxes[rng.integers(len(boxes), size=count)].transpose(1, 0, 2)
    points = low + rng.random((count, 3)) * (high - low)
    rows, axis = numpy.arange(count), rng.integers(3, size=count)
    points[rows, axis] = numpy.where(rng.random(count) < 0.5, low[rows, axis], high[rows, axis])
    return points


def draw(source, target, found, path):
    """The clouds as they lie, after the policy's steps, and under the pose given out."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 3, figsize=(12, 4), subplot_kw={"projection": "3d"})
    poses = {"as they lie": numpy.eye(4)}
    if found.steps:
        poses[f"after {len(found.steps)} steps"] = found.steps[-1].target_from_source
    poses[f"{found.verdict}, {100 * found.probability:.1f} %"] = found.target_from_source
    for axis, (title, pose) in zip(axes, poses.items()):
        moved = source @ pose[:3, :3].T + pose[:3, 3]
        axis.scatter(*target.T, s=2, color="tab:grey")
        axis.scatter(*moved.T, s=2, color="tab:orange")
        axis.set_title(title)
        axis.set_aspect("equal")
    figure.savefig(path)


def main(picture=None):
    rng = numpy.random.default_rng(1)
    target = part(rng, 1024)
    turn = numpy.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
    source = (part(rng, 1024) - [0.3, -0.2, 0.1]) @ turn + rng.normal(scale=0.01, size=(1024, 3))
    found = reagent.register(source, target)
    print(found)
    print(found.target_from_source.round(3))
    for step in found.steps:
        certain = step.rotation_probability.max(axis=1)
        print(f"step {step.number}: turn {numpy.degrees(step.rotation_rad).round(1)} degrees, held {certain.round(2)} likely")
    if found.undetermined:
        print("the shape leaves open:", found.undetermined)
    if picture:
        try:
            draw(source, target, found, picture)
        except ImportError:
            print("no picture without matplotlib: pip install matplotlib")
    return found


if __name__ == "__main__":
    main(*sys.argv[1:2])
