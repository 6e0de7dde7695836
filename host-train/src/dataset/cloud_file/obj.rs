//! Wavefront `.obj`: all objects of the file as one mesh, or its bare vertices if it has no faces.
//!
//! It is read here rather than by a crate, because a surface needs few of the format's keywords, and because a
//! refusal should name the line.

use super::lines::{decode, numbered, numbers, position};
use super::polygon::divide;
use super::{CloudFile, Note};
use crate::dataset::Point;

pub(super) fn parse(bytes: &[u8]) -> Result<CloudFile, String> {
    let mut file = CloudFile::default();
    let mut whole = decode(bytes, &mut file.notes)?;
    if whole.contains('\\') {
        // A backslash continues a line.
        whole = whole.replace("\\\r\n", " ").replace("\\\n", " ").into();
    }
    let (mut polygons, mut sizes) = (Vec::new(), Vec::new());
    let mut colours = Vec::new();
    let mut weighted = 0;
    let mut normals = Normals::default();
    let mut ignored: Vec<&str> = Vec::new();
    for (line, content) in numbered(&whole) {
        let (keyword, rest) = content
            .split_once(char::is_whitespace)
            .unwrap_or((content, ""));
        match keyword {
            "v" => {
                let row = numbers(rest);
                let mut point = position(row.as_deref(), rest, line)?;
                // A weight may follow the coordinates, or a colour.
                match row.as_deref() {
                    Some(&[_, _, _, weight]) if weight != 1.0 => {
                        point = point.map(|x| x / weight);
                        weighted += 1;
                    }
                    Some(&[_, _, _, r, g, b]) => colours.push([r, g, b]),
                    _ => {}
                }
                file.points.push(point);
            }
            "vn" => {
                let [x, y, z] = position(numbers(rest).as_deref(), rest, line)?;
                normals.listed.push([x as f32, y as f32, z as f32]);
            }
            "f" => {
                let before = polygons.len();
                for corner in rest.split_whitespace() {
                    let mut words = corner.split('/');
                    let index = words.next().and_then(|word| word.parse().ok());
                    let vertex = index.and_then(|index| resolve(index, file.points.len()));
                    let vertex = vertex.ok_or_else(|| {
                        format!("line {line}: \"{corner}\" names no vertex before it")
                    })?;
                    polygons.push(vertex);
                    normals.assign(vertex, words.nth(1));
                }
                sizes.push(polygons.len() - before);
            }
            // Names, groups and materials do not change the surface.
            "o" | "g" | "s" | "vt" | "mtllib" | "usemtl" => {}
            _ if !ignored.contains(&keyword) && ignored.len() < 8 => ignored.push(keyword),
            _ => {}
        }
    }
    if !ignored.is_empty() {
        let what = format!("lines {}", super::lines::excerpt(&ignored.join(", ")));
        file.notes.push(Note::Ignored { what });
    }
    if weighted > 0 {
        file.notes.push(Note::Weighted { vertices: weighted });
    }
    if colours.len() == file.points.len() {
        file.colours = super::colours(&colours);
    }
    divide(&mut file, &polygons, &sizes)?;
    file.normals = normals.of_vertices(file.points.len(), file.faces.is_some());
    if file.normals.is_none() && !normals.listed.is_empty() {
        file.notes.push(Note::NormalsLeftOut);
    }
    Ok(file)
}

/// The entry that an index names: indices count from 1, negative ones backwards from the end.
fn resolve(index: i64, entries: usize) -> Option<u32> {
    let count = i64::try_from(entries).ok()?;
    let at = if index < 0 {
        count.checked_add(index)?
    } else {
        index.checked_sub(1)?
    };
    if (0..count).contains(&at) {
        u32::try_from(at).ok()
    } else {
        None
    }
}

/// Normals as the format gives them: a list, and an index into it at every corner of a face.
#[derive(Default)]
struct Normals {
    listed: Vec<Point>,
    /// The normal of each vertex that faces give one.
    of_vertex: Vec<Option<Point>>,
    /// Some vertex has several normals.
    ambiguous: bool,
}

impl Normals {
    fn assign(&mut self, vertex: u32, word: Option<&str>) {
        let index = word.and_then(|word| resolve(word.parse().ok()?, self.listed.len()));
        let Some(&normal) = index.and_then(|index| self.listed.get(index as usize)) else {
            return;
        };
        let vertex = vertex as usize;
        if self.of_vertex.len() <= vertex {
            self.of_vertex.resize(vertex + 1, None);
        }
        let before = self.of_vertex[vertex].replace(normal);
        self.ambiguous |= before.is_some_and(|before| before != normal);
    }

    /// One normal for each vertex, if each has exactly one; for a plain cloud the list in its order.
    fn of_vertices(&mut self, vertices: usize, faces: bool) -> Option<Vec<Point>> {
        if !faces {
            return Some(self.listed.clone()).filter(|l| !l.is_empty() && l.len() == vertices);
        }
        if self.ambiguous || self.of_vertex.len() != vertices {
            return None;
        }
        std::mem::take(&mut self.of_vertex).into_iter().collect()
    }
}

/// Writes the mesh, with colours and normals of its vertices if it has them.
pub(super) fn emit(file: &CloudFile) -> Vec<u8> {
    let mut text = String::new();
    for (i, [x, y, z]) in file.points.iter().enumerate() {
        text += &format!("v {x} {y} {z}");
        if let Some(colours) = &file.colours {
            let [r, g, b] = colours[i].map(|c| f32::from(c) / 255.0);
            text += &format!(" {r} {g} {b}");
        }
        text += "\n";
    }
    for [x, y, z] in file.normals.iter().flatten() {
        text += &format!("vn {x} {y} {z}\n");
    }
    for face in file.faces.iter().flatten() {
        let [a, b, c] = face.map(|i| match file.normals {
            Some(_) => format!("{0}//{0}", i + 1),
            None => (i + 1).to_string(),
        });
        text += &format!("f {a} {b} {c}\n");
    }
    text.into_bytes()
}
