//! The objects of generated scenes: meshes scaled to millimetres, with their known symmetries.

use crate::dataset::bop::BopError;
use crate::dataset::bop::json::{self, ContinuousSymmetry, ModelInfo, Numbered};
use crate::dataset::cloud_file::{extension, read_file};
use crate::dataset::mesh::Mesh;
use crate::dataset::procedural::{FAMILIES, shape};
use crate::dataset::tree;
use crate::diameter::diameter;
use crate::random::{Purpose, Rng, stream};
use glam::{Affine3A, Vec2, Vec3};
use rand::RngExt;
use std::f32::consts::TAU;
use std::path::{Path, PathBuf};

/// Diameters to which objects are scaled, millimetres: those of LINEMOD's objects are 102 to 283.
const DIAMETER_MM: std::ops::Range<f32> = 100.0..250.0;
/// First stream of the objects, apart from those of the scenes.
const OBJECT_STREAM: u64 = 1 << 56;
/// Number of the first built-in shape; training counts from 0, evaluation from 2^32.
const SHAPES: u64 = 1 << 33;
/// Kinds of files that may hold a mesh.
const MESH_FILES: [&str; 4] = ["ply", "off", "obj", "stl"];

/// The turns that leave an object unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Symmetry {
    /// None is known.
    None,
    /// Any turn about y through the origin: a solid of revolution.
    Revolution,
    /// Half a turn about x, y or z through the origin: a box.
    HalfTurns,
}

/// One object: its surface in millimetres, with the centre of its bounding box at the origin.
#[derive(Clone, Debug)]
pub struct Object {
    /// Its id, from 1.
    pub id: u32,
    /// Its name.
    pub name: String,
    /// Its surface.
    pub mesh: Mesh,
    /// Its symmetry.
    pub symmetry: Symmetry,
}

impl Object {
    /// Centres a mesh and scales it to `diameter_mm`. `None` for a mesh without extent.
    fn new(
        id: u32,
        name: String,
        mut mesh: Mesh,
        diameter_mm: f32,
        symmetry: Symmetry,
    ) -> Option<Object> {
        let bounds = |f: fn(Vec3, Vec3) -> Vec3| mesh.vertices.iter().copied().reduce(f);
        let centre = (bounds(Vec3::min)? + bounds(Vec3::max)?) / 2.0;
        let extent = exact_diameter(&mesh) as f32;
        if !(extent > 0.0 && extent.is_finite() && mesh.area() > 0.0) {
            return None;
        }
        for vertex in &mut mesh.vertices {
            *vertex = (*vertex - centre) * (diameter_mm / extent);
        }
        Some(Object {
            id,
            name,
            mesh,
            symmetry,
        })
    }

    fn info(&self) -> ModelInfo {
        let fold = |f: fn(Vec3, Vec3) -> Vec3| {
            let vertices = self.mesh.vertices.iter().copied();
            vertices
                .reduce(f)
                .unwrap_or_default()
                .to_array()
                .map(f64::from)
        };
        let (low, high) = (fold(Vec3::min), fold(Vec3::max));
        let half_turn = |axis: usize| {
            let mut matrix = vec![0.0; 16];
            for i in 0..3 {
                matrix[5 * i] = if i == axis { 1.0 } else { -1.0 };
            }
            matrix[15] = 1.0;
            matrix
        };
        ModelInfo {
            diameter: exact_diameter(&self.mesh),
            min_x: low[0],
            min_y: low[1],
            min_z: low[2],
            size_x: high[0] - low[0],
            size_y: high[1] - low[1],
            size_z: high[2] - low[2],
            symmetries_discrete: match self.symmetry {
                Symmetry::HalfTurns => (0..3).map(half_turn).collect(),
                _ => Vec::new(),
            },
            symmetries_continuous: match self.symmetry {
                Symmetry::Revolution => vec![ContinuousSymmetry {
                    axis: [0.0, 1.0, 0.0],
                    offset: [0.0; 3],
                }],
                _ => Vec::new(),
            },
            name: Some(self.name.clone()),
        }
    }
}

fn exact_diameter(mesh: &Mesh) -> f64 {
    let vertices: Vec<[f32; 3]> = mesh.vertices.iter().map(|v| v.to_array()).collect();
    diameter(&vertices)
}

/// Built-in objects of random diameters. Of every eight, one is a plain solid of revolution and one a box; the others
/// are shapes of the parametric families.
pub fn procedural(count: usize, seed: u64) -> Vec<Object> {
    let draw = |k: usize| {
        let rng = &mut stream(seed, Purpose::Scene, OBJECT_STREAM + k as u64);
        let id = k as u32 + 1;
        let (name, mesh, symmetry) = match k % 8 {
            3 => ("turned".into(), turned(rng), Symmetry::Revolution),
            7 => ("box".into(), cuboid(rng), Symmetry::HalfTurns),
            _ => {
                let shape = shape(seed, SHAPES + k as u64);
                let family = FAMILIES[shape.model.label as usize];
                (family.to_string(), shape.mesh, Symmetry::None)
            }
        };
        let size = rng.random_range(DIAMETER_MM);
        Object::new(id, format!("{name}_{id}"), mesh, size, symmetry)
            .expect("built-in shapes have an extent")
    };
    (0..count).map(draw).collect()
}

