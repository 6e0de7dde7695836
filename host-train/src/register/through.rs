//! Detects a part that would stand where the camera saw something behind it: the target is too large, has more to it than
//! what was seen, or is another part.

use crate::dataset::Point;
use crate::register::prepared::Prepared;
use glam::{Mat3, Vec3};
use reagent_core::{Error, Frame, Pose};

/// Cells across the target in the image.
const CELLS: usize = 32;
/// A point counts if something was seen behind it by more than this, in target radii.
const MARGIN: f32 = 0.1;
/// Share of the target's points that must count: more than of any right pose that was tried.
const LEAST: f32 = 0.05;

/// Share of the target's points facing the sensor behind which something was seen, if it is too large for a right pose. `None`
/// where nothing besides the source was seen.
///
/// # Errors
/// A target that the core refuses.
pub fn seen_through(
    [source, target]: [&Prepared<'_>; 2],
    view_point: Vec3,
    target_from_source: Pose,
) -> Result<Option<f32>, Error> {
    if source.background.is_empty() {
        return Ok(None);
    }
    let Frame { centre, scale } = Frame::of(target.points())?;
    let eye = target_from_source.apply(view_point);
    let distance = eye.distance(centre);
    if distance <= scale {
        return Ok(None);
    }
    let ahead = (centre - eye) / distance;
    let (right, down) = ahead.any_orthonormal_pair();
    let camera = Mat3::from_cols(right, down, ahead).transpose();
    // Of the image plane at depth 1, from the middle to where the bounding sphere ends.
    let half = scale / (distance * distance - scale * scale).sqrt();
    let cell = |at: Vec3| -> Option<(usize, f32)> {
        let Vec3 { x, y, z } = camera * (at - eye);
        let [column, row] = [x, y].map(|x| (x / z / half + 1.0) * 0.5 * CELLS as f32);
        let is_inside = |at: f32| (0.0..CELLS as f32).contains(&at);
        let is_seen = z > 0.0 && is_inside(column) && is_inside(row);
        is_seen.then_some((row as usize * CELLS + column as usize, z))
    };
    // The nearest point seen in each cell.
    let mut depths = vec![f32::INFINITY; CELLS * CELLS];
    for &point in source.all.iter().chain(&source.background) {
        if let Some((cell, depth)) = cell(target_from_source.apply(point.into())) {
            depths[cell] = depths[cell].min(depth);
        }
    }
    // Cameras see little at edges, and masks end beside them: what was seen in the cells around counts, too.
    let around = |cell: usize| {
        let [row, column] =
            [cell / CELLS, cell % CELLS].map(|at| at.saturating_sub(1)..(at + 2).min(CELLS));
        row.flat_map(move |row| column.clone().map(move |column| row * CELLS + column))
    };
    let facing = target.all_seen_from(Some(eye))?.points;
    let is_through = |point: &&Point| {
        cell(Vec3::from(**point)).is_some_and(|(cell, depth)| {
            let nearest =
                around(cell).fold(f32::INFINITY, |nearest, cell| nearest.min(depths[cell]));
            depths[cell].is_finite() && depth < nearest - MARGIN * scale
        })
    };
    let through = facing.iter().filter(is_through).count();
    let share = through as f32 / facing.len().max(1) as f32;
    Ok((share > LEAST).then_some(share))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::cloud_file::CloudFile;
    use crate::dataset::mesh::Mesh;
    use crate::dataset::winding::tests::block;
    use std::path::Path;

    fn part(size: Vec3) -> Prepared<'static> {
        let Mesh { vertices, faces } = block(Vec3::ZERO, size);
        let vertices: Vec<Point> = vertices.iter().map(|v| v.to_array()).collect();
        let file = CloudFile {
            faces: Some(faces),
            ..CloudFile::of(&vertices)
        };
        Prepared::of_file(&file, Path::new("part"), None, 1).expect("a mesh")
    }

    /// The upper side of a block of this width, and the table around it, as a sensor above sees them.
    fn seen(width: f32, with_table: bool) -> Prepared<'static> {
        let grid = (0..80 * 80).map(|i| [i % 80, i / 80].map(|k| (k as f32 - 39.5) * 0.04));
        let is_on = |&[x, y]: &[f32; 2]| x.abs() < 0.5 * width && y.abs() < 0.5;
        let top = grid.clone().filter(is_on).map(|[x, y]| [x, y, 0.3]);
        let top: Vec<Point> = top.collect();
        let file = CloudFile::of(&top);
        let mut source = Prepared::of_file(&file, Path::new("scan"), None, 1).expect("a cloud");
        if with_table {
            let table = grid.filter(|at| !is_on(at)).map(|[x, y]| [x, y, -0.3]);
            source.see(&table.collect::<Vec<Point>>(), 1.0);
        }
        source
    }

    #[test]
    fn a_part_that_is_smaller_than_the_model_is_noticed_where_its_surroundings_were_seen() {
        let model = part(Vec3::new(1.6, 1.0, 0.6));
        let share = |width, with_table| {
            let source = seen(width, with_table);
            let eye = Vec3::new(0.0, 0.0, 6.0);
            seen_through([&source, &model], eye, Pose::IDENTITY).expect("clouds")
        };
        assert_eq!(share(1.6, true), None);
        assert_eq!(share(1.2, false), None);
        let noticed = share(1.2, true).expect("a quarter was seen through");
        assert!((0.15..0.35).contains(&noticed), "{noticed}");
    }

    #[test]
    fn a_sensor_within_the_target_tells_nothing() {
        let model = part(Vec3::new(1.6, 1.0, 0.6));
        let within = seen_through([&seen(1.2, true), &model], Vec3::ZERO, Pose::IDENTITY);
        assert_eq!(within, Ok(None));
    }
}
