//! Checks for all formats: what no cloud may hold is left out or refused.

use super::{CloudError, CloudFile, MAX_COORDINATE, Note, extent};
use crate::dataset::Point;
use crate::pose64::Position;
use glam::Vec3;
use std::path::Path;

impl CloudFile {
    /// The file without invalid points, and with unit normals or none.
    ///
    /// # Errors
    /// Faces that name missing vertices, and files without valid points.
    pub fn checked(mut self, path: &Path) -> Result<CloudFile, CloudError> {
        let vertices = self.points.len();
        for (face, corners) in self.faces.iter().flatten().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&vertex| vertex as usize >= vertices) {
                return Err(CloudError::BadFace {
                    path: path.into(),
                    face,
                    vertex,
                    vertices,
                });
            }
        }
        let dropped = self.drop_invalid();
        if self.points.is_empty() {
            return Err(CloudError::Empty {
                path: path.into(),
                dropped,
            });
        }
        let unit = |normal: Point| Some(Vec3::from(normal).try_normalize()?.to_array());
        let count = self.points.len();
        if let Some(normals) = self.normals.take() {
            // A single undefined normal makes all of the file's unusable.
            let units: Option<Vec<Point>> = normals.into_iter().map(unit).collect();
            self.normals = units.filter(|units| units.len() == count);
            if self.normals.is_none() {
                self.notes.push(Note::NormalsLeftOut);
            }
        }
        self.notice_loose_vertices();
        // Whole numbers lie on finer grids, too, without a place between.
        let is_used = |&step: &f64| {
            self.points
                .iter()
                .flatten()
                .any(|x| (x / step) % 2.0 != 0.0)
        };
        let coarse = extent::coarse_step(&self.points).filter(is_used);
        self.notes.extend(coarse.map(|step| Note::Coarse { step }));
        Ok(self)
    }

    /// Adds a note if most vertices belong to no face, as in a cloud with a few triangles: only the surface is used.
    fn notice_loose_vertices(&mut self) {
        let Some(faces) = &self.faces else { return };
        let mut is_corner = vec![false; self.points.len()];
        for &vertex in faces.iter().flatten() {
            is_corner[vertex as usize] = true;
        }
        let of = is_corner.len();
        let vertices = is_corner.into_iter().filter(|&corner| !corner).count();
        if 2 * vertices > of {
            self.notes.push(Note::LooseVertices { vertices, of });
        }
    }

    /// Removes invalid points, their attributes, and the faces at them. Returns the number of points removed.
    fn drop_invalid(&mut self) -> usize {
        let valid = |p: &Position| p.iter().all(|x| x.abs() <= MAX_COORDINATE);
        let kept: Vec<bool> = self.points.iter().map(valid).collect();
        let dropped = kept.iter().filter(|&&kept| !kept).count();
        if dropped == 0 {
            return 0;
        }
        let mut count = 0;
        let place: Vec<Option<u32>> = kept
            .iter()
            .map(|&kept| {
                count += u32::from(kept);
                kept.then_some(count.wrapping_sub(1))
            })
            .collect();
        retain(&mut self.points, &kept);
        if let Some(normals) = &mut self.normals {
            retain(normals, &kept);
        }
        if let Some(colours) = &mut self.colours {
            retain(colours, &kept);
        }
        if let Some(intensities) = &mut self.intensities {
            retain(intensities, &kept);
        }
        let moved = |face: &[u32; 3]| {
            let [a, b, c] = face.map(|vertex| place[vertex as usize]);
            Some([a?, b?, c?])
        };
        let before = self.faces.as_ref().map_or(0, Vec::len);
        if let Some(faces) = &mut self.faces {
            *faces = faces.iter().filter_map(moved).collect();
        }
        let after = self.faces.as_ref().map_or(0, Vec::len);
        self.notes.push(Note::Dropped {
            points: dropped,
            faces: before - after,
        });
        dropped
    }
}

/// Keeps the entries that are marked.
fn retain<T>(entries: &mut Vec<T>, kept: &[bool]) {
    let mut marks = kept.iter();
    entries.retain(|_| marks.next().copied().unwrap_or(true));
}
