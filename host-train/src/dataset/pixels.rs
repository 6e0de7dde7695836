//! Numbers in rows and columns, whatever file they come from.

/// Most pixels of an image that are read: 8 times those of a full HD camera.
pub const MAX_PIXELS: usize = 1 << 24;

/// One value a pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Image<T> {
    /// Columns and rows.
    pub size: [usize; 2],
    /// Values row by row.
    pub values: Vec<T>,
}

impl<T> Image<T> {
    /// The same of other values.
    pub fn map<U>(self, of: impl Fn(T) -> U) -> Image<U> {
        Image {
            size: self.size,
            values: self.values.into_iter().map(of).collect(),
        }
    }
}

/// The largest integer of a type as NumPy names it, by a letter and its bytes; none of floats. Sensors and programs mark by it
/// what was not measured.
pub fn largest_integer(kind: u8, bytes: usize) -> Option<f64> {
    let bits = 8 * bytes as i32;
    match kind {
        b'u' => Some(2f64.powi(bits) - 1.0),
        b'i' => Some(2f64.powi(bits - 1) - 1.0),
        _ => None,
    }
}
