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

use crate::covariance::Covariance;
use crate::error::Error;
use crate::frame::{Frame, check_cloud};
use crate::freespace::DepthGrid;
use crate::kernels::{Isa, PAIRS, Pairs, Sums, Weighing};
use crate::loss::{self, Losses};
use crate::nearest::Lookup;
use crate::pose::{Pose, mean};
use crate::solve::{Motion, Rigid, least};
use crate::surface::Surface;
use glam::Vec3;

mod coarse;

/// Working memory of a [`Refiner`], [`crate::budget::WORKSPACE_BYTES`]; the caller owns it.
#[derive(Clone, Debug)]
pub struct Workspace {
    /// Kernels of the refiners that work in it; the fastest unless told otherwise.
    isa: Option<Isa>,
    source: Surface,
    target: Surface,
    lookup: Lookup,
    pub(crate) losses: Losses,
    pub(crate) seen: DepthGrid,
}

impl Workspace {
    /// Empty working memory.
    pub const fn new() -> Self {
        Workspace {
            isa: None,
            source: Surface::EMPTY,
            target: Surface::EMPTY,
            lookup: Lookup::EMPTY,
            losses: Losses::EMPTY,
            seen: DepthGrid::EMPTY,
        }
    }

    /// The same for given kernels.
    pub const fn with_isa(isa: Isa) -> Self {
        let mut workspace = Workspace::new();
        workspace.isa = Some(isa);
        workspace
    }
}

impl Default for Workspace {
    fn default() -> Self {
        Self::new()
    }
}

/// How far two clouds are apart under a pose, each in its own way: mean over the points of a loss that is 0 for a
/// point on the other cloud's surface and 1 for a point near nothing of it. 0 for equal clouds, about .4
/// for two samples of one noisy surface, 1 for clouds that have nothing in common; a part that the other cloud lacks adds its
/// share.
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
    /// Distance between the clouds under it. A view point changes nothing in it: what it tells chooses between poses.
    pub residual: Residual,
    /// How well the planes matched fix a turn about the axis about which they fix it least, as a share of all axes:
    /// up to a third, near 0 for a surface of revolution.
    pub rotation_constraint: f32,
    /// Share of the source's points that lie on the target's surface.
    pub overlap: f32,
    /// Share of them that lie near it, three times as far at most: low where there is something else, not only noise.
    pub near: f32,
    /// Share of them that lie within a neighbourhood's radius of it.
    pub within: f32,
    /// Root of the mean squared distance of those on the surface from it, in the clouds' own units.
    pub inlier_rmse: f32,
    /// Points that differ from all others, in the cloud with fewer of them.
    pub distinct_points: usize,
    /// Size of the source over that of the target, each the distance from the centroid that nine in ten points keep.
    pub extents_ratio: f32,
    /// Shares of the source's and of the target's points that were left out, since they lie far from all others.
    pub left_out: [f32; 2],
    /// Steps made.
    pub iterations: usize,
    /// How uncertain the pose is, if it is right.
    pub covariance: Covariance,
}

/// How much of the source lies on the target's surface: see [`Refined`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Overlap {
    on_surface: f32,
    near: f32,
    within: f32,
    inlier_rmse: f32,
}

/// A pose in the refiner's frame, and how it fits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Candidate {
    pub(crate) at: Rigid,
    pub(crate) residual: Residual,
    pub(crate) rotation_constraint: f32,
    pub(crate) overlap: Overlap,
    pub(crate) iterations: usize,
}

impl Candidate {
    /// Whether its steps ended because they moved nothing any more.
    pub(crate) fn is_settled(&self) -> bool {
        self.iterations < NEAR.iterations + FINE.iterations
    }
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
    /// The same at most, in radii of a neighbourhood.
    pub(crate) widest: f32,
    /// Weight of the distance between points beside that between planes.
    pub(crate) tangential: f32,
}

impl Stage {
    /// Squared distance from which a match has no weight, by the median squared distance.
    fn gate(&self, median: f32, radius: f32) -> f32 {
        let (least, widest) = (LEAST_GATE * radius, self.widest * radius);
        (self.gate * self.gate * median)
            .max(least * least)
            .min(widest * widest)
            .max(1e-12)
    }
}

