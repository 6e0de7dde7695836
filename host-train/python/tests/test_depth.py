"""Depth images as sources."""

import numpy
import pytest
from conftest import BOXES, bracket, moved

import reagent

CAMERA = (200, 210, 79.5, 59.5)
SHAPE = (120, 160)
GOOD = bracket(1, 100)


def rays():
    """Directions of the pixels, to depth 1: (rows, columns, 3)."""
    v, u = numpy.indices(SHAPE)
    fx, fy, cx, cy = CAMERA
    return numpy.stack([(u - cx) / fx, (v - cy) / fy, numpy.ones(SHAPE)], axis=-1)


def render(camera_from_model):
    """Depths of the bracket: where rays enter its boxes; 0 beside it."""
    turn, shift = camera_from_model[:3, :3], camera_from_model[:3, 3]
    eye, ahead = -turn.T @ shift, rays() @ turn
    nearest = numpy.full(SHAPE, numpy.inf)
    for low, high in numpy.array(BOXES, float):
        with numpy.errstate(divide="ignore"):
            crossed = numpy.sort(numpy.stack([(low - eye) / ahead, (high - eye) / ahead]), axis=0)
        enters, leaves = crossed[0].max(axis=-1), crossed[1].min(axis=-1)
        nearest = numpy.where(enters < leaves, numpy.minimum(nearest, enters), nearest)
    return numpy.where(numpy.isfinite(nearest), nearest, 0)


def view():
    """A turn about the axes by half a radian and more, eight units ahead."""
    a, b = 2.3, 0.6
    about_x = numpy.array([[1, 0, 0], [0, numpy.cos(a), -numpy.sin(a)], [0, numpy.sin(a), numpy.cos(a)]])
    about_z = numpy.array([[numpy.cos(b), -numpy.sin(b), 0], [numpy.sin(b), numpy.cos(b), 0], [0, 0, 1]])
    matrix = numpy.eye(4)
    matrix[:3, :3], matrix[:3, 3] = about_x @ about_z, (0.3, -0.2, 8)
    return matrix


def test_points_lie_on_rays():
    depth = render(view())
    points = reagent.points_of_depth(depth, CAMERA, depth_scale=0.5)
    assert points.dtype == numpy.float64 and len(points) == (depth > 0).sum() > 1000
    numpy.testing.assert_allclose(points, 0.5 * (depth[..., None] * rays())[depth > 0], rtol=1e-6)
    matrix = [[200, 0, 79.5], [0, 210, 59.5], [0, 0, 1]]
    numpy.testing.assert_array_equal(points, reagent.points_of_depth(depth, matrix, depth_scale=0.5))


def test_what_was_not_measured_is_left_out():
    depth = numpy.array([[1, numpy.nan, 0], [-1, numpy.inf, 2]])
    for given in [depth, depth.astype(numpy.float32), depth.T.copy().T]:
        assert reagent.points_of_depth(given, CAMERA)[:, 2].tolist() == [1, 2]
    marked = numpy.array([[65535, 7, 0]], numpy.uint16)
    assert reagent.points_of_depth(marked, CAMERA)[:, 2].tolist() == [7]
    assert reagent.points_of_depth(marked.astype(float), CAMERA)[:, 2].tolist() == [65535, 7]
    assert reagent.points_of_depth(memoryview(marked), CAMERA)[:, 2].tolist() == [7]
    hidden = numpy.ma.masked_array([[5, 6]], mask=[[True, False]])
    assert reagent.points_of_depth(hidden, CAMERA)[:, 2].tolist() == [6]
    for mask in [[[True, False]], numpy.uint8([[255, 0]])]:
        assert reagent.points_of_depth([[5, 6]], CAMERA, mask)[:, 2].tolist() == [5]


def test_a_view_is_registered():
    truth = numpy.linalg.inv(view())
    depth = (1000 * render(view())).round().astype(numpy.uint16)
    wall = numpy.where(depth > 0, depth, 12000).astype(numpy.uint16)
    points = reagent.points_of_depth(wall, CAMERA, depth > 0, depth_scale=0.001)
    start = truth.copy()
    start[:3, 3] += (0.2, -0.1, 0.1)
    target = bracket(3, 2000)
    for found in [
        reagent.register(points, target, start, viewpoint=(0, 0, 0)),
        reagent.register_depth(wall, CAMERA, target, start, mask=depth > 0, depth_scale=0.001),
    ]:
        assert found.converged
        numpy.testing.assert_allclose(moved(found.target_from_source, points), moved(truth, points), atol=0.1)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((numpy.ones((2, 3)), CAMERA, numpy.ones((3, 2))), "mask: 2 x 3 pixels, but the depth image depth has 3 x 2"),
        ((numpy.ones((2, 3)), CAMERA, numpy.zeros((2, 3))), "mask: no pixel shows the object"),
        ((numpy.zeros((2, 3)), CAMERA), "depth: none of the object's 6 pixels has a depth"),
        ((numpy.ones((2, 3, 3)), CAMERA), r"depth: expected an array of shape \(rows, columns\), found shape"),
        ((numpy.ones((2, 3), numpy.uint8), CAMERA), "depth: .*16 bits or more"),
        (("depth.png", CAMERA), "depth: .*numpy.asarray says"),
        ((numpy.ones((2, 3)), (0, 200, 1, 1)), "camera: focal lengths are positive"),
        ((numpy.ones((2, 3)), (200, numpy.nan, 1, 1)), "camera: focal lengths are positive"),
        ((numpy.ones((2, 3)), (200, 200, 1)), r"camera: .*found shape \[3\]"),
        ((numpy.ones((2, 3)), numpy.ones((3, 3))), "camera: K has the rows"),
    ],
)
def test_what_is_no_depth_image_is_refused(arguments, said):
    with pytest.raises(reagent.Error, match=said):
        reagent.points_of_depth(*arguments)
    depth, camera, *mask = arguments
    with pytest.raises(reagent.Error, match=said):
        reagent.register_depth(depth, camera, GOOD, mask=mask[0] if mask else None)


def test_other_arguments_are_those_of_register():
    image = (numpy.ones((9, 9)), CAMERA)
    with pytest.raises(reagent.CloudError, match="target: "):
        reagent.register_depth(*image, GOOD[:, :2])
    with pytest.raises(reagent.CloudError, match="depth: the cloud has 2 point"):
        reagent.register_depth(numpy.eye(2), CAMERA, GOOD)
    with pytest.raises(reagent.Error, match="init: "):
        reagent.register_depth(*image, GOOD, "somewhere")


@pytest.mark.parametrize("scale", [0, -1, numpy.nan, numpy.inf, "mm"])
def test_scales_are_positive(scale):
    with pytest.raises(reagent.Error, match="depth_scale: expected a positive number"):
        reagent.points_of_depth(numpy.ones((2, 3)), CAMERA, depth_scale=scale)
