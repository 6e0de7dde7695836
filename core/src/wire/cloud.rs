//! A cloud inside a frame: little-endian triples of f32, or of 16-bit codes on a grid, viewed where they lie.

use crate::error::Error;
use crate::grid::Grid;
use core::ops::Range;
use serde::de::{self, Deserialize, Deserializer};
use serde::{Serialize, Serializer};

/// Bytes of a point as f32.
pub(crate) const POINT_BYTES: usize = 12;
/// Bytes of a point as codes.
pub(super) const CODE_BYTES: usize = 6;

#[cfg(target_endian = "big")]
compile_error!(
    "clouds are viewed in place as little-endian numbers; big-endian targets are not supported"
);

/// Points borrowed from a frame or a slice, in the order given. Coordinates are not checked.
///
/// Its encoding in a frame: 0, then bytes, 12 a point; or 1, the [`Grid`], then bytes, 6 a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudView<'a> {
    /// Where the codes lie in space; `None` for coordinates in f32.
    grid: Option<Grid>,
    /// A multiple of [`Self::point_bytes`] bytes, of any alignment.
    bytes: &'a [u8],
}

impl<'a> CloudView<'a> {
    /// A view of `points`, to put into a frame.
    pub fn of(points: &'a [[f32; 3]]) -> CloudView<'a> {
        CloudView {
            grid: None,
            bytes: bytemuck::cast_slice(points),
        }
    }

    /// A view of points on a grid, by their codes, to put into a frame.
    pub fn on_grid(grid: Grid, codes: &'a [[i16; 3]]) -> CloudView<'a> {
        CloudView {
            grid: Some(grid),
            bytes: bytemuck::cast_slice(codes),
        }
    }

    /// The grid, if the points are codes.
    pub fn grid(&self) -> Option<Grid> {
        self.grid
    }

    /// Bytes of a point.
    fn point_bytes(&self) -> usize {
        match self.grid {
            None => POINT_BYTES,
            Some(_) => CODE_BYTES,
        }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.bytes.len() / self.point_bytes()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// The points in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = [f32; 3]> + use<'a> {
        let grid = self.grid;
        self.bytes
            .chunks_exact(self.point_bytes())
            .map(move |point| match grid {
                None => bytemuck::pod_read_unaligned(point),
                Some(grid) => grid.decode(bytemuck::pod_read_unaligned(point)),
            })
    }

    /// Byte range of the points in `frame`, from which they must be borrowed.
    pub(crate) fn range_in(&self, frame: &[u8]) -> Range<usize> {
        let start = self
            .bytes
            .as_ptr()
            .addr()
            .saturating_sub(frame.as_ptr().addr());
        start..start + self.bytes.len()
    }

    /// Copies the points to the front of `points` and returns their number.
    ///
    /// # Errors
    /// [`Error::TooManyPoints`] if they do not fit; nothing is copied then.
    pub fn copy_into(&self, points: &mut [[f32; 3]]) -> Result<usize, Error> {
        let capacity = points.len();
        let places = points.get_mut(..self.len()).ok_or(Error::TooManyPoints {
            points: self.len(),
            capacity,
        })?;
        for (place, point) in places.iter_mut().zip(self.iter()) {
            *place = point;
        }
        Ok(self.len())
    }
}

impl Serialize for CloudView<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        (self.grid, Bytes(self.bytes)).serialize(serializer)
    }
}

impl<'de: 'a, 'a> Deserialize<'de> for CloudView<'a> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let (grid, bytes) = <(Option<Grid>, &'de [u8])>::deserialize(deserializer)?;
        let view = CloudView { grid, bytes };
        if bytes.len().is_multiple_of(view.point_bytes()) {
            Ok(view)
        } else {
            Err(de::Error::invalid_length(
                bytes.len(),
                &"a whole number of points",
            ))
        }
    }
}

/// Bytes that are serialised as one piece.
pub(super) struct Bytes<'a>(pub(super) &'a [u8]);

impl Serialize for Bytes<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(self.0)
    }
}
