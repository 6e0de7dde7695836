//! Object file format `.off`, with colours or normals of the vertices (COFF, NOFF, CNOFF). Counts may be on the
//! first line, as in some files of ModelNet.

use super::lines::{decode, numbered, numbers, position};
use super::polygon::divide;
use super::{CloudFile, Note};

pub(super) fn parse(bytes: &[u8]) -> Result<CloudFile, String> {
    let mut file = CloudFile::default();
    let text = decode(bytes, &mut file.notes)?;
    let mut lines = numbered(&text);
    let (line, first) = lines.next().ok_or("the file is empty")?;
    let (prefix, after) = first
        .split_once("OFF")
        .ok_or("it does not begin with OFF")?;
    if prefix.contains(['4', 'n']) || after.trim() == "BINARY" {
        return Err(format!(
            "\"{}\" is not read; write it as three-dimensional text",
            first.trim()
        ));
    }
    let (line, counts) = if after.trim().is_empty() {
        lines.next().ok_or("it ends before the counts")?
    } else {
        (line, after)
    };
    let counted: Vec<usize> = counts
        .split_whitespace()
        .map_while(|word| word.parse().ok())
        .collect();
    let &[vertices, faces, ..] = counted.as_slice() else {
        return Err(format!(
            "line {line}: expected the numbers of vertices and faces"
        ));
    };
    // After the coordinates: normal, then colour, then texture coordinates.
    let normal = prefix.contains('N').then_some(3);
    let colour = prefix
        .contains('C')
        .then_some(normal.map_or(3, |at| at + 3));
    let (mut normals, mut colours) = (Vec::new(), Vec::new());
    for read in 0..vertices {
        let (line, text) = lines
            .next()
            .ok_or_else(|| format!("it ends after {read} of {vertices} vertices"))?;
        let row = numbers(text);
        file.points.push(position(row.as_deref(), text, line)?);
        let triple = |at: Option<usize>| row.as_deref()?.get(at?..at? + 3)?.try_into().ok();
        normals.extend(triple(normal).map(|n: [f64; 3]| n.map(|x| x as f32)));
        colours.extend(triple(colour));
    }
    file.normals = normal.map(|_| normals);
    file.colours = colour.and_then(|_| super::colours(&colours));
    if prefix.contains("ST") {
        let what = "texture coordinates".into();
        file.notes.push(Note::Ignored { what });
    }
    let (mut polygons, mut sizes) = (Vec::new(), Vec::new());
    for read in 0..faces {
        let (line, text) = lines
            .next()
            .ok_or_else(|| format!("it ends after {read} of {faces} faces"))?;
        let bad =
            || format!("line {line}: expected a number of corners and as many vertex indices");
        let mut words = text.split_whitespace();
        let corners: usize = words
            .next()
            .and_then(|word| word.parse().ok())
            .ok_or_else(bad)?;
        let before = polygons.len();
        polygons.extend(
            words
                .take(corners)
                .map_while(|word| word.parse::<u32>().ok()),
        );
        if polygons.len() - before != corners {
            return Err(bad());
        }
        sizes.push(corners);
    }
    let rest: String = lines.map(|(_, text)| text).collect();
    file.notes.extend(Note::beyond(rest.as_bytes()));
    divide(&mut file, &polygons, &sizes)?;
    Ok(file)
}

/// Writes the mesh, with normals or colours of its vertices if it has them.
pub(super) fn emit(file: &CloudFile) -> Vec<u8> {
    let faces = file.faces.as_deref().unwrap_or_default();
    let mut text = String::new();
    if file.colours.is_some() {
        text += "C";
    }
    if file.normals.is_some() {
        text += "N";
    }
    text += &format!("OFF\n{} {} 0\n", file.points.len(), faces.len());
    for (i, [x, y, z]) in file.points.iter().enumerate() {
        text += &format!("{x} {y} {z}");
        if let Some(normals) = &file.normals {
            let [x, y, z] = normals[i];
            text += &format!(" {x} {y} {z}");
        }
        if let Some(colours) = &file.colours {
            let [r, g, b] = colours[i];
            text += &format!(" {r} {g} {b} 255");
        }
        text += "\n";
    }
    for [a, b, c] in faces {
        text += &format!("3 {a} {b} {c}\n");
    }
    text.into_bytes()
}
