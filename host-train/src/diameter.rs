//! The largest distance between two points of a cloud.

use crate::dataset::Point;
use crate::neighbours::wide;
use nalgebra::Vector3;

/// Exact diameter of a cloud, in its units; 0 for fewer than two points.
///
/// Points are visited from the farthest from the centroid inwards. By the triangle inequality the distance of a
/// pair is at most the sum of its two radii, so that the search ends long before all pairs are seen.
pub fn diameter(points: &[Point]) -> f64 {
    let points: Vec<Vector3<f64>> = points.iter().map(|&p| wide(p)).collect();
    let centroid = points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64;
    let mut by_radius: Vec<(f64, Vector3<f64>)> = points
        .into_iter()
        .map(|p| ((p - centroid).norm(), p))
        .collect();
    by_radius.sort_by(|a, b| b.0.total_cmp(&a.0));

    let (mut squared, mut best) = (0.0f64, 0.0f64);
    for (i, &(radius, p)) in by_radius.iter().enumerate() {
        if 2.0 * radius < best {
            break;
        }
        for &(other, q) in &by_radius[i + 1..] {
            if radius + other < best {
                break;
            }
            let d = (p - q).norm_squared();
            if d > squared {
                (squared, best) = (d, d.sqrt());
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn brute(points: &[Point]) -> f64 {
        let distance = |a: &Point, b: &Point| (wide(*a) - wide(*b)).norm();
        points
            .iter()
            .flat_map(|a| points.iter().map(move |b| distance(a, b)))
            .fold(0.0, f64::max)
    }

    proptest! {
        #[test]
        fn equals_brute_force(points in prop::collection::vec(prop::array::uniform3(-5.0f32..5.0), 0..60)) {
            prop_assert_eq!(diameter(&points), brute(&points));
        }
    }

    #[test]
    fn points_on_a_circle_are_the_worst_case() {
        let circle: Vec<Point> = (0..500)
            .map(|i| (i as f32 * 0.012_566).sin_cos())
            .map(|(s, c)| [s, c, 0.0])
            .collect();
        assert_eq!(diameter(&circle), brute(&circle));
    }
}