/// Draws near from where a policy ends.
const NEAR: Stage = Stage {
    iterations: 12,
    points: 512,
    gate: 4.0,
    widest: f32::INFINITY,
    tangential: 0.0,
};
/// Finishes.
const FINE: Stage = Stage {
    iterations: 10,
    points: usize::MAX,
    gate: 3.0,
    widest: WIDEST_GATE,
    tangential: 0.2,
};
/// The same for a hypothesis that is to be compared with others.
const BRIEF_NEAR: Stage = Stage {
    iterations: 6,
    points: 256,
    ..NEAR
};
const BRIEF_FINE: Stage = Stage {
    iterations: 4,
    points: 384,
    ..FINE
};
/// Share of the source's points in a comparison of poses: the target often has sides that the source does not show.
const SOURCE_SHARE: f32 = 0.8;
/// Loss of a target's point that was not seen and need not have been, of that of one that would have hidden what was.
const UNSEEN: f32 = 0.5;
/// Share of the equations' trace that is added to their diagonal.
const RIDGE: f64 = 1e-7;
/// A turn (radians) and shift below this end a stage.
const STOP: f32 = 3e-4;
/// A match closer than this always counts, in radii of a neighbourhood.
const LEAST_GATE: f32 = 0.02;
/// Widest gate of the last steps, in radii of a neighbourhood: where clouds overlap in part, the median is that of
/// points without a counterpart.
const WIDEST_GATE: f32 = 0.4;

