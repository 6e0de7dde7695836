//! Iterative closest point (Besl and McKay 1992; planes: Chen and Medioni 1991; trimmed: Chetverikov et al. 2002).
//!
//! The rules are those of Open3D's `registration_icp`, so that numbers compare. Correspondences are the nearest
//! target points within a fixed distance. Each iteration solves for the rigid transform, in closed form point to
//! point, by one Gauss-Newton step point to plane. It stops when fitness and RMSE, both of point-to-point
//! distances, change by less than 1e-6. Trimming keeps a fixed share of the correspondences, the shortest.

use super::align::{kabsch, plane_step};
use super::normals::{NormalSettings, normals};
use super::{narrow, widen};
use crate::dataset::Point;
use crate::neighbours::{Neighbours, check_finite, wide};
use nalgebra::{Matrix3, Vector3};
use reagent_core::{Error, Pose};

/// What an iteration minimises.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Residual {
    /// Distances to the corresponding points.
    Point,
    /// Distances to the planes through the corresponding points, along estimated normals.
    Plane,
}

/// What to minimise, when to stop, and what counts as a correspondence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IcpSettings {
    /// What an iteration minimises.
    pub residual: Residual,
    /// Farthest a source point may be from its nearest target point, in the clouds' units.
    pub max_correspondence: f64,
    /// Share of the source's points whose correspondences are kept, the shortest; 1 keeps all.
    pub kept_share: f64,
    /// Most iterations.
    pub max_iterations: usize,
    /// Change of the fraction of source points that have a correspondence, below which it may stop.
    pub fitness_change: f64,
    /// Change of the RMSE over the correspondences, in the clouds' units, below which it may stop.
    pub rmse_change: f64,
}

impl IcpSettings {
    /// Point to point, Open3D's defaults with correspondences up to 0.5.
    pub const POINT: IcpSettings = IcpSettings {
        residual: Residual::Point,
        max_correspondence: 0.5,
        kept_share: 1.0,
        max_iterations: 30,
        fitness_change: 1e-6,
        rmse_change: 1e-6,
    };
    /// Point to plane, up to 50 iterations.
    pub const PLANE: IcpSettings = IcpSettings {
        residual: Residual::Plane,
        max_iterations: 50,
        ..IcpSettings::POINT
    };
    /// Point to plane, on the nearest 80 % of the points: for sources that show parts which the target lacks.
    pub const TRIMMED: IcpSettings = IcpSettings {
        kept_share: 0.8,
        ..IcpSettings::PLANE
    };
}

/// Result of ICP.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IcpResult {
    /// The estimate.
    pub target_from_source: Pose,
    /// Iterations made.
    pub iterations: usize,
    /// Fraction of source points with a correspondence at the end.
    pub fitness: f64,
    /// Root mean square distance over those, in the clouds' units; 0 without any.
    pub rmse: f64,
    /// Whether the changes fell below the settings' before the iterations ran out.
    pub converged: bool,
}

/// Registers `source [N, 3]` to `target [M, 3]`, starting from the plain transform `initial`.
///
/// Refuses empty clouds, coordinates that are not finite and an initial pose that is not rigid.
pub fn icp(
    source: &[Point],
    target: &[Point],
    initial: Pose,
    settings: &IcpSettings,
) -> Result<IcpResult, Error> {
    IcpTarget::new(target, settings.residual)?.register(source, initial, settings)
}

/// See [`IcpTarget::loss`].
const GAPS: f64 = 0.6;

/// A target that is prepared once for several runs.
#[derive(Debug)]
pub struct IcpTarget<'t> {
    points: &'t [Point],
    tree: Neighbours,
    /// Normals of all points; used by [`Residual::Plane`].
    normals: Vec<Vector3<f64>>,
}

impl<'t> IcpTarget<'t> {
    /// Prepares `target [M, 3]`, with its normals for [`Residual::Plane`].
    ///
    /// # Errors
    /// As [`icp`].
    pub fn new(target: &'t [Point], residual: Residual) -> Result<Self, Error> {
        let tree = Neighbours::new(target)?;
        let normals = match residual {
            Residual::Point => Vec::new(),
            Residual::Plane => {
                let settings = NormalSettings::DEFAULT;
                let lists = tree.lists(target, settings.radius, settings.most);
                normals(target, &lists, &settings)
            }
        };
        Ok(IcpTarget {
            points: target,
            tree,
            normals,
        })
    }

    /// Prepares `target [M, 3]` with the normals of its surface `[M, 3]`, which may point to either side.
    ///
    /// # Errors
    /// As [`icp`].
    pub fn with_normals(target: &'t [Point], normals: &[Point]) -> Result<Self, Error> {
        Ok(IcpTarget {
            points: target,
            tree: Neighbours::new(target)?,
            normals: normals.iter().map(|&normal| wide(normal)).collect(),
        })
    }

