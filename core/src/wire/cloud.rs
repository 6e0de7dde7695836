//! A cloud inside a frame: little-endian f32 triples, viewed where they lie.

use crate::error::Error;
use core::fmt;
use core::ops::Range;
use serde::de::{self, Deserialize, Deserializer, Visitor};
use serde::{Serialize, Serializer};

/// Bytes of one point on the wire: x, y, z as little-endian f32.
pub(crate) const POINT_BYTES: usize = 12;

#[cfg(target_endian = "big")]
compile_error!(
    "clouds are viewed in place as little-endian f32; big-endian targets are not supported"
);

/// Points borrowed from a frame or from a slice, in the order given. Coordinates are not checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudView<'a> {
    /// A multiple of [`POINT_BYTES`] bytes, of any alignment.
    bytes: &'a [u8],
}

impl<'a> CloudView<'a> {
    /// The view that puts `points` into a frame.
    pub fn of(points: &'a [[f32; 3]]) -> CloudView<'a> {
        CloudView {
            bytes: bytemuck::cast_slice(points),
        }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.bytes.len() / POINT_BYTES
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// The points in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = [f32; 3]> + use<'a> {
        self.bytes
            .chunks_exact(POINT_BYTES)
            .map(bytemuck::pod_read_unaligned)
    }

    /// Where in `frame`, which they are borrowed from, the points lie.
    pub(crate) fn range_in(&self, frame: &[u8]) -> Range<usize> {
        let start = self
            .bytes
            .as_ptr()
            .addr()
            .saturating_sub(frame.as_ptr().addr());
        start..start + self.bytes.len()
    }

    /// Copies the points to the front of `points` and returns how many they are.
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
        serializer.serialize_bytes(self.bytes)
    }
}

impl<'de: 'a, 'a> Deserialize<'de> for CloudView<'a> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_bytes(PointBytes)
    }
}

struct PointBytes;

impl<'de> Visitor<'de> for PointBytes {
    type Value = CloudView<'de>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a multiple of 12 bytes")
    }

    fn visit_borrowed_bytes<E: de::Error>(self, bytes: &'de [u8]) -> Result<Self::Value, E> {
        if bytes.len().is_multiple_of(POINT_BYTES) {
            Ok(CloudView { bytes })
        } else {
            Err(E::invalid_length(bytes.len(), &self))
        }
    }
}