/// Distance from which a point is near nothing of a surface, in radii of a neighbourhood: its loss is 1 anyway.
const NEAR_NOTHING: f32 = 1.0;

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
    /// Prepares two clouds on the workspace's kernels.
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
        let isa = workspace.isa.unwrap_or_else(Isa::best);
        Self::with_isa(isa, source, target, workspace)
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
        check_cloud(target)?;
        let bulk_of_source = workspace.source.bulk(source);
        let bulk_of_target = workspace.target.bulk(target);
        let frame = Frame::of_points(bulk_of_target.kept(target))?;
        let source_centre = mean(bulk_of_source.kept(source));
        let factor = 1.0 / frame.scale;
        let Workspace {
            source: seen,
            target: model,
            ..
        } = &mut *workspace;
        seen.fill(isa, source, bulk_of_source, source_centre, factor);
        model.fill(isa, target, bulk_of_target, frame.centre, factor);
        workspace.lookup.fill(isa, &workspace.target);
        workspace.seen = DepthGrid::EMPTY;
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
        self.match_all(at);
        Ok(self.matched_residual(at))
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

    /// A few steps on some of the points, to compare with others.
    pub(crate) fn polish_briefly(&mut self, initial: Rigid) -> Rigid {
        let (near, _) = self.run(initial, &BRIEF_NEAR);
        self.run(near, &BRIEF_FINE).0
    }

    /// [`Self::polish`] in this frame.
    pub(crate) fn polish_inside(&mut self, initial: Rigid) -> Candidate {
        self.match_all(initial);
        let before = self.matched_residual(initial);
        let (near, steps) = self.run(initial, &NEAR);
        let (at, more) = self.run(near, &FINE);
        self.match_all(at);
        let residual = self.matched_residual(at);
        let iterations = steps + more;
        let better = residual.mean() <= before.mean();
        let at = if better {
            at
        } else {
            self.match_all(initial);
            initial
        };
        let overlap = self.matched_overlap(at);
        Candidate {
            at,
            residual: self.matched_residual_of(at, &DepthGrid::EMPTY),
            overlap,
            rotation_constraint: self.least_constraint(at).1,
            iterations,
        }
    }

    /// The candidate in the user's frame; exactly `initial` where it is that.
    pub(crate) fn refined(&mut self, candidate: &Candidate, initial: Pose) -> Refined {
        let unmoved = candidate.at == self.inside(initial);
        Refined {
            target_from_source: if unmoved {
                initial
            } else {
                self.outside(candidate.at)
            },
            residual: candidate.residual,
            rotation_constraint: candidate.rotation_constraint,
            overlap: candidate.overlap.on_surface,
            near: candidate.overlap.near,
            within: candidate.overlap.within,
            inlier_rmse: candidate.overlap.inlier_rmse * self.target.scale,
            distinct_points: self.distinct_points(),
            extents_ratio: self.extents_ratio(),
            left_out: self.surfaces().map(|surface| surface.left_out),
            iterations: candidate.iterations,
            covariance: self.covariance(candidate.at),
        }
    }

    /// Steps of a stage, and how many.
    pub(crate) fn run(&mut self, initial: Rigid, stage: &Stage) -> (Rigid, usize) {
        let mut at = initial;
        for i in 0..stage.iterations {
            let (turn, shift) = self.matched_equations(at, stage).solve(RIDGE);
            at = at.moved(turn, shift);
            if turn.length_squared().max(shift.length_squared()) < STOP * STOP {
                return (at, i + 1);
            }
        }
        (at, stage.iterations)
    }

    /// The axis, through the target's centre, about which the planes matched under a pose fix a turn least, and how well
    /// ([`Refined::rotation_constraint`]).
    pub(crate) fn least_constraint(&mut self, at: Rigid) -> (Vec3, f32) {
        let (axis, constraint) = least(self.matched_equations(at, &NEAR).turning());
        (if axis == Vec3::ZERO { Vec3::Z } else { axis }, constraint)
    }

    /// Matches every point of each cloud with all of the other, however far.
    fn match_all(&mut self, at: Rigid) {
        let Workspace { source, target, .. } = &mut *self.workspace;
        let pose = at.pose();
        source.match_to(self.isa, target, pose, 1, f32::INFINITY);
        target.match_to(self.isa, source, pose.inverse(), 1, f32::INFINITY);
    }

    /// Matches about `points` of each cloud with all of the other; one that is near nothing, with any.
    pub(crate) fn match_both(&mut self, at: Rigid, points: usize) {
        let Workspace { source, target, .. } = &mut *self.workspace;
        let (pose, [every_s, every_t]) = (at.pose(), every(points, source, target));
        let [near_target, near_source] = [&*target, &*source]
            .map(|other| (NEAR_NOTHING * other.radius) * (NEAR_NOTHING * other.radius));
        source.match_to(self.isa, target, pose, every_s, near_target);
        target.match_to(self.isa, source, pose.inverse(), every_t, near_source);
    }

    /// The same for a stage's steps, and the squared distance from which a match has no weight: only those nearer are the
    /// nearest for certain.
    fn match_within_gate(&mut self, at: Rigid, stage: &Stage) -> f32 {
        let Workspace { source, target, .. } = &mut *self.workspace;
        let (pose, [every_s, every_t]) = (at.pose(), every(stage.points, source, target));
        let radius = source.radius.max(target.radius);
        let back = pose.inverse();
        // A median is at most what it was by the last matches, and so is the gate.
        let gate = stage.gate(source.largest_median(target, pose, every_s), radius);
        source.match_to(self.isa, target, pose, every_s, gate);
        let median = source.median_squared();
        let gate = stage.gate(
            target.largest_median(source, back, every_t).min(median),
            radius,
        );
        target.match_to(self.isa, source, back, every_t, gate);
        // Where one cloud shows a part of the other, its own points' median is that of the part.
        stage.gate(target.median_squared().min(median), radius)
    }

    /// Residual under the pose for which points were matched last, by what the view point tells.
    pub(crate) fn matched_residual(&self, at: Rigid) -> Residual {
        self.matched_residual_of(at, &self.workspace.seen)
    }

    fn matched_residual_of(&self, at: Rigid, seen: &DepthGrid) -> Residual {
        let Workspace { source, target, .. } = &*self.workspace;
        let [source, target] =
            matched_losses(source, target, seen, at, loss::of_match).map(|losses| {
                let (mut sum, mut count) = (0.0f64, 0u32);
                for loss in losses {
                    sum += f64::from(loss);
                    count += 1;
                }
                (sum / f64::from(count.max(1))) as f32
            });
        Residual { source, target }
    }

    /// How much of the source, matched last, lies on the target's surface.
    fn matched_overlap(&self, at: Rigid) -> Overlap {
        let Workspace { source, target, .. } = &*self.workspace;
        let pose = at.pose();
        let mut sum = 0.0f64;
        let [mut on_surface, mut near, mut within, mut count] = [0u32; 4];
        for found in source.matches() {
            let ((p, _), (q, n)) = (source.at(found.of), target.at(found.to));
            let apart = pose.apply(p) - q;
            count += 1;
            near += u32::from(loss::is_near_surface(apart, n, target.radius));
            within += u32::from(apart.length_squared() < target.radius * target.radius);
            if loss::is_on_surface(apart, n, target.radius) {
                let across = n.dot(apart);
                sum += f64::from(across * across);
                on_surface += 1;
            }
        }
        let share = |of: u32| (f64::from(of) / f64::from(count.max(1))) as f32;
        Overlap {
            on_surface: share(on_surface),
            near: share(near),
            within: share(within),
            inlier_rmse: libm::sqrt(sum / f64::from(on_surface.max(1))) as f32,
        }
    }

    /// Normal equations of a stage's step.
    fn matched_equations(&mut self, at: Rigid, stage: &Stage) -> Motion {
        let by = Weighing {
            gate: self.match_within_gate(at, stage),
            tangential: stage.tangential,
        };
        let [source, target] = self.surfaces();
        let mut matched = self.matched();
        let (pose, mut sums) = (at.pose(), Sums::ZERO);
        loop {
            let mut pairs = Pairs::ZERO;
            let count = fill(&mut pairs, &mut matched, source, target);
            if count == 0 {
                return Motion::of(&sums);
            }
            self.isa.see(&mut pairs, &pose);
            self.isa.equations(&pairs, by, count, &mut sums);
        }
    }

    /// Places in the source and in the target of the points matched last, both ways.
    fn matched(&self) -> impl Iterator<Item = (usize, usize)> {
        let [source, target] = self.surfaces();
        let forward = source.matches().map(|found| (found.of, found.to));
        forward.chain(target.matches().map(|found| (found.to, found.of)))
    }

    /// Normal equations of planes under a refined pose, summed in f64, and the weighted mean of their squared residuals.
    fn information(&mut self, at: Rigid) -> (Motion, f64) {
        let gate = self.match_within_gate(at, &FINE);
        let [source, target] = self.surfaces();
        let (pose, mut motion) = (at.pose(), Motion::ZERO);
        let (mut squares, mut weights) = (0.0f64, 0.0f64);
        for (i, j) in self.matched() {
            let ((p, m), (q, n)) = (source.at(i), target.at(j));
            let (p, m) = (pose.apply(p), pose.rotation * m);
            let (apart, middle) = (p - q, (p + q) * 0.5);
            let share = (1.0 - apart.length_squared() / gate).max(0.0);
            let normal = (if m.dot(n) < 0.0 { n - m } else { n + m }).normalize_or_zero();
            let across = normal.dot(apart);
            if share > 0.0 {
                motion.add(middle, normal, share * share);
                squares += f64::from(share * share * across * across);
                weights += f64::from(share * share);
            }
        }
        (motion, squares / weights.max(f64::MIN_POSITIVE))
    }

    /// How uncertain a refined pose is.
    fn covariance(&mut self, at: Rigid) -> Covariance {
        let (equations, variance) = self.information(at);
        Covariance::of(&equations, variance, self.target.centre, self.target.scale)
    }

    /// A plain pose between the user's clouds as one between those inside.
    pub(crate) fn inside(&self, pose: Pose) -> Rigid {
        let centre = pose.apply(self.source_centre) - self.target.centre;
        Rigid::new(pose.rotation, centre * (1.0 / self.target.scale))
    }

    pub(crate) fn outside(&self, at: Rigid) -> Pose {
        let rotation = at.turn.matrix();
        let centre = at.shift * self.target.scale + self.target.centre;
        Pose {
            rotation,
            translation: centre - rotation * self.source_centre,
        }
    }

    /// How many points differ from all others, in the cloud with fewer.
    fn distinct_points(&self) -> usize {
        let [source, target] = self.surfaces().map(|surface| surface.points().len());
        source.min(target)
    }

    /// Size of the source over that of the target: distance from the centroid that nine in ten points keep.
    fn extents_ratio(&mut self) -> f32 {
        let Workspace { source, target, .. } = &mut *self.workspace;
        source.extent() / target.extent().max(1e-30)
    }

    /// The target's centre, in its own units.
    pub(crate) fn target_centre(&self) -> Vec3 {
        self.target.centre
    }

    /// Says from where the source was seen, in its own frame: what would stand before what was seen counts against a
    /// pose, and what is hidden does not.
    pub fn seen_from(&mut self, view_point: Vec3) {
        self.seen_before(view_point, &[]);
    }

    /// The same with what was seen besides the source, `background [B, 3]` in its frame, such as the other pixels of a depth
    /// image: what would stand before that counts against a pose, too. What lies in the image farther from the source than its
    /// own width, or is no number, is not looked at.
    pub fn seen_before(&mut self, view_point: Vec3, background: &[[f32; 3]]) {
        let (centre, factor) = (self.source_centre, 1.0 / self.target.scale);
        let inside = |point: Vec3| (point - centre) * factor;
        let around = background.iter().map(|&p| inside(Vec3::from_array(p)));
        let Workspace { source, seen, .. } = &mut *self.workspace;
        seen.fill(source, inside(view_point), around);
    }

    /// Takes the source's mirror image in its place; twice is the same again.
    pub(crate) fn mirror_source(&mut self) {
        self.workspace.source.mirror();
        self.workspace.seen.mirror();
    }

    /// Towards which the sensor looks, in the source's frame.
    pub(crate) fn ahead(&self) -> Option<Vec3> {
        self.workspace.seen.ahead()
    }

    /// Losses that were kept.
    pub(crate) fn losses(&self) -> &Losses {
        &self.workspace.losses
    }

    /// The losses kept, to change.
    pub(crate) fn losses_mut(&mut self) -> &mut Losses {
        &mut self.workspace.losses
    }

    /// Keeps the losses of the points matched last; their sum, as of [`loss::COMPARED`] points of each cloud,
    /// and the mean of the source's.
    pub(crate) fn keep_matched_losses(&mut self, contender: usize, at: Rigid) -> [f32; 2] {
        self.keep_losses_by(contender, at, loss::of_match);
        let Residual { source, target } = self.matched_residual(at);
        let mean = SOURCE_SHARE * source + (1.0 - SOURCE_SHARE) * target;
        [mean * 2.0 * loss::COMPARED as f32, source]
    }

    /// Keeps how far the points matched last are from surfaces, and not from points: where those lie is chance.
    pub(crate) fn keep_matched_surface_losses(&mut self, contender: usize, at: Rigid) {
        let by = |apart, normal, radius| loss::of_surface(apart, normal, radius, loss::SURFACE);
        self.keep_losses_by(contender, at, by);
    }

    /// Keeps what the points matched last lose by such a loss.
    fn keep_losses_by(
        &mut self,
        contender: usize,
        at: Rigid,
        by: impl Fn(Vec3, Vec3, f32) -> f32 + Copy,
    ) {
        let Workspace {
            source,
            target,
            seen,
            losses,
            ..
        } = &mut *self.workspace;
        let [of_source, of_target] = matched_losses(source, target, seen, at, by);
        losses.keep(contender, of_source.chain(of_target));
    }

    /// Both surfaces, source first.
    pub(crate) fn surfaces(&self) -> [&Surface; 2] {
        [&self.workspace.source, &self.workspace.target]
    }
}

