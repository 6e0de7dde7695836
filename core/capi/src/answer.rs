//! The pose, and what can be said about it.

use crate::register::ReagentPose;
use reagent_core::pipeline::Refinement;
use reagent_core::verify::OTHERS;
use reagent_core::{Pose, Verdict};

/// What can be said about a pose.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ReagentVerdict {
    /// The clouds fit so well that the pose is probably right; without refinement: the policy saw nothing left to correct.
    Converged = 0,
    /// The steps ran out while the policy still moved, or nothing was done.
    #[default]
    StepLimit = 1,
    /// The steps ran out while the policy went back and forth.
    Oscillating = 2,
    /// The steps ran out while the policy still took the largest steps: the pose is farther away than the steps reach.
    OutOfRange = 3,
    /// The clouds do not fit: the pose is probably wrong.
    PoorFit = 4,
    /// One cloud is several times as large as the other, by extents_ratio; perhaps inches against millimetres.
    SizesDiffer = 5,
    /// One cloud has too few distinct points for any pose to be trusted.
    TooFewPoints = 6,
    /// The mirror image of the source fits better: a left-hand part for a
    /// right-hand one, a reversed axis, or a wrong pose of a symmetric shape.
    Mirrored = 7,
}

impl From<Verdict> for ReagentVerdict {
    fn from(verdict: Verdict) -> Self {
        match verdict {
            Verdict::Converged => ReagentVerdict::Converged,
            Verdict::StepLimit => ReagentVerdict::StepLimit,
            Verdict::Oscillating => ReagentVerdict::Oscillating,
            Verdict::OutOfRange => ReagentVerdict::OutOfRange,
            Verdict::PoorFit => ReagentVerdict::PoorFit,
            Verdict::SizesDiffer => ReagentVerdict::SizesDiffer,
            Verdict::TooFewPoints => ReagentVerdict::TooFewPoints,
            Verdict::Mirrored => ReagentVerdict::Mirrored,
        }
    }
}

/// Most poses that an answer lists as fitting equally well.
pub const REAGENT_OTHERS: usize = 5;

const _: () = assert!(REAGENT_OTHERS == OTHERS);

/// The pose, and what can be said about it. All but pose, verdict and steps describe a refined pose; in mode FAST they are 0.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReagentAnswer {
    /// The pose.
    pub target_from_source: ReagentPose,
    /// What can be said about it.
    pub verdict: ReagentVerdict,
    /// Number of steps that the policy took.
    pub steps: u32,
    /// Whether the pose was refined.
    pub refined: bool,
    /// Probability that the pose is within 5 degrees and .05 target radii of the truth, or not to be told from it (ADI below
    /// .02 diameters), up to what is undetermined; 0 in mode FAST, else at most .9999.
    pub probability: f32,
    /// Share of the source's points that lie on the target's surface.
    pub overlap: f32,
    /// RMS distance of those points from it, in the clouds' unit.
    pub inlier_rmse: f32,
    /// Size of the source over that of the target.
    pub extents_ratio: f32,
    /// Distinct points of the cloud that has fewer of them.
    pub distinct_points: u32,
    /// Shares of the source's and of the target's points left out because they lie far from all others.
    pub left_out: [f32; 2],
    /// Share of the target's points behind which something was seen, so that they cannot be there; 0 where nothing
    /// besides the source was seen.
    pub seen_through: f32,
    /// Whether the clouds fit as well turned about an axis. Modes POLISH and REFINE look for it
    /// only where the surface hardly holds it; in mode FAST it is false.
    pub axis_is_open: bool,
    /// A point of the axis, in the target's frame and unit.
    pub axis_point: [f32; 3],
    /// Unit vector along the axis.
    pub axis_direction: [f32; 3],
    /// Smallest (not positive) and largest (not negative) right-handed turn about it at which they fit as well, in radians.
    pub axis_range_rad: [f32; 2],
    /// Whether the clouds fit as well shifted along a direction. Only
    /// mode VERIFY looks for it: in other modes it is always false.
    pub slide_is_open: bool,
    /// Unit vector along that direction, in the target's frame.
    pub slide_direction: [f32; 3],
    /// Smallest (not positive) and largest (not negative) shift along it that fit as well, in the target's unit.
    pub slide_range: [f32; 2],
    /// Whether the axis may have any direction, since the target is a ball.
    pub any_rotation: bool,
    /// Not 0: turned about another axis by any multiple of a full turn over this number, the clouds fit as well, as a flange with
    /// six holes does for 6. Only mode VERIFY looks for it: in other modes it is always 0.
    pub fold_order: u32,
    /// A point of that axis, in the target's frame and unit.
    pub fold_point: [f32; 3],
    /// Unit vector along it.
    pub fold_direction: [f32; 3],
    /// How many other poses are listed that fit as well, fewer than there are if there are more than REAGENT_OTHERS.
    /// Only mode VERIFY looks for them: in the other modes it is always 0.
    pub others: u32,
    /// The other poses, those first that the fold makes of the given one.
    pub other_poses: [ReagentPose; REAGENT_OTHERS],
    /// Covariance of the pose's error if it is the right pose: of a rotation vector in radians,
    /// then of a translation in the clouds' unit, both along the target's axes. A point that
    /// the pose puts at x, the truth puts at c + exp(rotation) (x - c) + translation.
    pub covariance: [[f32; 6]; 6],
    /// The point c: the target's centroid, or the point of an open axis nearest to it.
    pub covariance_about: [f32; 3],
}

impl ReagentAnswer {
    pub(crate) fn of(
        pose: Pose,
        verdict: Verdict,
        steps: usize,
        refinement: Option<&Refinement>,
    ) -> ReagentAnswer {
        let mut answer = ReagentAnswer {
            target_from_source: pose.into(),
            verdict: verdict.into(),
            steps: steps as u32,
            ..ReagentAnswer::default()
        };
        if let Some(found) = refinement {
            answer.fill(found);
        }
        answer
    }

    fn fill(&mut self, found: &Refinement) {
        self.refined = true;
        self.probability = found.evidence.probability();
        self.overlap = found.refined.overlap;
        self.inlier_rmse = found.refined.inlier_rmse;
        self.extents_ratio = found.refined.extents_ratio;
        self.distinct_points = found.refined.distinct_points as u32;
        self.left_out = found.refined.left_out;
        self.seen_through = found.refined.seen_through;
        if let Some(axis) = found.undetermined.axis {
            self.axis_is_open = true;
            self.axis_point = axis.point.to_array();
            self.axis_direction = axis.direction.to_array();
            self.axis_range_rad = axis.range_rad;
        }
        if let Some(slide) = found.undetermined.slide {
            self.slide_is_open = true;
            self.slide_direction = slide.direction.to_array();
            self.slide_range = slide.range;
        }
        self.any_rotation = found.undetermined.any_rotation;
        if let Some(fold) = found.undetermined.fold {
            self.fold_order = u32::from(fold.order);
            self.fold_point = fold.point.to_array();
            self.fold_direction = fold.direction.to_array();
        }
        self.covariance = found.refined.covariance.matrix;
        self.covariance_about = found.refined.covariance.about.to_array();
        let given = found.refined.target_from_source;
        let others = found.undetermined.copies(given);
        for (place, pose) in self.other_poses.iter_mut().zip(others) {
            *place = pose.into();
            self.others += 1;
        }
    }
}
