//! Polygons of mesh files, divided into triangles.

use super::{CloudFile, Note, Position};
use crate::dataset::triangulate::{cross, signed_area, triangulate};
use glam::Vec2;
use nalgebra::Vector3;

/// Most corners of a concave outline that is divided; ear clipping takes the square of their number.
const MAX_CORNERS: usize = 2048;

/// Divides every polygon into triangles: convex ones by a fan from their first corner, concave ones by ear clipping. Others
/// also become fans, with a note. `polygons` holds the corners of all, one after another, `sizes` the number of each.
pub(super) fn divide(
    file: &mut CloudFile,
    polygons: &[u32],
    sizes: &[usize],
) -> Result<(), String> {
    let mut triangles = Vec::new();
    let mut crossed = 0;
    let mut rest = polygons;
    for &size in sizes {
        let (polygon, after) = rest.split_at(size);
        rest = after;
        if size == 3 {
            triangles.push([polygon[0], polygon[1], polygon[2]]);
        } else if size > 3 {
            match cut(&file.points, polygon)? {
                Some(parts) => triangles.extend(parts),
                None => {
                    crossed += 1;
                    triangles.extend(fan(polygon));
                }
            }
        }
    }
    if crossed > 0 {
        file.notes.push(Note::CrossedPolygons { polygons: crossed });
    }
    file.faces = Some(triangles).filter(|triangles| !triangles.is_empty());
    Ok(())
}

/// Divides a polygon into a fan of triangles from its first corner.
fn fan(polygon: &[u32]) -> impl Iterator<Item = [u32; 3]> + '_ {
    let edges = polygon.windows(2).skip(1);
    edges.map(|edge| [polygon[0], edge[0], edge[1]])
}

/// The polygon's triangles; `None` if its outline crosses itself.
fn cut(points: &[Position], polygon: &[u32]) -> Result<Option<Vec<[u32; 3]>>, String> {
    let corners: Option<Vec<Position>> = polygon
        .iter()
        .map(|&corner| points.get(corner as usize).copied())
        .collect();
    // Faces that name missing vertices are refused later; those with invalid vertices are dropped.
    let Some(outline) = corners.and_then(|corners| flattened(&corners)) else {
        return Ok(Some(fan(polygon).collect()));
    };
    if is_convex(&outline) {
        return Ok(Some(fan(polygon).collect()));
    }
    if outline.len() > MAX_CORNERS {
        return Err(format!(
            "a face of {} corners that is not convex; at most {MAX_CORNERS} are divided",
            outline.len()
        ));
    }
    if crosses_itself(&outline) {
        return Ok(None);
    }
    let (_, triangles) = triangulate(&outline, &[]);
    let area = |[a, b, c]: [u32; 3]| signed_area(&[a, b, c].map(|i| outline[i as usize]));
    let covered: f32 = triangles.iter().map(|&t| area(t).abs()).sum();
    let whole = signed_area(&outline);
    if (covered - whole.abs()).abs() > 1e-3 * whole.abs() {
        return Ok(None);
    }
    // Ear clipping runs counterclockwise; the file's winding is restored.
    let named = triangles.into_iter().map(|[a, b, c]| {
        let turned = if whole < 0.0 { [a, c, b] } else { [a, b, c] };
        turned.map(|i| polygon[i as usize])
    });
    Ok(Some(named.collect()))
}

/// Projects the outline onto its own plane, by Newell's normal, its largest coordinate at 1; `None` if it has no area.
fn flattened(corners: &[Position]) -> Option<Vec<Vec2>> {
    let from_first: Vec<Vector3<f64>> = corners
        .iter()
        .map(|&corner| Vector3::from(corner) - Vector3::from(corners[0]))
        .collect();
    let following = from_first.iter().cycle().skip(1);
    let normal: Vector3<f64> = from_first
        .iter()
        .zip(following)
        .map(|(a, b)| a.cross(b))
        .sum();
    let normal = normal.try_normalize(0.0)?;
    let u = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).normalize();
    let v = normal.cross(&u);
    let size = from_first.iter().map(|p| p.amax()).fold(0.0, f64::max);
    let flat = from_first
        .iter()
        .map(|p| Vec2::new((p.dot(&u) / size) as f32, (p.dot(&v) / size) as f32));
    Some(flat.collect()).filter(|flat: &Vec<Vec2>| flat.iter().all(|p| p.is_finite()))
}

