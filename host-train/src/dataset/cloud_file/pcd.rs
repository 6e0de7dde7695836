//! Point Cloud Library files: ASCII, binary and compressed.

use super::CloudFile;
use crate::dataset::Point;
use pcd_rs::{DataKind, DynReader, DynRecord, Field, PcdMeta};
use std::io::Read;

/// Larger records than any sensor's are a corrupt header.
const MAX_RECORD_BYTES: u64 = 1 << 16;

pub(super) fn parse(bytes: &[u8]) -> Result<CloudFile, String> {
    check_sizes(bytes)?;
    let reader = DynReader::from_bytes(bytes).map_err(|e| e.to_string())?;
    // Padding has a definition, but no place in the records that the reader returns.
    let definitions = reader.meta().field_defs.fields.iter();
    let fields: Vec<String> = definitions
        .map(|field| field.name.clone())
        .filter(|name| name != "_")
        .collect();
    let place = |name| fields.iter().position(|field| field == name);
    let [Some(x), Some(y), Some(z)] = ["x", "y", "z"].map(place) else {
        return Err(format!(
            "it has no fields x, y, z, only {}",
            fields.join(" ")
        ));
    };
    let normal = match ["normal_x", "normal_y", "normal_z"].map(place) {
        [Some(x), Some(y), Some(z)] => Some([x, y, z]),
        _ => None,
    };
    let mut file = CloudFile {
        normals: normal.map(|_| Vec::new()),
        ..CloudFile::default()
    };
    for (index, record) in reader.enumerate() {
        let record = record.map_err(|e| format!("point {index}: {e}"))?;
        let point = vector(&record, [x, y, z])
            .ok_or("its fields x, y, z are not floating-point numbers")?;
        if !point.iter().all(|x| x.is_finite()) {
            file.dropped += 1;
            continue;
        }
        file.points.push(point);
        if let (Some(normals), Some(places)) = (&mut file.normals, normal) {
            normals.push(vector(&record, places).unwrap_or([f32::NAN; 3]));
        }
    }
    Ok(file)
}

fn vector(record: &DynRecord, places: [usize; 3]) -> Option<Point> {
    let number = |place: usize| match record.0.get(place) {
        Some(Field::F32(values)) => values.first().copied(),
        Some(Field::F64(values)) => values.first().map(|&x| x as f32),
        _ => None,
    };
    let [x, y, z] = places.map(number);
    Some([x?, y?, z?])
}

/// Refuses what would make the reader reserve memory for, or reach for, more than the file holds.
fn check_sizes(bytes: &[u8]) -> Result<(), String> {
    let mut rest = bytes;
    let meta = PcdMeta::from_reader(&mut rest).map_err(|e| e.to_string())?;
    let fields = meta.field_defs.fields.iter();
    let record = fields.fold(0u64, |sum, f| {
        sum.saturating_add(f.count.saturating_mul(f.kind.byte_size() as u64))
    });
    if record > MAX_RECORD_BYTES {
        return Err(format!("a point of {record} bytes"));
    }
    let size = record.saturating_mul(meta.num_points);
    let too_short = || {
        Err(format!(
            "{} points of {record} bytes do not fit the file; it is cut off or corrupt",
            meta.num_points
        ))
    };
    match meta.data {
        DataKind::Ascii => Ok(()),
        DataKind::Binary if size > rest.len() as u64 => too_short(),
        DataKind::Binary => Ok(()),
        DataKind::BinaryCompressed => {
            let mut sizes = [0u8; 8];
            rest.read_exact(&mut sizes).map_err(|e| e.to_string())?;
            let [compressed, whole] = [0, 4].map(|at| {
                u64::from(u32::from_le_bytes([
                    sizes[at],
                    sizes[at + 1],
                    sizes[at + 2],
                    sizes[at + 3],
                ]))
            });
            // LZF makes at most 264 bytes of 3.
            if compressed > rest.len() as u64 || whole != size || whole > 88 * compressed {
                return too_short();
            }
            Ok(())
        }
    }
}

/// A binary file of `[N, 3]` points, or `[N, 6]` points and normals, given as little-endian float32.
pub(super) fn emit(rows: &[u8], count: usize, columns: usize) -> Vec<u8> {
    let fields = ["x", "y", "z", "normal_x", "normal_y", "normal_z"];
    let list = |word: &str| vec![word; columns].join(" ");
    let header = format!(
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {}\nSIZE {}\nTYPE {}\nCOUNT {}\n\
         WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n",
        fields[..columns].join(" "),
        list("4"),
        list("F"),
        list("1"),
    );
    [header.as_bytes(), rows].concat()
}
