//! Refinement of a pose by closest points: a few robust steps that make the distances between both surfaces
//! small, seen from both.
//!
//! | stage | what |
//! |---|---|
//! | prepare, once | both clouds in spatial order, normals from moments of neighbourhoods ([`Refiner::new`]) |
//! | match | each point of either cloud with the nearest of the other, exactly |
//! | weigh | Tukey's weight of the distance; it ends at a multiple of the median distance, which shrinks as the pose gets better |
//! | step | one Gauss-Newton step of the symmetric point-to-plane distance (Rusinkiewicz 2019), along the sum of both normals |
//! | finish | the same with a share of the distance between the points themselves: it fixes what planes leave free, and finds points that both clouds share |
//!
//! Everything is f32 in a fixed order (normal equations and their solution in f64), without fused multiply-add,
//! without the system's mathematics: the same bits on every kernel and target.

use crate::error::Error;
use crate::kernels::Isa;
use crate::pose::{Pose, centroid};
use crate::register::{Frame, check_cloud};
use crate::solve::{Motion, Rigid, least};
use crate::surface::{Match, Surface};
use glam::Vec3;

/// Working memory of a [`Refiner`], [`crate::dims::WORKSPACE_BYTES`]; the caller owns it.
#[derive(Clone, Debug)]
pub struct Workspace {
    source: Surface,
    target: Surface,
}

impl Workspace {
    /// Empty working memory.
    pub const fn new() -> Self {
        Workspace {
            source: Surface::EMPTY,
            target: Surface::EMPTY,
        }
    }
}

impl Default for Workspace {
    fn default() -> Self {
        Self::new()
    }
}

/// How far two clouds are apart under a pose, each in its own way: mean over the points of `d² / (d² + c²)`, `d`
/// being the distance to the nearest point of the other cloud and `c` two fifths of the radius that
/// holds 24 of its points. 0 for equal clouds, about .17 for two samples of one surface, 1 for clouds that
/// have nothing in common; a part that the other cloud lacks adds its share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Residual {
    /// Of the source's points, to the target.
    pub source: f32,
    /// Of the target's points, to the source.
    pub target: f32,
}

impl Residual {
    /// Both ways.
    pub fn mean(&self) -> f32 {
        0.5 * (self.source + self.target)
    }
}

/// A pose and how it fits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refined {
    /// Plain rigid transform, in the clouds' own units.
    pub target_from_source: Pose,
    /// Distance between the clouds under it.
    pub residual: Residual,
    /// How well the planes matched fix a turn about the axis about which they fix it least, as a share of all axes:
    /// up to a third, near 0 for a surface of revolution.
    pub grip: f32,
    /// Steps made.
    pub iterations: usize,
}

/// A pose in the refiner's frame, and how it fits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Candidate {
    pub(crate) at: Rigid,
    pub(crate) residual: Residual,
    pub(crate) grip: f32,
    pub(crate) iterations: usize,
}

/// Steps of one kind.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stage {
    /// Steps at most.
    pub(crate) iterations: usize,
    /// Points of each cloud that are matched, about.
    pub(crate) points: usize,
    /// Distance from which a match has no weight, in median distances.
    pub(crate) gate: f32,
    /// Weight of the distance between points beside that between planes.
    pub(crate) tangential: f32,
    /// A turn (radians) and shift below this end the stage.
    pub(crate) stop: f32,
}

/// Draws near from where a policy ends.
const NEAR: Stage = Stage {
    iterations: 12,
    points: 512,
    gate: 4.0,
    tangential: 0.0,
    stop: 3e-4,
};
/// Finishes.
const FINE: Stage = Stage {
    iterations: 10,
    points: usize::MAX,
    gate: 3.0,
    tangential: 0.3,
    stop: 1e-4,
};
/// Share of the equations' trace that is added to their diagonal.
const RIDGE: f64 = 1e-7;
/// A match closer than this always counts, in radii of a neighbourhood.
const LEAST_GATE: f32 = 0.02;
/// Scale of a [`Residual`], in radii of a neighbourhood.
pub(crate) const RESIDUAL_SCALE: f32 = 0.4;

