"""Clouds in every layout of memory."""

import numpy
import pytest

import reagent

REGISTRAR = reagent.Registrar(reagent.Policy.pretrained("int8"))


def unaligned(points):
    """The same at addresses that are no multiples of a number's size."""
    size = points.dtype.itemsize
    memory = numpy.zeros(points.size * size + 1, numpy.uint8)
    array = memory[1:].view(points.dtype).reshape(points.shape)
    array[...] = points
    assert not array.flags.aligned
    return array


def strided(points):
    array = numpy.full((2 * len(points), 5), 7.0, points.dtype)
    array[::2, 1:4] = points
    return array[::2, 1:4]


def read_only(points):
    array = points.copy()
    array.flags.writeable = False
    return array


class Tensor:
    """What enters through `numpy.asarray`."""

    def __init__(self, points):
        self.points = points

    def __array__(self, dtype=None, copy=None):
        return self.points.astype(dtype or self.points.dtype)


LAYOUTS = {
    "fortran": numpy.asfortranarray,
    "strided": strided,
    "reversed": lambda points: points[::-1].copy()[::-1],
    "read only": read_only,
    "unaligned": unaligned,
    "other byte order": lambda points: points.astype(points.dtype.newbyteorder(">")),
    "masked, nothing hidden": numpy.ma.masked_array,
    "tensor": Tensor,
    "subclass": lambda points: points.view(numpy.recarray),
}


@pytest.mark.parametrize("dtype", [numpy.float32, numpy.float64])
@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS.keys())
def test_layouts_give_the_same_bits(pair, dtype, layout):
    source, target = (cloud.astype(dtype) for cloud in pair[:2])
    expected = REGISTRAR.register(source, target)
    found = REGISTRAR.register(layout(source), layout(target))
    assert found.target_from_source.tobytes() == expected.target_from_source.tobytes()
    assert found.probability == expected.probability and found.notes == []


def test_both_sizes_of_numbers_give_the_same_bits(pair):
    source, target = (cloud.astype(numpy.float32) for cloud in pair[:2])
    expected = REGISTRAR.register(source, target).target_from_source
    assert (REGISTRAR.register(source.astype(float), target).target_from_source == expected).all()
    assert (REGISTRAR.register(source.tolist(), target).target_from_source == expected).all()


def test_arrays_are_left_alone(pair):
    source, target = (cloud.astype(numpy.float32) for cloud in pair[:2])
    before = source.tobytes(), target.tobytes()
    found = REGISTRAR.register(source, target)
    assert (source.tobytes(), target.tobytes()) == before
    found.target_from_source[0, 0] = 7
    assert found.target_from_source[0, 0] != 7


@pytest.mark.parametrize("dtype", [numpy.float32, numpy.float64])
@pytest.mark.parametrize("invalid", [numpy.nan, numpy.inf, -numpy.inf, 2e30])
def test_invalid_points_are_left_out_and_said(pair, dtype, invalid):
    source, target = (cloud.astype(dtype) for cloud in pair[:2])
    marked = numpy.insert(source, [0, 10, 900], [invalid, 0, 0], axis=0)
    found = REGISTRAR.register(marked, target)
    expected = REGISTRAR.register(source, target)
    assert (found.target_from_source == expected.target_from_source).all()
    assert found.notes == ["source: left out 3 invalid points (NaN, infinite or beyond 1e12)"]


def test_masked_points_are_left_out(pair):
    source, target, _ = pair
    masked = numpy.ma.masked_array(numpy.insert(source, 0, 0.0, axis=0))
    masked[0] = numpy.ma.masked
    found = REGISTRAR.register(masked, target)
    assert (found.target_from_source == REGISTRAR.register(source, target).target_from_source).all()
    assert found.notes == ["source: left out 1 invalid point (NaN, infinite or beyond 1e12)"]
