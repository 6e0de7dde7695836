//! Two plain text formats: `.xyz` and `.off`.

use super::{CloudFile, fan};
use crate::dataset::Point;

/// Lines of `x y z …`, separated by blanks, tabs, commas or semicolons; `#` starts a comment.
pub(super) fn parse_xyz(bytes: &[u8]) -> Result<CloudFile, String> {
    let points = lines(bytes)?
        .map(|(line, text)| point(text, line))
        .collect::<Result<_, _>>()?;
    Ok(CloudFile {
        points,
        ..CloudFile::default()
    })
}

/// Points as lines of `x y z`, in the shortest form that reads back the same.
pub(super) fn emit_xyz(points: &[Point]) -> Vec<u8> {
    let lines = points.iter().map(|[x, y, z]| format!("{x} {y} {z}\n"));
    lines.collect::<String>().into_bytes()
}

/// Object file format, also with colours or normals (COFF, NOFF), and with the counts on the first line as
/// some files of ModelNet have them.
pub(super) fn parse_off(bytes: &[u8]) -> Result<CloudFile, String> {
    let mut lines = lines(bytes)?;
    let (line, first) = lines.next().ok_or("the file is empty")?;
    let (_, after) = first
        .split_once("OFF")
        .ok_or("it does not begin with OFF")?;
    let (line, counts) = if after.trim().is_empty() {
        lines.next().ok_or("it ends before the counts")?
    } else {
        (line, after)
    };
    let numbers: Vec<usize> = counts
        .split_whitespace()
        .map_while(|word| word.parse().ok())
        .collect();
    let &[vertices, faces, ..] = numbers.as_slice() else {
        return Err(format!(
            "line {line}: expected the numbers of vertices and faces"
        ));
    };
    let mut file = CloudFile::default();
    for read in 0..vertices {
        let (line, text) = lines
            .next()
            .ok_or_else(|| format!("it ends after {read} of {vertices} vertices"))?;
        file.points.push(point(text, line)?);
    }
    let mut triangles = Vec::new();
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
        let polygon: Vec<u32> = words
            .take(corners)
            .map_while(|word| word.parse().ok())
            .collect();
        if polygon.len() != corners {
            return Err(bad());
        }
        triangles.extend(fan(&polygon));
    }
    file.faces = Some(triangles).filter(|triangles| !triangles.is_empty());
    Ok(file)
}

/// Lines that hold something, with their numbers from 1, comments removed.
pub(super) fn lines(bytes: &[u8]) -> Result<impl Iterator<Item = (usize, &str)>, String> {
    let text =
        std::str::from_utf8(bytes).map_err(|e| format!("byte {} is not text", e.valid_up_to()))?;
    Ok(numbered(text))
}

/// As [`lines`], of what is known to be text.
pub(super) fn numbered(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let numbered = text
        .lines()
        .enumerate()
        .map(|(i, line)| (i + 1, line.split('#').next().unwrap_or("").trim()));
    numbered.filter(|(_, line)| !line.is_empty())
}

pub(super) fn point(text: &str, line: usize) -> Result<Point, String> {
    let mut words = text
        .split([' ', '\t', ',', ';'])
        .filter(|word| !word.is_empty());
    let mut point = [0.0; 3];
    for coordinate in &mut point {
        let word = words.next().and_then(|word| word.parse().ok());
        *coordinate = word.ok_or_else(|| {
            format!(
                "line {line}: expected three coordinates, found \"{}\"",
                text.chars().take(40).collect::<String>()
            )
        })?;
    }
    Ok(point)
}
