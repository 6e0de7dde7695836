//! Registrations: one, or many over threads.

use crate::arguments;
use crate::cloud::{Cloud, SEEDS, View};
use crate::clouds::Clouds;
use crate::depth::depth_image;
use crate::error::{Error, bad_cloud, no_threads};
use crate::options::{Asked, Options};
use crate::policy::{self, Policy};
use crate::registration::Registration;
use host_train::dataset::cloud_file::Note;
use host_train::register::Memory;
use host_train::register::batch::for_each;
use host_train::register::prepared::Prepared;
use host_train::register::request::Request;
use pyo3::prelude::*;
use pyo3::types::PyList;
use reagent_core::weights;
use std::path::Path;
use std::sync::Mutex;

/// Pairs that a thread registers between two checks for an interrupt by the user.
const BETWEEN_LOOKS: usize = 64;

/// Working memory that no registration is using.
static IDLE: Mutex<Vec<Box<Memory>>> = Mutex::new(Vec::new());

/// Registers with a policy of its own, packed once. One object may be used by several threads at a time.
///
/// If no `policy` is given, it is the bundled "reagent", or "views" for a source seen from a `viewpoint`. `threads` are
/// those of `register_batch`; by default, as many as the machine has cores.
///
/// >>> import numpy, reagent
/// >>> registrar = reagent.Registrar(reagent.Policy.pretrained("int8"))
/// >>> cloud = numpy.random.default_rng(1).normal(size=(500, 3)) * [3, 2, 1]
/// >>> registrar.register(cloud + [0.2, 0, 0], cloud).target_from_source[:3, 3].round(3) + 0.0
/// array([-0.2,  0. ,  0. ])
#[pyclass(module = "reagent", frozen)]
pub struct Registrar {
    policy: Option<Policy>,
    threads: usize,
}

#[pymethods]
impl Registrar {
    #[new]
    #[pyo3(signature = (policy = None, *, threads = None))]
    fn new(
        #[pyo3(from_py_with = policy::if_any)] policy: Option<Policy>,
        #[pyo3(from_py_with = arguments::threads_if_any)] threads: Option<usize>,
    ) -> Registrar {
        Registrar {
            policy,
            threads: threads.unwrap_or(0),
        }
    }

    /// The policy; None if none was given.
    #[getter]
    fn policy(&self) -> Option<Policy> {
        self.policy.clone()
    }

