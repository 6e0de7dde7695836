//! Stereolithography `.stl`, ASCII and binary: a mesh of loose triangles.

use super::CloudFile;
use std::io::Cursor;

pub(super) fn parse(bytes: &[u8]) -> Result<CloudFile, String> {
    let mut cursor = Cursor::new(bytes);
    let triangles = stl_io::create_stl_reader(&mut cursor).map_err(|e| e.to_string())?;
    let mut file = CloudFile::default();
    let mut faces = Vec::new();
    for (index, triangle) in triangles.enumerate() {
        let triangle = triangle.map_err(|e| format!("triangle {index}: {e}"))?;
        let first = file.points.len() as u32;
        faces.push([first, first + 1, first + 2]);
        file.points.extend(triangle.vertices.map(|vertex| vertex.0));
    }
    file.faces = Some(faces).filter(|faces| !faces.is_empty());
    Ok(file)
}