/// A closed vessel or pin with a random profile about y.
fn turned(rng: &mut Rng) -> Mesh {
    let rings = rng.random_range(3..7);
    let mut profile = vec![Vec2::ZERO];
    for ring in 0..rings {
        let height = ring as f32 / (rings - 1) as f32;
        profile.push(Vec2::new(rng.random_range(0.15..0.5), height));
    }
    profile.push(Vec2::new(0.0, 1.0));
    let mut mesh = Mesh::default();
    mesh.add_revolved(Affine3A::IDENTITY, &profile, TAU);
    mesh
}

fn cuboid(rng: &mut Rng) -> Mesh {
    let mut mesh = Mesh::default();
    let size = Vec3::new(1.0, rng.random_range(0.5..0.8), rng.random_range(0.15..0.4));
    mesh.add_box(Affine3A::IDENTITY, size);
    mesh
}

/// Meshes from a file, or from the files of a folder and its subfolders (`.ply .off .obj .stl`): at most `count` of
/// them, drawn at random but in the order of their paths. Their symmetries are not known. Each is scaled to a random
/// diameter, or by `mm_per_unit`.
///
/// # Errors
/// No such files; a file that cannot be read or holds no surface.
pub fn from_files(
    path: &Path,
    count: usize,
    mm_per_unit: Option<f32>,
    seed: u64,
) -> Result<Vec<Object>, BopError> {
    let mut files = mesh_files(path)?;
    let rng = &mut stream(seed, Purpose::Scene, OBJECT_STREAM);
    if files.len() > count {
        let mut chosen = rand::seq::index::sample(rng, files.len(), count).into_vec();
        chosen.sort_unstable();
        files = chosen.into_iter().map(|i| files[i].clone()).collect();
    }
    let mut objects = Vec::new();
    for (k, file) in files.into_iter().enumerate() {
        let read = read_file(&file)?;
        let mesh = read.mesh();
        let drawn = rng.random_range(DIAMETER_MM);
        let size = mm_per_unit.map_or(drawn, |scale| scale * exact_diameter(&mesh) as f32);
        let folder = if path.is_file() {
            path.parent()
        } else {
            Some(path)
        };
        let below = folder.and_then(|folder| file.strip_prefix(folder).ok());
        let name = below
            .unwrap_or(&file)
            .with_extension("")
            .to_string_lossy()
            .into_owned();
        let object = Object::new(k as u32 + 1, name, mesh, size, Symmetry::None);
        objects.push(object.ok_or_else(|| BopError::Empty {
            path: file.clone(),
            what: "no surface: the file has no faces, or none with an area",
        })?);
    }
    Ok(objects)
}

fn mesh_files(path: &Path) -> Result<Vec<PathBuf>, BopError> {
    if path.is_file() {
        return Ok(vec![path.into()]);
    }
    let io = |source: std::io::Error| BopError::Io {
        path: path.into(),
        source,
    };
    let mut files = Vec::new();
    for entry in tree::walk(path) {
        let file = entry.map_err(|e| io(e.into()))?;
        if file.file_type().is_file() && MESH_FILES.contains(&extension(file.path()).as_str()) {
            files.push(file.into_path());
        }
    }
    if files.is_empty() {
        return Err(BopError::Empty {
            path: path.into(),
            what: "no .ply, .off, .obj or .stl files",
        });
    }
    Ok(files)
}

/// Writes `obj_NNNNNN.ply` and `models_info.json`.
pub(super) fn write_models(folder: &Path, objects: &[Object]) -> Result<(), BopError> {
    super::create(folder)?;
    for object in objects {
        let path = folder.join(format!("obj_{:06}.ply", object.id));
        crate::files::write(&path, &ply(&object.mesh)).map_err(super::io(&path))?;
    }
    let info: Numbered<ModelInfo> = objects.iter().map(|o| (o.id, o.info())).collect();
    json::write(&folder.join("models_info.json"), &info)
}

/// A binary Stanford polygon file.
fn ply(mesh: &Mesh) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        mesh.vertices.len(),
        mesh.faces.len()
    )
    .into_bytes();
    for vertex in &mesh.vertices {
        bytes.extend(vertex.to_array().iter().flat_map(|x| x.to_le_bytes()));
    }
    for face in &mesh.faces {
        bytes.push(3);
        bytes.extend(face.iter().flat_map(|i| i.to_le_bytes()));
    }
    bytes
}
