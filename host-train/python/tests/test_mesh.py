"""Meshes where clouds go."""

import json

import numpy
import pytest
from conftest import apart, pose

import reagent

SIZE = numpy.array([1.6, 1.0, 0.06])
CORNERS = (numpy.array(list(numpy.ndindex(2, 2, 2)))[:, ::-1] - 0.5) * SIZE
SIDES = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
FACES = numpy.array([face for a, b, c, d in SIDES for face in [(a, b, c), (a, c, d)]])
# The plate's upper side, as a sensor above sees it.
SEEN = numpy.random.default_rng(3).uniform(-0.49, 0.49, (600, 3)) * [1.6, 1.0, 0] + [0, 0, 0.03]
NEARER_THE_LOWER = pose(1, 0, (0, 0, -0.05))


def write_obj(path, vertices, faces):
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces.tolist()]
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("turned", [False, True])
def test_the_side_that_was_seen(turned):
    mesh = reagent.Mesh(CORNERS, FACES[:, ::-1] if turned else FACES)
    found = reagent.refine(SEEN, mesh, NEARER_THE_LOWER, (0, 0, 4), dense="never")
    assert abs(found.target_from_source[2, 3]) < 0.006
    tracker = reagent.Tracker(mesh, NEARER_THE_LOWER, viewpoint=(0, 0, 4))
    followed = [tracker.follow(SEEN) for _ in range(3)]
    assert all(abs(found.target_from_source[2, 3]) < 0.006 for found in followed)
    # Without a piece of a narrow side it encloses nothing, but looks alike from outside.
    for dense in ["never", "always"]:
        found = reagent.refine(SEEN, reagent.Mesh(CORNERS, FACES[1:]), NEARER_THE_LOWER, (0, 0, 4), dense=dense)
        assert abs(found.target_from_source[2, 3]) < 0.006


def test_the_numbers_of_the_command_line(command_line, tmp_path):
    write_obj(tmp_path / "plate.obj", CORNERS, FACES)
    numpy.save(tmp_path / "seen.npy", SEEN)
    for options, arguments in [({}, []), ({"viewpoint": (0, 0, 4)}, ["--view", "0,0,4"])]:
        command_line(tmp_path, "register", "seen.npy", "plate.obj", "--json", "found.json", *arguments)
        theirs = json.loads((tmp_path / "found.json").read_text())
        ours = reagent.register(SEEN, reagent.Mesh(CORNERS, FACES), **options).to_dict()
        assert ours["target_from_source"] == theirs["target_from_source"]
        assert ours["probability"] == pytest.approx(theirs["probability"]) and ours["notes"] == theirs["notes"]
    command_line(tmp_path, "register", "plate.obj", "plate.obj", "--json", "found.json")
    theirs = json.loads((tmp_path / "found.json").read_text())
    mesh = reagent.Mesh(CORNERS, FACES)
    both = reagent.register_batch(mesh, [mesh])
    assert both[0].to_dict()["target_from_source"] == theirs["target_from_source"]
    assert apart(both[0].target_from_source, numpy.eye(4))[1] < 0.1


@pytest.mark.parametrize(
    ("vertices", "faces", "said"),
    [
        (CORNERS, [[0, 1, 8]], "mesh: face 0 names vertex 8"),
        (CORNERS, [[0, 1, -1]], "faces: expected numbers of vertices, found -1"),
        (CORNERS, [[0, 1, 0.5]], "faces: expected numbers of vertices, found 0.5"),
        (CORNERS, [[0, 1, 2, 3]], r"faces: expected an array of integers of shape \(F, 3\), found shape \[1, 4\]"),
        (CORNERS[:, :2], FACES, r"vertices: expected an array of float32 or float64 of shape \(N, 3\)"),
        (CORNERS * numpy.nan, FACES, "mesh: no points but 8 invalid ones"),
    ],
)
def test_refusals(vertices, faces, said):
    with pytest.raises(reagent.Error, match=said):
        reagent.Mesh(vertices, faces)


def test_a_mesh_without_area_is_refused_by_the_arguments_name():
    flat = reagent.Mesh(CORNERS, numpy.zeros((0, 3), int))
    with pytest.raises(reagent.CloudError, match="target: "):
        reagent.register(SEEN, flat)
    with pytest.raises(reagent.CloudError, match="sources"):
        reagent.evaluate(numpy.eye(4)[None], numpy.eye(4)[None], [flat], [SEEN])
