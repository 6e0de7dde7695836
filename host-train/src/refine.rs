//! What follows a policy: core's polishing and verification, with a verdict.

use crate::dataset::Point;
use reagent_core::polish::{Refined, Refiner, Workspace};
use reagent_core::verdict::Evidence;
use reagent_core::{Error, Pose};

/// What happens after the policy's steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Mode {
    /// Nothing: the policy alone, as the paper has it
    Fast,
    /// A few robust steps of closest points
    Polish,
    /// The same, and comparison with other poses where the clouds do not fit as two samples of one surface do
    Verify,
}

/// A refined pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refinement {
    /// The pose and how it fits.
    pub refined: Refined,
    /// The initial pose, polished.
    pub polished: Refined,
    /// Other poses that were tried, if the mode tries any.
    pub hypotheses: Option<usize>,
    /// What speaks for the pose and against it.
    pub evidence: Evidence,
}

/// Refines a pose as the mode says; `None` for [`Mode::Fast`].
///
/// # Errors
/// Clouds or an initial pose that the core refuses.
pub fn refine(
    source: &[Point],
    target: &[Point],
    initial: Pose,
    mode: Mode,
    workspace: &mut Workspace,
) -> Result<Option<Refinement>, Error> {
    if mode == Mode::Fast {
        return Ok(None);
    }
    let mut refiner = Refiner::new(source, target, workspace)?;
    if mode == Mode::Polish {
        let polished = refiner.polish(initial)?;
        return Ok(Some(Refinement {
            refined: polished,
            polished,
            hypotheses: None,
            evidence: Evidence::polished(&polished),
        }));
    }
    let found = refiner.verify(initial)?;
    Ok(Some(Refinement {
        refined: found.best,
        polished: found.polished,
        hypotheses: Some(found.hypotheses),
        evidence: Evidence::verified(&found),
    }))
}
