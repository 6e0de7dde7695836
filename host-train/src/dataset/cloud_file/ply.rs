//! Stanford polygon files: ASCII and both binary forms.

use super::{CloudFile, fan};
use crate::dataset::Point;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};

#[derive(Default)]
struct Vertex {
    position: Point,
}

impl PropertyAccess for Vertex {
    fn new() -> Vertex {
        Vertex::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let axis = match name {
            "x" => 0,
            "y" => 1,
            "z" => 2,
            _ => return PropertyAccessResult::Ignored,
        };
        self.position[axis] = property.to_f32_lossy().unwrap_or(f32::NAN);
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
    let header = vertices
        .read_header(&mut reader)
        .map_err(|e| e.to_string())?;
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
                .map_err(|e| e.to_string())?;
            file.faces = Some(read.iter().flat_map(|face| fan(&face.corners)).collect())
                .filter(|f: &Vec<_>| !f.is_empty());
        } else {
            let read = vertices
                .read_payload_for_element(&mut reader, element, &header)
                .map_err(|e| e.to_string())?;
            if name == "vertex" {
                if ["x", "y", "z"]
                    .iter()
                    .any(|&axis| !element.properties.contains_key(axis))
                {
                    return Err("its vertices lack x, y or z".into());
                }
                file.points = read.into_iter().map(|vertex| vertex.position).collect();
            }
        }
    }
    Ok(file)
}

pub(super) fn emit(points: &[Point]) -> Vec<u8> {
    let axes = "property float x\nproperty float y\nproperty float z\n";
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n{axes}end_header\n",
        points.len()
    );
    let numbers = points.iter().flatten().flat_map(|x| x.to_le_bytes());
    header.into_bytes().into_iter().chain(numbers).collect()
}
