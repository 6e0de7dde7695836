//! Depth images: what a depth camera measures at each pixel, along its axis.
//!
//! | part | what |
//! |---|---|
//! | depths | greyscale PNG of 16 bits, or an array `.npy` of floats or of integers of 16 bits or more; 0, negative, NaN, beyond 1e12 and the largest integer, such as 65535: nothing was measured |
//! | camera | a pinhole without distortion: [`Intrinsics`] |
//! | mask | greyscale PNG, or an array `.npy`: what is above 0 shows the object |
//!
//! Points are in the camera's frame: x to the right, y down, z along its axis. The view point is their origin.

mod camera;
mod error;
pub mod image;

pub use camera::{Intrinsics, checked_scale};
pub use error::DepthError;

use super::Point;
use super::cloud_file::{MAX_COORDINATE, extension, npy};
use super::raster::Pinhole;
use image::{Image, NOT_MEASURED};
use std::path::Path;

/// What the camera sees of an object and around it.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthImage {
    /// The camera, with the size of the image.
    pub camera: Pinhole,
    /// Row by row; 0 where there is none.
    depths: Vec<f32>,
    /// Whether a pixel shows the object.
    mask: Vec<bool>,
}

/// Something, and the file or argument that it comes from.
pub type Named<'p, T> = (&'p Path, T);

impl DepthImage {
    /// Of depths and a mask of the camera's size, row by row. What is no positive number was not measured.
    pub fn new(camera: Pinhole, depths: Vec<f32>, mask: Vec<bool>) -> DepthImage {
        let measured = |depth: f32| {
            if depth > 0.0 && f64::from(depth) <= MAX_COORDINATE {
                depth
            } else {
                0.0
            }
        };
        DepthImage {
            camera,
            depths: depths.into_iter().map(measured).collect(),
            mask,
        }
    }

    /// The same of parts that a user gave. Depths are multiplied by `scale`, which gives the points their unit; without a mask
    /// all pixels show the object.
    ///
    /// # Errors
    /// Sizes that differ, a mask that is 0 everywhere, no depth where the object is.
    pub fn checked(
        (depth_path, depth): Named<'_, Image<f32>>,
        (camera_path, camera): Named<'_, Intrinsics>,
        mask: Option<Named<'_, Image<bool>>>,
        scale: f64,
    ) -> Result<DepthImage, DepthError> {
        let size = depth.size;
        let same = |path: &Path, found| match found == size {
            true => Ok(()),
            false => Err(DepthError::Size {
                path: path.into(),
                found,
                depth: depth_path.into(),
                expected: size,
            }),
        };
        same(camera_path, camera.size.unwrap_or(size))?;
        let mask = match mask {
            None => vec![true; depth.values.len()],
            Some((path, mask)) => {
                same(path, mask.size)?;
                if !mask.values.contains(&true) {
                    return Err(DepthError::EmptyMask { path: path.into() });
                }
                mask.values
            }
        };
        let scaled = |&units: &f32| (f64::from(units) * scale) as f32;
        let depths = depth.values.iter().map(scaled).collect();
        let image = DepthImage::new(camera.pinhole(size), depths, mask);
        if image.pixels(true).is_empty() {
            return Err(DepthError::NoDepth {
                path: depth_path.into(),
                pixels: image.object_pixels(),
            });
        }
        Ok(image)
    }

    /// Pixels of the object, with a depth or without.
    pub fn object_pixels(&self) -> usize {
        self.mask.iter().filter(|&&inside| inside).count()
    }

    /// Pixels (row-major) with a depth, inside the mask or outside of it.
    pub fn pixels(&self, inside: bool) -> Vec<u32> {
        let pixels = self.depths.iter().zip(&self.mask).enumerate();
        pixels
            .filter(|(_, (depth, mask))| **depth > 0.0 && **mask == inside)
            .map(|(i, _)| i as u32)
            .collect()
    }

    /// Depth at a pixel, inside the mask or outside of it; 0 where there is none.
    pub fn depth(&self, pixel: usize) -> f32 {
        self.depths[pixel]
    }

    /// The point seen at one of [`Self::pixels`], in the camera's frame.
    pub fn point(&self, pixel: u32) -> Point {
        let pixel = pixel as usize;
        let width = self.camera.size[0];
        let ray = self.camera.ray(pixel % width, pixel / width);
        (ray * self.depths[pixel]).to_array()
    }

