//! NumPy arrays `.npy`: `[N, C]` numbers, of which the first three columns are coordinates; `[C, N]` where the
//! second axis is longer, and `[H, W, C]` of an organised cloud, C of at most 16. Six columns are coordinates and normals where
//! the last three are unit vectors everywhere.
//!
//! Read here rather than by a crate: the header of a plain array is one line, and the crates' parsers of
//! Python literals recurse and multiply without limits on corrupt ones.

use super::{CloudFile, Note, Position};
use crate::dataset::pixels::{Image, MAX_PIXELS, largest_integer};
use half::f16;

const MAGIC: &[u8] = b"\x93NUMPY";
/// Rows of an organised cloud up to which they may be clouds of their own instead.
const MOST_CLOUDS: usize = 16;
/// The type of a mask, which holds no coordinates.
const BOOLEAN: &str = "|b1";

pub(super) fn parse(bytes: &[u8]) -> Result<CloudFile, String> {
    let Array {
        shape,
        sizes,
        fortran,
        width,
        decode,
        payload,
        kind,
    } = Array::of(bytes)?;
    if kind == BOOLEAN {
        return Err("its elements are booleans, which are no coordinates: --mask takes those of a depth image".into());
    }
    if payload.is_empty() && sizes.iter().flatten().any(|&size| size == 0) {
        return Ok(CloudFile::default());
    }
    let unexpected = || {
        format!(
            "its shape is ({shape}), expected (N, 3) or more columns, or (rows, columns, 3 to 16) of an organised cloud"
        )
    };
    let (first, second, organised) = match sizes.as_deref() {
        Some(&[rows, columns]) | Some(&[1, rows, columns]) => (rows, columns, false),
        Some(&[height, width, columns @ 3..=16]) => {
            let points = height.checked_mul(width).ok_or_else(unexpected)?;
            (points, columns, true)
        }
        _ => return Err(unexpected()),
    };
    let count = payload.len() / width;
    if first.checked_mul(second) != Some(count) {
        return Err(format!(
            "its shape is ({shape}), but {count} numbers follow; it is cut off or corrupt"
        ));
    }
    let mut file = CloudFile::default();
    let normals_in_rows = || {
        let row = |i: usize| &payload[i * 6 * width..][..6 * width];
        let normal = |i: usize| [3, 4, 5].map(|axis| decode(&row(i)[axis * width..]) as f32);
        !fortran && super::are_units(&(0..first).map(normal).collect::<Vec<_>>())
    };
    // Points lie along the longer axis; but a few points may have more columns than there are points.
    let transposed = match (first, second) {
        _ if organised => false,
        (3.., 6) if second > first => !normals_in_rows(),
        (3, 4..) => true,
        (4.., 17..) => second > first,
        _ => false,
    };
    let (points, columns) = if transposed {
        file.notes.push(Note::LongerAxis {
            rows: first,
            columns: second,
        });
        (second, first)
    } else {
        (first, second)
    };
    if columns < 3 {
        return Err(unexpected());
    }
    // As many rows as a batch has clouds.
    if let (true, Some(&[clouds @ 2..=MOST_CLOUDS, of, _])) = (organised, sizes.as_deref())
        && of > MOST_CLOUDS
    {
        file.notes.push(Note::Stacked { clouds, of });
    }
    let at = |point: usize, column: usize| {
        let index = if fortran != transposed {
            column * points + point
        } else {
            point * columns + column
        };
        decode(&payload[index * width..])
    };
    let columns_from = |first: usize| -> Vec<Position> {
        (0..points)
            .map(|point| [0, 1, 2].map(|axis| at(point, first + axis)))
            .collect()
    };
    file.points = columns_from(0);
    if columns == 6 {
        let normals: Vec<_> = columns_from(3)
            .into_iter()
            .map(|n| n.map(|x| x as f32))
            .collect();
        file.normals = Some(normals).filter(|normals| super::are_units(normals));
    }
    if columns > 3 && file.normals.is_none() {
        let what = "columns from number 4 on".into();
        file.notes.push(Note::Ignored { what });
    }
    Ok(file)
}

