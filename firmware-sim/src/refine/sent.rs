//! What a client sends of a cloud.

use host_train::dataset::Point;
use host_train::dataset::cloud_file::Note;
use host_train::pose64::Position;
use host_train::register::in_order;
use host_train::register::prepared::Prepared;
use std::path::Path;

/// A cloud as it is sent.
pub(super) struct Sent {
    /// Relative to the origin.
    pub(super) points: Vec<Point>,
    /// In the file's own coordinates.
    pub(super) origin: Position,
    /// Where the sensor stood, relative to the origin, if the cloud is a source seen from one point.
    pub(super) view_point: Option<Point>,
    /// What else the sensor saw, relative to the origin.
    pub(super) background: Vec<Point>,
    /// Outward directions at the points of a target that was seen from one point, if a mesh tells them.
    pub(super) outward: Vec<Point>,
    /// What the reader noticed.
    pub(super) notes: Vec<Note>,
}

impl Sent {
    /// The cloud that was read, and which way it faces if `tells_sides`. Prints what the reader noticed.
    pub(super) fn of(
        cloud: Prepared<'_>,
        path: &Path,
        view_point: Option<Position>,
        tells_sides: bool,
    ) -> Sent {
        for note in &cloud.notes {
            eprintln!("{}: {note}", path.display());
        }
        let relative = |at: Position| [0, 1, 2].map(|k| (at[k] - cloud.origin[k]) as f32);
        let points = in_order(cloud.points().to_vec());
        let outward = match tells_sides {
            true => cloud.outward_at(&points),
            false => Vec::new(),
        };
        Sent {
            points,
            outward,
            origin: cloud.origin,
            view_point: view_point.map(relative),
            background: cloud.background,
            notes: cloud.notes,
        }
    }
}
