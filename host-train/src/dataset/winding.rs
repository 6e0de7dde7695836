//! The winding of a mesh's faces, if they enclose a volume.

use super::mesh::Mesh;
use nalgebra::Vector3;
use std::collections::HashMap;

/// Least volume of a shell, in cubes of its extent; less is a double-sided sheet, or rounding.
const LEAST_VOLUME: f64 = 1e-7;

/// The side of a solid from which its faces look counterclockwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Winding {
    /// The outside: normals point outward.
    Outward,
    /// The inside.
    Inward,
}

impl Mesh {
    /// The winding of the faces if they enclose one or several solids, all in the same way. `None` for a mesh with
    /// holes, flipped faces or edges that more than two faces share, or without volume. Coincident vertices are merged.
    pub fn winding(&self) -> Option<Winding> {
        let mut merged = HashMap::new();
        let vertices = self.vertices.iter();
        let places: Vec<u32> = vertices
            // Adding 0 turns -0 into 0.
            .map(|&v| (v + 0.0).to_array().map(f32::to_bits))
            .zip(0..)
            .map(|(bits, i)| *merged.entry(bits).or_insert(i))
            .collect();
        let merged = self.faces.iter().filter_map(|face| {
            let [a, b, c] = face.map(|i| places.get(i as usize).copied());
            Some([a?, b?, c?])
        });
        let faces: Vec<[u32; 3]> = merged
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .collect();
        let mut shells = Shells::of_closed(&faces)?;
        let at = |i: u32| Vector3::from(self.vertices[i as usize].to_array().map(f64::from));
        let mut of_shells: HashMap<u32, Shell> = HashMap::new();
        for (&face, number) in faces.iter().zip(0..) {
            let first = shells.of(number);
            let middle = at(faces[first as usize][0]);
            let shell = of_shells.entry(first).or_default();
            shell.add(face.map(|i| at(i) - middle));
        }
        let mut windings = of_shells.values().map(Shell::winding);
        let first = windings.next()?;
        windings.all(|other| other == first).then_some(first)?
    }
}

/// Shells of faces that are joined by edges, as disjoint sets: each face points to one of the same shell.
struct Shells(Vec<u32>);

impl Shells {
    /// The shells, if every edge is traversed once in each direction; else `None`.
    fn of_closed(faces: &[[u32; 3]]) -> Option<Shells> {
        let edges = faces.iter().zip(0..).flat_map(|(&[a, b, c], face)| {
            [(a, b), (b, c), (c, a)].map(|(a, b)| (a.min(b), a.max(b), a < b, face))
        });
        let mut edges: Vec<(u32, u32, bool, u32)> = edges.collect();
        edges.sort_unstable();
        let mut shells = Shells((0..faces.len() as u32).collect());
        for edge in edges.chunk_by(|one, other| (one.0, one.1) == (other.0, other.1)) {
            let &[(.., false, one), (.., true, other)] = edge else {
                return None;
            };
            shells.join(one, other);
        }
        Some(shells)
    }

    /// The face that represents a face's shell.
    fn of(&mut self, mut face: u32) -> u32 {
        while self.0[face as usize] != face {
            let next = self.0[face as usize];
            self.0[face as usize] = self.0[next as usize];
            face = next;
        }
        face
    }

    fn join(&mut self, one: u32, other: u32) {
        let (one, other) = (self.of(one), self.of(other));
        self.0[one.max(other) as usize] = one.min(other);
    }
}

/// Measures of a shell.
#[derive(Default)]
struct Shell {
    /// Six times its volume; negative if it is wound inward.
    six_volumes: f64,
    /// Squared distance of the farthest corner from the first one.
    squared: f64,
}

impl Shell {
    fn add(&mut self, [a, b, c]: [Vector3<f64>; 3]) {
        self.six_volumes += a.dot(&b.cross(&c));
        let corners = [a, b, c].into_iter();
        self.squared = corners
            .map(|c| c.norm_squared())
            .fold(self.squared, f64::max);
    }