    /// The points of the object.
    pub fn object(&self) -> Vec<Point> {
        let pixels = self.pixels(true).into_iter();
        pixels.map(|pixel| self.point(pixel)).collect()
    }

    /// What is seen around the object: the points outside of the mask, as far from it in the image as it is wide or high.
    pub fn background(&self) -> Vec<Point> {
        self.background_across(usize::MAX)
    }

    /// The same of every so many columns and rows, so that not many more than `across` of these meet the object.
    pub fn background_across(&self, across: usize) -> Vec<Point> {
        let width = self.camera.size[0];
        let place = |pixel: usize| [pixel % width, pixel / width];
        let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
        for (pixel, _) in self.mask.iter().enumerate().filter(|(_, inside)| **inside) {
            for (axis, at) in place(pixel).into_iter().enumerate() {
                low[axis] = low[axis].min(at);
                high[axis] = high[axis].max(at + 1);
            }
        }
        let far = |axis: usize| high[axis].saturating_sub(low[axis]);
        let reach = far(0).max(far(1));
        let every = (reach / across).max(1);
        let is_around = |&pixel: &u32| {
            let at = place(pixel as usize);
            (0..2).all(|axis| {
                at[axis].is_multiple_of(every)
                    && at[axis] + reach >= low[axis]
                    && at[axis] <= high[axis] + reach
            })
        };
        let pixels = self.pixels(false).into_iter().filter(is_around);
        pixels.map(|pixel| self.point(pixel)).collect()
    }
}

/// What a file of depths must be.
const DEPTHS: &str = "depths in a greyscale PNG of 16 bits, or an array (rows, columns) in a .npy file, floats or integers of 16 bits or more";
/// What a file of a mask must be.
const MASK: &str = "a mask in a greyscale PNG, or an array (rows, columns) in a .npy file, 0 where the object is not seen";

/// Depths as a file holds them.
#[derive(Clone, Debug, PartialEq)]
pub struct Depths {
    /// 0 where the file has the largest integer of its type, which marks what was not measured.
    pub image: Image<f32>,
    /// Whether they are floating-point numbers: by convention (ROS REP 118) these are metres, and integers millimetres.
    pub is_float: bool,
    /// That integer, and how many pixels had it, if any.
    pub marked: Option<(f64, usize)>,
}

impl Depths {
    /// Of numbers as they are, and the largest integer of their type; none of floats.
    pub fn of(image: Image<f64>, largest: Option<f64>) -> Depths {
        let is_mark = |x: f64| Some(x) == largest;
        let pixels = image.values.iter().filter(|&&x| is_mark(x)).count();
        Depths {
            image: image.map(|x| if is_mark(x) { 0.0 } else { x as f32 }),
            is_float: largest.is_none(),
            marked: largest
                .map(|largest| (largest, pixels))
                .filter(|_| pixels > 0),
        }
    }
}

/// Reads the depths in a file.
///
/// # Errors
/// A file that cannot be read, or is none of [the kinds](self).
pub fn read_depths(path: &Path) -> Result<Depths, DepthError> {
    if extension(path) == "png" {
        let image = image::read_depth(path)?.map(f64::from);
        return Ok(Depths::of(image, Some(NOT_MEASURED.into())));
    }
    let grid = read_grid(path, DEPTHS)?;
    if grid.bytes == 1 {
        return Err(DepthError::Malformed {
            path: path.into(),
            reason: "its numbers have 8 bits, which are too few for depths".into(),
            expected: DEPTHS,
        });
    }
    Ok(Depths::of(grid.image, grid.largest))
}

/// The mask in a file.
///
/// # Errors
/// As [`read_depths`].
pub fn read_mask(path: &Path) -> Result<Image<bool>, DepthError> {
    if extension(path) == "png" {
        return Ok(image::read_mask(path)?.map(|value| value > 0));
    }
    Ok(read_grid(path, MASK)?.image.map(|value| value > 0.0))
}

fn read_grid(path: &Path, expected: &'static str) -> Result<npy::Grid, DepthError> {
    let malformed = |reason: String| DepthError::Malformed {
        path: path.into(),
        reason,
        expected,
    };
    let kind = extension(path);
    if kind != "npy" {
        return Err(malformed(format!("its extension is \".{kind}\"")));
    }
    let bytes = std::fs::read(path).map_err(|source| DepthError::Io {
        path: path.into(),
        source,
    })?;
    npy::grid(&bytes).map_err(malformed)
}

#[cfg(test)]
mod tests;