    /// How far `source [N, 3]` lies off the surface under a pose: the mean of the squared distances, at most 1 each, in units of
    /// `off`. Distances along the surface count from where gaps between its points do not explain them, at .6 `off`. The target
    /// must have been prepared with normals.
    pub fn loss(&self, source: &[Point], pose: Pose, off: f64) -> f64 {
        let (rotation, translation) = widen(pose);
        let losses = source.iter().map(|&p| {
            let p = rotation * wide(p) + translation;
            let (nearest, squared) = self.tree.nearest(p);
            let across = self.normals[nearest].dot(&(p - wide(self.points[nearest])));
            let along = (squared - across * across).max(0.0).sqrt() - GAPS * off;
            ((across * across + along.max(0.0).powi(2)) / (off * off)).min(1.0)
        });
        losses.sum::<f64>() / source.len().max(1) as f64
    }

    /// As [`icp`]; point to plane only if the target was prepared for it.
    ///
    /// # Errors
    /// As [`icp`].
    pub fn register(
        &self,
        source: &[Point],
        initial: Pose,
        settings: &IcpSettings,
    ) -> Result<IcpResult, Error> {
        if source.is_empty() {
            return Err(Error::EmptyCloud);
        }
        check_finite(source)?;
        let pose = widen(initial.checked()?);
        let source: Vec<Vector3<f64>> = source.iter().map(|&p| wide(p)).collect();
        Ok(self.iterate(&source, pose, settings))
    }

    fn iterate(
        &self,
        source: &[Vector3<f64>],
        (mut rotation, mut translation): (Matrix3<f64>, Vector3<f64>),
        settings: &IcpSettings,
    ) -> IcpResult {
        let Self {
            points: target,
            tree,
            normals,
        } = self;
        let mut matches = Matches::find(source, tree, &rotation, &translation, settings);
        let (mut iterations, mut converged) = (0, false);
        while iterations < settings.max_iterations && !converged && matches.pairs.len() >= 3 {
            let pairs = matches.pairs.iter();
            match settings.residual {
                Residual::Point => {
                    let pairs = pairs.map(|m| (source[m.source], wide(target[m.target]), 1.0));
                    (rotation, translation) = kabsch(pairs);
                }
                Residual::Plane => {
                    let moved = |p: Vector3<f64>| rotation * p + translation;
                    let (turn, shift) = plane_step(pairs.map(|m| {
                        (
                            moved(source[m.source]),
                            wide(target[m.target]),
                            normals[m.target],
                        )
                    }));
                    (rotation, translation) = (turn * rotation, turn * translation + shift);
                }
            }
            iterations += 1;
            let next = Matches::find(source, tree, &rotation, &translation, settings);
            converged = (next.fitness - matches.fitness).abs() < settings.fitness_change
                && (next.rmse - matches.rmse).abs() < settings.rmse_change;
            matches = next;
        }
        IcpResult {
            target_from_source: narrow(&rotation, &translation),
            iterations,
            fitness: matches.fitness,
            rmse: matches.rmse,
            converged,
        }
    }
}

/// A source point and its nearest target point, by index, and the SQUARED distance between them.
#[derive(Clone, Copy)]
struct Match {
    source: usize,
    target: usize,
    squared: f64,
}

/// Correspondences under one pose.
struct Matches {
    pairs: Vec<Match>,
    fitness: f64,
    rmse: f64,
}

