//! The objects of a data set: meshes in millimetres, diameters and symmetries.

use super::BopError;
use super::json::{self, MODELS_INFO, ModelInfo, Numbered};
use crate::dataset::Point;
use crate::dataset::cloud_file::{CloudError, read_file};
use crate::dataset::mesh::Mesh;
use crate::random::{Purpose, stream};
use glam::{Mat3, Vec3};
use reagent_core::Pose;
use std::collections::BTreeMap;
use std::f32::consts::TAU;
use std::path::{Path, PathBuf};

/// Points drawn once from each mesh, evenly by area (authors' code: about 4096).
pub const SURFACE_POINTS: usize = 4096;
/// A mesh with fewer vertices is too coarse for the AD metrics to use its vertices.
const DENSE_VERTICES: usize = 1000;
/// Index of the stream that draws the surface; all models share it, since each has its own mesh.
const SURFACE_STREAM: u64 = 1 << 48;

/// Steps of a full turn for a continuous symmetry: π / .01, rounded up.
pub const CONTINUOUS_STEPS: usize = 315;

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
    /// Largest distance between two of its vertices, millimetres, from `models_info.json`.
    pub diameter_mm: f64,
    /// Poses of the model in which it looks the same, millimetres, the identity included. A continuous symmetry is
    /// divided into [`CONTINUOUS_STEPS`] turns, as in the BOP toolkit; each moves no point by more than .01 diameters.
    pub symmetries: Vec<Pose>,
    /// The mesh, millimetres; without faces if the model is a cloud.
    pub mesh: Mesh,
    /// [`SURFACE_POINTS`] points drawn evenly from the surface, millimetres, from which targets are drawn.
    pub surface: Vec<Point>,
    /// Points of the AD metrics, millimetres: the mesh's vertices, as in the BOP toolkit, or twice
    /// [`SURFACE_POINTS`] points of the surface if it has fewer than 1000.
    pub metric_points: Vec<Point>,
}

impl BopModel {
    /// Whether it has a symmetry, so that ADI replaces ADD.
    pub fn is_symmetric(&self) -> bool {
        self.symmetries.len() > 1
    }
}

/// All objects of a data set, by id.
#[derive(Clone, Debug)]
pub struct Models {
    /// Folder that they were read from.
    pub dir: PathBuf,
    models: BTreeMap<u32, BopModel>,
}

