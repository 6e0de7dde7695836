//! Files of the Point Cloud Library: ASCII, binary and compressed.

use super::{CloudFile, Note, Position};
use pcd_rs::{DataKind, DynReader, DynRecord, Field, PcdMeta, ViewPoint};
use std::borrow::Cow;

/// Largest record; a larger one means a corrupt header.
const MAX_RECORD_BYTES: u64 = 1 << 16;

pub(super) fn parse(bytes: &[u8]) -> Result<CloudFile, String> {
    if !bytes.windows(6).any(|word| word == b"FIELDS") {
        return Err("it has no line FIELDS; is it of another format?".into());
    }
    let bytes = &*as_the_reader_takes_it(bytes);
    let Some(after) = after_points(bytes)? else {
        return Ok(CloudFile::default());
    };
    let reader = DynReader::from_bytes(bytes).map_err(|e| e.to_string())?;
    // Padding is in the definitions, but not in the records that the reader returns.
    let definitions = reader.meta().field_defs.fields.iter();
    let fields: Vec<String> = definitions
        .map(|field| field.name.clone())
        .filter(|name| name != "_")
        .collect();
    let place = |name: &str| {
        let mut names = fields.iter();
        names.position(|field| field.eq_ignore_ascii_case(name))
    };
    let triple = |names: [&str; 3]| {
        let [x, y, z] = names.map(place);
        Some([x?, y?, z?])
    };
    let point = triple(["x", "y", "z"])
        .ok_or_else(|| format!("it has no fields x, y, z, only {}", fields.join(" ")))?;
    let normal = triple(["normal_x", "normal_y", "normal_z"]);
    let colour = place("rgb").or_else(|| place("rgba"));
    let intensity = place("intensity");
    let mut file = CloudFile {
        normals: normal.map(|_| Vec::new()),
        colours: colour.map(|_| Vec::new()),
        intensities: intensity.map(|_| Vec::new()),
        notes: Note::beyond(after).into_iter().collect(),
        ..CloudFile::default()
    };
    let used: Vec<usize> = [Some(point), normal]
        .into_iter()
        .flatten()
        .flatten()
        .chain(colour)
        .chain(intensity)
        .collect();
    let ignored: Vec<&str> = (0..fields.len())
        .filter(|at| !used.contains(at))
        .map(|at| fields[at].as_str())
        .collect();
    if !ignored.is_empty() {
        let what = super::lines::excerpt(&ignored.join(", "));
        file.notes.push(Note::Ignored { what });
    }
    let stood = &reader.meta().viewpoint;
    if *stood != ViewPoint::default() {
        let at = [stood.tx, stood.ty, stood.tz];
        file.notes.push(Note::ViewPoint { at });
    }
    let claimed = reader.meta().width.saturating_mul(reader.meta().height);
    for (index, record) in reader.enumerate() {
        let record = record.map_err(|e| format!("point {index}: {e}"))?;
        let number = |at: usize| number(&record, at).ok_or("a field of it holds no numbers");
        let vector = |at: [usize; 3]| -> Result<Position, &str> {
            Ok([number(at[0])?, number(at[1])?, number(at[2])?])
        };
        file.points.push(vector(point)?);
        if let (Some(normals), Some(at)) = (&mut file.normals, normal) {
            normals.push(vector(at)?.map(|x| x as f32));
        }
        if let (Some(colours), Some(at)) = (&mut file.colours, colour) {
            colours.push(packed(&record, at).ok_or("its colours are not packed into 4 bytes")?);
        }
        if let (Some(intensities), Some(at)) = (&mut file.intensities, intensity) {
            intensities.push(number(at)? as f32);
        }
    }
    let read = file.points.len();
    if claimed != read as u64 {
        let what = "points by WIDTH and HEIGHT";
        file.notes.push(Note::Count {
            what,
            claimed,
            read,
        });
    }
    Ok(file)
}

fn number(record: &DynRecord, at: usize) -> Option<f64> {
    Some(match record.0.get(at)? {
        Field::I8(v) => f64::from(*v.first()?),
        Field::I16(v) => f64::from(*v.first()?),
        Field::I32(v) => f64::from(*v.first()?),
        Field::I64(v) => *v.first()? as f64,
        Field::U8(v) => f64::from(*v.first()?),
        Field::U16(v) => f64::from(*v.first()?),
        Field::U32(v) => f64::from(*v.first()?),
        Field::U64(v) => *v.first()? as f64,
        Field::F32(v) => f64::from(*v.first()?),
        Field::F64(v) => *v.first()?,
    })
}

/// Red, green and blue from the lower 24 bits, whatever the field's type.
fn packed(record: &DynRecord, at: usize) -> Option<[u8; 3]> {
    let bits = match record.0.get(at)? {
        Field::F32(v) => v.first()?.to_bits(),
        Field::U32(v) => *v.first()?,
        Field::I32(v) => v.first()?.cast_unsigned(),
        _ => return None,
    };
    let [_, r, g, b] = bits.to_be_bytes();
    Some([r, g, b])
}

