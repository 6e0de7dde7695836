//! Surface normals by principal component analysis of each point's neighbourhood.

use crate::dataset::Point;
use crate::neighbours::wide;
use crate::threads::on_all_threads;
use nalgebra::{Matrix3, Vector3};

/// Size of a neighbourhood.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalSettings {
    /// Its radius, in the cloud's units.
    pub radius: f64,
    /// Most points in it; the nearest are taken.
    pub most: usize,
}

impl NormalSettings {
    /// For clouds of about a thousand points and a radius of 1.
    pub const DEFAULT: NormalSettings = NormalSettings {
        radius: 0.2,
        most: 30,
    };
}

/// Unit normals `[N]` of a cloud `[N]`: the direction in which a point's neighbours spread least. `lists` holds
/// each point's neighbours, itself included, the nearest first, and at least as many as the settings ask for
/// ([`Neighbours::lists`](crate::neighbours::Neighbours::lists)). A point with fewer than three neighbours, or only
/// equal ones, gets z.
///
/// A neighbourhood does not tell inside from outside, but features depend on the normals' signs. Here the sign is
/// that of Open3D's eigenvector solver (Eberly, "A Robust Eigensolver for 3 x 3 Symmetric Matrices"), so that
/// features are the same. It changes as a cloud is turned; that of [`outward`] does not.
pub fn normals(
    points: &[Point],
    lists: &[Vec<(usize, f64)>],
    settings: &NormalSettings,
) -> Vec<Vector3<f64>> {
    let limit = settings.radius * settings.radius;
    let normal = |k: usize| {
        let nearest = lists[k].iter().take(settings.most);
        let neighbours = nearest.take_while(|near| near.1 <= limit);
        least_spread(neighbours.map(|near| wide(points[near.0])))
    };
    on_all_threads(lists.len(), normal)
}

/// Turns a cloud's normals away from its mean, so that the same surface has the same normals in every pose.
pub fn outward(points: &[Point], normals: &mut [Vector3<f64>]) {
    let sum: Vector3<f64> = points.iter().map(|&p| wide(p)).sum();
    let mean = sum / points.len().max(1) as f64;
    for (&point, normal) in points.iter().zip(normals) {
        if normal.dot(&(wide(point) - mean)) < 0.0 {
            *normal = -*normal;
        }
    }
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
    let (values, vectors) = (eigen.eigenvalues, eigen.eigenvectors);
    let (least, most) = (values.imin(), values.imax());
    if values[most] <= 0.0 {
        return Vector3::z();
    }
    let middle = values.sum() - values[least] - values[most];
    let vector = |i: usize| vectors.column(i).into_owned();
    // The solver starts from the eigenvector that is best determined: the normal of a flat neighbourhood …
    if 3.0 * middle > values.sum() {
        return signed(vector(least));
    }
    // … or the line of a long one, from which the middle vector and their cross product follow.
    let along = signed(vector(most));
    let (x, y, z) = (along.x, along.y, along.z);
    let u = if x.abs() > y.abs() {
        Vector3::new(-z, 0.0, x)
    } else {
        Vector3::new(0.0, z, -y)
    };
    let across = along.cross(&vector(least));
    let (by_u, by_v) = (
        across.dot(&u.normalize()),
        across.dot(&along.cross(&u.normalize())),
    );
    let sign = if by_u.abs() >= by_v.abs() {
        by_u.signum()
    } else {
        -by_v.signum()
    };
    (sign * across).cross(&along)
}

/// The vector or its opposite: the one whose largest component is positive along x and z, negative along y.
fn signed(vector: Vector3<f64>) -> Vector3<f64> {
    let largest = vector.iamax();
    let wanted = if largest == 1 { -1.0 } else { 1.0 };
    vector * (wanted * vector[largest].signum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neighbours::Neighbours;
    use crate::random::{Purpose, stream};

    /// Axis of the row, axis of the bend, normal in the middle.
    type Signed = (usize, usize, [f64; 3]);
    const OPEN3D: [Signed; 6] = [
        (0, 1, [0.0227, -0.0031, -0.9997]),
        (0, 2, [-0.0227, 0.9997, 0.0031]),
        (1, 0, [-0.0031, 0.0227, -0.9997]),
        (1, 2, [0.9997, -0.0227, 0.0031]),
        (2, 0, [-0.0031, -0.9997, 0.0227]),
        (2, 1, [0.9997, 0.0031, -0.0227]),
    ];

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
    fn planes_have_one_normal_whose_sign_is_fixed_where_neighbourhoods_are_round() {
        for axis in 0..3 {
            let grid: Vec<Point> = (0..25)
                .map(|i| {
                    let mut p = [0.5; 3];
                    p[(axis + 1) % 3] = 0.05 * (i % 5) as f32;
                    p[(axis + 2) % 3] = 0.05 * (i / 5) as f32;
                    p
                })
                .collect();
            let mut expected = Vector3::zeros();
            expected[axis] = if axis == 1 { -1.0 } else { 1.0 };
            let found = of(&grid);
            assert!((found[12] - expected).norm() < 1e-9, "{}", found[12]);
            assert!(
                found
                    .iter()
                    .all(|n| (n.dot(&expected).abs() - 1.0).abs() < 1e-9)
            );
        }
    }

    #[test]
    fn turned_outward_normals_follow_the_surface() {
        let cloud: Vec<Point> = (0..300)
            .map(|i| [(i % 20) as f32 * 0.05, (i / 20) as f32 * 0.05, 0.0])
            .chain((0..20).map(|i| [0.5, 0.01 * i as f32, -0.4]))
            .collect();
        let turned: Vec<Point> = cloud.iter().map(|p| [p[0], -p[1], -p[2]]).collect();
        let outward_of = |cloud: &[Point]| {
            let mut normals = of(cloud);
            outward(cloud, &mut normals);
            normals
        };
        for (a, b) in outward_of(&cloud).iter().zip(outward_of(&turned)).take(300) {
            assert!(
                (a - Vector3::z()).norm() < 1e-6,
                "away from the points below: {a}"
            );
            assert!((b + Vector3::z()).norm() < 1e-6, "{b}");
        }
    }

    /// Signs of Open3D 0.20 for straight rows of points, bent a little: no flat neighbourhood but a long one.
    #[test]
    fn long_neighbourhoods_have_the_signs_of_open3d() {
        let row = |axis: usize, bend: usize| -> Vec<Point> {
            (0..9)
                .map(|i| {
                    let mut p = [0.0; 3];
                    p[axis] = 0.02 * (i as f32 - 4.0);
                    p[bend] = 0.003 * (i as f32 - 4.0).powi(2);
                    p[3 - axis - bend] = 0.001 * (i as f32 * 2.3).sin() + 0.0005 * i as f32;
                    p
                })
                .collect()
        };
        for (axis, bend, expected) in OPEN3D {
            let normal = of(&row(axis, bend))[4];
            let expected = Vector3::from(expected);
            assert!(
                (normal - expected).norm() < 1e-3,
                "{axis} {bend}: {normal} {expected}"
            );
        }
    }

    #[test]
    fn lonely_points_get_the_z_axis() {
        let far = [[0.0; 3], [5.0, 0.0, 0.0], [5.1, 0.0, 0.0]];
        assert!(of(&far).iter().all(|n| *n == Vector3::z()));
    }
}
