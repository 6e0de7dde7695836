//! The last refinement: ICP on all points that the files hold, where the policy saw a part of them.

use crate::baselines::{IcpSettings, IcpTarget, Residual};
use crate::dataset::Point;
use crate::register::thin::{bulk, thin};
use glam::Vec3;
use reagent_core::dims::MAX_POINTS;
use reagent_core::pose::centroid;
use reagent_core::{Error, Frame, Pose};
use serde::Serialize;
use std::borrow::Cow;

/// Most points of each cloud that are used; more would only take longer, without changing the pose.
pub const DENSE_POINTS: usize = 20_000;

/// Points of a surface.
pub struct Planes<'a> {
    /// The points.
    pub points: Cow<'a, [Point]>,
    /// Normals of the faces that they were drawn from, which may point to either side; empty without faces.
    pub normals: Cow<'a, [Point]>,
}

/// When to refine on up to [`DENSE_POINTS`] points of each cloud.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Dense {
    /// Where a cloud has more points than the policy saw
    Auto,
    /// In every case
    Always,
    /// Not at all
    Never,
}

/// Result of the refinement.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DenseRefinement {
    /// The pose.
    #[serde(skip)]
    pub target_from_source: Pose,
    /// Points of source and target that were used.
    pub points: [usize; 2],
    /// Iterations made.
    pub iterations: usize,
    /// Share of the source's points that have a target point within [`DenseRefinement::within`].
    pub overlap: f64,
    /// Root mean square distance of those pairs, in the clouds' units.
    pub rmse: f64,
    /// Largest distance of corresponding points, in the clouds' units.
    pub within: f64,
}

/// The target's frame, in which lengths are in target radii.
pub(super) struct InRadii(pub(super) Frame);

impl InRadii {
    /// Points of either cloud, in this frame.
    pub(super) fn points(&self, points: &[Point]) -> Vec<Point> {
        let Frame { centre, scale } = self.0;
        let to = |p: &Point| ((Vec3::from(*p) - centre) / scale).to_array();
        points.iter().map(to).collect()
    }

    /// A pose between points in this frame.
    pub(super) fn inward(&self, pose: Pose) -> Pose {
        let Frame { centre, scale } = self.0;
        Pose {
            rotation: pose.rotation,
            translation: (pose.rotation * centre + pose.translation - centre) / scale,
        }
    }

    /// The reverse of [`InRadii::inward`].
    fn outward(&self, pose: Pose) -> Pose {
        let Frame { centre, scale } = self.0;
        Pose {
            rotation: pose.rotation,
            translation: pose.translation * scale + centre - pose.rotation * centre,
        }
    }
}

