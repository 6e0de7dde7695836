//! NumPy arrays `.npy`: `[N, C]` floating-point numbers, of which the first three columns are coordinates. Six
//! columns are coordinates and normals where the last three are unit vectors everywhere.
//!
//! Read here rather than by a crate: the header of a plain array is one line, and the crates' parsers of
//! Python literals recurse and multiply without limits on corrupt ones.

use super::CloudFile;
use crate::dataset::Point;

const MAGIC: &[u8] = b"\x93NUMPY";

pub(super) fn parse(bytes: &[u8]) -> Result<CloudFile, String> {
    let (header, payload) = split(bytes)?;
    let decode: fn(&[u8]) -> f32 = match value(header, "descr")? {
        "'<f4'" => |b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]),
        "'>f4'" => |b| f32::from_be_bytes([b[0], b[1], b[2], b[3]]),
        "'<f8'" => |b| f64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]) as f32,
        "'>f8'" => |b| f64::from_be_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]) as f32,
        other => {
            return Err(format!(
                "its numbers are {other}, expected float32 or float64"
            ));
        }
    };
    let width = if value(header, "descr")?.contains("f4") {
        4
    } else {
        8
    };
    let by_columns = match value(header, "fortran_order")? {
        "False" => false,
        "True" => true,
        other => return Err(format!("its fortran_order is {other}")),
    };
    let shape = value(header, "shape")?;
    let sizes: Option<Vec<usize>> = shape
        .split(',')
        .map(str::trim)
        .filter(|size| !size.is_empty())
        .map(|size| size.parse().ok())
        .collect();
    let (rows, columns) = match sizes.as_deref() {
        Some(&[rows, columns]) if columns >= 3 => (rows, columns),
        _ => {
            return Err(format!(
                "its shape is ({shape}), expected (N, 3) or more columns"
            ));
        }
    };
    let numbers = payload.chunks_exact(width);
    if rows.checked_mul(columns) != Some(numbers.len()) {
        return Err(format!(
            "its shape is ({shape}), but {} numbers follow; it is cut off or corrupt",
            numbers.len()
        ));
    }
    let at = |row: usize, column: usize| {
        let index = if by_columns {
            column * rows + row
        } else {
            row * columns + column
        };
        decode(&payload[index * width..])
    };
    let columns_from = |first: usize| -> Vec<Point> {
        (0..rows)
            .map(|row| [0, 1, 2].map(|axis| at(row, first + axis)))
            .collect()
    };
    let unit = |normal: &Point| (normal.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 0.02;
    Ok(CloudFile {
        points: columns_from(0),
        normals: Some(columns)
            .filter(|&columns| columns == 6)
            .map(|_| columns_from(3))
            .filter(|normals| normals.iter().all(unit)),
        ..CloudFile::default()
    })
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

/// The value of a key of the header; of a tuple, what is between its parentheses.
fn value<'a>(header: &'a str, key: &str) -> Result<&'a str, String> {
    let missing = || format!("its header has no {key}");
    let (_, after) = header
        .split_once(&format!("'{key}':"))
        .ok_or_else(missing)?;
    let after = after.trim_start();
    let (value, _) = match after.strip_prefix('(') {
        Some(tuple) => tuple.split_once(')'),
        None => after.split_once([',', '}']),
    }
    .ok_or_else(missing)?;
    Ok(value.trim())
}

/// `[N, 3]` points, or `[N, 6]` points and normals, as little-endian float32.
pub(super) fn emit(rows: &[u8], count: usize, columns: usize) -> Vec<u8> {
    let dictionary =
        format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({count}, {columns}), }}");
    // Magic, version, length and dictionary take a multiple of 64 bytes and end with a line break.
    let length = (dictionary.len() + 11).next_multiple_of(64) - 10;
    let header = format!("{dictionary:<width$}\n", width = length - 1);
    [
        MAGIC,
        &[1, 0],
        &(length as u16).to_le_bytes(),
        header.as_bytes(),
        rows,
    ]
    .concat()
}
