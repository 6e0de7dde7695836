//! The paper's metrics for one registration (appendix, "Definition of Used Metrics"), in f64.
//!
//! | field | definition |
//! |---|---|
//! | `r_mae_deg` | mean absolute difference of the EXTRINSIC xyz Euler angles, `R = Rz Ry Rx`, degrees |
//! | `t_mae` | mean absolute difference of the translations' components |
//! | `r_iso_deg` | angle of `R*^T R`, degrees |
//! | `t_iso` | Euclidean distance of the translations |
//! | `chamfer_mod` | `CD(X', Y_clean) + CD(Y, X_clean)`, squared distances |
//! | `add` | mean distance of corresponding clean points, over the diameter |
//! | `adi` | mean distance of closest clean points, over the diameter |
//!
//! With the residual `E = T T*^-1`, the clean source under the estimate is `E` applied to the clean
//! target. `E` is rigid, so the distance of `y` to the nearest point of `E Y_clean` is that of `E^-1 y` to
//! the nearest point of `Y_clean`, and the diameter does not depend on `E`: one kd-tree and one diameter
//! serve every estimate for a pair.

mod summary;

#[cfg(not(target_family = "wasm"))]
pub(crate) use summary::quantile;
pub use summary::{Errors, Quartiles, Summary, auc, is_right};

use crate::baselines::widen;
use crate::dataset::Point;
use crate::dataset::pairs::Symmetry;
use crate::diameter::diameter;
use crate::neighbours::{Neighbours, check_finite, wide};
use nalgebra::{Matrix3, Vector3};
use reagent_core::{Error, Pose};

/// Errors of one estimated pose. Lengths are in the clouds' units, angles in degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairMetrics {
    /// Mean absolute error of the extrinsic xyz Euler angles, degrees.
    pub r_mae_deg: f64,
    /// Mean absolute error of the translation's components.
    pub t_mae: f64,
    /// Isotropic rotation error: angle of the residual rotation, degrees.
    pub r_iso_deg: f64,
    /// Isotropic translation error: length of the difference.
    pub t_iso: f64,
    /// Modified Chamfer distance, squared units.
    pub chamfer_mod: f64,
    /// Average distance of corresponding model points, in diameters.
    pub add: f64,
    /// Average distance of closest model points, for objects whose views are indistinguishable, in diameters.
    pub adi: f64,
    /// ADI if the object is known to have a symmetry, else ADD; the least over the poses that look like the true one.
    pub ad: f64,
}

/// Reference that estimates for one pair are measured against.
#[derive(Debug)]
pub struct GroundTruth<'a> {
    source: &'a [Point],
    target: &'a [Point],
    clean: &'a [Point],
    target_from_source: Pose,
    clean_tree: Neighbours,
    diameter: f64,
    /// Poses that look like the true one; `symmetric` says whether ADI counts.
    alike: Vec<Pose>,
    symmetric: bool,
}

