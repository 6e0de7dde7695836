//! Where clouds come from.

pub mod bop;
pub mod camera;
pub mod cloud_file;
mod error;
pub mod h5;
pub mod mesh;
pub mod modelnet;
pub mod pairs;
pub mod procedural;
pub mod raster;
pub mod solids;
pub mod triangulate;

pub use error::{DatasetError, MODELNET40_URL};

/// A point in a cloud's own units.
pub type Point = [f32; 3];

/// One model's cloud as a data set holds it.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Points, `[N, 3]`, normalised units (mean at the origin, farthest point at 1).
    pub points: Vec<Point>,
    /// Category index.
    pub label: u32,
}
