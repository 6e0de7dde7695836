//! Tracking: an object's pose from one cloud of a stream to the next.

use crate::arguments;
use crate::cloud::{Cloud, SEEDS};
use crate::error::{CloudError, Error, bad, bad_cloud};
use crate::options::Options;
use crate::policy::{self, Policy};
use crate::registration::Registration;
use host_train::register::Memory;
use host_train::register::prepared::Prepared;
use host_train::register::request::Request;
use host_train::register::track::{POINTS, Tracking, bundled_policy};
use pyo3::prelude::*;
use reagent_core::pipeline::Mode;
use std::sync::{Mutex, MutexGuard, PoisonError};

// The Python signature needs a number, not the name of a constant.
const _: () = assert!(POINTS == 1024);

/// Follows an object through a stream of clouds, such as a camera's.
///
/// Each pose is refined by closest points from the last one, in a few milliseconds. If that is probably not right, and
/// at every thirtieth cloud, the policy's steps and `mode` follow. A lost object is looked for alternately from the
/// last pose and from anywhere.
///
/// target: the object's model, as `register` takes it.
/// init: where to look for it at first: a pose, "identity" or "anywhere".
/// viewpoint: where the sensor stands in the clouds' coordinates, if each is a view from there.
/// policy: by default the bundled "compact", or "views-compact" with a `viewpoint`.
/// points: most points of each cloud that are used; fewer take less time.
///
/// Several threads may use one object, one after the other.
///
/// >>> import numpy, reagent
/// >>> model = numpy.random.default_rng(1).normal(size=(500, 3)) * [3, 2, 1]
/// >>> tracker = reagent.Tracker(model)
/// >>> [tracker.follow(model + [0.1 * step, 0, 0]).state for step in range(3)]
/// ['found', 'tracked', 'tracked']
/// >>> tracker.follow(model[:100] @ numpy.diag([0.2, 2, 4])).state
/// 'lost'
#[pyclass(module = "reagent", frozen)]
pub struct Tracker {
    target: Prepared<'static>,
    request: Request,
    policy: Policy,
    points: Option<usize>,
    state: Mutex<State>,
}

/// What the clouds so far have shown, and working memory.
struct State {
    tracking: Tracking,
    memory: Box<Memory>,
}

impl Tracker {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl Tracker {
    #[new]
    #[pyo3(signature = (target, init = None, mode = "verify", viewpoint = None, *, policy = None, steps = 10, points = 1024))]
    #[allow(clippy::too_many_arguments, reason = "keywords in Python")]
    fn new(
        py: Python<'_>,
        target: &Bound<'_, PyAny>,
        init: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = arguments::word)] mode: &str,
        viewpoint: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = policy::if_any)] policy: Option<Policy>,
        #[pyo3(from_py_with = arguments::steps)] steps: usize,
        #[pyo3(from_py_with = arguments::points)] points: usize,
    ) -> PyResult<Tracker> {
        let points = Some(points);
        let asked = Options::new(init, mode, viewpoint, (steps, points, "never"), 1)?.one()?;
        let [start] = asked.starts[..] else {
            return Err(bad("init", "expected one start"));
        };
        let request = Request {
            start,
            ..asked.request
        };
        if request.mode == Mode::Fast {
            return Err(bad("mode", "fast does not tell whether the object is lost"));
        }
        let target = Cloud::or_mesh("target", target)?;
        let prepared = target.view().copied(points, SEEDS[1]);
        let mut target = prepared.map_err(|error| bad_cloud(&error))?;
        let is_view = request.view_point.is_some();
        if is_view {
            target.notice_missing_faces();
        }
        py.detach(|| request.get_ready(&target));
        let bundled = || Policy::pretrained(bundled_policy(is_view));
        Ok(Tracker {
            target,
            request,
            policy: policy.map_or_else(bundled, Ok)?,
            points,
            state: Mutex::new(State {
                tracking: Tracking::new(),
                memory: Box::new(Memory::new()),
            }),
        })
    }

    /// Registers the next cloud. In the result, `state` is "found", "tracked" or "lost"; the pose of a lost object is
    /// not reliable. A cloud that is refused, such as an empty one, raises `CloudError` and counts as one without the object.
    fn follow(&self, py: Python<'_>, source: &Bound<'_, PyAny>) -> PyResult<Registration> {
        let source = Cloud::or_mesh("source", source).inspect_err(|error| {
            // Of another shape: no cloud shows the object. Other threads may hold the state while they wait for Python.
            if error.is_instance_of::<CloudError>(py) {
                py.detach(|| self.state().tracking.miss());
            }
        })?;
        let source = source.view();
        py.detach(|| {
            let mut state = self.state();
            let State { tracking, memory } = &mut *state;
            let source = source.prepared(self.points, SEEDS[0]).map_err(|error| {
                tracking.miss();
                bad_cloud(&error)
            })?;
            let clouds = [&source, &self.target];
            let tracked = tracking.follow(&self.request, self.policy.view(), memory, clouds);
            let tracked = tracked.map_err(|error| {
                Error::new_err(format!("cannot register source to target: {error}"))
            })?;
            let registration = Registration::new(clouds, tracked.done, 1);
            Ok(registration.with_state(tracked.state))
        })
    }

    /// The policy.
    #[getter]
    fn policy(&self) -> Policy {
        self.policy.clone()
    }

    fn __repr__(&self) -> String {
        format!("Tracker({})", self.policy.__repr__())
    }
}
