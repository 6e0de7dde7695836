//! Stanford polygon files: ASCII and both binary forms.

use super::{CloudFile, fan};
use crate::dataset::Point;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};

#[derive(Default)]
struct Vertex {
    position: Point,
    normal: Point,
}

impl PropertyAccess for Vertex {
    fn new() -> Vertex {
        Vertex::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let coordinate = match name {
            "x" => &mut self.position[0],
            "y" => &mut self.position[1],
            "z" => &mut self.position[2],
            "nx" => &mut self.normal[0],
            "ny" => &mut self.normal[1],
            "nz" => &mut self.normal[2],
            _ => return PropertyAccessResult::Ignored,
        };
        *coordinate = property.to_f32_lossy().unwrap_or(f32::NAN);
        PropertyAccessResult::Set
    }
}

#[derive(Default)]
struct Face {
    corners: Vec<u32>,
}

impl PropertyAccess for Face {
    fn new() -> Face {
        Face::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !matches!(name, "vertex_indices" | "vertex_index") {
            return PropertyAccessResult::Ignored;
        }
        // A negative index is out of range like any other that names no vertex.
        self.corners = property.to_u32_list().unwrap_or_else(|| vec![u32::MAX; 3]);
        PropertyAccessResult::Set
    }
}

pub(super) fn parse(bytes: &[u8]) -> Result<CloudFile, String> {
    let mut reader = Reader::new(bytes);
    let vertices = Parser::<Vertex>::new();
    let faces = Parser::<Face>::new();
    let header = vertices.read_header(&mut reader).map_err(reason)?;
    let mut file = CloudFile::default();
    for (name, element) in &header.elements {
        // An entry takes a byte at least, so that a corrupt count cannot ask for more than the file has.
        if element.properties.is_empty() || element.count > bytes.len() {
            return Err(format!(
                "{} elements \"{name}\" do not fit a file of {} bytes",
                element.count,
                bytes.len()
            ));
        }
        if name == "face" {
            let read = faces
                .read_payload_for_element(&mut reader, element, &header)
                .map_err(reason)?;
            file.faces = Some(read.iter().flat_map(|face| fan(&face.corners)).collect())
                .filter(|f: &Vec<_>| !f.is_empty());
        } else {
            let read = vertices
                .read_payload_for_element(&mut reader, element, &header)
                .map_err(reason)?;
            if name == "vertex" {
                let has = |axes: [&str; 3]| {
                    axes.iter()
                        .all(|&axis| element.properties.contains_key(axis))
                };
                if !has(["x", "y", "z"]) {
                    return Err("its vertices lack x, y or z".into());
                }
                file.points = read.iter().map(|vertex| vertex.position).collect();
                if has(["nx", "ny", "nz"]) {
                    file.normals = Some(read.iter().map(|vertex| vertex.normal).collect());
                }
            }
        }
    }
    Ok(file)
}

/// What the parser said, on one line; it repeats lines of the file, which may be long and binary.
fn reason(error: ParseError) -> String {
    let said = error.to_string();
    let words: Vec<&str> = said.split_whitespace().collect();
    let printable = words.join(" ").replace(|c: char| c.is_control(), "?");
    printable.chars().take(200).collect()
}

/// A binary file of `[N, 3]` points, or `[N, 6]` points and normals, given as little-endian float32.
pub(super) fn emit(rows: &[u8], count: usize, columns: usize) -> Vec<u8> {
    let properties: String = ["x", "y", "z", "nx", "ny", "nz"][..columns]
        .iter()
        .map(|name| format!("property float {name}\n"))
        .collect();
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{properties}end_header\n"
    );
    [header.as_bytes(), rows].concat()
}
