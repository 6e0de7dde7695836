//! Fast global registration (Zhou, Park and Koltun, ECCV 2016): feature matches, most of them wrong, and a robust
//! cost that is made less and less convex.
//!
//! Parameters are Open3D's, except for the correspondence distance of .05. Where the paper takes one Gauss-Newton
//! step for each value of the line process, this solves for the rigid motion in closed form.

use super::align::kabsch;
use super::fpfh::{FpfhSettings, fpfh};
use super::narrow;
use super::normals::{NormalSettings, normals, outward};
use crate::dataset::Point;
use crate::neighbours::{Neighbours, wide};
use crate::random::Rng;
use nalgebra::{Matrix3, Vector3};
use ndarray::{Array1, Array2, ArrayView2, Axis, s};
use rand::RngExt;
use reagent_core::{Error, Pose};

/// Fewest matches that are worth a registration; with fewer, the pose is the identity.
const FEWEST_MATCHES: usize = 10;
/// Tuples tried for each match.
const TRIALS: usize = 100;
/// Iterations between two changes of the cost.
const PERIOD: usize = 4;
/// Features compared at once, which bounds the memory.
const BLOCK: usize = 128;

/// How to match and to register. Lengths, but for those of neighbourhoods, are in radii of the larger cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FgrSettings {
    /// Neighbourhoods of normals.
    pub normals: NormalSettings,
    /// Whether normals are turned away from the cloud's mean, which suits an object seen as a whole. Otherwise they
    /// keep the signs that the eigenvector solver happens to give them.
    pub outward: bool,
    /// Neighbourhoods of features, at least as large as those of normals.
    pub features: FpfhSettings,
    /// The cost's scale μ starts at 1 and falls until it is no larger than this.
    pub max_correspondence: f64,
    /// Divisor of μ at every fourth iteration; 1 leaves it constant.
    pub division: f64,
    /// Iterations.
    pub iterations: usize,
    /// Least ratio of corresponding sides of two triangles, the shorter to the longer.
    pub tuple_scale: f64,
    /// Triangles of matches to find.
    pub max_tuples: usize,
}

impl FgrSettings {
    /// The defaults of Open3D's Python interface. The cost stays constant, so that matches which are far off keep
    /// some weight to the end, and signs of normals change as a cloud is turned.
    pub const OPEN3D: FgrSettings = FgrSettings {
        outward: false,
        division: 1.0,
        ..FgrSettings::GRADUATED
    };
    /// Graduated non-convexity as in the paper, with normals that do not depend on the pose.
    pub const GRADUATED: FgrSettings = FgrSettings {
        outward: true,
        normals: NormalSettings::DEFAULT,
        features: FpfhSettings::DEFAULT,
        max_correspondence: 0.05,
        division: 1.4,
        iterations: 64,
        tuple_scale: 0.95,
        max_tuples: 1000,
    };
}

/// Result of fast global registration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FgrResult {
    /// The estimate; the identity where there were too few matches.
    pub target_from_source: Pose,
    /// Number of reciprocal matches: features that are each other's nearest.
    pub reciprocal: usize,
    /// Triangles of such matches that passed the test.
    pub tuples: usize,
}

/// Registers `source [N, 3]` to `target [M, 3]` without an initial estimate. `rng` chooses the triangles to test.
///
/// Refuses empty clouds, clouds without extent and coordinates that are not finite.
pub fn fgr(
    source: &[Point],
    target: &[Point],
    settings: &FgrSettings,
    rng: &mut Rng,
) -> Result<FgrResult, Error> {
    let (source_features, target_features) =
        (features(source, settings)?, features(target, settings)?);
    let (from, from_centre, from_radius) = centred(source);
    let (to, to_centre, to_radius) = centred(target);
    let scale = from_radius.max(to_radius);
    if scale <= 0.0 {
        return Err(Error::NoExtent);
    }

    let reciprocal = reciprocal(&source_features, &target_features);
    let passed = triangles(&from, &to, &reciprocal, settings, rng);
    let mut result = FgrResult {
        target_from_source: Pose::IDENTITY,
        reciprocal: reciprocal.len(),
        tuples: passed.len() / 3,
    };
    if passed.len() >= FEWEST_MATCHES {
        let pairs: Vec<_> = passed
            .iter()
            .map(|&(i, j)| (from[i] / scale, to[j] / scale))
            .collect();
        let (rotation, shift) = graduated(&pairs, settings);
        let translation = shift * scale + to_centre - rotation * from_centre;
        result.target_from_source = narrow(&rotation, &translation);
    }
    Ok(result)
}