    /// As the function `register`, with this policy.
    #[pyo3(signature = (source, target, init = None, mode = "verify", viewpoint = None, *, steps = 10, points = None,
        dense = "auto", best = 1))]
    #[allow(clippy::too_many_arguments, reason = "keywords in Python")]
    pub(crate) fn register(
        &self,
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
        let options = Options::new(init, mode, viewpoint, (steps, points, dense), best)?;
        self.run(py, [source, target], &options)
    }

    /// As the function `register_depth`, with this policy.
    #[pyo3(signature = (depth, camera, target, init = None, mode = "verify", *, mask = None, depth_scale = 1.0, steps = 10,
        points = None, dense = "auto", best = 1))]
    #[allow(clippy::too_many_arguments, reason = "keywords in Python")]
    pub(crate) fn register_depth(
        &self,
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
        let options = Options::new(init, mode, None, (steps, points, dense), best)?;
        let mut asked = options.one()?;
        asked.request.view_point = Some([0.0; 3]);
        let seen = depth_image(depth, camera, mask, depth_scale)?;
        let target = Cloud::or_mesh("target", target)?;
        let target = target.view();
        let policy = self.policy_for(&asked.request);
        py.detach(|| {
            let object = seen.object();
            let source = Prepared::of_points(&object, Path::new("depth"), points);
            let mut source = source.map_err(|error| bad_cloud(&error))?;
            source.see(&seen.background(), 1.0);
            if seen.camera.is_off_centre() {
                source.notes.push(Note::OffCentre {
                    centre: seen.camera.centre.to_array(),
                    size: seen.camera.size,
                });
            }
            let names = ["depth", target.name()];
            let target = target
                .prepared(points, SEEDS[1])
                .map_err(|error| bad_cloud(&error))?;
            with_memory(|memory| register_prepared(policy, memory, [source, target], names, &asked))
        })
    }

    /// As the function `refine`.
    #[pyo3(signature = (source, target, init = None, viewpoint = None, *, points = None, dense = "auto", best = 1))]
    #[allow(clippy::too_many_arguments, reason = "keywords in Python")]
    pub(crate) fn refine(
        &self,
        py: Python<'_>,
        source: &Bound<'_, PyAny>,
        target: &Bound<'_, PyAny>,
        init: Option<&Bound<'_, PyAny>>,
        viewpoint: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = arguments::points_if_any)] points: Option<usize>,
        #[pyo3(from_py_with = arguments::word)] dense: &str,
        #[pyo3(from_py_with = arguments::best)] best: usize,
    ) -> PyResult<Registration> {
        let options = Options::new(init, "refine", viewpoint, (1, points, dense), best)?;
        self.run(py, [source, target], &options)
    }

    /// As the function `verify`.
    #[pyo3(signature = (source, target, init = None, viewpoint = None, *, points = None, dense = "auto", best = 1))]
    #[allow(clippy::too_many_arguments, reason = "keywords in Python")]
    pub(crate) fn verify(
        &self,
        py: Python<'_>,
        source: &Bound<'_, PyAny>,
        target: &Bound<'_, PyAny>,
        init: Option<&Bound<'_, PyAny>>,
        viewpoint: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = arguments::points_if_any)] points: Option<usize>,
        #[pyo3(from_py_with = arguments::word)] dense: &str,
        #[pyo3(from_py_with = arguments::best)] best: usize,
    ) -> PyResult<Registration> {
        let options = Options::new(init, "verify", viewpoint, (1, points, dense), best)?;
        self.run(py, [source, target], &options.without_policy())
    }

    /// As the function `register_batch`, with this policy and these threads.
    #[pyo3(signature = (sources, targets, init = None, mode = "verify", viewpoint = None, *, steps = 10, points = None,
        dense = "auto", best = 1, return_exceptions = false))]
    #[allow(clippy::too_many_arguments, reason = "keywords in Python")]
    pub(crate) fn register_batch<'py>(
        &self,
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
        let options = Options::new(init, mode, viewpoint, (steps, points, dense), best)?;
        let clouds = [
            Clouds::new("sources", sources)?,
            Clouds::new("targets", targets)?,
        ];
        let list = PyList::empty(py);
        for result in self.run_all(py, &clouds, &options)? {
            match result {
                Ok(registration) => list.append(registration)?,
                Err(error) if return_exceptions => list.append(error)?,
                Err(error) => return Err(error),
            }
        }
        Ok(list)
    }

    fn __repr__(&self) -> String {
        let threads = match self.threads {
            0 => "None".into(),
            threads => threads.to_string(),
        };
        let policy = self.policy.as_ref().map_or("None".into(), Policy::__repr__);
        format!("Registrar({policy}, threads={threads})")
    }
}

impl Registrar {
    /// A registrar with the bundled policies.
    pub(crate) fn bundled() -> Registrar {
        Registrar {
            policy: None,
            threads: 0,
        }
    }

