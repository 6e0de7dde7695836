//! Stanford polygon files: ASCII and both binary forms, with faces or strips of triangles.

use super::polygon::divide;
use super::{CloudFile, Note};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Property, PropertyAccess, PropertyAccessResult};
use std::borrow::Cow;

/// Properties of a vertex that are read, in the order of [`Vertex::values`].
const VERTEX: [&str; 10] = [
    "x",
    "y",
    "z",
    "nx",
    "ny",
    "nz",
    "red",
    "green",
    "blue",
    "intensity",
];

#[derive(Default)]
struct Vertex {
    values: [f64; 10],
}

/// Aliases of some of these.
const ALIASES: [(&str, &str); 5] = [
    ("r", "red"),
    ("g", "green"),
    ("b", "blue"),
    ("scalar_intensity", "intensity"),
    ("reflectance", "intensity"),
];

/// Index of a property, by any of its names, in either case.
fn place(name: &str) -> Option<usize> {
    let name = name.strip_prefix("diffuse_").unwrap_or(name);
    let other = ALIASES
        .iter()
        .find(|(other, _)| other.eq_ignore_ascii_case(name));
    let name = other.map_or(name, |&(_, name)| name);
    VERTEX
        .iter()
        .position(|known| known.eq_ignore_ascii_case(name))
}

impl PropertyAccess for Vertex {
    fn new() -> Vertex {
        Vertex::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some(place) = place(name) else {
            return PropertyAccessResult::Ignored;
        };
        self.values[place] = match property {
            Property::Char(x) => x.into(),
            Property::UChar(x) => x.into(),
            Property::Short(x) => x.into(),
            Property::UShort(x) => x.into(),
            Property::Int(x) => x.into(),
            Property::UInt(x) => x.into(),
            Property::Float(x) => x.into(),
            Property::Double(x) => x,
            _ => f64::NAN,
        };
        PropertyAccessResult::Set
    }
}

/// Vertex indices of a face, or of strips separated by -1.
#[derive(Default)]
struct Corners(Vec<u32>);

const RESTART: u32 = u32::MAX;

impl PropertyAccess for Corners {
    fn new() -> Corners {
        Corners::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !matches!(name, "vertex_indices" | "vertex_index") {
            return PropertyAccessResult::Ignored;
        }
        // Negative indices are out of range like any other that names no vertex.
        let signed = |x: i64| u32::try_from(x).unwrap_or(RESTART);
        self.0 = match property {
            Property::ListChar(list) => list.into_iter().map(|x| signed(x.into())).collect(),
            Property::ListShort(list) => list.into_iter().map(|x| signed(x.into())).collect(),
            Property::ListInt(list) => list.into_iter().map(|x| signed(x.into())).collect(),
            other => other.to_u32_list().unwrap_or_else(|| vec![RESTART; 3]),
        };
        PropertyAccessResult::Set
    }
}

pub(super) fn parse(bytes: &[u8]) -> Result<CloudFile, String> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    if !bytes.starts_with(b"ply") {
        return Err("it does not begin with \"ply\"; is it of another format?".into());
    }
    let bytes = &*plain(bytes);
    let mut reader = Reader::new(bytes);
    let vertices = Parser::<Vertex>::new();
    let corners = Parser::<Corners>::new();
    let header = vertices.read_header(&mut reader).map_err(reason)?;
    let mut file = CloudFile::default();
    let (mut polygons, mut sizes) = (Vec::new(), Vec::new());
    let mut ignored = Vec::new();
    for (name, element) in &header.elements {
        // An entry takes at least one byte, so a corrupt count cannot ask for more than the file has.
        if element.properties.is_empty() || element.count > bytes.len() {
            return Err(format!(
                "{} elements \"{name}\" do not fit a file of {} bytes",
                element.count,
                bytes.len()
            ));
        }
        match name.as_str() {
            "face" | "tristrips" => {
                let read = corners
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(reason)?;
                for Corners(list) in read {
                    if name == "face" {
                        sizes.push(list.len());
                        polygons.extend(list);
                    } else {
                        strips(&list, |triangle| {
                            sizes.push(3);
                            polygons.extend(triangle);
                        });
                    }
                }
                let used = |name: &str| matches!(name, "vertex_indices" | "vertex_index");
                ignored.extend(unused(element, used));
            }
            "vertex" => {
                let read = vertices
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(reason)?;
                fill(&mut file, element, &read)?;
                ignored.extend(unused(element, |name| place(name).is_some()));
            }
            _ => {
                vertices
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(reason)?;
                ignored.push(format!("element {name}"));
            }
        }
    }
    if !ignored.is_empty() {
        let what = super::lines::excerpt(&ignored.join(", "));
        file.notes.push(Note::Ignored { what });
    }
    file.notes.extend(Note::beyond(reader.get_ref()));
    divide(&mut file, &polygons, &sizes)?;
    Ok(file)
}

