//! The package's functions: those of a [`Registrar`] with the bundled policies.

use crate::arguments;
use crate::registrar::Registrar;
use crate::registration::Registration;
use pyo3::prelude::*;
use pyo3::types::PyList;

/// Registers `source` to `target`: finds the rigid transform that maps the source onto the target.
///
/// Clouds are arrays of float32 or float64 of shape (N, 3), both in one unit of length, or whatever `numpy.asarray`
/// turns into such arrays. They are read in place, and must not be written to meanwhile. Points that are NaN, infinite
/// or beyond 1e12, and masked points, are left out. A cloud of more than 4096 points is thinned to 2048 for the policy,
/// and a last refinement uses up to 20,000.
///
/// init: where to start: a pose (4x4, or the 3x4 of it), "identity" (as the clouds lie; the default) or "anywhere" (the
///     source may be turned in any way; the command line's `--init none`). Of several, in a list or an array (K, 4, 4), each
///     is tried, the most probable pose wins, and `start` of what is returned says where it came from.
/// mode: "fast" (the policy's steps alone), "polish" (then closest points), "verify" (then compared with other poses) or
///     "refine" (closest points from the start, without the policy).
/// viewpoint: where the sensor stood in the source's coordinates, if the source is a view from one point.
/// steps: most steps of the policy.
/// points: most points of each cloud that the policy sees.
/// dense: whether the pose is refined at last on up to 20,000 points of each cloud: "auto" (where a cloud was thinned), "always" or "never".
/// best: how many of the most probable poses to tell: the first is given out, those that follow are `others`.
///
/// Raises CloudError or Error, which are ValueErrors. The numbers are those of `host-train register`.
///
/// >>> import numpy, reagent
/// >>> cloud = numpy.random.default_rng(1).normal(size=(500, 3)) * [3, 2, 1]
/// >>> reagent.register(cloud + [0.2, 0, 0], cloud).verdict
/// 'converged'
/// >>> turn = numpy.diag([-1, -1, 1, 1])
/// >>> found = reagent.register(cloud + [0.2, 0, 0], cloud, [turn, "identity"], best=2)
/// >>> found.start, len(found.others) <= 1
/// (1, True)
/// >>> reagent.register(cloud[:, :2], cloud)
/// Traceback (most recent call last):
/// reagent.CloudError: source: expected an array of float32 or float64 of shape (N, 3), found shape (500, 2) of float64
#[pyfunction]
#[pyo3(signature = (source, target, init = None, mode = "verify", viewpoint = None, *, steps = 10, points = None,
    dense = "auto", best = 1))]
#[allow(clippy::too_many_arguments, reason = "keywords in Python")]
pub(crate) fn register(
    py: Python<'_>,
    source: &Bound<'_, PyAny>,
    target: &Bound<'_, PyAny>,
    init: Option<&Bound<'_, PyAny>>,
    #[pyo3(from_py_with = arguments::word)] mode: &str,
    viewpoint: Option<&Bound<'_, PyAny>>,
    #[pyo3(from_py_with = arguments::steps)] steps: usize,
    #[pyo3(from_py_with = arguments::points_if_any)] points: Option<usize>,
    #[pyo3(from_py_with = arguments::word)] dense: &str,
    #[pyo3(from_py_with = arguments::best)] best: usize,
) -> PyResult<Registration> {
    Registrar::bundled().register(
        py, source, target, init, mode, viewpoint, steps, points, dense, best,
    )
}

/// Registers what a depth camera saw to `target`: finds the rigid transform that maps the camera's frame (x right, y
/// down, z ahead) onto the target's. Anything that would stand in front of the background also counts against a pose.
///
/// depth, camera, mask, depth_scale: as for `points_of_depth`; scaled depths are in the target's unit.
/// Other arguments are as for `register`.
///
/// >>> import numpy, reagent
/// >>> v, u = numpy.mgrid[:40, :40]
/// >>> depth = numpy.where((u - 20) ** 2 + 2 * (v - 20) ** 2 < 200, 2 + (u - 20) ** 2 / 400 + (v + u) / 90, 9)
/// >>> points = reagent.points_of_depth(depth, (40, 40, 20, 20), depth < 9)
/// >>> found = reagent.register_depth(depth, (40, 40, 20, 20), points - [0.05, 0, 0], mask=depth < 9)
/// >>> found.target_from_source[:3, 3].round(2) + 0.0
/// array([-0.05,  0.  ,  0.  ])
#[pyfunction]
#[pyo3(signature = (depth, camera, target, init = None, mode = "verify", *, mask = None, depth_scale = 1.0, steps = 10,
    points = None, dense = "auto", best = 1))]
