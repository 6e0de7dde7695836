"""Every refusal says which argument, and what was expected."""

import numpy
import pytest
from conftest import bracket

import reagent

GOOD = bracket(1, 100)


class Broken:
    def __array__(self, dtype=None, copy=None):
        raise TypeError("can't convert cuda:0 device type tensor to numpy")


@pytest.mark.parametrize(
    ("cloud", "said"),
    [
        (numpy.zeros((0, 3)), "no points"),
        (numpy.full((5, 3), numpy.nan), r"no points but 5 invalid ones \(NaN, infinite or beyond 1e12\)"),
        (numpy.zeros((9, 3)), "all points coincide"),
        (GOOD[:2], r"the cloud has 2 points; give at least 3"),
        (numpy.full((4, 3), 1e20) * [[1], [2], [3], [4]], "no points but 4 invalid ones"),
        (GOOD.T, r"shape \(3, 100\); transpose it"),
        (GOOD[:, :2], r"float32 or float64 of shape \(N, 3\), found shape \(100, 2\) of float64"),
        (GOOD[0], r"found shape \(3,\)"),
        (GOOD[None], r"found shape \(1, 100, 3\)"),
        (GOOD.astype(int), r"found int64; convert it with .astype\(float\)"),
        (GOOD.astype(numpy.float16), "found float16"),
        (GOOD.astype(numpy.longdouble), "found (float128|longdouble)"),
        (GOOD.astype(complex), "found complex128"),
        (GOOD.astype(str), "found <U"),
        (None, r"found shape \(\) of object"),
        ("part.ply", r"found shape \(\) of"),
        # NumPy before 1.24 makes objects of them.
        ([[0.0, 1.0, 2.0], [3.0]], r"(numpy.asarray says|found shape \(2,\) of object)"),
        (Broken(), "numpy.asarray says: can't convert cuda:0"),
    ],
)
def test_clouds(cloud, said):
    for arguments, name in [((cloud, GOOD), "source"), ((GOOD, cloud), "target")]:
        with pytest.raises(reagent.CloudError, match=f"^{name}: .*{said}"):
            reagent.register(*arguments)
    with pytest.raises(reagent.CloudError, match=rf"^sources\[1\]: .*{said}"):
        reagent.register_batch([GOOD, cloud], [GOOD, GOOD])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"init": "near"}, 'init: expected a pose, "identity" or "anywhere"'),
        ({"init": numpy.eye(3)}, r"init: expected a pose, 4x4 or the rows of \[R \| t\], found shape \[3, 3\]"),
        ({"init": numpy.zeros((0, 4, 4))}, "init: expected one start or more, found none"),
        ({"init": ["identity", "near"]}, 'init: expected a pose, "identity" or "anywhere"'),
        ({"init": ["identity", numpy.eye(4)[None]]}, "init: expected a word or one pose in each place"),
        ({"init": ["identity", "anywhere"], "mode": "fast"}, "mode: fast does not compare poses"),
        ({"best": 2, "mode": "fast"}, "mode: fast does not compare poses"),
        ({"init": 1j * numpy.eye(4)}, "init: expected a pose.*, found complex128"),
        ({"init": [numpy.eye(4), numpy.ma.masked_equal(numpy.eye(4), 1)]}, "init: expected a pose.*, found masked elements"),
        ({"init": numpy.ma.masked_equal(numpy.eye(4), 1)}, "init: expected a pose.*, found masked elements"),
        ({"init": 2 * numpy.eye(4)}, "init: the last row of a pose is 0 0 0 1"),
        ({"init": 2 * numpy.eye(4)[:3]}, "init: the pose is not a rigid transform"),
        ({"init": numpy.diag([1, 1, -1, 1])}, "init: the pose is not a rigid transform"),
        ({"init": numpy.full((4, 4), numpy.nan)}, "init: "),
        ({"init": object()}, "init: expected a pose.*numpy.asarray says"),
        ({"mode": "slow"}, "mode: not a mode: refine, fast, polish, verify or best"),
        ({"viewpoint": [0, 0]}, r"viewpoint: expected three numbers, found shape \[2\]"),
        ({"viewpoint": [0, 0, numpy.inf]}, "viewpoint: expected three finite numbers, found inf"),
        ({"viewpoint": [0, 0, 1e20]}, "^viewpoint: expected three numbers up to 1e12, found 1e20"),
        ({"viewpoint": [0, 0, 1j]}, "viewpoint: expected three numbers, found complex128"),
        ({"viewpoint": numpy.ma.masked_equal([0, 0, 9.0], 9)}, "viewpoint: expected three numbers, found masked elements"),
        ({"viewpoint": [[0, 0, 1]]}, "viewpoint: expected one, for one pair of clouds"),
        ({"viewpoint": "origin"}, "viewpoint: expected three numbers; numpy.asarray says"),
        ({"mode": None}, "mode: not a mode: refine, fast, polish, verify or best"),
        ({"dense": "maybe"}, "dense: expected auto, always or never"),
        ({"dense": True}, "dense: expected auto, always or never"),
    ],
)
def test_options(options, said):
    with pytest.raises(reagent.Error, match=said):
        reagent.register(GOOD, GOOD, **options)


