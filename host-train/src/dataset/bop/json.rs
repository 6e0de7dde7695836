//! The JSON files of the layout.

use super::BopError;
use glam::{Mat3, Quat, Vec3};
use reagent_core::Pose;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// What `scene_gt.json` should hold.
pub(super) const SCENE_GT: &str = "{\"IMAGE\": [{\"obj_id\": int, \"cam_R_m2c\": [9 numbers], \"cam_t_m2c\": [3 numbers, mm]}, …]}";
/// What `scene_camera.json` should hold.
pub(super) const SCENE_CAMERA: &str =
    "{\"IMAGE\": {\"cam_K\": [9 numbers], \"depth_scale\": number}}";
/// What `scene_gt_info.json` should hold.
pub(super) const SCENE_GT_INFO: &str = "{\"IMAGE\": [{\"visib_fract\": number, …}, …]}";
/// What `models_info.json` should hold.
pub(super) const MODELS_INFO: &str = "{\"OBJECT\": {\"diameter\": number, mm, \"symmetries_discrete\" and \"symmetries_continuous\" where there are any}}";
/// What a list of targets should hold.
pub(super) const TARGETS: &str =
    "[{\"scene_id\": int, \"im_id\": int, \"obj_id\": int, \"inst_count\": int}, …]";

/// One annotated object in `scene_gt.json`.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(crate) struct Annotation {
    pub(crate) obj_id: u32,
    #[serde(rename = "cam_R_m2c")]
    pub(crate) rotation: [f64; 9],
    #[serde(rename = "cam_t_m2c")]
    pub(crate) translation: [f64; 3],
}

/// One image in `scene_camera.json`.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(crate) struct CameraEntry {
    #[serde(rename = "cam_K")]
    pub(crate) intrinsics: [f64; 9],
    #[serde(default = "one")]
    pub(crate) depth_scale: f64,
}

fn one() -> f64 {
    1.0
}

/// One annotated object in `scene_gt_info.json`.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(crate) struct AnnotationInfo {
    #[serde(default)]
    pub(crate) bbox_obj: [i64; 4],
    #[serde(default)]
    pub(crate) bbox_visib: [i64; 4],
    #[serde(default)]
    pub(crate) px_count_all: u64,
    #[serde(default)]
    pub(crate) px_count_valid: u64,
    #[serde(default)]
    pub(crate) px_count_visib: u64,
    pub(crate) visib_fract: f32,
}

/// One object in `models_info.json`; `name` is ours.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(crate) struct ModelInfo {
    pub(crate) diameter: f64,
    #[serde(default)]
    pub(crate) min_x: f64,
    #[serde(default)]
    pub(crate) min_y: f64,
    #[serde(default)]
    pub(crate) min_z: f64,
    #[serde(default)]
    pub(crate) size_x: f64,
    #[serde(default)]
    pub(crate) size_y: f64,
    #[serde(default)]
    pub(crate) size_z: f64,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) symmetries_discrete: Vec<Vec<f64>>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) symmetries_continuous: Vec<ContinuousSymmetry>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) name: Option<String>,
}

/// An axis about which any turn leaves the object unchanged.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(crate) struct ContinuousSymmetry {
    pub(crate) axis: [f64; 3],
    pub(crate) offset: [f64; 3],
}

/// One line of a list of targets.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
pub(crate) struct TargetEntry {
    pub(crate) scene_id: u32,
    pub(crate) im_id: u32,
    pub(crate) obj_id: u32,
    pub(crate) inst_count: usize,
}

/// Entries by number, in order.
pub(crate) type Numbered<T> = BTreeMap<u32, T>;

