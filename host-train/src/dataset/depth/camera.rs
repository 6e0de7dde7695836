//! Cameras as users have them: four numbers, or a file.

use super::DepthError;
use crate::dataset::cloud_file::npy;
use crate::dataset::raster::Pinhole;
use glam::Vec2;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::path::Path;
use std::str::FromStr;

/// What a camera must be.
const EXPECTED: &str = "fx,fy,cx,cy in pixels; a file of these four or of the nine numbers of K, as text or .npy; or JSON with fx, fy, cx, cy, or K, k or camera_matrix (ROS, OpenCV), \
     or cam_K, also for each image (BOP's camera.json, scene_camera.json), or as RealSense (ppx, ppy) and Open3D (intrinsic_matrix) write it";

/// A pinhole camera without distortion, pixels: centres of pixels lie at whole numbers, as in OpenCV and BOP.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// `(fx, fy)`.
    pub(super) focal: Vec2,
    /// `(cx, cy)`.
    pub(super) centre: Vec2,
    /// Columns and rows for which it was calibrated, if that is known.
    pub size: Option<[usize; 2]>,
    /// Millimetres a unit of the depth images, if that is known.
    pub depth_scale: Option<f64>,
}

/// BOP's `camera.json`, or a RealSense camera's intrinsics.
#[derive(Deserialize)]
struct Flat {
    fx: f64,
    fy: f64,
    #[serde(alias = "ppx")]
    cx: f64,
    #[serde(alias = "ppy")]
    cy: f64,
    width: Option<usize>,
    height: Option<usize>,
    depth_scale: Option<f64>,
}

/// Of the text of a file.
fn of_text(text: &str, image: &Path) -> Result<Intrinsics, String> {
    if text.starts_with('{') {
        of_json(text, image)
    } else if is_yaml(text) {
        Err(
            "it is YAML, which is not read: give the nine numbers of its camera_matrix, k or K"
                .into(),
        )
    } else {
        text.parse()
    }
}

/// Of focal lengths and principal point, or of the rows of K.
fn of_numbers(numbers: &[f64]) -> Result<Intrinsics, String> {
    match *numbers {
        [fx, fy, cx, cy] => Intrinsics::new([fx, fy, cx, cy]),
        [a, b, c, d, e, f, g, h, i] => Intrinsics::of_matrix([a, b, c, d, e, f, g, h, i]),
        _ => Err(format!("it has {} numbers", numbers.len())),
    }
}

/// Open3D's `PinholeCameraIntrinsic`: the columns of K.
#[derive(Deserialize)]
struct Columns {
    intrinsic_matrix: [f64; 9],
    width: Option<usize>,
    height: Option<usize>,
}

/// An entry of BOP's `scene_camera.json`.
#[derive(Deserialize)]
struct Matrix {
    #[serde(rename = "cam_K")]
    matrix: [f64; 9],
    depth_scale: Option<f64>,
}

impl Intrinsics {
    /// Of focal lengths and principal point.
    ///
    /// # Errors
    /// In words: a focal length that is not positive, a number that is not finite.
    pub fn new([fx, fy, cx, cy]: [f64; 4]) -> Result<Intrinsics, String> {
        let positive = |x: f64| x > 0.0 && x.is_finite();
        if !(positive(fx) && positive(fy)) {
            return Err(format!(
                "focal lengths are positive numbers of pixels, found {fx} and {fy}"
            ));
        }
        if !(cx.is_finite() && cy.is_finite()) {
            return Err(format!("the principal point is ({cx}, {cy})"));
        }
        Ok(Intrinsics {
            focal: Vec2::new(fx as f32, fy as f32),
            centre: Vec2::new(cx as f32, cy as f32),
            size: None,
            depth_scale: None,
        })
    }

    /// Of the rows of the camera's matrix K.
    ///
    /// # Errors
    /// As [`Intrinsics::new`], and a matrix that skews or is of another form.
    pub fn of_matrix(matrix: [f64; 9]) -> Result<Intrinsics, String> {
        let [fx, skew, cx, below, fy, cy, last @ ..] = matrix;
        if [skew, below] != [0.0; 2] || last != [0.0, 0.0, 1.0] {
            return Err(format!(
                "K has the rows fx 0 cx, 0 fy cy, 0 0 1; found {matrix:?}"
            ));
        }
        Intrinsics::new([fx, fy, cx, cy])
    }

    /// Reads a file. Of one that has a camera for each image, that of the number by which `image` is named is taken.
    ///
    /// # Errors
    /// A file that cannot be read, or holds no camera.
    pub fn read(path: &Path, image: &Path) -> Result<Intrinsics, DepthError> {
        let bytes = std::fs::read(path).map_err(|source| DepthError::Io {
            path: path.into(),
            source,
        })?;
        let found = match std::str::from_utf8(&bytes) {
            _ if npy::is(&bytes) => npy::matrix(&bytes).and_then(|numbers| of_numbers(&numbers)),
            Ok(text) => of_text(text.trim_start_matches('\u{feff}').trim(), image),
            Err(_) => Err("it is neither text nor a NumPy array".into()),
        };
        found.map_err(|reason| DepthError::Malformed {
            path: path.into(),
            reason,
            expected: EXPECTED,
        })
    }

    /// The camera of images of this size.
    pub(crate) fn pinhole(&self, size: [usize; 2]) -> Pinhole {
        Pinhole {
            size,
            focal: self.focal,
            centre: self.centre,
        }
    }
}

impl FromStr for Intrinsics {
    type Err = String;