/// FPFH features of a cloud, one row a point.
fn features(points: &[Point], settings: &FgrSettings) -> Result<Array2<f64>, Error> {
    let tree = Neighbours::new(points)?;
    // One search serves both: the neighbours for normals are the nearest of those for features.
    let lists = tree.lists(points, settings.features.radius, settings.features.most);
    let mut normals = normals(points, &lists, &settings.normals);
    if settings.outward {
        outward(points, &mut normals);
    }
    Ok(Array2::from(fpfh(points, &normals, &lists)))
}

/// The cloud centred on its mean, the mean, and the distance of the farthest point from it.
fn centred(points: &[Point]) -> (Vec<Vector3<f64>>, Vector3<f64>, f64) {
    let sum: Vector3<f64> = points.iter().map(|&p| wide(p)).sum();
    let mean = sum / points.len() as f64;
    let centred: Vec<Vector3<f64>> = points.iter().map(|&p| wide(p) - mean).collect();
    let radius = centred.iter().map(|p| p.norm()).fold(0.0, f64::max);
    (centred, mean, radius)
}

/// Pairs of rows of `a [N, 33]` and `b [M, 33]` that are each other's nearest.
fn reciprocal(a: &Array2<f64>, b: &Array2<f64>) -> Vec<(usize, usize)> {
    let norms = |m: &Array2<f64>| -> Array1<f64> { m.map_axis(Axis(1), |row| row.dot(&row)) };
    let (norms_a, norms_b) = (norms(a), norms(b));
    let mut nearest_a = vec![(f64::INFINITY, 0); a.nrows()];
    let mut nearest_b = vec![(f64::INFINITY, 0); b.nrows()];
    for start in (0..a.nrows()).step_by(BLOCK) {
        let rows: ArrayView2<f64> = a.slice(s![start..(start + BLOCK).min(a.nrows()), ..]);
        let products = rows.dot(&b.t());
        for (i, row) in products.outer_iter().enumerate() {
            let i = start + i;
            for (j, product) in row.iter().enumerate() {
                let squared = norms_a[i] + norms_b[j] - 2.0 * product;
                if squared < nearest_a[i].0 {
                    nearest_a[i] = (squared, j);
                }
                if squared < nearest_b[j].0 {
                    nearest_b[j] = (squared, i);
                }
            }
        }
    }
    let matches = nearest_a.iter().enumerate().map(|(i, &(_, j))| (i, j));
    matches.filter(|&(i, j)| nearest_b[j].1 == i).collect()
}

/// Random triples of matches whose triangles have sides of similar length in both clouds, flattened.
fn triangles(
    from: &[Vector3<f64>],
    to: &[Vector3<f64>],
    matches: &[(usize, usize)],
    settings: &FgrSettings,
    rng: &mut Rng,
) -> Vec<(usize, usize)> {
    let mut passed = Vec::new();
    if matches.len() < 3 {
        return passed;
    }
    let alike = |a: (usize, usize), b: (usize, usize)| {
        let (here, there) = ((from[a.0] - from[b.0]).norm(), (to[a.1] - to[b.1]).norm());
        here * settings.tuple_scale < there && there * settings.tuple_scale < here
    };
    for _ in 0..TRIALS * matches.len() {
        let [a, b, c] = std::array::from_fn(|_| matches[rng.random_range(0..matches.len())]);
        if alike(a, b) && alike(b, c) && alike(c, a) {
            passed.extend([a, b, c]);
            if passed.len() == 3 * settings.max_tuples {
                break;
            }
        }
    }
    passed
}

