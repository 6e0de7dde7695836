//! Fast point feature histograms (Rusu, Blodow and Beetz 2009): pose-invariant descriptors of the surface around a point.

use crate::dataset::Point;
use crate::neighbours::wide;
use nalgebra::Vector3;
use std::f64::consts::PI;

/// Length of a feature: eleven bins for each of three angles.
pub const FPFH_BINS: usize = 3 * BINS;
/// Bins for one angle.
const BINS: usize = 11;
/// Sum over the bins of one angle.
const TOTAL: f64 = 100.0;

/// Size of a neighbourhood.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FpfhSettings {
    /// Its radius, in the cloud's units.
    pub radius: f64,
    /// Most points in it; the nearest are taken.
    pub most: usize,
}

impl FpfhSettings {
    /// For clouds of about a thousand points and a radius of 1.
    pub const DEFAULT: FpfhSettings = FpfhSettings {
        radius: 0.3,
        most: 100,
    };
}

/// Features `[N]` of a cloud `[N]` with unit normals `[N]`. `lists` holds each point's neighbours within the
/// settings' radius and number, with squared distances.
///
/// They are computed as in Open3D: a point's own histogram is added to the mean of its neighbours' histograms,
/// weighted by the inverse squared distance. In both terms each angle's bins sum to 100.
pub fn fpfh(
    points: &[Point],
    normals: &[Vector3<f64>],
    lists: &[Vec<(usize, f64)>],
) -> Vec<[f64; FPFH_BINS]> {
    let own = simple(points, normals, lists);
    let feature = |(i, list): (usize, &Vec<(usize, f64)>)| {
        let mut sum = [0.0; FPFH_BINS];
        for &(j, squared) in list.iter().filter(|near| near.0 != i && near.1 > 0.0) {
            let weight = 1.0 / squared;
            for (total, bin) in sum.iter_mut().zip(&own[j]) {
                *total += weight * bin;
            }
        }
        for bins in sum.chunks_mut(BINS) {
            let total: f64 = bins.iter().sum();
            if total > 0.0 {
                bins.iter_mut().for_each(|bin| *bin *= TOTAL / total);
            }
        }
        for (bin, own) in sum.iter_mut().zip(&own[i]) {
            *bin += own;
        }
        sum
    };
    lists.iter().enumerate().map(feature).collect()
}

/// Each point's histogram over its own neighbours alone.
fn simple(
    points: &[Point],
    normals: &[Vector3<f64>],
    lists: &[Vec<(usize, f64)>],
) -> Vec<[f64; FPFH_BINS]> {
    let mut counts = vec![[0u32; FPFH_BINS]; points.len()];
    for (i, list) in lists.iter().enumerate() {
        for &(j, squared) in list.iter().filter(|near| near.0 != i) {
            // The angles belong to the unordered pair: if each point is in the other's list, one computation serves both.
            let mutual = holds(&lists[j], i, squared);
            if mutual && j < i {
                continue;
            }
            let bins = bins(wide(points[i]), &normals[i], wide(points[j]), &normals[j]);
            for bin in bins {
                counts[i][bin] += 1;
                if mutual {
                    counts[j][bin] += 1;
                }
            }
        }
    }
    let share = |counts: &[u32; FPFH_BINS]| {
        let neighbours: u32 = counts[..BINS].iter().sum();
        let one = TOTAL / f64::from(neighbours.max(1));
        counts.map(|count| one * f64::from(count))
    };
    counts.iter().map(share).collect()
}

/// Whether a list, sorted by distance, holds point `i` at this squared distance.
fn holds(list: &[(usize, f64)], i: usize, squared: f64) -> bool {
    let from = list.partition_point(|near| near.1 < squared);
    let as_far = list[from..].iter().take_while(|near| near.1 == squared);
    as_far.map(|near| near.0).any(|j| j == i)
}