/// The file without fields of COUNT 0, and with the kind of its data in lower case. Some programs use such fields as padding; the
/// Point Cloud Library skips them, but the reader used here takes them for COUNT 1.
fn as_the_reader_takes_it(bytes: &[u8]) -> Cow<'_, [u8]> {
    let mut end = 0;
    let mut header: Vec<Vec<&[u8]>> = Vec::new();
    for line in bytes.split_inclusive(|&b| b == b'\n').take(64) {
        end += line.len();
        let words: Vec<&[u8]> = line
            .split(u8::is_ascii_whitespace)
            .filter(|word| !word.is_empty())
            .collect();
        let is_data = words
            .first()
            .is_some_and(|w| w.eq_ignore_ascii_case(b"DATA"));
        header.push(words);
        if is_data {
            break;
        }
    }
    let counts = header
        .iter()
        .find(|words| words.first() == Some(&&b"COUNT"[..]));
    let empty: Vec<bool> = counts
        .into_iter()
        .flatten()
        .map(|&count| count == b"0")
        .collect();
    let kind = header.last().and_then(|words| words.get(1));
    let is_capital = kind.is_some_and(|kind| kind.iter().any(u8::is_ascii_uppercase));
    if !empty.contains(&true) && !is_capital {
        return bytes.into();
    }
    let last = header.len() - 1;
    let mut changed = Vec::with_capacity(bytes.len());
    for (line, words) in header.into_iter().enumerate() {
        let listed = words.first().is_some_and(|word| {
            [&b"FIELDS"[..], b"COLUMNS", b"SIZE", b"TYPE", b"COUNT"].contains(word)
        });
        for (at, word) in words.iter().enumerate() {
            if line == last {
                // The reader takes its word in capitals, and what follows it not.
                changed.extend(match at {
                    0 => word.to_ascii_uppercase(),
                    _ => word.to_ascii_lowercase(),
                });
            } else if listed && empty.get(at) == Some(&true) {
                continue;
            } else {
                changed.extend_from_slice(word);
            }
            changed.push(b' ');
        }
        changed.push(b'\n');
    }
    changed.extend_from_slice(&bytes[end..]);
    changed.into()
}

/// The bytes after the points that the header counts; `None` if it counts none. Refuses headers that would make the
/// reader allocate or read more than the file holds.
fn after_points(bytes: &[u8]) -> Result<Option<&[u8]>, String> {
    let mut rest = bytes;
    let meta = PcdMeta::from_reader(&mut rest).map_err(|e| e.to_string())?;
    if meta.num_points == 0 {
        return Ok(None);
    }
    let fields = meta.field_defs.fields.iter();
    let record = fields.fold(0u64, |sum, f| {
        sum.saturating_add(f.count.saturating_mul(f.kind.byte_size() as u64))
    });
    if record > MAX_RECORD_BYTES {
        return Err(format!("a point of {record} bytes"));
    }
    let size = record.saturating_mul(meta.num_points);
    let too_short = || {
        format!(
            "{} points of {record} bytes do not fit the file; it is cut off or corrupt",
            meta.num_points
        )
    };
    let after = |held: u64| {
        let held = usize::try_from(held).ok();
        held.and_then(|held| rest.get(held..)).ok_or_else(too_short)
    };
    let after = match meta.data {
        DataKind::Ascii => {
            let lines = rest.split_inclusive(|&byte| byte == b'\n');
            let held = lines.take(meta.num_points as usize).map(<[u8]>::len);
            &rest[held.sum()..]
        }
        DataKind::Binary => after(size)?,
        DataKind::BinaryCompressed => {
            let (sizes, data) = rest.split_at_checked(8).ok_or_else(too_short)?;
            let number = |at: usize| u32::from_le_bytes([0, 1, 2, 3].map(|i| sizes[at + i]));
            let [compressed, whole] = [0, 4].map(|at| u64::from(number(at)));
            // LZF expands 3 bytes to 264 at most.
            if whole != size || whole > 88 * compressed {
                return Err(too_short());
            }
            data.get(compressed as usize..).ok_or_else(too_short)?
        }
    };
    Ok(Some(after))
}

/// Writes a binary file of points, with normals, colours and intensities if there are any. Coordinates are float32,
/// as in the library's own point types, unless that would round those of a cloud far from the origin.
pub(super) fn emit(file: &CloudFile) -> Vec<u8> {
    let count = file.points.len();
    let wide = file.origin() != [0.0; 3];
    let mut fields = vec!["x", "y", "z"];
    if file.normals.is_some() {
        fields.extend(["normal_x", "normal_y", "normal_z"]);
    }
    if file.colours.is_some() {
        fields.push("rgb");
    }
    if file.intensities.is_some() {
        fields.push("intensity");
    }
    let size = |at: usize| if wide && at < 3 { "8" } else { "4" };
    let sizes: Vec<&str> = (0..fields.len()).map(size).collect();
    let list = |word: &str| vec![word; fields.len()].join(" ");
    let header = format!(
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {}\nSIZE {}\nTYPE {}\nCOUNT {}\n\
         WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n",
        fields.join(" "),
        sizes.join(" "),
        list("F"),
        list("1"),
    );
    let mut bytes = header.into_bytes();
    for (i, point) in file.points.iter().enumerate() {
        if wide {
            bytes.extend(point.iter().flat_map(|x| x.to_le_bytes()));
        } else {
            bytes.extend(point.iter().flat_map(|&x| (x as f32).to_le_bytes()));
        }
        if let Some(normals) = &file.normals {
            bytes.extend(normals[i].iter().flat_map(|x| x.to_le_bytes()));
        }
        if let Some(colours) = &file.colours {
            let [r, g, b] = colours[i];
            bytes.extend([b, g, r, 0]);
        }
        if let Some(intensities) = &file.intensities {
            bytes.extend(intensities[i].to_le_bytes());
        }
    }
    bytes
}
