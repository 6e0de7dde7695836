//! Errors as numbers, and as sentences.

use core::ffi::{CStr, c_char};
use reagent_core::Error;

/// Outcome of a call; reagent_status_text has a sentence for each. A call that is not OK changed nothing, except that
/// reagent_prepare leaves the model unprepared.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReagentStatus {
    /// Done.
    Ok = 0,
    /// A pointer is null or not aligned.
    Pointer = 1,
    /// reagent_init has not succeeded on this memory.
    NotInitialised = 2,
    /// No target or no source has been set.
    NotStarted = 3,
    /// The source, or the only cloud of the call, has no points.
    EmptyCloud = 4,
    /// The source, or the only cloud of the call, has fewer than 3 points.
    TooFewPoints = 5,
    /// The source, or the only cloud of the call, has more than 4096 points.
    TooManyPoints = 6,
    /// A coordinate of the source, of the only cloud of the call, of a grid or of an origin is NaN, infinite or beyond 1e12.
    NotFinite = 7,
    /// All points of a cloud coincide, or the target's points nearly do.
    NoExtent = 8,
    /// The initial pose is not a rigid transform, or its translation is beyond 1e12.
    BadPose = 9,
    /// The weights are cut short, or bytes follow their end.
    WeightsLength = 10,
    /// The bytes are not a weight file.
    WeightsMagic = 11,
    /// The weight file has a version, number format or shape that this library does not run.
    WeightsFormat = 12,
    /// The weights are damaged.
    WeightsDamaged = 13,
    /// The weights do not start on a 4-byte boundary.
    WeightsAlignment = 14,
    /// Any other error.
    Other = 15,
    /// The target has no points.
    TargetEmpty = 16,
    /// The target has fewer than 3 points.
    TargetTooFewPoints = 17,
    /// The target has more than 4096 points.
    TargetTooManyPoints = 18,
    /// A coordinate of the target is NaN, infinite or beyond 1e12.
    TargetNotFinite = 19,
    /// A coordinate of the view point is NaN, infinite or beyond 1e12.
    BadViewPoint = 20,
    /// A standard deviation of the start is negative or NaN.
    BadUncertainty = 21,
    /// The task's mode is not a ReagentMode.
    NoSuchMode = 22,
    /// reagent_prepare has not succeeded on the task's model.
    NotPrepared = 23,
    /// The task's background has more than 4096 points.
    BackgroundTooManyPoints = 24,
    /// The step of a grid is 0 or negative.
    BadGrid = 25,
    /// The task has outward directions, but not one for each point of the target.
    OutwardCount = 26,
    /// A depth image has no pixels, or its camera's focal lengths are not positive or a number of it is not finite.
    BadCamera = 27,
}

impl ReagentStatus {
    /// The status `of` in place of that of too many points.
    pub(crate) fn if_too_many(self, of: Self) -> Self {
        match self {
            ReagentStatus::TooManyPoints => of,
            other => other,
        }
    }

    /// The same status, for the target.
    pub(crate) fn of_target(self) -> Self {
        match self {
            ReagentStatus::EmptyCloud => ReagentStatus::TargetEmpty,
            ReagentStatus::TooFewPoints => ReagentStatus::TargetTooFewPoints,
            ReagentStatus::TooManyPoints => ReagentStatus::TargetTooManyPoints,
            ReagentStatus::NotFinite => ReagentStatus::TargetNotFinite,
            other => other,
        }
    }
}

/// One for each number of a [`ReagentStatus`].
const TEXTS: [&CStr; 28] = [
    c"done",
    c"a pointer is null or not aligned",
    c"the memory is not initialised: call reagent_init first",
    c"no target or no source is set: call reagent_set_target, then reagent_set_source or reagent_begin",
    c"the source is empty: give at least 3 points",
    c"the source has fewer than 3 points: give at least 3",
    c"the source has more than 4096 points: subsample it",
    c"the source, the grid or an origin has a coordinate that is NaN, infinite or beyond 1e12: drop invalid points first",
    c"all points of a cloud coincide, or nearly: there is nothing to align",
    c"the initial pose is not a rigid transform, or its translation is beyond 1e12: give a rotation without scale",
    c"the weights are cut, or bytes follow their end: check the length",
    c"the weights are not a policy file (.rgw)",
    c"this library cannot run weights of this version, number format or shape: export them again",
    c"the weights are damaged: fetch them again",
    c"the weights do not start on a 4-byte boundary: align the array, or copy it",
    c"the call was refused for another reason: is the library older than its weights?",
    c"the target is empty: give at least 3 points",
    c"the target has fewer than 3 points: give at least 3",
    c"the target has more than 4096 points: subsample it",
    c"the target has a coordinate that is NaN, infinite or beyond 1e12: drop invalid points first",
    c"the view point has a coordinate that is NaN, infinite or beyond 1e12: give the sensor's place in the source's frame",
    c"a standard deviation of the start is negative or NaN: give 0 or more",
    c"the task's mode is none of ReagentMode: begin with reagent_task()",
    c"the task's model is not prepared: call reagent_prepare first",
    c"the task's background has more than 4096 points: leave some out",
    c"the grid's step is 0 or negative: reagent_grid_of makes a grid",
    c"the task's outward directions are not as many as the target's points: give one for each, or none",
    c"the depth image has no pixels, or its camera's focal lengths are not positive numbers: give fx, fy, cx and cy in pixels",
];

/// An English sentence that says what a status means and what to do; it lives as long as the program.
#[unsafe(no_mangle)]
pub extern "C" fn reagent_status_text(status: i32) -> *const c_char {
    let text = usize::try_from(status).ok().and_then(|at| TEXTS.get(at));
    text.unwrap_or(&c"not a status of this library").as_ptr()
}

impl From<Error> for ReagentStatus {
    fn from(error: Error) -> Self {
        match error {
            Error::EmptyCloud => ReagentStatus::EmptyCloud,
            Error::TooFewPoints { .. } => ReagentStatus::TooFewPoints,
            Error::TooManyPoints { .. } => ReagentStatus::TooManyPoints,
            Error::NotFinite { .. } | Error::OutOfRange { .. } => ReagentStatus::NotFinite,
            Error::NoExtent | Error::TooSmall => ReagentStatus::NoExtent,
            Error::NotStarted => ReagentStatus::NotStarted,
            Error::BadPose => ReagentStatus::BadPose,
            Error::BadViewPoint => ReagentStatus::BadViewPoint,
            Error::BadUncertainty => ReagentStatus::BadUncertainty,
            Error::WeightsLength { .. } => ReagentStatus::WeightsLength,
            Error::WeightsMagic => ReagentStatus::WeightsMagic,
            Error::WeightsVersion { .. }
            | Error::WeightsFormat { .. }
            | Error::WeightsDecision { .. }
            | Error::WeightsShape { .. } => ReagentStatus::WeightsFormat,
            Error::WeightsCrc | Error::WeightsNotFinite { .. } | Error::WeightsRange { .. } => {
                ReagentStatus::WeightsDamaged
            }
            Error::WeightsAlignment => ReagentStatus::WeightsAlignment,
            _ => ReagentStatus::Other,
        }
    }
}

/// The status that a call returns.
pub(crate) fn status(outcome: Result<(), ReagentStatus>) -> ReagentStatus {
    outcome.err().unwrap_or(ReagentStatus::Ok)
}
