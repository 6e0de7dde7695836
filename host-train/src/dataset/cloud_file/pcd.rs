//! Point Cloud Library files: ASCII, binary and compressed.

use super::CloudFile;
use crate::dataset::Point;
use pcd_rs::{DataKind, DynReader, Field, PcdMeta};
use std::io::Read;

/// Larger records than any sensor's are a corrupt header.
const MAX_RECORD_BYTES: u64 = 1 << 16;

pub(super) fn parse(bytes: &[u8]) -> Result<CloudFile, String> {
    check_sizes(bytes)?;
    let reader = DynReader::from_bytes(bytes).map_err(|e| e.to_string())?;
    let fields = &reader.meta().field_defs.fields;
    let axis = |name| {
        fields
            .iter()
            .position(|f| f.name == name)
            .ok_or_else(|| format!("it has no field {name}"))
    };
    let axes = [axis("x")?, axis("y")?, axis("z")?];
    let mut file = CloudFile::default();
    for (index, record) in reader.enumerate() {
        let record = record.map_err(|e| format!("point {index}: {e}"))?;
        let coordinate = |axis: usize| match record.0.get(axis) {
            Some(Field::F32(values)) => values.first().copied(),
            Some(Field::F64(values)) => values.first().map(|&x| x as f32),
            _ => None,
        };
        let [Some(x), Some(y), Some(z)] = axes.map(coordinate) else {
            return Err("its fields x, y, z are not floating-point numbers".into());
        };
        let point: Point = [x, y, z];
        if point.iter().all(|x| x.is_finite()) {
            file.points.push(point);
        } else {
            file.dropped += 1;
        }
    }
    Ok(file)
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