/// Whether this is a NumPy array.
pub(crate) fn is(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// The numbers of an array (rows, columns), row by row, or of one in a row.
pub(crate) fn matrix(bytes: &[u8]) -> Result<Vec<f64>, String> {
    let mut array = Array::of(bytes)?;
    if let Some(&[columns]) = array.sizes.as_deref() {
        array.sizes = Some(vec![1, columns]);
    }
    grid_of(&array).map(|grid| grid.image.values)
}

/// Numbers in rows and columns.
pub(crate) struct Grid {
    pub(crate) image: Image<f64>,
    /// The largest number of its type; none of floats.
    pub(crate) largest: Option<f64>,
    /// Of a number.
    pub(crate) bytes: usize,
}

/// An array (rows, columns), or (rows, columns, 1), as an image.
pub(crate) fn grid(bytes: &[u8]) -> Result<Grid, String> {
    grid_of(&Array::of(bytes)?)
}

fn grid_of(array: &Array<'_>) -> Result<Grid, String> {
    let shape = array.shape;
    let unexpected = || format!("its shape is ({shape}), expected (rows, columns)");
    let (Some(&[rows, columns]) | Some(&[rows, columns, 1])) = array.sizes.as_deref() else {
        return Err(unexpected());
    };
    let pixels = rows.checked_mul(columns).ok_or_else(unexpected)?;
    if pixels == 0 || pixels > MAX_PIXELS {
        return Err(format!(
            "its shape is ({shape}); from 1 to {MAX_PIXELS} pixels are read"
        ));
    }
    let count = array.payload.len() / array.width;
    if pixels != count {
        return Err(format!(
            "its shape is ({shape}), but {count} numbers follow; it is cut off or corrupt"
        ));
    }
    let value = |pixel: usize| {
        let index = if array.fortran {
            pixel % columns * rows + pixel / columns
        } else {
            pixel
        };
        (array.decode)(&array.payload[index * array.width..])
    };
    Ok(Grid {
        image: Image {
            size: [columns, rows],
            values: (0..pixels).map(value).collect(),
        },
        largest: (array.kind.as_bytes().get(1))
            .and_then(|&kind| largest_integer(kind, array.width)),
        bytes: array.width,
    })
}

/// A file whose header was read.
struct Array<'a> {
    /// The type of the numbers, as the header has it.
    kind: &'a str,
    /// The same of the shape.
    shape: &'a str,
    /// Its lengths, if these are numbers.
    sizes: Option<Vec<usize>>,
    fortran: bool,
    /// Bytes of a number.
    width: usize,
    decode: Decode,
    payload: &'a [u8],
}

impl Array<'_> {
    fn of(bytes: &[u8]) -> Result<Array<'_>, String> {
        let (header, payload) = split(bytes)?;
        let kind = value(header, "descr")?;
        let kind = kind.trim_matches(['\'', '"']);
        let (width, decode) = number(kind)?;
        let fortran = match value(header, "fortran_order")? {
            "False" => false,
            "True" => true,
            other => return Err(format!("its fortran_order is {other}")),
        };
        let shape = value(header, "shape")?;
        let sizes = shape.split(',').map(str::trim);
        let sizes = sizes.filter(|size| !size.is_empty());
        Ok(Array {
            kind,
            shape,
            sizes: sizes.map(|size| size.parse().ok()).collect(),
            fortran,
            width,
            decode,
            payload,
        })
    }
}

/// One number's bytes as a number.
type Decode = fn(&[u8]) -> f64;

/// Bytes of a number of this type, and how it is read.
#[rustfmt::skip]
fn number(kind: &str) -> Result<(usize, Decode), String> {
    /// Reads the first bytes of a slice by one of the standard library's functions.
    macro_rules! read {
        ($type:ty, $from:ident) => {
            (size_of::<$type>(), |bytes| <$type>::$from(first(bytes)) as f64)
        };
    }
    Ok(match kind {
        "<f2" => (2, |bytes| f16::from_le_bytes(first(bytes)).to_f64()),
        ">f2" => (2, |bytes| f16::from_be_bytes(first(bytes)).to_f64()),
        "<f4" => read!(f32, from_le_bytes),
        ">f4" => read!(f32, from_be_bytes),
        "<f8" => read!(f64, from_le_bytes),
        ">f8" => read!(f64, from_be_bytes),
        "|i1" => read!(i8, from_le_bytes),
        "|u1" | BOOLEAN => read!(u8, from_le_bytes),
        "<i2" => read!(i16, from_le_bytes),
        ">i2" => read!(i16, from_be_bytes),
        "<u2" => read!(u16, from_le_bytes),
        ">u2" => read!(u16, from_be_bytes),
        "<i4" => read!(i32, from_le_bytes),
        ">i4" => read!(i32, from_be_bytes),
        "<u4" => read!(u32, from_le_bytes),
        ">u4" => read!(u32, from_be_bytes),
        "<i8" => read!(i64, from_le_bytes),
        ">i8" => read!(i64, from_be_bytes),
        "<u8" => read!(u64, from_le_bytes),
        ">u8" => read!(u64, from_be_bytes),
        _ if kind.starts_with('[') => return Err(format!(
            "its elements are records, {kind}: stack the fields, as in numpy.stack([a[\"x\"], a[\"y\"], a[\"z\"]], axis=-1)"
        )),
        _ => return Err(format!(
            "its elements are \"{kind}\", expected floats of 16, 32 or 64 bits or integers of 8 to 64"
        )),
    })
}