/// Minimises the sum of `μ r² / (μ + r²)` (Geman-McClure) over rigid motions of the first points while μ falls. The
/// weight of a match is `(μ / (μ + r²))²`.
fn graduated(
    pairs: &[(Vector3<f64>, Vector3<f64>)],
    settings: &FgrSettings,
) -> (Matrix3<f64>, Vector3<f64>) {
    let (mut rotation, mut shift) = (Matrix3::identity(), Vector3::zeros());
    let mut mu = 1.0;
    for iteration in 0..settings.iterations {
        let weight = |a: Vector3<f64>, b: Vector3<f64>| {
            let share = mu / (mu + (rotation * a + shift - b).norm_squared());
            share * share
        };
        (rotation, shift) = kabsch(pairs.iter().map(|&(a, b)| (a, b, weight(a, b))));
        if iteration % PERIOD == 0 && mu > settings.max_correspondence {
            mu /= settings.division;
        }
    }
    (rotation, shift)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, stream};
    use glam::Vec3;
    use reagent_core::pose::rotation_from_euler;

    /// Half a cylinder with a bump and a fin: no symmetry, surfaces that differ from place to place.
    fn shape(index: u64) -> Vec<Point> {
        let mut rng = stream(8, Purpose::Shape, index);
        (0..1000)
            .map(|i| {
                let (a, h) = (
                    rng.random_range(0.0..3.0f32),
                    rng.random_range(-0.8..0.8f32),
                );
                let radius = 0.5 + 0.3 * (-8.0 * ((a - 1.0).powi(2) + (h - 0.3).powi(2))).exp();
                if i % 4 == 0 {
                    [0.2 + 0.5 * a.min(1.0), -0.4 * h.abs(), h]
                } else {
                    [radius * a.cos(), radius * a.sin(), h]
                }
            })
            .collect()
    }

    fn turned(cloud: &[Point]) -> (Vec<Point>, Pose) {
        let target_from_source = Pose {
            rotation: rotation_from_euler(Vec3::new(0.4, -0.3, 0.6)),
            translation: Vec3::new(0.4, -0.2, 0.3),
        };
        let back = target_from_source.inverse();
        let source = cloud.iter().map(|&p| back.apply(Vec3::from(p)).to_array());
        (source.collect(), target_from_source)
    }

    #[test]
    fn finds_a_large_offset_between_different_samples() {
        let target = shape(0);
        let (source, truth) = turned(&shape(1));
        for (settings, degrees) in [(FgrSettings::GRADUATED, 6.0), (FgrSettings::OPEN3D, 15.0)] {
            let rng = &mut stream(1, Purpose::Tuples, 0);
            let found = fgr(&source, &target, &settings, rng).expect("valid clouds");
            assert!(found.reciprocal > 50 && found.tuples > 100, "{found:?}");
            let residual = found.target_from_source.rotation * truth.rotation.transpose();
            let trace = residual.x_axis.x + residual.y_axis.y + residual.z_axis.z;
            let angle = ((trace - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees();
            assert!(angle < degrees, "{angle} degrees: {found:?}");
        }
    }

    #[test]
    fn the_seed_and_nothing_else_decides() {
        let (target, (source, _)) = (shape(0), turned(&shape(1)));
        let run = |seed| {
            let rng = &mut stream(seed, Purpose::Tuples, 3);
            fgr(&source, &target, &FgrSettings::GRADUATED, rng).expect("valid clouds")
        };
        assert_eq!(run(1), run(1));
        assert_ne!(run(1).target_from_source, run(2).target_from_source);
    }

    #[test]
    fn the_unit_of_length_changes_nothing_but_the_neighbourhoods() {
        let (target, (source, _)) = (shape(0), turned(&shape(1)));
        let scaled = |cloud: &[Point]| cloud.iter().map(|p| p.map(|x| 8.0 * x)).collect::<Vec<_>>();
        let mut wider = FgrSettings::GRADUATED;
        wider.normals.radius *= 8.0;
        wider.features.radius *= 8.0;
        let rng = || stream(1, Purpose::Tuples, 0);
        let here = fgr(&source, &target, &FgrSettings::GRADUATED, &mut rng()).expect("valid");
        let there = fgr(&scaled(&source), &scaled(&target), &wider, &mut rng()).expect("valid");
        let (a, b) = (here.target_from_source, there.target_from_source);
        assert!(a.rotation.abs_diff_eq(b.rotation, 1e-5));
        assert!((8.0 * a.translation - b.translation).length() < 1e-4);
    }

    #[test]
    fn reciprocal_matches_are_each_other_s_nearest() {
        let rows = |values: &[f64]| {
            let features: Vec<[f64; 33]> = values.iter().map(|&x| [x; 33]).collect();
            Array2::from(features)
        };
        // 0.0 and 0.9 both choose 1.0, which chooses 0.9; 7.0 and 6.5 choose each other.
        let found = reciprocal(&rows(&[0.0, 0.9, 7.0]), &rows(&[6.5, 1.0]));
        assert_eq!(found, [(1, 1), (2, 0)]);
    }

    #[test]
    fn too_few_points_stay_and_bad_clouds_are_refused() {
        let few = [[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.2, 0.0]];
        let run = |s: &[Point], t: &[Point]| {
            let rng = &mut stream(1, Purpose::Tuples, 0);
            fgr(s, t, &FgrSettings::GRADUATED, rng)
        };
        let found = run(&few, &few).expect("valid clouds");
        assert_eq!(found.target_from_source, Pose::IDENTITY);
        assert_eq!(run(&[], &few).err(), Some(Error::EmptyCloud));
        assert_eq!(
            run(&[[1.0; 3]; 4], &[[1.0; 3]; 9]).err(),
            Some(Error::NoExtent)
        );
        assert_eq!(
            run(&few, &[[f32::NAN; 3]]).err(),
            Some(Error::NotFinite { index: 0 })
        );
    }
}
