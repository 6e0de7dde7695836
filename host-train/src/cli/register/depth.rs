//! A depth image in place of the source: `--depth`.

use crate::dataset::Point;
use crate::dataset::cloud_file::{CloudFile, Note};
use crate::dataset::depth::{DepthError, DepthImage, Depths, Intrinsics, read_depths, read_mask};
use clap::Args;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Millimetres per unit of depth: of floating-point numbers, which are metres, and of integers.
const METRES: f64 = 1000.0;
const MILLIMETRES: f64 = 1.0;

/// A depth image, its camera and its mask.
#[derive(Clone, Debug, Default, Args)]
pub(super) struct DepthArgs {
    /// Depth image in place of SOURCE: a greyscale PNG of 16 bits, or an array (rows, columns) in a .npy file. What it shows
    /// becomes the source, in millimetres in the camera's frame (x right, y down, z ahead), seen from the origin
    #[arg(long, value_name = "FILE.png|.npy", requires = "camera", conflicts_with_all = ["pairs", "view"])]
    pub(super) depth: Option<PathBuf>,
    /// Camera of the depth image, a pinhole without distortion, pixels: fx,fy,cx,cy, or a file with these four, with the nine
    /// numbers of K, or JSON of RealSense, Open3D or BOP (camera.json, scene_camera.json)
    #[arg(
        long,
        value_name = "FX,FY,CX,CY|FILE",
        requires = "depth",
        conflicts_with = "pairs",
        allow_hyphen_values = true
    )]
    camera: Option<Camera>,
    /// Millimetres per unit of depth [default: for integers what the camera's file says, or 1; for floating-point
    /// numbers, which are metres by convention, 1000]
    #[arg(long, value_name = "FACTOR", requires = "depth", conflicts_with = "pairs", value_parser = super::factor)]
    depth_scale: Option<f64>,
    /// Which pixels show the object: a greyscale PNG, or an array in a .npy file, 0 where they do not
    /// [default: all]
    #[arg(
        long,
        value_name = "FILE.png|.npy",
        requires = "depth",
        conflicts_with = "pairs"
    )]
    pub(super) mask: Option<PathBuf>,
}

/// A camera on the command line, or the file that holds it.
#[derive(Clone, Debug)]
enum Camera {
    Numbers(Intrinsics),
    File(PathBuf),
}

impl FromStr for Camera {
    type Err = String;

    fn from_str(text: &str) -> Result<Camera, String> {
        Ok(match text.contains(',') {
            true => Camera::Numbers(text.parse()?),
            false => Camera::File(text.into()),
        })
    }
}

impl DepthArgs {
    /// The files named.
    pub(super) fn files(&self) -> impl Iterator<Item = &PathBuf> {
        let camera = match &self.camera {
            Some(Camera::File(path)) => Some(path),
            _ => None,
        };
        [self.depth.as_ref(), camera, self.mask.as_ref()]
            .into_iter()
            .flatten()
    }

    /// The options that help if sizes differ.
    pub(super) fn size_advice(&self, notes: &[Note]) -> String {
        let scene = match self.mask {
            None => "Without --mask the source is the whole scene. ",
            Some(_) => "",
        };
        let is_metres =
            |note: &Note| matches!(note, Note::Seen { scale_mm, .. } if *scale_mm == METRES);
        let unit = match self.depth_scale.is_none() && notes.iter().any(is_metres) {
            true => {
                "A unit of depth was taken for a metre: if it is a millimetre, give --depth-scale 1"
            }
            false => "See --depth-scale and --unit",
        };
        format!("{scene}{unit}")
    }

    /// The object's points and those around it, millimetres in the camera's frame.
    pub(super) fn read(&self) -> Result<Option<(CloudFile, Vec<Point>)>, DepthError> {
        let (Some(path), Some(camera)) = (&self.depth, &self.camera) else {
            return Ok(None);
        };
        let Depths {
            image: depth,
            is_float,
            marked,
        } = read_depths(path)?;
        let (origin, camera) = match camera {
            Camera::Numbers(camera) => (Path::new("--camera"), *camera),
            Camera::File(file) => (file.as_path(), Intrinsics::read(file, path)?),
        };
        let usual = match is_float {
            true => METRES,
            false => camera.depth_scale.unwrap_or(MILLIMETRES),
        };
        let scale_mm = self.depth_scale.unwrap_or(usual);
        let mask = match &self.mask {
            Some(mask) => Some((mask.as_path(), read_mask(mask)?)),
            None => None,
        };
        let image = DepthImage::checked((path, depth), (origin, camera), mask, scale_mm)?;
        let points = image.object();
        let seen = Note::Seen {
            pixels: points.len(),
            without: image.object_pixels() - points.len(),
            scale_mm,
        };
        let marked = marked.map(|(number, pixels)| Note::Marked { number, pixels });
        let off_centre = image.camera.is_off_centre().then(|| Note::OffCentre {
            centre: image.camera.centre.to_array(),
            size: image.camera.size,
        });
        let object = CloudFile {
            notes: [Some(seen), marked, off_centre]
                .into_iter()
                .flatten()
                .collect(),
            ..CloudFile::of(&points)
        };
        Ok(Some((object, image.background())))
    }
}
