//! Classical registration beside the policy, in f64: the baselines of the paper's tables.
//!
//! | file | what |
//! |---|---|
//! | `icp` | iterative closest point: point to point, point to plane, trimmed |
//! | `fgr` | fast global registration of FPFH matches, for when there is no first estimate |
//! | `normals`, `fpfh` | what they need of a cloud |
//! | `align` | the least-squares problems they solve |
//!
//! Rules and parameters are those of Open3D 0.20, so that numbers compare. No published crate would have served:
//! threecrate-algorithms has FPFH with RANSAC, not FGR, in f32; fast-gicp wraps a C++ library.

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

/// A pose computed in f64, as the rest of the program takes it.
fn narrow(rotation: &Matrix3<f64>, translation: &Vector3<f64>) -> Pose {
    Pose::from_rows(std::array::from_fn(|i| {
        let r = rotation.row(i);
        [r[0], r[1], r[2], translation[i]].map(|x| x as f32)
    }))
}