/// Bins of the three angles between two oriented points, in the frame of the one whose normal is closer to the line
/// between them.
fn bins(p: Vector3<f64>, n_p: &Vector3<f64>, q: Vector3<f64>, n_q: &Vector3<f64>) -> [usize; 3] {
    let line = q - p;
    let length = line.norm();
    let (cos_p, cos_q) = (n_p.dot(&line) / length, n_q.dot(&line) / length);
    let (u, other, line, phi) = if cos_p.abs() < cos_q.abs() {
        (n_q, n_p, -line, -cos_q)
    } else {
        (n_p, n_q, line, cos_p)
    };
    let v = line.cross(u);
    let norm = v.norm();
    // Equal points, or a line along the normal, define no frame. NaN fails the comparison, too.
    let [theta, alpha, phi] = if norm > 0.0 {
        let v = v / norm;
        let w = u.cross(&v);
        [w.dot(other).atan2(u.dot(other)) / PI, v.dot(other), phi]
    } else {
        [0.0; 3]
    };
    // Each is in [-1, 1].
    let bin = |x: f64| ((BINS as f64 * (x + 1.0) / 2.0) as usize).min(BINS - 1);
    [bin(theta), BINS + bin(alpha), 2 * BINS + bin(phi)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baselines::{NormalSettings, normals};
    use crate::neighbours::Neighbours;
    use crate::random::{Purpose, stream};
    use glam::Vec3;
    use rand::RngExt;
    use reagent_core::pose::rotation_from_euler;

    fn features(points: &[Point], turn: glam::Mat3) -> Vec<[f64; FPFH_BINS]> {
        let tree = Neighbours::new(points).expect("valid");
        let settings = FpfhSettings::DEFAULT;
        let lists = tree.lists(points, settings.radius, settings.most);
        // Normals of the unturned cloud, turned: estimated ones have signs that depend on the pose.
        let back: Vec<Point> = points
            .iter()
            .map(|&p| (turn.transpose() * Vec3::from(p)).to_array())
            .collect();
        let turn = |n: Vector3<f64>| {
            let n = turn * Vec3::new(n.x as f32, n.y as f32, n.z as f32);
            wide(n.to_array())
        };
        let normals = normals(&back, &lists, &NormalSettings::DEFAULT);
        fpfh(
            points,
            &normals.into_iter().map(turn).collect::<Vec<_>>(),
            &lists,
        )
    }

    fn bumpy(n: usize) -> Vec<Point> {
        let mut rng = stream(6, Purpose::Shape, 0);
        (0..n)
            .map(|_| {
                let [x, y] = [0, 1].map(|_| rng.random_range(-0.7f32..0.7));
                [x, y, 0.2 * (5.0 * x).sin() * (4.0 * y).cos()]
            })
            .collect()
    }

    #[test]
    fn features_do_not_change_with_the_pose_and_sum_to_what_they_should() {
        let cloud = bumpy(600);
        let turn = rotation_from_euler(Vec3::new(0.3, -0.5, 0.9));
        let turned: Vec<Point> = cloud
            .iter()
            .map(|&p| (turn * Vec3::from(p) + Vec3::new(1.0, 2.0, 3.0)).to_array())
            .collect();
        let here = features(&cloud, glam::Mat3::IDENTITY);
        let there = features(&turned, turn);
        let distance = |a: &[f64; FPFH_BINS], b: &[f64; FPFH_BINS]| {
            a.iter().zip(b).map(|(x, y)| (x - y).abs()).sum::<f64>()
        };
        let mut changes: Vec<f64> = here
            .iter()
            .zip(&there)
            .map(|(a, b)| distance(a, b))
            .collect();
        changes.sort_by(f64::total_cmp);
        // Single pairs at a bin's edge change bins by rounding.
        assert!(changes[300] < 5.0 && changes[590] < 60.0, "{changes:?}");
        assert!(distance(&here[0], &here[300]) > 60.0, "places differ");
        for feature in here {
            for bins in feature.chunks(BINS) {
                assert!((bins.iter().sum::<f64>() - 2.0 * TOTAL).abs() < 1e-9);
            }
        }
    }

    /// Every point of a plane sees neighbours in the plane with the same normal: all angles are zero.
    #[test]
    fn on_a_plane_the_middle_bins_hold_everything() {
        let flat: Vec<Point> = bumpy(400).iter().map(|p| [p[0], p[1], 0.0]).collect();
        let tree = Neighbours::new(&flat).expect("valid");
        let settings = FpfhSettings::DEFAULT;
        let lists = tree.lists(&flat, settings.radius, settings.most);
        for feature in fpfh(&flat, &vec![Vector3::z(); 400], &lists) {
            for bins in feature.chunks(BINS) {
                assert!((bins[BINS / 2] - 2.0 * TOTAL).abs() < 1e-6, "{bins:?}");
            }
        }
    }

    #[test]
    fn repeated_and_lonely_points_have_finite_features() {
        let cloud = [[0.0; 3], [0.0; 3], [0.1, 0.0, 0.0], [9.0; 3]];
        let features = features(&cloud, glam::Mat3::IDENTITY);
        assert!(features.iter().flatten().all(|x| x.is_finite()));
        assert_eq!(features[3], [0.0; FPFH_BINS]);
    }
}
