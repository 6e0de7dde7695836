//! The meaning of a table's columns, told by their names or by their number.

/// Which columns hold what.
pub(super) struct Layout {
    pub(super) point: [usize; 3],
    pub(super) normal: Option<[usize; 3]>,
    pub(super) colour: Option<[usize; 3]>,
    pub(super) intensity: Option<usize>,
    /// The columns whose meaning is not known.
    pub(super) ignored: String,
}

impl Layout {
    /// Tells columns by their names; `None` if those of the coordinates are missing.
    pub(super) fn named(names: &[String]) -> Option<Layout> {
        let place = |options: &[&str]| names.iter().position(|n| options.contains(&n.as_str()));
        let places = |options: [&[&str]; 3]| {
            let [a, b, c] = options.map(place);
            Some([a?, b?, c?])
        };
        let point = coordinates(names)?;
        let normal = places([
            &["nx", "normal_x", "normals:0"],
            &["ny", "normal_y", "normals:1"],
            &["nz", "normal_z", "normals:2"],
        ]);
        let colour = places([&["r", "red"], &["g", "green"], &["b", "blue"]]);
        let intensity = place(&["i", "intensity", "scalar_intensity", "reflectance"]);
        let used: Vec<usize> = [Some(point), normal, colour]
            .into_iter()
            .flatten()
            .flatten()
            .chain(intensity)
            .collect();
        let ignored: Vec<&str> = (0..names.len())
            .filter(|at| !used.contains(at))
            .map(|at| names[at].as_str())
            .filter(|name| !name.is_empty())
            .collect();
        Some(Layout {
            point,
            normal,
            colour,
            intensity,
            ignored: match ignored.is_empty() {
                true => String::new(),
                false => format!("columns {}", ignored.join(", ")),
            },
        })
    }

    /// Moves all columns to the right, because the first one has no name.
    pub(super) fn shift(&mut self) {
        let places = [
            Some(&mut self.point),
            self.normal.as_mut(),
            self.colour.as_mut(),
        ];
        let places = places.into_iter().flatten().flatten();
        places
            .chain(self.intensity.as_mut())
            .for_each(|at| *at += 1);
    }

    /// Tells columns by their number, in the order of `.pts` and most programs: `x y z`, then an intensity, a
    /// colour, or both, then a normal. `is_byte` says whether a column holds whole numbers up to 255.
    pub(super) fn guessed(first: usize, columns: usize, is_byte: impl Fn(usize) -> bool) -> Layout {
        let at = |start: usize| [start, start + 1, start + 2];
        let after = first + 3;
        let bytes = |start: usize| start + 3 <= columns && (start..start + 3).all(&is_byte);
        let mut layout = Layout {
            point: at(first),
            normal: None,
            colour: None,
            intensity: None,
            ignored: String::new(),
        };
        let used = match columns - after {
            0 => 0,
            1 => {
                layout.intensity = Some(after);
                1
            }
            3 if bytes(after) => {
                layout.colour = Some(at(after));
                3
            }
            3 => {
                layout.normal = Some(at(after));
                3
            }
            4 if bytes(after + 1) => {
                layout.intensity = Some(after);
                layout.colour = Some(at(after + 1));
                4
            }
            6 if bytes(after) => {
                layout.colour = Some(at(after));
                layout.normal = Some(at(after + 3));
                6
            }
            _ => 0,
        };
        if used < columns - after {
            layout.ignored = format!("columns from number {} on", after + used + 1);
        }
        layout
    }
}

/// Names of the coordinates in various programs.
const COORDINATES: [[&str; 3]; 11] = [
    ["x", "y", "z"],
    ["points:0", "points:1", "points:2"],
    ["points_0", "points_1", "points_2"],
    ["points_m_xyz:0", "points_m_xyz:1", "points_m_xyz:2"],
    ["x_coord", "y_coord", "z_coord"],
    ["coord_x", "coord_y", "coord_z"],
    ["x-coordinate", "y-coordinate", "z-coordinate"],
    ["pos_x", "pos_y", "pos_z"],
    ["point.x", "point.y", "point.z"],
    ["easting", "northing", "elevation"],
    ["east", "north", "height"],
];

/// The columns of the coordinates: the first complete set of names, or else the only candidate for each axis.
fn coordinates(names: &[String]) -> Option<[usize; 3]> {
    let place = |name: &str| names.iter().position(|n| n == name);
    let together = |[x, y, z]: [&str; 3]| Some([place(x)?, place(y)?, place(z)?]);
    let only = |axis: usize| {
        let mut places = COORDINATES.iter().filter_map(|of| place(of[axis]));
        places.next().filter(|_| places.next().is_none())
    };
    let found = COORDINATES.into_iter().find_map(together);
    found.or_else(|| Some([only(0)?, only(1)?, only(2)?]))
}
