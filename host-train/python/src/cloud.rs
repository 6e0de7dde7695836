//! Python arrays and meshes as clouds.

use crate::array::{Numbers, Rows};
use crate::mesh::Mesh;
use host_train::dataset::Point;
use host_train::dataset::cloud_file::CloudError;
use host_train::pose64::Position;
use host_train::random::{SEED, seeds};
use host_train::register::prepared::Prepared;
use pyo3::prelude::*;
use std::path::Path;

/// The command line's seeds.
pub(crate) const SEEDS: [u64; 2] = seeds(SEED);

/// A cloud whose numbers stay where Python has them.
pub(crate) struct Cloud<'py> {
    /// Name of the argument.
    name: String,
    given: Given<'py>,
}

enum Given<'py> {
    Mesh(Bound<'py, Mesh>),
    Array(Numbers<'py>),
}

/// The same, usable while Python goes on.
#[derive(Clone, Copy)]
pub(crate) struct View<'a> {
    name: &'a str,
    seen: Seen<'a>,
}

#[derive(Clone, Copy)]
enum Seen<'a> {
    Mesh(&'a Mesh),
    Rows(Rows<'a>),
}

impl<'py> Cloud<'py> {
    /// Takes an array ([`Numbers::of`]).
    pub(crate) fn new(name: impl Into<String>, given: &Bound<'py, PyAny>) -> PyResult<Cloud<'py>> {
        let name = name.into();
        let given = Given::Array(Numbers::of(&name, given)?);
        Ok(Cloud { name, given })
    }

    /// The same for an array or a mesh.
    pub(crate) fn or_mesh(
        name: impl Into<String>,
        given: &Bound<'py, PyAny>,
    ) -> PyResult<Cloud<'py>> {
        match given.cast::<Mesh>() {
            Ok(mesh) => Ok(Cloud {
                name: name.into(),
                given: Given::Mesh(mesh.clone()),
            }),
            Err(_) => Cloud::new(name, given),
        }
    }

    pub(crate) fn view(&self) -> View<'_> {
        View {
            name: &self.name,
            seen: match &self.given {
                Given::Mesh(mesh) => Seen::Mesh(mesh.get()),
                Given::Array(numbers) => Seen::Rows(numbers.rows()),
            },
        }
    }
}

impl<'a> View<'a> {
    pub(crate) fn name(self) -> &'a str {
        self.name
    }

    /// The cloud, prepared for registration, with at most so many points for the policy. The seed samples a mesh.
    pub(crate) fn prepared(
        self,
        points: Option<usize>,
        seed: u64,
    ) -> Result<Prepared<'a>, CloudError> {
        match self.seen {
            Seen::Rows(Rows::Points(rows)) => {
                Prepared::of_points(rows, Path::new(self.name), points)
            }
            _ => self.copied(points, seed),
        }
    }

    /// The same as a copy that can be kept.
    pub(crate) fn copied(
        self,
        points: Option<usize>,
        seed: u64,
    ) -> Result<Prepared<'static>, CloudError> {
        let name = Path::new(self.name);
        match self.seen {
            Seen::Mesh(mesh) => mesh.prepared(name, points, seed),
            Seen::Rows(rows) => Prepared::of_positions(rows.positions(), name, points),
        }
    }

    /// A copy of all points in f32.
    pub(crate) fn points(self) -> Vec<Point> {
        match self.seen {
            Seen::Rows(Rows::Points(rows)) => rows.to_vec(),
            _ => (self.positions().iter())
                .map(|p| p.map(|x| x as f32))
                .collect(),
        }
    }

    /// A copy of all points in f64; the vertices of a mesh.
    pub(crate) fn positions(self) -> Vec<Position> {
        match self.seen {
            Seen::Mesh(mesh) => mesh.file().points.clone(),
            Seen::Rows(rows) => rows.positions(),
        }
    }
}