impl<'a> GroundTruth<'a> {
    /// Prepares a pair: `source [N, 3]` and `target [M, 3]` as observed, the true pose, and `raw [K, 3]`, the
    /// noise-free cloud in the target's frame. Without `raw` the target stands in for it.
    ///
    /// Refuses empty clouds, coordinates that are not finite, a clean cloud without extent, and a true pose that is
    /// not rigid.
    pub fn new(
        source: &'a [Point],
        target: &'a [Point],
        raw: Option<&'a [Point]>,
        target_from_source: Pose,
    ) -> Result<GroundTruth<'a>, Error> {
        if source.is_empty() || target.is_empty() {
            return Err(Error::EmptyCloud);
        }
        check_finite(source)?;
        check_finite(target)?;
        let clean = raw.unwrap_or(target);
        let clean_tree = Neighbours::new(clean)?;
        let diameter = diameter(clean);
        if diameter <= 0.0 {
            return Err(Error::NoExtent);
        }
        let target_from_source = target_from_source.checked()?;
        Ok(GroundTruth {
            source,
            target,
            clean,
            target_from_source,
            clean_tree,
            diameter,
            alike: Vec::new(),
            symmetric: false,
        })
    }

    /// Adds what is known of the object's symmetry.
    ///
    /// # Errors
    /// [`Error::BadPose`] for a symmetry that is not rigid.
    pub fn with_symmetry(mut self, symmetry: &Symmetry) -> Result<GroundTruth<'a>, Error> {
        let poses = symmetry
            .truths
            .iter()
            .map(|rows| Pose::from_rows(*rows).checked());
        self.alike = poses.collect::<Result<_, _>>()?;
        self.symmetric = symmetry.sym;
        Ok(self)
    }

    /// ADD and ADI of an estimate against one of the poses that look like the true one, in diameters.
    fn average_distances(&self, estimate: Pose, truth: Pose) -> [f64; 2] {
        let (r_true, t_true) = widen(truth);
        let (r, t) = widen(estimate);
        // E = T T*^-1 takes the clean target to where the estimate would put the clean source.
        let r_residual = r * r_true.transpose();
        let t_residual = t - r_residual * t_true;
        let forward = |p: Point| r_residual * wide(p) + t_residual;
        let backward = |p: Point| r_residual.tr_mul(&(wide(p) - t_residual));
        let add = mean(self.clean, |p| (forward(p) - wide(p)).norm());
        let adi = mean(self.clean, |p| {
            self.clean_tree.nearest(backward(p)).1.sqrt()
        });
        [add, adi].map(|distance| distance / self.diameter)
    }

    /// Errors of `estimate`, a plain `target_from_source` transform.
    pub fn measure(&self, estimate: Pose) -> PairMetrics {
        let (r_true, t_true) = widen(self.target_from_source);
        let (r, t) = widen(estimate);
        let difference = t - t_true;
        let angles = euler_extrinsic_xyz_deg(&r) - euler_extrinsic_xyz_deg(&r_true);

        let r_residual = r * r_true.transpose();
        let t_residual = t - r_residual * t_true;
        let backward = |p: Point| r_residual.tr_mul(&(wide(p) - t_residual));

        let nearest = |p: Vector3<f64>| self.clean_tree.nearest(p).1;
        let chamfer_source = mean(self.source, |p| nearest(r * wide(p) + t));
        let chamfer_target = mean(self.target, |p| nearest(backward(p)));
        let [add, adi] = self.average_distances(estimate, self.target_from_source);
        let of = |[add, adi]: [f64; 2]| if self.symmetric { adi } else { add };
        let others = self
            .alike
            .iter()
            .map(|&truth| of(self.average_distances(estimate, truth)));
        let ad = others.fold(of([add, adi]), f64::min);

        PairMetrics {
            r_mae_deg: angles.abs().sum() / 3.0,
            t_mae: difference.abs().sum() / 3.0,
            r_iso_deg: angle_deg(&r_true.tr_mul(&r)),
            t_iso: difference.norm(),
            chamfer_mod: chamfer_source + chamfer_target,
            add,
            adi,
            ad,
        }
    }
}

fn mean(points: &[Point], f: impl Fn(Point) -> f64) -> f64 {
    points.iter().map(|&p| f(p)).sum::<f64>() / points.len() as f64
}

/// Angle of a rotation, degrees, by atan2 of its sine and cosine: exact near 0, where acos is not.
fn angle_deg(r: &Matrix3<f64>) -> f64 {
    let twice_sine = Vector3::new(
        r[(2, 1)] - r[(1, 2)],
        r[(0, 2)] - r[(2, 0)],
        r[(1, 0)] - r[(0, 1)],
    );
    twice_sine.norm().atan2(r.trace() - 1.0).to_degrees()
}

