//! Options of a registration.

use crate::array::{Poses, Positions, poses, positions};
use crate::error::bad;
use host_train::pose64::Position;
use host_train::register::Start;
use host_train::register::dense::Dense;
use host_train::register::request::Request;
use numpy::PyUntypedArray;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedStr;
use pyo3::types::{PySequence, PyString};
use reagent_core::pipeline::Mode;

/// What to do with one pair, or with each of several.
pub(crate) struct Options {
    common: Request,
    /// Starts: several for one pair, or one for each of several pairs.
    starts: Option<Vec<Start>>,
    best: usize,
    view_points: Option<Vec<[f64; 3]>>,
    /// Most points of each cloud that the policy sees.
    pub(crate) points: Option<usize>,
}

/// What to do with a pair.
#[derive(Clone)]
pub(crate) struct Asked {
    pub(crate) request: Request,
    /// The starts, in place of the request's own.
    pub(crate) starts: Vec<Start>,
    /// Number of the most probable poses to report.
    pub(crate) best: usize,
}

impl Options {
    pub(crate) fn new(
        init: Option<&Bound<'_, PyAny>>,
        mode: &str,
        viewpoint: Option<&Bound<'_, PyAny>>,
        (steps, points, dense): (usize, Option<usize>, &str),
        best: usize,
    ) -> PyResult<Options> {
        let mut options = Options {
            common: Request {
                mode: mode.parse().map_err(|error| bad("mode", error))?,
                steps,
                dense: match dense {
                    "auto" => Dense::Auto,
                    "always" => Dense::Always,
                    "never" => Dense::Never,
                    _ => return Err(bad("dense", "expected auto, always or never")),
                },
                ..Request::default()
            },
            starts: None,
            best,
            view_points: None,
            points,
        };
        if steps == 0 && options.common.mode == Mode::Fast {
            let said = "expected at least 1 for mode fast, which is the policy's steps alone";
            return Err(bad("steps", said));
        }
        if best > 1 {
            options.compares_poses()?;
        }
        match init.map(start).transpose()? {
            None => {}
            Some(Starts::One(start)) => options.common.start = start,
            Some(Starts::Each(starts)) => options.starts = Some(starts),
        }
        match viewpoint
            .map(|given| positions("viewpoint", given))
            .transpose()?
        {
            None => {}
            Some(Positions::One(point)) => {
                is_near("viewpoint", point)?;
                options.common.view_point = Some(point);
            }
            Some(Positions::Each(points)) => {
                for (i, &point) in points.iter().enumerate() {
                    is_near(&format!("viewpoint[{i}]"), point)?;
                }
                options.view_points = Some(points);
            }
        }
        Ok(options)
    }

    /// The same without the policy: the start is refined and compared with other poses.
    pub(crate) fn without_policy(mut self) -> Options {
        self.common.steps = 0;
        self
    }

    /// Refuses a mode that does not compare poses.
    fn compares_poses(&self) -> PyResult<()> {
        match self.common.mode {
            Mode::Fast => Err(bad(
                "mode",
                "fast does not compare poses: take another one for `best` and for several starts",
            )),
            _ => Ok(()),
        }
    }

    /// The options for a single pair.
    pub(crate) fn one(&self) -> PyResult<Asked> {
        if self.view_points.is_some() {
            return Err(bad("viewpoint", "expected one, for one pair of clouds"));
        }
        let starts = self.starts.clone().unwrap_or(vec![self.common.start]);
        if starts.is_empty() {
            return Err(bad("init", "expected one start or more, found none"));
        }
        if starts.len() > 1 {
            self.compares_poses()?;
        }
        Ok(Asked {
            request: self.common,
            starts,
            best: self.best,
        })
    }

    /// The options for each of so many pairs.
    pub(crate) fn each(&self, pairs: usize) -> PyResult<Vec<Asked>> {
        let starts = each("init", &self.starts, self.common.start, pairs)?;
        let points = self.view_points.as_ref();
        let points = points.map(|points| points.iter().copied().map(Some).collect());
        let points = each("viewpoint", &points, self.common.view_point, pairs)?;
        let asked = |(start, view_point)| Asked {
            request: Request {
                view_point,
                ..self.common
            },
            starts: vec![start],
            best: self.best,
        };
        Ok(starts.into_iter().zip(points).map(asked).collect())
    }
}

/// Largest coordinate of a view point, as of a cloud.
const LARGEST: f64 = 1e12;

/// Refuses a view point that no cloud can be seen from.
fn is_near(name: &str, point: Position) -> PyResult<()> {
    match point.into_iter().find(|x| x.abs() > LARGEST) {
        None => Ok(()),
        Some(x) => Err(bad(
            name,
            format!("expected three numbers up to {LARGEST:e}, found {x:e}"),
        )),
    }
}

/// The values for each of so many pairs: those given, or the common one for all.
fn each<T: Clone>(name: &str, given: &Option<Vec<T>>, common: T, pairs: usize) -> PyResult<Vec<T>> {
    match given {
        None => Ok(vec![common; pairs]),
        Some(given) if given.len() == pairs => Ok(given.clone()),
        Some(given) => {
            let found = given.len();
            let what = format!("expected one, or one for each of {pairs} pairs, found {found}");
            Err(bad(name, what))
        }
    }
}

/// Starts: one, or one for each of several pairs.
enum Starts {
    One(Start),
    Each(Vec<Start>),
}

fn start(given: &Bound<'_, PyAny>) -> PyResult<Starts> {
    // Words and poses in a sequence, which is not an array.
    if let Ok(listed) = given.cast::<PySequence>()
        && !given.is_instance_of::<PyString>()
        && !given.is_instance_of::<PyUntypedArray>()
    {
        let items = listed.try_iter()?.collect::<PyResult<Vec<_>>>()?;
        if items.iter().any(|item| item.is_instance_of::<PyString>()) {
            let each = items.iter().map(|item| match start(item)? {
                Starts::One(start) => Ok(start),
                Starts::Each(_) => Err(bad("init", "expected a word or one pose in each place")),
            });
            return each.collect::<PyResult<_>>().map(Starts::Each);
        }
    }
    if let Ok(word) = given.extract::<PyBackedStr>() {
        return match &*word {
            "identity" => Ok(Starts::One(Start::Identity)),
            "anywhere" => Ok(Starts::One(Start::None)),
            _ => Err(bad("init", "expected a pose, \"identity\" or \"anywhere\"")),
        };
    }
    Ok(match poses("init", given)? {
        Poses::One(pose) => Starts::One(Start::Pose(pose)),
        Poses::Each(poses) => Starts::Each(poses.into_iter().map(Start::Pose).collect()),
    })
}
