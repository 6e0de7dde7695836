//! Wavefront `.obj`: all objects of the file as one mesh, or its bare vertices where it has no faces.

use super::{CloudFile, text};
use tobj::{LoadError, LoadOptions};

pub(super) fn parse(mut bytes: &[u8]) -> Result<CloudFile, String> {
    let whole = bytes;
    let options = LoadOptions {
        triangulate: true,
        ignore_points: true,
        ignore_lines: true,
        ..LoadOptions::default()
    };
    // Materials play no part.
    let loaded = tobj::load_obj_buf(&mut bytes, &options, |_| Err(LoadError::GenericFailure));
    let (models, _) = loaded.map_err(|e| e.to_string())?;
    let mut file = CloudFile::default();
    let mut triangles = Vec::new();
    for model in models {
        let first = file.points.len() as u32;
        let (points, _) = model.mesh.positions.as_chunks::<3>();
        file.points.extend(points);
        let (faces, _) = model.mesh.indices.as_chunks::<3>();
        triangles.extend(
            faces
                .iter()
                .map(|face| face.map(|index| first.saturating_add(index))),
        );
    }
    if triangles.is_empty() {
        let vertices = text::lines(whole)?
            .filter_map(|(line, text)| text.strip_prefix("v ").map(|rest| (line, rest)));
        file.points = vertices
            .map(|(line, rest)| text::point(rest, line))
            .collect::<Result<_, _>>()?;
    } else {
        file.faces = Some(triangles);
    }
    Ok(file)
}
