//! What a mesh tells of the points drawn from it.

use crate::dataset::Point;
use crate::dataset::mesh::Mesh;
use crate::dataset::outside::Outside;
use crate::dataset::winding::Winding;
use crate::threads::on_all_threads;
use glam::Vec3;
use reagent_core::pipeline::INSIDE;
use std::sync::OnceLock;

/// A surface faces away from the sensor if the cosine between its normal and the direction to the sensor is below minus this.
const AWAY: f32 = 0.1;

/// A mesh, and the normals of its faces at the points drawn from it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Surface {
    mesh: Mesh,
    normals: Vec<Point>,
    outward: OnceLock<Vec<Point>>,
}

impl Surface {
    pub(super) fn new(mesh: Mesh, normals: Vec<Point>) -> Surface {
        Surface {
            mesh,
            normals,
            outward: OnceLock::new(),
        }
    }

    /// Normals of the faces at the points drawn.
    pub(super) fn normals(&self) -> &[Point] {
        &self.normals
    }

    /// Of the points drawn: outward normals, [`INSIDE`] where nothing outside can see them, and NaN where both sides can be seen.
    /// Empty if nothing is told.
    pub(super) fn outward(&self, points: &[Point]) -> &[Point] {
        self.outward.get_or_init(|| self.look(points))
    }

    fn look(&self, points: &[Point]) -> Vec<Point> {
        let Some(outside) = Outside::of(&self.mesh) else {
            return Vec::new();
        };
        let winding = self.mesh.winding();
        let of = |k: usize| {
            let (point, normal) = (points[k], self.normals[k]);
            let inward = normal.map(|x| -x);
            match (outside.sees(point.into(), normal.into()), winding) {
                ([false, false], _) => INSIDE,
                (_, Some(Winding::Outward)) | ([true, false], None) => normal,
                (_, Some(Winding::Inward)) | ([false, true], None) => inward,
                ([true, true], None) => [f32::NAN; 3],
            }
        };
        let told = on_all_threads(points.len().min(self.normals.len()), of);
        let tells = told.iter().any(|outward| !outward[0].is_nan());
        if tells { told } else { Vec::new() }
    }
}

/// Whether a sensor at `eye` may see a piece of surface.
pub(super) fn is_seen(point: Point, outward: Point, eye: Vec3) -> bool {
    let towards = (eye - Vec3::from(point)).normalize_or_zero();
    let is_away = towards.dot(Vec3::from(outward)) < -AWAY;
    outward != INSIDE && !is_away
}
