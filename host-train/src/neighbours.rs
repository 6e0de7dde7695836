//! Exact nearest neighbours in one cloud, by a kd-tree in f64.

use crate::dataset::Point;
use crate::threads::on_all_threads;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::Vector3;
use reagent_core::Error;
use std::num::NonZeroUsize;

/// A kd-tree over one cloud.
#[derive(Debug)]
pub struct Neighbours {
    tree: ImmutableKdTree<f64, 3>,
}

impl Neighbours {
    /// Builds the tree. Refuses an empty cloud and coordinates that are not finite.
    pub fn new(points: &[Point]) -> Result<Neighbours, Error> {
        if points.is_empty() {
            return Err(Error::EmptyCloud);
        }
        check_finite(points)?;
        let points: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
        let tree = ImmutableKdTree::new_from_slice(&points).map_err(|_| Error::TooManyPoints {
            points: points.len(),
            capacity: u32::MAX as usize,
        })?;
        Ok(Neighbours { tree })
    }

    /// Index of the point nearest to `query`, and the SQUARED distance to it.
    pub fn nearest(&self, query: Vector3<f64>) -> (usize, f64) {
        let found = self
            .tree
            .query(&[query.x, query.y, query.z])
            .nearest_one::<SquaredEuclidean<f64>>()
            .execute();
        (found.item as usize, found.distance)
    }

    /// Index and SQUARED distance of the `most` points nearest to `query` within `radius`, the nearest first.
    pub fn around(&self, query: Vector3<f64>, radius: f64, most: usize) -> Vec<(usize, f64)> {
        let Some(most) = NonZeroUsize::new(most) else {
            return Vec::new();
        };
        let found = self
            .tree
            .query(&[query.x, query.y, query.z])
            .nearest_n::<SquaredEuclidean<f64>>(most)
            .within(radius * radius)
            .execute();
        found
            .into_iter()
            .map(|near| (near.item as usize, near.distance))
            .collect()
    }

    /// [`Neighbours::around`] for each of `points`.
    pub fn lists(&self, points: &[Point], radius: f64, most: usize) -> Vec<Vec<(usize, f64)>> {
        let around = |k: usize| self.around(wide(points[k]), radius, most);
        on_all_threads(points.len(), around)
    }
}

/// Refuses a cloud with a NaN or an infinity, and names the first such point.
pub(crate) fn check_finite(points: &[Point]) -> Result<(), Error> {
    match points.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
        Some(index) => Err(Error::NotFinite { index }),
        None => Ok(()),
    }
}

/// A point in f64.
pub(crate) fn wide(point: Point) -> Vector3<f64> {
    Vector3::from(point.map(f64::from))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, stream};
    use rand::RngExt;

    fn brute(points: &[Point], query: Vector3<f64>) -> f64 {
        points
            .iter()
            .map(|&p| (wide(p) - query).norm_squared())
            .fold(f64::INFINITY, f64::min)
    }

    /// Planes, repeated points and shared coordinates, because scans and CAD shapes consist of them.
    #[test]
    fn agrees_with_brute_force_on_flat_and_repeated_points() {
        let mut rng = stream(1, Purpose::Pairs, 0);
        let mut flat: Vec<Point> = (0..600)
            .map(|_| {
                [
                    rng.random_range(-1.0..1.0),
                    0.25,
                    rng.random_range(-1.0..1.0),
                ]
            })
            .collect();
        flat.extend_from_within(..300);
        flat.extend([[0.5; 3]; 200]);
        let tree = Neighbours::new(&flat).expect("finite cloud");
        for _ in 0..500 {
            let query = Vector3::from_fn(|_, _| rng.random_range(-2.0..2.0));
            let (index, squared) = tree.nearest(query);
            assert_eq!(squared, brute(&flat, query));
            assert_eq!(squared, (wide(flat[index]) - query).norm_squared());
        }
    }

    #[test]
    fn a_neighbourhood_is_limited_by_radius_and_by_number() {
        let line: Vec<Point> = (0..50).map(|i| [i as f32, 0.0, 0.0]).collect();
        let tree = Neighbours::new(&line).expect("finite cloud");
        let around = |radius, most| tree.around(Vector3::new(10.2, 0.0, 0.0), radius, most);
        let indices =
            |found: Vec<(usize, f64)>| -> Vec<usize> { found.iter().map(|n| n.0).collect() };
        assert_eq!(indices(around(1.5, 9)), [10, 11, 9]);
        assert_eq!(indices(around(100.0, 4)), [10, 11, 9, 12]);
        assert!((around(1.5, 9)[2].1 - 1.44).abs() < 1e-9);
        assert!(around(0.1, 9).is_empty() && around(9.0, 0).is_empty());
    }

    #[test]
    fn empty_and_not_finite_clouds_are_refused() {
        assert_eq!(Neighbours::new(&[]).err(), Some(Error::EmptyCloud));
        let cloud = [[0.0; 3], [0.0, f32::NAN, 0.0]];
        assert_eq!(
            Neighbours::new(&cloud).err(),
            Some(Error::NotFinite { index: 1 })
        );
    }
}