/// Refines a pose by point-to-plane ICP on up to 20,000 points of each cloud; a target's normals are estimated where no faces tell
/// them. Correspondences reach .05 target radii at first, then three times the distance that this leaves between the surfaces.
/// `None` where the fit does not improve, or the pose moves by more than .1 target radii or 10 degrees.
///
/// # Errors
/// Clouds that the core refuses.
pub fn refine_densely(
    source: &[Point],
    target: &Planes<'_>,
    from: Pose,
) -> Result<Option<DenseRefinement>, Error> {
    // Points far from all others were left out for the policy, too.
    let near = |points: &[Point]| {
        let bulk = bulk(points);
        let near = points.iter().copied().filter(|&point| bulk.holds(point));
        near.collect::<Vec<Point>>()
    };
    let source = thin(&near(source), DENSE_POINTS);
    let (target, normals) = if target.normals.is_empty() {
        (thin(&near(&target.points), DENSE_POINTS), Vec::new())
    } else {
        let bulk = bulk(&target.points);
        let planes = target
            .points
            .iter()
            .copied()
            .zip(target.normals.iter().copied());
        planes.filter(|&(point, _)| bulk.holds(point)).unzip()
    };
    let frame = InRadii(Frame::of(&thin(&target, MAX_POINTS))?);
    let inward = frame.inward(from);
    let (source, target) = (frame.points(&source), frame.points(&target));
    let settings = |max_correspondence: f64, max_iterations: usize| IcpSettings {
        residual: Residual::Plane,
        max_correspondence,
        max_iterations,
        ..IcpSettings::PLANE
    };
    let prepared = match normals.is_empty() {
        true => IcpTarget::new(&target, Residual::Plane)?,
        false => IcpTarget::with_normals(&target, &normals)?,
    };
    let wide = prepared.register(&source, inward, &settings(0.05, 30))?;
    let within = (3.0 * wide.rmse).clamp(1e-3, 0.05);
    let counting = IcpSettings {
        residual: Residual::Point,
        ..settings(within, 0)
    };
    let before = prepared.register(&source, inward, &counting)?;
    let fine = prepared.register(&source, wide.target_from_source, &settings(within, 30))?;
    let found = fine.target_from_source;
    let middle = centroid(&source);
    let near = found.angle_to(&inward) < 10f32.to_radians()
        && found.apply(middle).distance(inward.apply(middle)) < 0.1;
    // More correspondences, or closer ones.
    let better = fine.fitness > before.fitness
        || fine.fitness > 0.98 * before.fitness && fine.rmse < before.rmse;
    if !(near && better) {
        return Ok(None);
    }
    let unit = f64::from(frame.0.scale);
    Ok(Some(DenseRefinement {
        target_from_source: frame.outward(found),
        points: [source.len(), target.len()],
        iterations: wide.iterations + fine.iterations,
        overlap: fine.fitness,
        rmse: fine.rmse * unit,
        within: within * unit,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::procedural;
    use crate::random::{Purpose, stream};
    use reagent_core::pose::rotation_from_euler;
    use std::borrow::Cow;

    fn refine_densely(
        source: &[Point],
        target: &[Point],
        from: Pose,
    ) -> Result<Option<DenseRefinement>, Error> {
        let target = Planes {
            points: Cow::Borrowed(target),
            normals: Cow::Borrowed(&[]),
        };
        super::refine_densely(source, &target, from)
    }

    /// Two samples of one surface: the pose becomes as good as their number of points allows, in any unit.
    #[test]
    fn many_points_give_a_finer_pose() {
        let mesh = procedural::shape(1, 1).mesh;
        let sample = |index: u64| mesh.sample(20_000, &mut stream(2, Purpose::Surface, index));
        for unit in [1.0, 1000.0] {
            let scaled = |points: Vec<Point>| -> Vec<Point> {
                points.into_iter().map(|p| p.map(|x| x * unit)).collect()
            };
            let (source, target) = (scaled(sample(0)), scaled(sample(1)));
            let off = Pose {
                rotation: rotation_from_euler(Vec3::new(0.01, -0.01, 0.01)),
                translation: Vec3::new(0.01, 0.005, -0.01) * unit,
            };
            let found = refine_densely(&source, &target, off)
                .expect("clouds")
                .expect("better");
            let pose = found.target_from_source;
            let trace = pose.rotation.x_axis.x + pose.rotation.y_axis.y + pose.rotation.z_axis.z;
            assert!(trace > 3.0 - 3e-6, "{pose:?}");
            assert!(pose.translation.length() < 1e-3 * unit, "{pose:?}");
            assert!(found.rmse < 0.03 * f64::from(unit), "{found:?}");
            // From there on nothing improves.
            let again = refine_densely(&source, &target, pose).expect("clouds");
            let still = again.map_or(pose, |found| found.target_from_source);
            assert!((still.translation - pose.translation).length() < 1e-4 * unit);
        }
    }

    #[test]
    fn marks_of_what_is_invalid_change_nothing() {
        let mesh = procedural::shape(1, 1).mesh;
        let cloud = |i| mesh.sample(5000, &mut stream(2, Purpose::Surface, i));
        let (source, target) = (cloud(0), cloud(1));
        let off = Pose {
            translation: Vec3::splat(0.01),
            ..Pose::IDENTITY
        };
        let refined = |source: &[Point], target: &[Point]| {
            let found = refine_densely(source, target, off).expect("clouds");
            found.expect("better")
        };
        let expected = refined(&source, &target);
        let marked = |cloud: &[Point]| [cloud, &[[1e10; 3]; 300]].concat();
        assert_eq!(refined(&marked(&source), &marked(&target)), expected);
    }

    /// Normals of faces hold a pose at edges, where estimated ones are round.
    #[test]
    fn normals_of_faces_give_a_finer_pose_and_marks_change_nothing() {
        let mesh = crate::dataset::winding::tests::block(Vec3::ZERO, Vec3::new(1.0, 0.8, 0.1));
        let source = mesh.sample(2000, &mut stream(2, Purpose::Surface, 0));
        let drawn = mesh.sample_with_normals(2000, &mut stream(2, Purpose::Surface, 1));
        let (points, normals): (Vec<Point>, Vec<Point>) = drawn.into_iter().unzip();
        let off = Pose {
            translation: Vec3::new(0.01, -0.01, 0.005),
            ..Pose::IDENTITY
        };
        let error = |points: &[Point], normals: &[Point]| {
            let target = Planes {
                points: Cow::Borrowed(points),
                normals: Cow::Borrowed(normals),
            };
            let found = super::refine_densely(&source, &target, off).expect("clouds");
            let pose = found.expect("better").target_from_source;
            pose.translation.length()
        };
        let [estimated, told] = [&[][..], &normals].map(|normals| error(&points, normals));
        assert!(told < 5e-4 && told < 0.5 * estimated, "{told} {estimated}");
        let marked = [vec![[1e6; 3]; 40], points.clone()].concat();
        let of_marks = [vec![[1.0, 0.0, 0.0]; 40], normals].concat();
        assert_eq!(error(&marked, &of_marks), told);
    }

    #[test]
    fn what_has_no_partner_stays() {
        let points = thin(
            &procedural::shape(1, 1)
                .mesh
                .sample(3000, &mut stream(2, Purpose::Surface, 0)),
            1000,
        );
        let away = Pose {
            translation: Vec3::new(9.0, 0.0, 0.0),
            ..Pose::IDENTITY
        };
        assert_eq!(refine_densely(&points, &points, away), Ok(None));
        assert_eq!(refine_densely(&[], &points, away), Err(Error::EmptyCloud));
    }
}