@pytest.mark.parametrize(
    ("name", "within", "numbers"),
    [("steps", "0 to 65535", [-1, 65536, 10**8]), ("best", "1 to 65535", [0]), ("points", "16 to 4096", [15, 5000])],
)
def test_numbers(name, within, numbers):
    for number in [*numbers, -1, 2**70, 1.5, "ten", [3]]:
        with pytest.raises(reagent.Error, match=f"^{name}: expected a whole number from {within}"):
            reagent.register(GOOD, GOOD, **{name: number})


def test_registrars():
    for threads in [0, -1, 10**9, 2**70, 1.5]:
        with pytest.raises(reagent.Error, match="^threads: expected a whole number from 1 to 512"):
            reagent.Registrar(threads=threads)
    with pytest.raises(reagent.Error, match="^policy: expected a Policy, such as"):
        reagent.Registrar("int8")


@pytest.mark.parametrize("path", [None, 3, ["a.rgw"]])
def test_paths(path):
    with pytest.raises(reagent.Error, match="^path: expected a file's name, as text or a pathlib.Path, found <class"):
        reagent.Policy.load(path)


def test_batches():
    with pytest.raises(reagent.Error, match="^return_exceptions: expected True or False"):
        reagent.register_batch([GOOD], GOOD, return_exceptions="yes")
    with pytest.raises(reagent.Error, match=r"^viewpoint\[1\]: expected three numbers up to 1e12"):
        reagent.register_batch([GOOD] * 2, GOOD, viewpoint=[[0, 0, 9], [0, 0, -1e13]])
    with pytest.raises(reagent.Error, match="as many sources as targets, or one of either for all, found 2 and 3"):
        reagent.register_batch([GOOD] * 2, [GOOD] * 3)
    with pytest.raises(reagent.Error, match="init: expected one, or one for each of 2 pairs, found 3"):
        reagent.register_batch([GOOD] * 2, GOOD, numpy.stack([numpy.eye(4)] * 3))
    with pytest.raises(reagent.Error, match="sources: expected a sequence of clouds, or one for all"):
        reagent.register_batch(3, GOOD)


def test_poses_to_evaluate():
    poses, clouds = numpy.stack([numpy.eye(4)] * 2), [GOOD, GOOD]
    for arguments, said in [
        ((numpy.eye(4), poses, clouds, clouds), "found: expected poses of several pairs"),
        ((poses[:0], poses[:0], [], []), "the set holds no pairs"),
        (([], [], [], []), "the set holds no pairs"),
        ((poses, poses[:1], clouds, clouds), "truth: expected one for each of 2 poses, found 1"),
        ((poses, poses, clouds, clouds[:1]), "targets: expected one for each of 2 poses, found 1"),
        ((poses, poses, 3, clouds), "sources: expected a sequence of clouds"),
        ((poses, poses, [GOOD, GOOD * numpy.nan], clouds), "pair 1: point 0 has a NaN"),
    ]:
        with pytest.raises(reagent.Error, match=said):
            reagent.evaluate(*arguments)


class Interrupted:
    """An array that is interrupted while it is computed."""

    def __init__(self, error):
        self.error = error

    def __array__(self, dtype=None, copy=None):
        raise self.error


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit, MemoryError])
def test_what_interrupts_an_argument_is_no_error_of_the_argument(error):
    with pytest.raises(error):
        reagent.register(Interrupted(error), GOOD)
    with pytest.raises(error):
        reagent.register(GOOD, GOOD, init=Interrupted(error))
    with pytest.raises(error):
        reagent.register_batch([GOOD, Interrupted(error)], GOOD, return_exceptions=True)


def test_of_several_starts_and_view_points_the_wrong_one_is_named():
    mirrored = numpy.stack([numpy.eye(4), numpy.diag([-1.0, 1, 1, 1])])
    with pytest.raises(reagent.Error, match=r"init\[1\]: "):
        reagent.register_batch([GOOD, GOOD], GOOD, init=mirrored)
    eyes = numpy.array([[0, 0, numpy.nan], [0, 0, 9]])
    with pytest.raises(reagent.Error, match=r"viewpoint\[0\]: expected three finite numbers"):
        reagent.register_batch([GOOD, GOOD], GOOD, viewpoint=eyes)