impl Matches {
    fn find(
        source: &[Vector3<f64>],
        tree: &Neighbours,
        rotation: &Matrix3<f64>,
        translation: &Vector3<f64>,
        settings: &IcpSettings,
    ) -> Matches {
        let limit = settings.max_correspondence * settings.max_correspondence;
        let nearest = |(source, point): (usize, &Vector3<f64>)| {
            let (target, squared) = tree.nearest(rotation * point + translation);
            Match {
                source,
                target,
                squared,
            }
        };
        let mut pairs: Vec<Match> = source
            .iter()
            .enumerate()
            .map(nearest)
            .filter(|m| m.squared < limit)
            .collect();
        let kept = (settings.kept_share * source.len() as f64).ceil() as usize;
        if kept < pairs.len() {
            pairs.select_nth_unstable_by(kept, |a, b| {
                a.squared
                    .total_cmp(&b.squared)
                    .then(a.source.cmp(&b.source))
            });
            pairs.truncate(kept);
        }
        let sum: f64 = pairs.iter().map(|m| m.squared).sum();
        Matches {
            fitness: pairs.len() as f64 / source.len() as f64,
            rmse: (sum / pairs.len().max(1) as f64).sqrt(),
            pairs,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, stream};
    use glam::Vec3;
    use rand::RngExt;
    use reagent_core::pose::rotation_from_euler;

    fn moved(cloud: &[Point], pose: Pose) -> Vec<Point> {
        cloud
            .iter()
            .map(|&p| pose.apply(Vec3::from(p)).to_array())
            .collect()
    }

    #[test]
    fn finds_a_small_offset_exactly() {
        let mut rng = stream(3, Purpose::Pairs, 0);
        let source: Vec<Point> = (0..500)
            .map(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0)))
            .collect();
        let pose = Pose {
            rotation: rotation_from_euler(Vec3::new(0.02, -0.03, 0.01)),
            translation: Vec3::new(0.02, 0.01, -0.03),
        };
        let target = moved(&source, pose);
        let found =
            icp(&source, &target, Pose::IDENTITY, &IcpSettings::POINT).expect("valid clouds");
        assert!(
            found.converged && found.rmse < 1e-6 && found.fitness == 1.0,
            "{found:?}"
        );
        assert!((found.target_from_source.translation - pose.translation).length() < 1e-5);
        assert!(
            found
                .target_from_source
                .rotation
                .abs_diff_eq(pose.rotation, 1e-5)
        );
    }

    /// The surface of a box, so that planes meet in every direction: the offset is found from other samples of it.
    fn box_surface(index: u64) -> Vec<Point> {
        let mut rng = stream(5, Purpose::Shape, index);
        (0..1500)
            .map(|i| {
                let mut p = [0.8, 0.5, 0.3].map(|half: f32| rng.random_range(-half..half));
                let side = i % 6;
                p[side % 3] = [0.8, 0.5, 0.3][side % 3] * if side < 3 { 1.0 } else { -1.0 };
                p
            })
            .collect()
    }

    fn error_deg(found: Pose, truth: Pose) -> f32 {
        let residual = found.rotation * truth.rotation.transpose();
        let trace = residual.x_axis.x + residual.y_axis.y + residual.z_axis.z;
        ((trace - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees()
    }

    #[test]
    fn planes_are_more_accurate_than_points_between_different_samples() {
        let truth = Pose {
            rotation: rotation_from_euler(Vec3::new(0.1, -0.15, 0.2)),
            translation: Vec3::new(0.05, 0.1, -0.05),
        };
        let source = moved(&box_surface(0), truth.inverse());
        let target = box_surface(1);
        let run = |settings| icp(&source, &target, Pose::IDENTITY, &settings).expect("valid");
        let (point, plane) = (run(IcpSettings::POINT), run(IcpSettings::PLANE));
        assert!(plane.converged && plane.fitness == 1.0, "{plane:?}");
        let error = |found: IcpResult| error_deg(found.target_from_source, truth);
        assert!(
            error(plane) < 0.3 && error(plane) < error(point),
            "{plane:?}\n{point:?}"
        );
        assert!((plane.target_from_source.translation - truth.translation).length() < 0.01);
    }

    #[test]
    fn trimming_ignores_what_the_target_lacks() {
        let target = box_surface(1);
        let mut source = box_surface(0);
        // A slab beside the box, 15 % of the points, pulls on its neighbours.
        source.extend(source.clone().iter().take(260).map(|p| [1.0, p[1], p[2]]));
        let error = |settings: IcpSettings| {
            let found = icp(&source, &target, Pose::IDENTITY, &settings).expect("valid");
            assert!(found.fitness <= settings.kept_share + 1e-3, "{found:?}");
            found.target_from_source.translation.length()
        };
        let (all, trimmed) = (error(IcpSettings::PLANE), error(IcpSettings::TRIMMED));
        assert!(trimmed < 0.01 && all > 3.0 * trimmed, "{trimmed} {all}");
    }

    #[test]
    fn clouds_out_of_reach_leave_the_initial_pose() {
        let near = [[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]];
        let far = near.map(|p| p.map(|x| x + 10.0));
        let found = icp(&near, &far, Pose::IDENTITY, &IcpSettings::POINT).expect("valid clouds");
        assert_eq!(found.target_from_source, Pose::IDENTITY);
        assert!(!found.converged && found.fitness == 0.0);
    }

    #[test]
    fn bad_clouds_are_refused() {
        let run = |s: &[Point], t: &[Point]| icp(s, t, Pose::IDENTITY, &IcpSettings::POINT).err();
        assert_eq!(run(&[], &[[0.0; 3]]), Some(Error::EmptyCloud));
        assert_eq!(run(&[[0.0; 3]], &[]), Some(Error::EmptyCloud));
        assert_eq!(
            run(&[[f32::INFINITY; 3]], &[[0.0; 3]]),
            Some(Error::NotFinite { index: 0 })
        );
    }
}