/// Two clouds, prepared to be refined and compared.
#[derive(Debug)]
pub struct Refiner<'w> {
    isa: Isa,
    workspace: &'w mut Workspace,
    /// Centroids of the clouds and the target's scale: the frame of everything inside.
    source_centre: Vec3,
    target: Frame,
}

impl<'w> Refiner<'w> {
    /// Prepares two clouds on the fastest kernels of this machine.
    ///
    /// # Shapes
    /// `source [N, 3]`, `target [M, 3]`; of more than [`crate::dims::SURFACE_POINTS`] so many are used.
    ///
    /// # Errors
    /// As [`check_cloud`] and [`Frame::of`].
    pub fn new(
        source: &[[f32; 3]],
        target: &[[f32; 3]],
        workspace: &'w mut Workspace,
    ) -> Result<Self, Error> {
        Self::with_isa(Isa::best(), source, target, workspace)
    }

    /// As [`Self::new`], on given kernels.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_isa(
        isa: Isa,
        source: &[[f32; 3]],
        target: &[[f32; 3]],
        workspace: &'w mut Workspace,
    ) -> Result<Self, Error> {
        check_cloud(source)?;
        let frame = Frame::of(target)?;
        let source_centre = centroid(source);
        let factor = 1.0 / frame.scale;
        workspace.source.fill(isa, source, source_centre, factor);
        workspace.target.fill(isa, target, frame.centre, factor);
        Ok(Refiner {
            isa,
            workspace,
            source_centre,
            target: frame,
        })
    }

    /// How a pose fits.
    ///
    /// # Errors
    /// [`Error::BadPose`] for one that is not rigid.
    pub fn residual(&mut self, target_from_source: Pose) -> Result<Residual, Error> {
        let at = self.inside(target_from_source.checked()?);
        self.match_both(at, usize::MAX);
        Ok(self.matched_residual(RESIDUAL_SCALE))
    }

    /// Refines a pose; the result fits no worse. At most 22 steps.
    ///
    /// # Errors
    /// [`Error::BadPose`] for an initial pose that is not rigid.
    pub fn polish(&mut self, initial: Pose) -> Result<Refined, Error> {
        let at = self.inside(initial.checked()?);
        let found = self.polish_inside(at);
        Ok(self.refined(&found, initial))
    }

    /// [`Self::polish`] in this frame.
    pub(crate) fn polish_inside(&mut self, initial: Rigid) -> Candidate {
        self.match_both(initial, usize::MAX);
        let before = self.matched_residual(RESIDUAL_SCALE);
        let (near, steps) = self.run(initial, &NEAR);
        let (at, more) = self.run(near, &FINE);
        self.match_both(at, usize::MAX);
        let residual = self.matched_residual(RESIDUAL_SCALE);
        let iterations = steps + more;
        let better = residual.mean() <= before.mean();
        let (at, residual) = if better {
            (at, residual)
        } else {
            self.match_both(initial, usize::MAX);
            (initial, before)
        };
        let (_, grip) = least(self.equations(at, &NEAR).turning());
        Candidate {
            at,
            residual,
            grip,
            iterations,
        }
    }

    /// The candidate in the user's frame; exactly `initial` where it is that.
    pub(crate) fn refined(&self, candidate: &Candidate, initial: Pose) -> Refined {
        let unmoved = candidate.at == self.inside(initial);
        Refined {
            target_from_source: if unmoved {
                initial
            } else {
                self.outside(candidate.at)
            },
            residual: candidate.residual,
            grip: candidate.grip,
            iterations: candidate.iterations,
        }
    }

    /// Steps of a stage, and how many.
    pub(crate) fn run(&mut self, initial: Rigid, stage: &Stage) -> (Rigid, usize) {
        let mut at = initial;
        for i in 0..stage.iterations {
            self.match_both(at, stage.points);
            let (turn, shift) = self.equations(at, stage).solve(RIDGE);
            at = at.moved(turn, shift);
            if turn.length_squared().max(shift.length_squared()) < stage.stop * stage.stop {
                return (at, i + 1);
            }
        }
        (at, stage.iterations)
    }

    /// The axis, through the target's centre, about which the planes matched under a pose fix a turn least.
    pub(crate) fn slippery_axis(&mut self, at: Rigid) -> Vec3 {
        self.match_both(at, NEAR.points);
        let (axis, _) = least(self.equations(at, &NEAR).turning());
        if axis == Vec3::ZERO { Vec3::Z } else { axis }
    }

    /// Matches about `points` of each cloud with all of the other.
    pub(crate) fn match_both(&mut self, at: Rigid, points: usize) {
        let Workspace { source, target } = &mut *self.workspace;
        let pose = at.pose();
        let every = |surface: &Surface| surface.points().len() / points.max(1);
        let (every_s, every_t) = (every(source), every(target));
        source.match_to(self.isa, target, pose, every_s);
        target.match_to(self.isa, source, pose.inverse(), every_t);
    }

    /// Residual of the points matched last; `scale` in radii of a neighbourhood.
    pub(crate) fn matched_residual(&self, scale: f32) -> Residual {
        let Workspace { source, target } = &*self.workspace;
        let of = |surface: &Surface, other: &Surface| {
            let c = scale * other.radius;
            let squared_scale = (c * c).max(1e-12);
            let (mut sum, mut count) = (0.0f64, 0u32);
            for found in surface.matches() {
                sum += f64::from(found.squared / (found.squared + squared_scale));
                count += 1;
            }
            (sum / f64::from(count.max(1))) as f32
        };
        Residual {
            source: of(source, target),
            target: of(target, source),
        }
    }

    /// Normal equations of the points matched last.
    fn equations(&mut self, at: Rigid, stage: &Stage) -> Motion {
        let Workspace { source, target } = &mut *self.workspace;
        let median = 0.5 * (source.median_squared() + target.median_squared());
        let least = LEAST_GATE * source.radius.max(target.radius);
        let gate = (stage.gate * stage.gate * median)
            .max(least * least)
            .max(1e-12);
        let pose = at.pose();
        let mut motion = Motion::ZERO;
        let mut add = |i: usize, j: usize, squared: f32| {
            let share = 1.0 - squared / gate;
            if share <= 0.0 {
                return;
            }
            let weight = share * share;
            let ((p, m), (q, n)) = (source.at(i), target.at(j));
            let (p, m) = (pose.apply(p), pose.rotation * m);
            let sum = if m.dot(n) < 0.0 { n - m } else { n + m };
            let normal = sum * (1.0 / libm::sqrtf(sum.length_squared().max(1e-6)));
            let (middle, apart) = ((p + q) * 0.5, p - q);
            motion.add(middle, normal, normal.dot(apart), weight);
            if stage.tangential > 0.0 {
                motion.add_point(middle, apart, weight * stage.tangential);
            }
        };
        let forward = source.matches();
        forward.for_each(|Match { of, to, squared }| add(of, to, squared));
        let backward = target.matches();
        backward.for_each(|Match { of, to, squared }| add(to, of, squared));
        motion
    }

    /// A plain pose between the user's clouds as one between those inside.
    pub(crate) fn inside(&self, pose: Pose) -> Rigid {
        let centre = pose.apply(self.source_centre) - self.target.centre;
        Rigid::new(pose.rotation, centre * (1.0 / self.target.scale))
    }

    fn outside(&self, at: Rigid) -> Pose {
        let rotation = at.turn.matrix();
        let centre = at.shift * self.target.scale + self.target.centre;
        Pose {
            rotation,
            translation: centre - rotation * self.source_centre,
        }
    }

    /// Both surfaces, source first.
    pub(crate) fn surfaces(&self) -> [&Surface; 2] {
        [&self.workspace.source, &self.workspace.target]
    }
}

#[cfg(test)]
pub(crate) mod tests;