    fn winding(&self) -> Option<Winding> {
        let least = 6.0 * LEAST_VOLUME * self.squared.powf(1.5);
        match self.six_volumes {
            v if v > least => Some(Winding::Outward),
            v if v < -least => Some(Winding::Inward),
            _ => None,
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use glam::Vec3;

    /// A tetrahedron with a corner at `at`, wound outward.
    fn tetrahedron(at: Vec3) -> Mesh {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
        Mesh {
            vertices: corners.map(|corner| at + corner).to_vec(),
            faces: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        }
    }

    /// A box of these edge lengths about a point, wound outward.
    pub(crate) fn block(middle: Vec3, size: Vec3) -> Mesh {
        let side = |corner: u32, bit: u32| if corner >> bit & 1 == 1 { 0.5 } else { -0.5 };
        let corner = |i: u32| middle + size * Vec3::new(side(i, 0), side(i, 1), side(i, 2));
        let sides = [
            [0, 4, 6, 2],
            [1, 3, 7, 5],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 2, 3, 1],
            [4, 5, 7, 6],
        ];
        Mesh {
            vertices: (0..8).map(corner).collect(),
            faces: sides
                .iter()
                .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
                .collect(),
        }
    }

    /// The mesh with separate vertices for every face, as in STL.
    fn loose(mesh: &Mesh) -> Mesh {
        let corners = mesh.faces.iter().flat_map(|&face| mesh.corners(face));
        Mesh {
            vertices: corners.flatten().collect(),
            faces: (0..mesh.faces.len() as u32)
                .map(|i| [3 * i, 3 * i + 1, 3 * i + 2])
                .collect(),
        }
    }

    fn together(one: Mesh, other: &Mesh) -> Mesh {
        let first = one.vertices.len() as u32;
        let more = other.faces.iter().map(|face| face.map(|i| i + first));
        Mesh {
            vertices: [one.vertices, other.vertices.clone()].concat(),
            faces: one.faces.into_iter().chain(more).collect(),
        }
    }

    fn turned(mut mesh: Mesh) -> Mesh {
        mesh.faces.iter_mut().for_each(|face| face.swap(0, 1));
        mesh
    }

    #[test]
    fn solids_are_wound_one_way() {
        let solid = || tetrahedron(Vec3::new(1e3, 0.0, -7.0));
        assert_eq!(solid().winding(), Some(Winding::Outward));
        assert_eq!(turned(solid()).winding(), Some(Winding::Inward));
        assert_eq!(loose(&solid()).winding(), Some(Winding::Outward));
        // Solids that touch in a corner or overlap are kept apart.
        for apart in [9.0, 1.0, 0.2] {
            let other = loose(&tetrahedron(Vec3::new(1e3 + apart, 0.0, -7.0)));
            let both = together(solid(), &other);
            assert_eq!(both.winding(), Some(Winding::Outward), "{apart}");
        }
        let mut with_needle = solid();
        with_needle.faces.extend([[0, 0, 1], [2, 3, 99]]);
        assert_eq!(with_needle.winding(), Some(Winding::Outward));
    }

    #[test]
    fn what_is_no_solid_has_no_winding() {
        let solid = || tetrahedron(Vec3::ZERO);
        let mut open = solid();
        open.faces.pop();
        let mut with_turned_face = solid();
        with_turned_face.faces[1].swap(0, 1);
        let two_sided = together(open.clone(), &turned(open.clone()));
        let one_inside_out = together(solid(), &turned(tetrahedron(Vec3::ONE)));
        // Halves that share a side, one of them inside out.
        let [left, right] = [-0.5, 0.5].map(|x| block(Vec3::new(x, 0.0, 0.0), Vec3::ONE));
        let touching = together(left, &turned(right));
        let twice = together(solid(), &solid());
        for mesh in [
            open,
            with_turned_face,
            two_sided,
            one_inside_out,
            touching,
            twice,
        ] {
            assert_eq!(mesh.winding(), None, "{mesh:?}");
        }
        assert_eq!(Mesh::default().winding(), None);
    }
}