impl Models {
    /// Reads `models_eval` of a data set's folder, or `models` where that is absent. The points drawn depend on
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
            let symmetries = symmetries(&info).ok_or_else(|| BopError::Malformed {
                path: info_path.clone(),
                reason: format!("object {object}: a symmetry is no rigid transform of 16 numbers, or an axis has no direction"),
                expected: MODELS_INFO,
            })?;
            let name = info.name.or(known.map(|&name| name.into()));
            let path = dir.join(format!("obj_{object:06}.ply"));
            let (mesh, [surface, metric_points]) = points(&path, seed)?;
            models.insert(
                object,
                BopModel {
                    object,
                    name: name.unwrap_or_else(|| format!("obj_{object:06}")),
                    diameter_mm: info.diameter,
                    symmetries,
                    mesh,
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

    /// The object with this id.
    pub fn get(&self, object: u32) -> Option<&BopModel> {
        self.models.get(&object)
    }

    /// All objects, by id.
    pub fn iter(&self) -> impl Iterator<Item = &BopModel> {
        self.models.values()
    }
}

/// The mesh, points of its surface, and points of the metrics.
fn points(path: &Path, seed: u64) -> Result<(Mesh, [Vec<Point>; 2]), BopError> {
    let file = read_file(path)?;
    let vertices = file.relative_to([0.0; 3]);
    let mesh = file.mesh();
    if file.faces.is_none() {
        // The model is a cloud already.
        return Ok((mesh, [vertices.clone(), vertices]));
    }
    let rng = &mut stream(seed, Purpose::Shape, SURFACE_STREAM);
    let surface = mesh.sample_outside(SURFACE_POINTS, rng);
    if surface.is_empty() {
        return Err(CloudError::NoArea { path: path.into() }.into());
    }
    let metric_points = if vertices.len() < DENSE_VERTICES {
        mesh.sample(2 * SURFACE_POINTS, rng)
    } else {
        vertices
    };
    Ok((mesh, [surface, metric_points]))
}

/// Compositions of all discrete with all continuous symmetries; `None` if one is malformed.
fn symmetries(info: &ModelInfo) -> Option<Vec<Pose>> {
    let discrete = info.symmetries_discrete.iter().map(|rows| {
        let rows: &[f64; 16] = rows.as_slice().try_into().ok()?;
        let [a, b, c, p, d, e, f, q, g, h, i, r, ..] = *rows;
        json::pose(&[a, b, c, d, e, f, g, h, i], &[p, q, r])
    });
    let discrete: Vec<Pose> = [Some(Pose::IDENTITY)]
        .into_iter()
        .chain(discrete)
        .collect::<Option<_>>()?;
    let mut turns = Vec::new();
    for symmetry in &info.symmetries_continuous {
        let axis = Vec3::from_array(symmetry.axis.map(|x| x as f32)).try_normalize()?;
        let offset = Vec3::from_array(symmetry.offset.map(|x| x as f32));
        turns.extend((0..CONTINUOUS_STEPS).map(|k| {
            let rotation = Mat3::from_axis_angle(axis, TAU * k as f32 / CONTINUOUS_STEPS as f32);
            Pose {
                rotation,
                translation: offset - rotation * offset,
            }
        }));
    }
    if turns.is_empty() {
        return Some(discrete);
    }
    let after = |first: &Pose| {
        turns
            .iter()
            .map(|turn| turn.after(*first))
            .collect::<Vec<_>>()
    };
    Some(discrete.iter().flat_map(after).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn info(symmetries: &str) -> ModelInfo {
        serde_json::from_str(&format!("{{\"diameter\": 100{symmetries}}}")).expect("an object")
    }

    #[test]
    fn symmetries_are_all_poses_in_which_an_object_looks_the_same() {
        assert_eq!(symmetries(&info("")), Some(vec![Pose::IDENTITY]));
        // Half a turn about an axis through (5, 0, 0), and any turn about z through the same point.
        let half = ", \"symmetries_discrete\": [[-1,0,0,10, 0,-1,0,0, 0,0,1,0, 0,0,0,1]]";
        let any = ", \"symmetries_continuous\": [{\"axis\": [0, 0, 2], \"offset\": [5, 0, 3]}]";
        let found = symmetries(&info(half)).expect("two");
        assert_eq!(found.len(), 2);
        assert_eq!(found[1].apply(Vec3::ZERO), Vec3::new(10.0, 0.0, 0.0));
        let found = symmetries(&info(&format!("{half}{any}"))).expect("many");
        assert_eq!(found.len(), 2 * CONTINUOUS_STEPS);
        let centre = Vec3::new(5.0, 0.0, 1.0);
        for pose in &found {
            let distance = pose.apply(Vec3::new(55.0, 0.0, 1.0)).distance(centre);
            assert!((distance - 50.0).abs() < 1e-3 && pose.apply(centre).distance(centre) < 1e-3);
        }
        // Neighbouring turns move the farthest points by less than .01 diameters, 1 mm.
        let [a, b] = [0, 1].map(|k| found[k].apply(Vec3::new(55.0, 0.0, 1.0)));
        assert!(a.distance(b) < 1.0, "{}", a.distance(b));
        for bad in [
            ", \"symmetries_discrete\": [[1, 0]]",
            ", \"symmetries_discrete\": [[2,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]]",
            ", \"symmetries_continuous\": [{\"axis\": [0, 0, 0], \"offset\": [0, 0, 0]}]",
        ] {
            assert_eq!(symmetries(&info(bad)), None);
        }
    }
}
