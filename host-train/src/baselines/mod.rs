//! Classical registration in f64 to compare the policy with: the baselines of the paper's tables.
//!
//! | file | what |
//! |---|---|
//! | `icp` | iterative closest point: point to point, point to plane, trimmed |
//! | `fgr` | fast global registration on FPFH matches, without an initial estimate |
//! | `normals`, `fpfh` | the surface normals and features that they need |
//! | `align` | the least-squares problems that they solve |
//!
//! Rules and parameters are those of Open3D 0.20, so that numbers compare. No published crate serves:
//! threecrate-algorithms has FPFH with RANSAC in f32, but not FGR; fast-gicp wraps a C++ library.

mod align;
mod fgr;
mod fpfh;
mod icp;
mod normals;

pub use fgr::{FgrResult, FgrSettings, fgr};
pub use fpfh::{FPFH_BINS, FpfhSettings, fpfh};
pub use icp::{IcpResult, IcpSettings, IcpTarget, Residual, icp};
pub use normals::{NormalSettings, normals, outward};

use nalgebra::{Matrix3, Vector3};
use reagent_core::Pose;

/// Converts a pose from f64 to the rest of the program's f32.
fn narrow(rotation: &Matrix3<f64>, translation: &Vector3<f64>) -> Pose {
    Pose::from_rows(std::array::from_fn(|i| {
        let r = rotation.row(i);
        [r[0], r[1], r[2], translation[i]].map(|x| x as f32)
    }))
}

/// Converts a pose to f64.
pub(crate) fn widen(pose: Pose) -> (Matrix3<f64>, Vector3<f64>) {
    let [a, b, c] = pose.to_rows().map(|row| row.map(f64::from));
    let rotation = Matrix3::new(a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]);
    (rotation, Vector3::new(a[3], b[3], c[3]))
}