/// Angles of `R = Rz(c) Ry(b) Rx(a)` in degrees, as scipy's `as_euler("xyz")` gives them; at gimbal lock the third
/// angle is 0.
fn euler_extrinsic_xyz_deg(r: &Matrix3<f64>) -> Vector3<f64> {
    let sine = (-r[(2, 0)]).clamp(-1.0, 1.0);
    let (first, third) = if sine.abs() > 1.0 - 1e-12 {
        ((-r[(1, 2)]).atan2(r[(1, 1)]), 0.0)
    } else {
        (r[(2, 1)].atan2(r[(2, 2)]), r[(1, 0)].atan2(r[(0, 0)]))
    };
    Vector3::new(first, sine.asin(), third).map(f64::to_degrees)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use reagent_core::pose::rotation_from_euler;

    #[test]
    fn angles_are_exact_near_zero_and_near_half_a_turn() {
        for degrees in [0.0, 1e-7, 0.5, 90.0, 179.999, 180.0] {
            let (s, c) = f64::to_radians(degrees).sin_cos();
            let turn = Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0);
            assert!((angle_deg(&turn) - degrees).abs() < 1e-9, "{degrees}");
        }
    }

    #[test]
    fn euler_angles_are_extrinsic_and_survive_gimbal_lock() {
        let (a, b, c) = (0.3f64, -0.8f64, 2.1f64);
        let axis = |v: Vector3<f64>, x: f64| nalgebra::Rotation3::new(v * x).into_inner();
        let compose =
            |a, b, c| axis(Vector3::z(), c) * axis(Vector3::y(), b) * axis(Vector3::x(), a);
        let back = euler_extrinsic_xyz_deg(&compose(a, b, c));
        assert!((back - Vector3::new(a, b, c).map(f64::to_degrees)).norm() < 1e-9);
        let locked = compose(0.4, std::f64::consts::FRAC_PI_2, 0.1);
        let back = euler_extrinsic_xyz_deg(&locked).map(f64::to_radians);
        assert!(
            (compose(back.x, back.y, back.z) - locked).norm() < 1e-6,
            "{back}"
        );
    }

    #[test]
    fn a_shifted_square_has_the_errors_one_can_see() {
        // Corners of a unit square, shifted by a quarter along x: the diameter is sqrt 2.
        let square = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [1.0, 1.0, 0.0],
            [0.0, 1.0, 0.0],
        ];
        let truth = GroundTruth::new(&square, &square, None, Pose::IDENTITY).expect("valid pair");
        let shifted = Pose {
            translation: Vec3::new(0.25, 0.0, 0.0),
            ..Pose::IDENTITY
        };
        let m = truth.measure(shifted);
        assert!((m.t_iso - 0.25).abs() < 1e-9 && (m.t_mae - 0.25 / 3.0).abs() < 1e-9);
        assert!((m.add - 0.25 / 2f64.sqrt()).abs() < 1e-9 && (m.adi - m.add).abs() < 1e-9);
        assert!((m.chamfer_mod - 2.0 * 0.0625).abs() < 1e-9);
        // A quarter turn about the centre maps the square to itself: only ADI and Chamfer see that.
        let quarter = rotation_from_euler(Vec3::new(0.0, 0.0, std::f32::consts::FRAC_PI_2));
        let turned = Pose {
            rotation: quarter,
            translation: Vec3::new(1.0, 0.0, 0.0),
        };
        let m = truth.measure(turned);
        assert!((m.r_iso_deg - 90.0).abs() < 1e-4 && m.adi < 1e-6 && m.chamfer_mod < 1e-12);
        assert!((m.add - 1.0 / 2f64.sqrt()).abs() < 1e-6);
    }

    #[test]
    fn bad_pairs_are_refused() {
        let (good, flat) = ([[0.0; 3], [1.0; 3]], [[1.0; 3]; 4]);
        let new = |s, t, raw| GroundTruth::new(s, t, raw, Pose::IDENTITY).err();
        assert_eq!(new(&[], &good, None), Some(Error::EmptyCloud));
        assert_eq!(new(&good, &good, Some(&[])), Some(Error::EmptyCloud));
        assert_eq!(new(&good, &flat, None), Some(Error::NoExtent));
        assert_eq!(
            new(&[[f32::NAN; 3]], &good, None),
            Some(Error::NotFinite { index: 0 })
        );
    }

    #[test]
    fn a_symmetric_pose_is_as_good_as_the_true_one() {
        let square = [
            [1.0, 1.0, 0.0],
            [-1.0, 1.0, 0.0],
            [-1.0, -1.0, 0.0],
            [1.0, -1.0, 0.0],
        ];
        let quarter = Pose {
            rotation: glam::Mat3::from_rotation_z(std::f32::consts::FRAC_PI_2),
            ..Pose::IDENTITY
        };
        let truth = || GroundTruth::new(&square, &square, None, Pose::IDENTITY).expect("valid");
        let ad = |symmetry: Symmetry| {
            let truth = truth().with_symmetry(&symmetry).expect("rigid");
            truth.measure(quarter).ad
        };
        assert!(truth().measure(quarter).ad > 0.5);
        let truths = vec![quarter.to_rows()];
        assert!(ad(Symmetry { truths, sym: false }) < 1e-6);
        assert!(
            ad(Symmetry {
                truths: Vec::new(),
                sym: true
            }) < 1e-6
        );
        let scaled = Symmetry {
            truths: vec![[[2.0, 0.0, 0.0, 0.0]; 3]],
            sym: false,
        };
        assert!(truth().with_symmetry(&scaled).is_err());
    }
}