/// The first bytes of a slice, or zeros where it has fewer.
fn first<const N: usize>(bytes: &[u8]) -> [u8; N] {
    bytes.first_chunk().copied().unwrap_or([0; N])
}

/// The header's dictionary and what follows it.
fn split(bytes: &[u8]) -> Result<(&str, &[u8]), String> {
    let cut = "it ends inside its header";
    let rest = bytes.strip_prefix(MAGIC).ok_or("it is not a NumPy array")?;
    let (version, rest) = rest.split_first_chunk::<2>().ok_or(cut)?;
    let (length, rest) = if version[0] == 1 {
        let (length, rest) = rest.split_first_chunk().ok_or(cut)?;
        (usize::from(u16::from_le_bytes(*length)), rest)
    } else {
        let (length, rest) = rest.split_first_chunk().ok_or(cut)?;
        (u32::from_le_bytes(*length) as usize, rest)
    };
    let (header, payload) = rest.split_at_checked(length).ok_or(cut)?;
    let header = str::from_utf8(header).map_err(|_| "its header is not text")?;
    Ok((header, payload))
}

/// The value of a key of the header; of a tuple, what is between its parentheses; a list with its brackets.
fn value<'a>(header: &'a str, key: &str) -> Result<&'a str, String> {
    let missing = || format!("its header has no {key}");
    let (_, after) = header
        .split_once(&format!("'{key}':"))
        .ok_or_else(missing)?;
    let after = after.trim_start();
    if after.starts_with('[') {
        return list(after).ok_or_else(missing);
    }
    let (value, _) = match after.strip_prefix('(') {
        Some(tuple) => tuple.split_once(')'),
        None => after.split_once([',', '}']),
    }
    .ok_or_else(missing)?;
    Ok(value.trim())
}

/// A list up to the bracket that ends it.
fn list(text: &str) -> Option<&str> {
    let mut depth = 0;
    for (at, c) in text.char_indices() {
        match c {
            '[' => depth += 1,
            ']' => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return text.get(..=at);
        }
    }
    None
}

/// `[N, 3]` points, or `[N, 6]` points and normals, as little-endian float64.
pub(super) fn emit(file: &CloudFile) -> Vec<u8> {
    let columns = if file.normals.is_some() { 6 } else { 3 };
    let count = file.points.len();
    let mut bytes = header("<f8", &[count, columns]);
    for (i, point) in file.points.iter().enumerate() {
        let normal = file
            .normals
            .as_ref()
            .map(|normals| normals[i].map(f64::from));
        for x in point.iter().chain(normal.iter().flatten()) {
            bytes.extend(x.to_le_bytes());
        }
    }
    bytes
}

/// What stands before the numbers of an array in C order.
pub(crate) fn header(kind: &str, shape: &[usize]) -> Vec<u8> {
    let shape: Vec<String> = shape.iter().map(usize::to_string).collect();
    let dictionary = format!(
        "{{'descr': '{kind}', 'fortran_order': False, 'shape': ({}), }}",
        shape.join(", ")
    );
    // Magic, version, length and dictionary take a multiple of 64 bytes and end with a line break.
    let length = (dictionary.len() + 11).next_multiple_of(64) - 10;
    let header = format!("{dictionary:<width$}\n", width = length - 1);
    [
        MAGIC,
        &[1, 0],
        &(length as u16).to_le_bytes(),
        header.as_bytes(),
    ]
    .concat()
}
