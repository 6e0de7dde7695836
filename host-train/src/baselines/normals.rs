//! Surface normals by principal component analysis of each point's neighbourhood.

use crate::dataset::Point;
use crate::neighbours::wide;
use nalgebra::{Matrix3, Vector3};

/// How large a neighbourhood is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalSettings {
    /// Its radius, in the cloud's units.
    pub radius: f64,
    /// Most points in it, the nearest.
    pub most: usize,
}

impl NormalSettings {
    /// For clouds of about a thousand points and radius 1.
    pub const DEFAULT: NormalSettings = NormalSettings {
        radius: 0.2,
        most: 30,
    };
}

/// Unit normals `[N]` of a cloud `[N]`: the direction in which a point's neighbours spread least. `lists` holds
/// the neighbours of each point, itself among them, the nearest first, at least as many as the settings ask for
/// ([`Neighbours::lists`](crate::neighbours::Neighbours::lists)). The normal of a point with fewer than three neighbours is z.
///
/// A neighbourhood does not tell inside from outside. The sign is fixed by the largest component: positive along x and
/// z, negative along y, which is what Open3D's eigenvector solver amounts to on flat surfaces. Features of normals
/// depend on it.
pub fn normals(
    points: &[Point],
    lists: &[Vec<(usize, f64)>],
    settings: &NormalSettings,
) -> Vec<Vector3<f64>> {
    let limit = settings.radius * settings.radius;
    let normal = |list: &Vec<(usize, f64)>| {
        let nearest = list.iter().take(settings.most);
        let neighbours = nearest.take_while(|near| near.1 <= limit);
        least_spread(neighbours.map(|near| wide(points[near.0])))
    };
    lists.iter().map(normal).collect()
}

fn least_spread(points: impl Iterator<Item = Vector3<f64>> + Clone) -> Vector3<f64> {
    let (mut count, mut sum) = (0, Vector3::zeros());
    for point in points.clone() {
        count += 1;
        sum += point;
    }
    if count < 3 {
        return Vector3::z();
    }
    let mean = sum / f64::from(count);
    let covariance = points.fold(Matrix3::zeros(), |total: Matrix3<f64>, point| {
        total + (point - mean) * (point - mean).transpose()
    });
    let eigen = covariance.symmetric_eigen();
    let normal = eigen
        .eigenvectors
        .column(eigen.eigenvalues.imin())
        .into_owned();
    let largest = normal.iamax();
    let wanted = if largest == 1 { -1.0 } else { 1.0 };
    normal * (wanted * normal[largest].signum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neighbours::Neighbours;
    use crate::random::{Purpose, stream};
    use rand::RngExt;

    fn of(points: &[Point]) -> Vec<Vector3<f64>> {
        let (tree, settings) = (Neighbours::new(points), NormalSettings::DEFAULT);
        let lists = tree
            .expect("valid")
            .lists(points, settings.radius, settings.most);
        normals(points, &lists, &settings)
    }

    #[test]
    fn a_sphere_s_normals_are_its_radii() {
        let mut rng = stream(4, Purpose::Shape, 0);
        let sphere: Vec<Point> = (0..3000)
            .map(|_| crate::augment::random_direction(&mut rng).to_array())
            .collect();
        for (&point, normal) in sphere.iter().zip(of(&sphere)) {
            assert!((normal.norm() - 1.0).abs() < 1e-9);
            assert!(normal.dot(&wide(point)).abs() > 0.98, "{point:?} {normal}");
        }
    }

    #[test]
    fn planes_have_one_normal_with_a_fixed_sign() {
        let mut rng = stream(4, Purpose::Shape, 1);
        for axis in 0..3 {
            let plane: Vec<Point> = (0..500)
                .map(|_| {
                    let mut p = [0.0; 3].map(|_: f32| rng.random_range(-1.0..1.0));
                    p[axis] = 0.5;
                    p
                })
                .collect();
            let mut expected = Vector3::zeros();
            expected[axis] = if axis == 1 { -1.0 } else { 1.0 };
            assert!(of(&plane).iter().all(|n| (n - expected).norm() < 1e-9));
        }
    }

    #[test]
    fn lonely_points_get_the_z_axis() {
        let far = [[0.0; 3], [5.0, 0.0, 0.0], [5.1, 0.0, 0.0]];
        assert!(of(&far).iter().all(|n| *n == Vector3::z()));
    }
}
