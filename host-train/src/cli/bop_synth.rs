//! `host-train bop-synth`

use super::progress::Progress;
use super::source::positive;
use crate::bop::synth::objects::{self, Object};
use crate::bop::synth::{ESTIMATES_FILE, SynthSettings, generate};
use crate::words::count;
use clap::Args;
use clap::builder::RangedI64ValueParser;
use std::path::PathBuf;

/// Generate scenes in the layout of the BOP benchmark
///
/// Renders several objects on a plane as a noisy depth camera sees them. Writes folders test and train with depth
/// images, masks and true poses, models_eval with the models (mm), and estimates.csv with initial poses for test, whose
/// errors are like PoseCNN's on LINEMOD. Masks as an estimator would give them are in mask_estimate, beside the
/// layout's own mask and mask_visib.
#[derive(Debug, Args)]
pub(super) struct BopSynthArgs {
    /// Meshes (.ply .off .obj .stl) from a file or a tree of folders, or the built-in shapes, which include solids of
    /// revolution and boxes
    #[arg(long, value_name = "DIR|FILE|procedural")]
    models: PathBuf,
    /// Folder to write; empty or absent
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Scenes of the split test
    #[arg(long, value_name = "N", value_parser = positive())]
    scenes: usize,
    /// Scenes of the split train; 0 leaves it out [default: as many as in test]
    #[arg(long, value_name = "N", value_parser = RangedI64ValueParser::<usize>::new().range(0..=1_000_000))]
    train_scenes: Option<usize>,
    /// Views of each scene
    #[arg(long, value_name = "N", value_parser = positive(), default_value_t = SynthSettings::default().images)]
    images: usize,
    /// Most objects in the data set
    #[arg(long, value_name = "N", value_parser = up_to(100_000), default_value_t = 8)]
    objects: usize,
    /// Objects in each scene
    #[arg(long, value_name = "N", value_parser = up_to(50), default_value_t = SynthSettings::default().per_scene)]
    per_scene: usize,
    /// Millimetres per unit of the meshes [default: each is scaled to a random diameter of 100 to 250 mm]
    #[arg(long, value_name = "MM", value_parser = scale)]
    mm_per_unit: Option<f32>,
    /// Columns and rows of the images
    #[arg(long, value_name = "COLUMNSxROWS", value_parser = size, default_value = "320x240")]
    size: [usize; 2],
    /// Factor on the sensor's noise; 0 gives exact depths
    #[arg(long, value_name = "FACTOR", value_parser = factor, default_value_t = 1.0)]
    noise: f32,
}

/// The name of the built-in shapes.
const PROCEDURAL: &str = "procedural";

impl BopSynthArgs {
    pub(super) fn run(self, seed: u64) -> anyhow::Result<()> {
        let objects: Vec<Object> = if self.models.as_os_str() == PROCEDURAL {
            objects::procedural(self.objects, seed)
        } else {
            objects::from_files(&self.models, self.objects, self.mm_per_unit, seed)?
        };
        let settings = SynthSettings {
            test_scenes: self.scenes,
            train_scenes: self.train_scenes.unwrap_or(self.scenes),
            images: self.images,
            per_scene: self.per_scene,
            size: self.size,
            noise: self.noise,
            seed,
        };
        let images = (settings.test_scenes + settings.train_scenes) * settings.images;
        let progress = Progress::new(images, "images");
        let done = generate(&objects, &settings, &self.out, &|| progress.tick());
        progress.finish();
        done?;
        println!(
            "{} of {} in {}; initial estimates in {}",
            count(images, "image", "images"),
            count(objects.len(), "object", "objects"),
            self.out.display(),
            self.out.join(ESTIMATES_FILE).display(),
        );
        Ok(())
    }
}

/// A number from 1 to `most`, since each object of a scene is rendered into an image of its own.
fn up_to(most: i64) -> RangedI64ValueParser<usize> {
    RangedI64ValueParser::new().range(1..=most)
}

/// `COLUMNSxROWS`, each from 16 to 2048.
fn size(text: &str) -> Result<[usize; 2], String> {
    let number = |word: &str| word.parse().ok().filter(|n| (16..=2048).contains(n));
    text.split_once('x')
        .and_then(|(columns, rows)| Some([number(columns)?, number(rows)?]))
        .ok_or_else(|| "give COLUMNSxROWS, such as 320x240, each from 16 to 2048".into())
}

fn scale(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(mm) if mm > 0.0 && mm <= 1e6 => Ok(mm),
        _ => Err("give a number above 0, such as 1000 for meshes in metres".into()),
    }
}

fn factor(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(x) if (0.0..=100.0).contains(&x) => Ok(x),
        _ => Err("give a number from 0 to 100".into()),
    }
}