/// An ASCII file as the parser takes it. It knows no `nan`, `inf` and `1.#QNAN`, for which a number beyond all valid coordinates
/// stands, and no number that begins or ends with its point; and it stops at empty lines.
fn plain(bytes: &[u8]) -> Cow<'_, [u8]> {
    const END: &[u8] = b"end_header";
    let Some(end) = bytes.windows(END.len()).position(|word| word == END) else {
        return bytes.into();
    };
    let (header, payload) = bytes.split_at(end + END.len());
    if !header.windows(12).any(|word| word == b"format ascii") {
        return bytes.into();
    }
    let is_word = |number: &[u8]| {
        let start = number.get(..3).unwrap_or_default().to_ascii_lowercase();
        start == b"nan" || start == b"inf" || start == b"1.#"
    };
    // Classic Mac OS ended lines by returns.
    let end_of_line = if header.contains(&b'\n') {
        b'\n'
    } else {
        b'\r'
    };
    let lines = || {
        bytes
            .split(|&byte| byte == end_of_line)
            .map(<[u8]>::trim_ascii)
    };
    let is_strange = |word: &[u8]| {
        is_word(number_of(word)) || word.ends_with(b".") || number_of(word).starts_with(b".")
    };
    let mut words = payload.split(u8::is_ascii_whitespace);
    let has_gaps = bytes
        .trim_ascii_end()
        .split(|&byte| byte == b'\n')
        .any(|line| line.trim_ascii().is_empty());
    if end_of_line == b'\n' && !has_gaps && !words.any(is_strange) {
        return bytes.into();
    }
    let mut changed = Vec::with_capacity(bytes.len());
    let mut in_header = true;
    for line in lines().filter(|line| !line.is_empty()) {
        if in_header {
            changed.extend_from_slice(line);
            in_header = line != END;
        } else {
            for word in line.split(u8::is_ascii_whitespace) {
                let number = number_of(word);
                changed.extend_from_slice(&word[..word.len() - number.len()]);
                match number {
                    _ if is_word(number) => changed.extend_from_slice(b"9e99"),
                    [b'.', digits @ ..] => changed.extend([b"0.", digits].concat()),
                    [digits @ .., b'.'] => changed.extend_from_slice(digits),
                    _ => changed.extend_from_slice(number),
                }
                changed.push(b' ');
            }
            changed.pop();
        }
        changed.push(b'\n');
    }
    changed.into()
}

/// A number without its sign.
fn number_of(word: &[u8]) -> &[u8] {
    word.strip_prefix(b"-").unwrap_or(word)
}

/// The triangles of strips, all with the same winding.
fn strips(list: &[u32], mut push: impl FnMut([u32; 3])) {
    for strip in list.split(|&index| index == RESTART) {
        for (i, window) in strip.windows(3).enumerate() {
            let [a, b, c] = [window[0], window[1], window[2]];
            // Triangles without area join strips.
            if a != b && b != c && c != a {
                push(if i % 2 == 0 { [a, b, c] } else { [b, a, c] });
            }
        }
    }
}

/// Fills in the points and their attributes.
fn fill(file: &mut CloudFile, element: &ElementDef, read: &[Vertex]) -> Result<(), String> {
    let known: Vec<usize> = element.properties.keys().filter_map(|n| place(n)).collect();
    let has = |first: usize| (first..first + 3).all(|at| known.contains(&at));
    let triple = |first: usize| {
        read.iter()
            .map(move |v| [v.values[first], v.values[first + 1], v.values[first + 2]])
    };
    if !has(0) {
        return Err("its vertices lack x, y or z".into());
    }
    if known.iter().filter(|&&at| at < 3).count() > 3 {
        return Err(
            "its vertices have coordinates in small letters and in capitals: leave one kind out"
                .into(),
        );
    }
    file.points = triple(0).collect();
    if has(3) {
        file.normals = Some(triple(3).map(|n| n.map(|x| x as f32)).collect());
    }
    if has(6) {
        file.colours = super::colours(&triple(6).collect::<Vec<_>>());
    }
    if element.properties.keys().any(|name| place(name) == Some(9)) {
        file.intensities = Some(read.iter().map(|v| v.values[9] as f32).collect());
    }
    Ok(())
}

/// Properties of an element that are not used, without an opaque alpha, which says nothing.
fn unused(element: &ElementDef, used: impl Fn(&str) -> bool) -> Vec<String> {
    let names = element
        .properties
        .keys()
        .filter(|name| !used(name) && *name != "alpha");
    names.cloned().collect()
}

/// The parser's message on one line, without what its grammar expected. It quotes lines of the file, which may be
/// long and binary.
fn reason(error: ParseError) -> String {
    let said = error.to_string();
    let (said, _) = said.split_once("Error: ").unwrap_or((&said, ""));
    let words: Vec<&str> = said.split_whitespace().collect();
    let said = words.join(" ").replace(". String: ", ": ");
    let said = said
        .strip_suffix(" '")
        .map_or(said.clone(), |said| format!("{said}'"));
    let printable = said.replace(|c: char| c.is_control(), "?");
    printable.chars().take(200).collect()
}

/// Writes a binary file with double coordinates, and with normals, colours, intensities and faces if there are any.
pub(super) fn emit(file: &CloudFile) -> Vec<u8> {
    let count = file.points.len();
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {count}\n\
         property double x\nproperty double y\nproperty double z\n"
    );
    if file.normals.is_some() {
        header += "property float nx\nproperty float ny\nproperty float nz\n";
    }
    if file.colours.is_some() {
        header += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    }
    if file.intensities.is_some() {
        header += "property float intensity\n";
    }
    if let Some(faces) = &file.faces {
        header += &format!(
            "element face {}\nproperty list uchar uint vertex_indices\n",
            faces.len()
        );
    }
    let mut bytes = (header + "end_header\n").into_bytes();
    for (i, point) in file.points.iter().enumerate() {
        bytes.extend(point.iter().flat_map(|x| x.to_le_bytes()));
        if let Some(normals) = &file.normals {
            bytes.extend(normals[i].iter().flat_map(|x| x.to_le_bytes()));
        }
        if let Some(colours) = &file.colours {
            bytes.extend(colours[i]);
        }
        if let Some(intensities) = &file.intensities {
            bytes.extend(intensities[i].to_le_bytes());
        }
    }
    for face in file.faces.iter().flatten() {
        bytes.push(3);
        bytes.extend(face.iter().flat_map(|i| i.to_le_bytes()));
    }
    bytes
}