/// Every how many-th point of each surface are about so many.
fn every(points: usize, source: &Surface, target: &Surface) -> [usize; 2] {
    [source, target].map(|surface| surface.points().len() / points.max(1))
}

/// Losses of the points matched last, of the source and of the target. Where a view point is known the target's
/// are 1 for what stands in front of what was seen, and less than that for what only was not seen.
fn matched_losses<'a>(
    source: &'a Surface,
    target: &'a Surface,
    seen: &'a DepthGrid,
    at: Rigid,
    by: impl Fn(Vec3, Vec3, f32) -> f32 + Copy + 'a,
) -> [impl Iterator<Item = f32> + 'a; 2] {
    let there = at.pose();
    [
        (source, target, there, false),
        (target, source, there.inverse(), seen.is_known()),
    ]
    .map(|(surface, other, pose, sees)| {
        surface.matches().map(move |found| {
            let ((p, _), (q, n)) = (surface.at(found.of), other.at(found.to));
            let p = pose.apply(p);
            let loss = by(p - q, n, other.radius);
            match sees {
                true if seen.hides(p) => 1.0,
                true => UNSEEN * loss,
                false => loss,
            }
        })
    })
}

/// Sets pairs to the next matches of a place in the source and one in the target; how many there were.
fn fill(
    pairs: &mut Pairs,
    matched: &mut impl Iterator<Item = (usize, usize)>,
    source: &Surface,
    target: &Surface,
) -> usize {
    let Pairs { p, m, q, n } = pairs;
    let lanes = columns(p).zip(columns(m)).zip(columns(q).zip(columns(n)));
    let filled = lanes.zip(matched).map(|(((p, m), (q, n)), (i, j))| {
        set(p, m, source.at(i));
        set(q, n, target.at(j));
    });
    filled.count()
}

/// The lanes of three rows.
fn columns(rows: &mut [[f32; PAIRS]; 3]) -> impl Iterator<Item = [&mut f32; 3]> {
    let [x, y, z] = rows;
    let lanes = x.iter_mut().zip(y).zip(z);
    lanes.map(|((x, y), z)| [x, y, z])
}

/// Sets a point and its normal.
fn set([x, y, z]: [&mut f32; 3], [a, b, c]: [&mut f32; 3], (point, normal): (Vec3, Vec3)) {
    [*x, *y, *z] = point.to_array();
    [*a, *b, *c] = normal.to_array();
}

#[cfg(test)]
pub(crate) mod tests;