#[allow(clippy::too_many_arguments, reason = "keywords in Python")]
pub(crate) fn register_depth(
    py: Python<'_>,
    depth: &Bound<'_, PyAny>,
    camera: &Bound<'_, PyAny>,
    target: &Bound<'_, PyAny>,
    init: Option<&Bound<'_, PyAny>>,
    #[pyo3(from_py_with = arguments::word)] mode: &str,
    mask: Option<&Bound<'_, PyAny>>,
    #[pyo3(from_py_with = arguments::depth_scale)] depth_scale: f64,
    #[pyo3(from_py_with = arguments::steps)] steps: usize,
    #[pyo3(from_py_with = arguments::points_if_any)] points: Option<usize>,
    #[pyo3(from_py_with = arguments::word)] dense: &str,
    #[pyo3(from_py_with = arguments::best)] best: usize,
) -> PyResult<Registration> {
    Registrar::bundled().register_depth(
        py,
        depth,
        camera,
        target,
        init,
        mode,
        mask,
        depth_scale,
        steps,
        points,
        dense,
        best,
    )
}

/// Refines a pose by closest points, without the policy: for tracking. Arguments are as for `register`.
///
/// >>> import numpy, reagent
/// >>> cloud = numpy.random.default_rng(1).normal(size=(500, 3)) * [3, 2, 1]
/// >>> reagent.refine(cloud + [0.02, 0, 0], cloud).steps
/// []
#[pyfunction]
#[pyo3(signature = (source, target, init = None, viewpoint = None, *, points = None, dense = "auto", best = 1))]
#[allow(clippy::too_many_arguments, reason = "keywords in Python")]
pub(crate) fn refine(
    py: Python<'_>,
    source: &Bound<'_, PyAny>,
    target: &Bound<'_, PyAny>,
    init: Option<&Bound<'_, PyAny>>,
    viewpoint: Option<&Bound<'_, PyAny>>,
    #[pyo3(from_py_with = arguments::points_if_any)] points: Option<usize>,
    #[pyo3(from_py_with = arguments::word)] dense: &str,
    #[pyo3(from_py_with = arguments::best)] best: usize,
) -> PyResult<Registration> {
    Registrar::bundled().refine(py, source, target, init, viewpoint, points, dense, best)
}

/// Refines a pose that something else found and compares it with others, without the policy. Says how likely it is
/// right, or gives a better one. Arguments are as for `register`.
///
/// >>> import numpy, reagent
/// >>> cloud = numpy.random.default_rng(1).normal(size=(500, 3)) * [3, 2, 1]
/// >>> reagent.verify(cloud, cloud, numpy.eye(4)).converged
/// True
#[pyfunction]
#[pyo3(signature = (source, target, init = None, viewpoint = None, *, points = None, dense = "auto", best = 1))]
#[allow(clippy::too_many_arguments, reason = "keywords in Python")]
pub(crate) fn verify(
    py: Python<'_>,
    source: &Bound<'_, PyAny>,
    target: &Bound<'_, PyAny>,
    init: Option<&Bound<'_, PyAny>>,
    viewpoint: Option<&Bound<'_, PyAny>>,
    #[pyo3(from_py_with = arguments::points_if_any)] points: Option<usize>,
    #[pyo3(from_py_with = arguments::word)] dense: &str,
    #[pyo3(from_py_with = arguments::best)] best: usize,
) -> PyResult<Registration> {
    Registrar::bundled().verify(py, source, target, init, viewpoint, points, dense, best)
}

/// Registers many pairs over threads: a list of Registrations in the order of the pairs.
///
/// `sources` and `targets` are sequences of as many clouds, or one array of shape (N, 3) for all pairs; `init` and
/// `viewpoint` are one, or an array with one for each pair. Other arguments are as for `register`. The first pair that
/// cannot be registered raises its exception; with `return_exceptions` its place in the list has it instead. A start or a
/// view point that is none raises in either case, before any pair is registered. Results
/// depend on neither the order nor the number of threads.
///
/// >>> import numpy, reagent
/// >>> cloud = numpy.random.default_rng(1).normal(size=(500, 3)) * [3, 2, 1]
/// >>> moved = [cloud + [0.1, 0, 0], cloud + [0, 0.1, 0]]
/// >>> [found.verdict for found in reagent.register_batch(moved, cloud)]
/// ['converged', 'converged']
#[pyfunction]
#[pyo3(signature = (sources, targets, init = None, mode = "verify", viewpoint = None, *, steps = 10, points = None,
    dense = "auto", best = 1, return_exceptions = false))]
#[allow(clippy::too_many_arguments, reason = "keywords in Python")]
pub(crate) fn register_batch<'py>(
    py: Python<'py>,
    sources: &Bound<'py, PyAny>,
    targets: &Bound<'py, PyAny>,
    init: Option<&Bound<'py, PyAny>>,
    #[pyo3(from_py_with = arguments::word)] mode: &str,
    viewpoint: Option<&Bound<'py, PyAny>>,
    #[pyo3(from_py_with = arguments::steps)] steps: usize,
    #[pyo3(from_py_with = arguments::points_if_any)] points: Option<usize>,
    #[pyo3(from_py_with = arguments::word)] dense: &str,
    #[pyo3(from_py_with = arguments::best)] best: usize,
    #[pyo3(from_py_with = arguments::return_exceptions)] return_exceptions: bool,
) -> PyResult<Bound<'py, PyList>> {
    Registrar::bundled().register_batch(
        py,
        sources,
        targets,
        init,
        mode,
        viewpoint,
        steps,
        points,
        dense,
        best,
        return_exceptions,
    )
}
