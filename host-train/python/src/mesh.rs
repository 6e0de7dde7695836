//! Triangle meshes, which go where clouds do.

use crate::array::{Numbers, numbers};
use crate::error::{bad, bad_cloud};
use host_train::dataset::cloud_file::{CloudError, CloudFile};
use host_train::register::prepared::Prepared;
use numpy::PyUntypedArrayMethods;
use pyo3::prelude::*;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// A triangle mesh, for a part that has one. It goes where a cloud does: points of its surface are registered, the same
/// that the command line draws. With a `viewpoint`, and faces that enclose the part and are all wound the same way,
/// surfaces facing away from the sensor count as unseen, so that one side of a wall is not taken for the other.
///
/// vertices: (V, 3), float32 or float64.
/// faces: (F, 3), integers: the vertices of each triangle.
///
/// >>> import numpy, reagent
/// >>> corners = numpy.array([[0, 0, 0], [3, 0, 0], [0, 2, 0], [0, 0, 1.0]])
/// >>> reagent.Mesh(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
/// Mesh(4 vertices, 4 faces)
#[pyclass(module = "reagent", frozen)]
pub struct Mesh {
    file: CloudFile,
    /// What was last made of it, of so many points with this seed: most programs ask for the same again.
    prepared: Mutex<Option<(Drawing, Prepared<'static>)>>,
}

/// How many points, if that was said, and the seed.
type Drawing = (Option<usize>, u64);

#[pymethods]
impl Mesh {
    #[new]
    fn new(vertices: &Bound<'_, PyAny>, faces: &Bound<'_, PyAny>) -> PyResult<Mesh> {
        let file = CloudFile {
            points: Numbers::of("vertices", vertices)?.rows().positions(),
            faces: Some(triangles(faces)?),
            ..CloudFile::default()
        };
        let file = file.checked(Path::new("mesh"));
        Ok(Mesh {
            file: file.map_err(|error| bad_cloud(&error))?,
            prepared: Mutex::default(),
        })
    }

    fn __repr__(&self) -> String {
        let faces = self.file.faces.as_ref().map_or(0, Vec::len);
        format!("Mesh({} vertices, {faces} faces)", self.file.points.len())
    }
}

impl Mesh {
    pub(crate) fn file(&self) -> &CloudFile {
        &self.file
    }

    /// Prepared for registration, with at most so many points for the policy. Errors name `path`.
    pub(crate) fn prepared(
        &self,
        path: &Path,
        points: Option<usize>,
        seed: u64,
    ) -> Result<Prepared<'static>, CloudError> {
        let mut held = self.prepared.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((of, prepared)) = &*held
            && *of == (points, seed)
        {
            return Ok(prepared.clone());
        }
        let prepared = Prepared::of_file(&self.file, path, points, seed)?;
        *held = Some(((points, seed), prepared.clone()));
        Ok(prepared)
    }
}

fn triangles(given: &Bound<'_, PyAny>) -> PyResult<Vec<[u32; 3]>> {
    let expected = "an array of integers of shape (F, 3)";
    let array = numbers("faces", given, expected)?;
    let &[_, 3] = array.shape() else {
        let shape = array.shape();
        return Err(bad(
            "faces",
            format!("expected {expected}, found shape {shape:?}"),
        ));
    };
    let vertex = |x: f64| match x as u32 {
        vertex if f64::from(vertex) == x => Ok(vertex),
        _ => Err(bad(
            "faces",
            format!("expected numbers of vertices, found {x}"),
        )),
    };
    let vertices: Vec<u32> = array
        .as_array()
        .iter()
        .copied()
        .map(vertex)
        .collect::<PyResult<_>>()?;
    Ok(vertices.as_chunks().0.to_vec())
}