/// Whether two edges cross inside both.
fn crosses_itself(outline: &[Vec2]) -> bool {
    let edge = |i: usize| (outline[i], outline[(i + 1) % outline.len()]);
    (0..outline.len()).any(|i| {
        let (a, b) = edge(i);
        (0..i).map(edge).any(|(c, d)| cross(a, b, c, d))
    })
}

/// Whether every corner turns left and the outline makes one full turn.
fn is_convex(outline: &[Vec2]) -> bool {
    let n = outline.len();
    let edge = |i: usize| outline[(i + 1) % n] - outline[i % n];
    let mut turned = 0.0;
    for i in 0..n {
        let (before, after) = (edge(i), edge(i + 1));
        let turn = before.perp_dot(after);
        if turn < -1e-6 {
            return false;
        }
        turned += turn.atan2(before.dot(after));
    }
    turned < 1.5 * std::f32::consts::TAU
}

/// The outline of a U of area 7.
#[cfg(test)]
#[rustfmt::skip]
pub(super) const NOTCHED: [[i32; 2]; 8] = [
    [0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3],
];

#[cfg(test)]
mod tests {
    use super::*;

    /// A U of area 7 in a tilted plane far from the origin, and the square around it of area 9.
    fn notched() -> (Vec<Position>, f64) {
        let tilted = |[x, y]: [i32; 2]| {
            let (x, y) = (f64::from(x), f64::from(y));
            [5e6 + 0.6 * x, 4e5 + y, 300.0 + 0.8 * x]
        };
        (NOTCHED.map(tilted).to_vec(), 7.0)
    }

    fn area(points: &[Position], faces: &[[u32; 3]]) -> (f64, Vector3<f64>) {
        let double = faces.iter().map(|face| {
            let [a, b, c] = face.map(|i| Vector3::from(points[i as usize]));
            (b - a).cross(&(c - a))
        });
        double.fold((0.0, Vector3::zeros()), |(sum, vector), d| {
            (sum + d.norm() / 2.0, vector + d / 2.0)
        })
    }

    #[test]
    fn a_notch_is_left_open_whichever_corner_comes_first() {
        let (points, exact) = notched();
        for start in 0..8u32 {
            for reversed in [false, true] {
                let mut polygon: Vec<u32> = (0..8).map(|i| (i + start) % 8).collect();
                if reversed {
                    polygon.reverse();
                }
                let mut file = CloudFile {
                    points: points.clone(),
                    ..CloudFile::default()
                };
                divide(&mut file, &polygon, &[8]).expect("divided");
                let (found, vector) = area(&points, &file.faces.expect("faces"));
                assert!((found - exact).abs() < 1e-6, "{found} from corner {start}");
                // The triangles keep the outline's winding.
                assert!((vector.norm() - exact).abs() < 1e-6);
                assert_eq!(vector.z < 0.0, reversed);
                assert_eq!(file.notes, []);
            }
        }
    }

    #[test]
    fn convex_polygons_are_fans_and_crossed_ones_are_said() {
        let points = vec![
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [1.0, 1.0, 0.1],
            [0.0, 1.0, 0.0],
        ];
        let mut file = CloudFile {
            points,
            ..CloudFile::default()
        };
        divide(&mut file, &[0, 1, 2, 3, 0, 1], &[4, 2]).expect("divided");
        assert_eq!(file.faces, Some(vec![[0, 1, 2], [0, 2, 3]]));
        assert_eq!(file.notes, []);
        file.points.push([3.0, 0.2, 0.0]);
        divide(&mut file, &[0, 2, 4, 3], &[4]).expect("divided");
        assert_eq!(file.faces, Some(vec![[0, 2, 4], [0, 4, 3]]));
        assert_eq!(file.notes, [Note::CrossedPolygons { polygons: 1 }]);
    }

    #[test]
    fn monstrous_faces_are_refused_at_once() {
        let (points, _) = notched();
        let mut file = CloudFile {
            points,
            ..CloudFile::default()
        };
        let corners: Vec<u32> = (0..200_000).map(|i| i % 8).collect();
        let said = divide(&mut file, &corners, &[200_000]).expect_err("refused");
        assert!(said.contains("200000 corners"), "{said}");
    }
}