    fn policy_for(&self, request: &Request) -> weights::Policy<'_> {
        let given = self.policy.as_ref();
        given.unwrap_or_else(|| Policy::fitting(request)).view()
    }

    fn run(
        &self,
        py: Python<'_>,
        [source, target]: [&Bound<'_, PyAny>; 2],
        options: &Options,
    ) -> PyResult<Registration> {
        let asked = options.one()?;
        let clouds = [
            Cloud::or_mesh("source", source)?,
            Cloud::or_mesh("target", target)?,
        ];
        let views = clouds.each_ref().map(Cloud::view);
        let policy = self.policy_for(&asked.request);
        py.detach(|| {
            with_memory(|memory| register_views(policy, memory, views, &asked, options.points))
        })
    }

    fn run_all(
        &self,
        py: Python<'_>,
        [sources, targets]: &[Clouds<'_>; 2],
        options: &Options,
    ) -> PyResult<Vec<PyResult<Registration>>> {
        let pairs = match (sources, targets) {
            (Clouds::Each(sources), Clouds::Each(targets)) if sources.len() != targets.len() => {
                let (sources, targets) = (sources.len(), targets.len());
                return Err(Error::new_err(format!(
                    "expected as many sources as targets, or one of either for all, found {sources} and {targets}"
                )));
            }
            (Clouds::Each(each), _) | (_, Clouds::Each(each)) => each.len(),
            (Clouds::One(_), Clouds::One(_)) => 1,
        };
        let each = options.each(pairs)?;
        let jobs: Vec<PyResult<[View<'_>; 2]>> = (0..pairs)
            .map(|pair| Ok([sources.view(py, pair)?, targets.view(py, pair)?]))
            .collect();
        let results = py.detach(|| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(self.threads.min(pairs))
                .build()
                .map_err(|error| no_threads(&error))?;
            let mut results = Vec::with_capacity(pairs);
            while results.len() < pairs {
                let done = results.len();
                let count = (pairs - done).min(BETWEEN_LOOKS * pool.current_num_threads());
                let register = |memory: &mut Memory, i: usize| {
                    let (asked, job) = (&each[done + i], jobs[done + i].as_ref().ok()?);
                    Some(register_views(
                        self.policy_for(&asked.request),
                        memory,
                        *job,
                        asked,
                        options.points,
                    ))
                };
                results.extend(pool.install(|| for_each(count, Memory::new, register)));
                Python::attach(|py| py.check_signals())?;
            }
            Ok::<_, PyErr>(results)
        })?;
        let joined = jobs.into_iter().zip(results);
        Ok(joined
            .map(|(job, result)| job.and_then(|_| result.expect("there are clouds")))
            .collect())
    }
}

/// Calls `of` with memory that is kept for later calls.
fn with_memory<T>(of: impl FnOnce(&mut Memory) -> T) -> T {
    let idle = IDLE.try_lock().ok().and_then(|mut idle| idle.pop());
    let mut memory = idle.unwrap_or_else(|| Box::new(Memory::new()));
    let found = of(&mut memory);
    // If the lock is held, for example in a forked process, this only costs new memory.
    if let Ok(mut idle) = IDLE.try_lock() {
        idle.push(memory);
    }
    found
}

/// Registers views of arrays that have been checked.
fn register_views(
    policy: weights::Policy<'_>,
    memory: &mut Memory,
    views: [View<'_>; 2],
    asked: &Asked,
    points: Option<usize>,
) -> PyResult<Registration> {
    let [source, target] = [0, 1].map(|i| views[i].prepared(points, SEEDS[i]));
    let source = source.map_err(|error| bad_cloud(&error))?;
    let target = target.map_err(|error| bad_cloud(&error))?;
    let names = views.map(View::name);
    register_prepared(policy, memory, [source, target], names, asked)
}

/// Why a registration gave no pose.
enum Ended {
    Refused(reagent_core::Error),
    /// Stopped, for instance by the user.
    Stopped(PyErr),
}

impl From<reagent_core::Error> for Ended {
    fn from(error: reagent_core::Error) -> Ended {
        Ended::Refused(error)
    }
}

fn register_prepared(
    policy: weights::Policy<'_>,
    memory: &mut Memory,
    [source, mut target]: [Prepared<'_>; 2],
    names: [&str; 2],
    asked: &Asked,
) -> PyResult<Registration> {
    let Asked {
        request,
        starts,
        best,
    } = asked;
    if request.view_point.is_some() {
        target.notice_missing_faces();
    }
    let clouds = [&source, &target];
    let go_on = || Python::attach(|py| py.check_signals()).map_err(Ended::Stopped);
    let done = request.register_from(starts, *best, policy, memory, clouds, go_on);
    let done = done.map_err(|ended| match ended {
        Ended::Stopped(error) => error,
        Ended::Refused(error) => {
            let [source, target] = names;
            Error::new_err(format!("cannot register {source} to {target}: {error}"))
        }
    })?;
    Ok(Registration::new(clouds, done, *best))
}
