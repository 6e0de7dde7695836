//! The objects of a data set: meshes in millimetres, diameters and symmetries.

use super::BopError;
use super::json::{self, MODELS_INFO, ModelInfo, Numbered};
use crate::dataset::Point;
use crate::dataset::cloud_file::{CloudError, read_file};
use crate::random::{Purpose, stream};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Points drawn evenly from each mesh, once (authors' code: about 4096).
pub const SURFACE_POINTS: usize = 4096;
/// A mesh with fewer vertices is too coarse for them to stand for its surface in the AD metrics.
const DENSE_VERTICES: usize = 1000;
/// Index of the stream that draws the surface; models share it, each has its own mesh.
const SURFACE_STREAM: u64 = 1 << 48;

/// Names of LINEMOD's objects; the data set itself has numbers only.
const LINEMOD: [&str; 15] = [
    "ape",
    "benchvise",
    "bowl",
    "camera",
    "can",
    "cat",
    "cup",
    "driller",
    "duck",
    "eggbox",
    "glue",
    "holepuncher",
    "iron",
    "lamp",
    "phone",
];

/// One object.
#[derive(Clone, Debug)]
pub struct BopModel {
    /// Its id.
    pub object: u32,
    /// Its name, or `obj_NNNNNN`.
    pub name: String,
    /// Largest distance between two of its vertices, millimetres, as `models_info.json` says.
    pub diameter_mm: f64,
    /// Whether it has any symmetry, so that ADI is used instead of ADD.
    pub symmetric: bool,
    /// [`SURFACE_POINTS`] points drawn evenly from the surface, millimetres, from which targets are drawn.
    pub surface: Vec<Point>,
    /// Points of the AD metrics, millimetres: the mesh's vertices, as in the BOP toolkit, or twice
    /// [`SURFACE_POINTS`] points of the surface where there are fewer than 1000.
    pub metric_points: Vec<Point>,
}

/// All objects of a data set, by id.
#[derive(Clone, Debug)]
pub struct Models {
    /// Folder they were read from.
    pub dir: PathBuf,
    models: BTreeMap<u32, BopModel>,
}

impl Models {
    /// Reads `models_eval`, or `models` where that is absent, of a data set's folder. The points drawn depend on
    /// `seed`.
    ///
    /// # Errors
    /// A missing folder or file, a mesh that cannot be read, a diameter that is not positive.
    pub fn open(root: &Path, seed: u64) -> Result<Models, BopError> {
        let eval = root.join("models_eval");
        let dir = if eval.is_dir() {
            eval
        } else {
            root.join("models")
        };
        if !dir.is_dir() {
            return Err(BopError::Missing {
                path: root.join("models_eval"),
                expected: "a folder of models_info.json and obj_NNNNNN.ply in millimetres",
            });
        }
        let info_path = dir.join("models_info.json");
        let info: Numbered<ModelInfo> = json::read(&info_path, MODELS_INFO)?;
        let linemod = root
            .file_name()
            .is_some_and(|name| ["lm", "lmo"].iter().any(|known| name == *known));
        let mut models = BTreeMap::new();
        for (object, info) in info {
            if !(info.diameter > 0.0 && info.diameter.is_finite()) {
                return Err(BopError::Malformed {
                    path: info_path,
                    reason: format!("object {object}: diameter {}", info.diameter),
                    expected: MODELS_INFO,
                });
            }
            let known = if linemod {
                LINEMOD.get((object as usize).wrapping_sub(1))
            } else {
                None
            };
            let name = info.name.or(known.map(|&name| name.into()));
            let (surface, metric_points) = points(&dir.join(format!("obj_{object:06}.ply")), seed)?;
            models.insert(
                object,
                BopModel {
                    object,
                    name: name.unwrap_or_else(|| format!("obj_{object:06}")),
                    diameter_mm: info.diameter,
                    symmetric: !info.symmetries_discrete.is_empty()
                        || !info.symmetries_continuous.is_empty(),
                    surface,
                    metric_points,
                },
            );
        }
        if models.is_empty() {
            return Err(BopError::Empty {
                path: info_path,
                what: "no objects",
            });
        }
        Ok(Models { dir, models })
    }

    /// The object of this id.
    pub fn get(&self, object: u32) -> Option<&BopModel> {
        self.models.get(&object)
    }

    /// All objects, by id.
    pub fn iter(&self) -> impl Iterator<Item = &BopModel> {
        self.models.values()
    }
}

/// Points of the surface, and points of the metrics.
fn points(path: &Path, seed: u64) -> Result<(Vec<Point>, Vec<Point>), BopError> {
    let file = read_file(path)?;
    let vertices = file.relative_to([0.0; 3]);
    if file.faces.is_none() {
        // A model that is a cloud already.
        return Ok((vertices.clone(), vertices));
    }
    let mesh = file.mesh();
    let rng = &mut stream(seed, Purpose::Shape, SURFACE_STREAM);
    let surface = mesh.sample(SURFACE_POINTS, rng);
    if surface.is_empty() {
        return Err(CloudError::NoArea { path: path.into() }.into());
    }
    let metric_points = if vertices.len() < DENSE_VERTICES {
        mesh.sample(2 * SURFACE_POINTS, rng)
    } else {
        vertices
    };
    Ok((surface, metric_points))
}