    /// Four numbers or nine, separated by commas or white space.
    fn from_str(text: &str) -> Result<Intrinsics, String> {
        let words = text.split(|c: char| c.is_whitespace() || matches!(c, ',' | '[' | ']'));
        let words = words.filter(|word| !word.is_empty());
        let number = |word: &str| {
            word.parse()
                .map_err(|_| format!("\"{word}\" is not a number"))
        };
        let numbers = words.map(number).collect::<Result<Vec<f64>, String>>()?;
        of_numbers(&numbers)
    }
}

/// Whether it begins as the files of ROS and OpenCV do, with a name and a colon or a mark of its own.
fn is_yaml(text: &str) -> bool {
    let first = text.lines().next().unwrap_or_default();
    let is_name = |name: &str| name.starts_with(char::is_alphabetic) && !name.contains(' ');
    let named = first.split_once(':').is_some_and(|(name, _)| is_name(name));
    named || ["---", "%YAML"].iter().any(|mark| first.starts_with(mark))
}

fn of_json(text: &str, image: &Path) -> Result<Intrinsics, String> {
    let document: Value = serde_json::from_str(text).map_err(|e| e.to_string())?;
    refuse_distortion(&document)?;
    if document.get("fx").is_some() {
        let flat: Flat = fields(document)?;
        return Ok(Intrinsics {
            size: size(flat.width, flat.height),
            depth_scale: flat.depth_scale.map(checked_scale).transpose()?,
            ..Intrinsics::new([flat.fx, flat.fy, flat.cx, flat.cy])?
        });
    }
    // Open3D writes it alone, or beside the camera's place.
    let pinhole = document.get("intrinsic").unwrap_or(&document);
    if pinhole.get("intrinsic_matrix").is_some() {
        let columns: Columns = fields(pinhole.clone())?;
        let [a, b, c, d, e, f, g, h, i] = columns.intrinsic_matrix;
        return Ok(Intrinsics {
            size: size(columns.width, columns.height),
            ..Intrinsics::of_matrix([a, d, g, b, e, h, c, f, i])?
        });
    }
    if let Some(rows) = first_of(&document, &ROWS) {
        let rows = flat(rows).and_then(|rows| <[f64; 9]>::try_from(rows).ok());
        let rows = rows.ok_or("its K does not have nine numbers")?;
        let side = |name: &str| document.get(name)?.as_u64()?.try_into().ok();
        let [width, height] = [["width", "image_width"], ["height", "image_height"]]
            .map(|names| names.into_iter().find_map(side));
        return Ok(Intrinsics {
            size: size(width, height),
            ..Intrinsics::of_matrix(rows)?
        });
    }
    let entry = if document.get("cam_K").is_some() {
        document
    } else {
        let name = image.file_stem().unwrap_or_default().to_string_lossy();
        let number: Option<u32> = name.parse().ok();
        let entry = number.and_then(|number| document.get(number.to_string()));
        let entry =
            entry.ok_or_else(|| format!("it has no fx, no K, no cam_K, and no image {name}"))?;
        entry.clone()
    };
    let Matrix {
        matrix,
        depth_scale,
    } = fields(entry)?;
    Ok(Intrinsics {
        depth_scale: depth_scale.map(checked_scale).transpose()?,
        ..Intrinsics::of_matrix(matrix)?
    })
}

/// The rows of K in ROS's messages and files, and in OpenCV's.
const ROWS: [&str; 4] = ["K", "k", "camera_matrix", "cameraMatrix"];
/// How the same call the lens's distortion.
const DISTORTION: [&str; 8] = [
    "D",
    "d",
    "distortion_coefficients",
    "dist_coeffs",
    "distCoeffs",
    "dist",
    "distortion",
    "coeffs",
];
/// The same, each coefficient by its name.
const COEFFICIENTS: [&str; 8] = ["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"];
/// A coefficient that moves no pixel.
const NO_DISTORTION: f64 = 1e-6;

fn first_of<'v>(document: &'v Value, names: &[&str]) -> Option<&'v Value> {
    names.iter().find_map(|name| document.get(name))
}

/// Numbers in a list, in lists of lists, or below `data`.
fn flat(value: &Value) -> Option<Vec<f64>> {
    match value {
        Value::Array(values) => {
            let parts = values.iter().map(|value| match value.as_f64() {
                Some(number) => Some(vec![number]),
                None => flat(value),
            });
            Some(parts.collect::<Option<Vec<_>>>()?.concat())
        }
        Value::Object(fields) => flat(fields.get("data")?),
        _ => None,
    }
}

/// Refuses a camera whose lens moves pixels. A word for the kind of distortion says nothing of how much there is.
fn refuse_distortion(document: &Value) -> Result<(), String> {
    let mut coefficients = Vec::new();
    for name in DISTORTION {
        let given = document
            .get(name)
            .filter(|v| !(v.is_null() || v.is_string()));
        if let Some(given) = given {
            coefficients.extend(flat(given).ok_or("its distortion is no list of numbers")?);
        }
    }
    let by_name = COEFFICIENTS
        .iter()
        .filter_map(|name| document.get(name)?.as_f64());
    coefficients.extend(by_name);
    match coefficients.iter().all(|x| x.abs() < NO_DISTORTION) {
        true => Ok(()),
        false => Err("its lens distorts: rectify the image, and give the camera of that".into()),
    }
}

fn size(width: Option<usize>, height: Option<usize>) -> Option<[usize; 2]> {
    Some([width?, height?])
}

/// What a unit of depth is in another unit, as a file or an argument has it.
///
/// # Errors
/// In words: it is not positive, or not finite.
pub fn checked_scale(scale: f64) -> Result<f64, String> {
    match scale > 0.0 && scale.is_finite() {
        true => Ok(scale),
        false => Err(format!(
            "depth_scale: expected a positive number, found {scale}"
        )),
    }
}

fn fields<T: DeserializeOwned>(document: Value) -> Result<T, String> {
    serde_json::from_value(document).map_err(|e| e.to_string())
}
