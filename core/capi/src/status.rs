//! Errors as numbers.

use reagent_core::Error;

/// What came of a call. Whatever is not OK has changed nothing.
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
    /// A cloud has no points.
    EmptyCloud = 4,
    /// A cloud has fewer than 3 points.
    TooFewPoints = 5,
    /// A cloud has more than 4096 points.
    TooManyPoints = 6,
    /// A coordinate is NaN or infinite.
    NotFinite = 7,
    /// All points of the target coincide.
    NoExtent = 8,
    /// The initial pose is not a finite rigid transform.
    BadPose = 9,
    /// The weights are cut, or bytes follow their end.
    WeightsLength = 10,
    /// The bytes are no weight file.
    WeightsMagic = 11,
    /// The weight file is of a version, number format or shape that this library does not run.
    WeightsFormat = 12,
    /// The weights are damaged.
    WeightsDamaged = 13,
    /// The weights do not start on a 4-byte boundary.
    WeightsAlignment = 14,
    /// Anything else.
    Other = 15,
}

impl From<Error> for ReagentStatus {
    fn from(error: Error) -> Self {
        match error {
            Error::EmptyCloud => ReagentStatus::EmptyCloud,
            Error::TooFewPoints { .. } => ReagentStatus::TooFewPoints,
            Error::TooManyPoints { .. } => ReagentStatus::TooManyPoints,
            Error::NotFinite { .. } => ReagentStatus::NotFinite,
            Error::NoExtent => ReagentStatus::NoExtent,
            Error::BadPose => ReagentStatus::BadPose,
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

/// What a call returns.
pub(crate) fn status(outcome: Result<(), ReagentStatus>) -> ReagentStatus {
    outcome.err().unwrap_or(ReagentStatus::Ok)
}