/// Reads a document.
pub(super) fn read<T: DeserializeOwned>(
    path: &Path,
    expected: &'static str,
) -> Result<T, BopError> {
    let text = std::fs::read(path).map_err(|source| match source.kind() {
        std::io::ErrorKind::NotFound => BopError::Missing {
            path: path.into(),
            expected,
        },
        _ => BopError::Io {
            path: path.into(),
            source,
        },
    })?;
    serde_json::from_slice(&text).map_err(|error| {
        // Once more, slower, to find the place of the fault.
        let document = &mut serde_json::Deserializer::from_slice(&text);
        let placed = serde_path_to_error::deserialize::<_, T>(document);
        BopError::Malformed {
            path: path.into(),
            reason: placed.map_or_else(|placed| placed.to_string(), |_| error.to_string()),
            expected,
        }
    })
}

/// Writes a document.
#[cfg(not(target_family = "wasm"))]
pub(crate) fn write(path: &Path, document: &impl Serialize) -> Result<(), BopError> {
    let io = |source| BopError::Io {
        path: path.into(),
        source,
    };
    let text = serde_json::to_string_pretty(document).map_err(|e| io(std::io::Error::other(e)))?;
    crate::files::write(path, (text + "\n").as_bytes()).map_err(io)
}

/// A pose from a row-major rotation and a translation; `None` unless it is finite and rigid to 1e-2, since files
/// have few digits. The rotation is made exactly orthonormal.
pub(super) fn pose(rotation: &[f64; 9], translation: &[f64; 3]) -> Option<Pose> {
    let (rows, _) = rotation.as_chunks::<3>();
    let row = |i: usize| Vec3::from_array(rows[i].map(|x| x as f32));
    let matrix = Mat3::from_cols(row(0), row(1), row(2)).transpose();
    let gram = matrix.transpose() * matrix;
    let rigid = gram.abs_diff_eq(Mat3::IDENTITY, 1e-2) && matrix.determinant() > 0.0;
    let pose = Pose {
        rotation: Mat3::from_quat(Quat::from_mat3(&matrix).normalize()),
        translation: Vec3::from_array(translation.map(|x| x as f32)),
    };
    (rigid && pose.translation.is_finite()).then_some(pose)
}

/// The row-major rotation and the translation of a pose.
pub(crate) fn rows(pose: &Pose) -> ([f64; 9], [f64; 3]) {
    let [a, b, c] = pose.to_rows().map(|row| row.map(f64::from));
    let rotation = [a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]];
    (rotation, [a[3], b[3], c[3]])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_told_with_its_place() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("scene_gt.json");
        let said = |text: &str| {
            std::fs::write(&path, text).expect("written");
            let read = read::<Numbered<Vec<Annotation>>>(&path, SCENE_GT);
            read.expect_err("malformed").to_string()
        };
        let short = r#"{"7": [{"obj_id": 1, "cam_R_m2c": [1, 0], "cam_t_m2c": [0, 0, 0]}]}"#;
        let found = said(short);
        assert!(
            found.contains("7[0].cam_R_m2c: invalid length 2"),
            "{found}"
        );
        assert!(said("{} {}").contains("trailing characters"));
    }

    #[test]
    fn poses_survive_and_bad_ones_are_refused() {
        let turn = Mat3::from_rotation_x(0.4) * Mat3::from_rotation_z(-1.1);
        let there = Pose {
            rotation: turn,
            translation: Vec3::new(10.0, -20.0, 900.0),
        };
        let (rotation, translation) = rows(&there);
        assert_eq!(rotation[1], f64::from(turn.y_axis.x), "row-major");
        let back = pose(&rotation, &translation).expect("rigid");
        assert!(back.rotation.abs_diff_eq(turn, 1e-6));
        assert_eq!(back.translation, there.translation);

        let mut mirrored = rotation;
        mirrored[..3].iter_mut().for_each(|x| *x = -*x);
        assert!(pose(&mirrored, &translation).is_none());
        assert!(pose(&[f64::NAN; 9], &translation).is_none());
        assert!(pose(&[0.0; 9], &translation).is_none());
        assert!(pose(&rotation, &[0.0, f64::INFINITY, 0.0]).is_none());
        assert!(pose(&rotation, &[0.0, 1e300, 0.0]).is_none());
    }
}
