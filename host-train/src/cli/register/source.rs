//! The source: a cloud in a file or a depth image, its unit, and where it was seen from.

use super::depth::DepthArgs;
use super::input::{Input, Units};
use super::{factor, view_point};
use crate::dataset::cloud_file::bag::{self, MessageSelector, is_bag};
use crate::dataset::cloud_file::{CloudError, CloudFile, Note, extension, read_file};
use clap::Args;
use std::path::{Path, PathBuf};

/// The message about bag options for a source that is not a bag.
pub(super) const OF_BAG: &str = "--topic and --message are for a bag (.mcap) as SOURCE";

/// The message about an image in place of a cloud.
const OF_IMAGE: &str = "a depth image goes with its camera in SOURCE's place: --depth IMAGE --camera FX,FY,CX,CY TARGET, and --mask and --depth-scale where they are needed";

/// Most columns of an array of points.
const MOST_COLUMNS: usize = 16;

/// Whether a file is an image, by its extension.
fn is_image(path: &Path) -> bool {
    let images = ["png", "tif", "tiff", "exr", "pgm", "jpg", "jpeg", "bmp"];
    images.contains(&extension(path).as_str())
}

/// Options that describe the source.
#[derive(Clone, Debug, Default, Args)]
pub struct SourceArgs {
    /// Unit of the source if the target is in metres, or units of both: in:mm. Units: mm, cm, m, in, ft. The source is
    /// scaled before anything else; the pose is that of the scaled source
    #[arg(long, value_name = "UNIT[:UNIT]", conflicts_with = "scale")]
    unit: Option<Units>,
    /// Factor by which the source is multiplied before anything else
    #[arg(long, value_name = "FACTOR", value_parser = factor)]
    scale: Option<f64>,
    /// Where the sensor stood in the source's coordinates, scaled, three numbers separated by commas, or "origin": the
    /// source is a view from there, and nothing stands between the sensor and what it saw
    #[arg(long, value_name = "X,Y,Z", value_parser = view_point, allow_hyphen_values = true)]
    view: Option<[f64; 3]>,
    #[command(flatten)]
    pub(super) depth: DepthArgs,
    /// For a bag as the source: the topic of the clouds [default: the only one that has any]
    #[arg(long, value_name = "/TOPIC", conflicts_with = "depth")]
    topic: Option<String>,
    /// For a bag as the source: the number of the message, from 0, or seconds after the bag's start, such as 2.5s, for
    /// the first one from then on [default: 0]
    #[arg(long, value_name = "N|TIME", conflicts_with = "depth")]
    message: Option<MessageSelector>,
}

impl SourceArgs {
    /// Source and target from the files named: two of them, or the target alone with a depth image.
    ///
    /// # Errors
    /// Too many or too few files, as a sentence.
    pub fn files(&self, named: [&Option<PathBuf>; 2]) -> Result<[PathBuf; 2], &'static str> {
        match (&self.depth.depth, named) {
            (_, [Some(source), _]) if !self.fits(source) => Err(OF_BAG),
            (Some(image), [Some(target), None]) => Ok([image.clone(), target.clone()]),
            (Some(_), [Some(_), Some(_)]) => {
                Err("--depth takes the place of SOURCE: name one file, TARGET")
            }
            (Some(_), _) => Err("--depth takes the place of SOURCE: give one more file, TARGET"),
            (None, [Some(source), Some(target)]) => match is_image(source) || is_image(target) {
                true => Err(OF_IMAGE),
                false => Ok([source.clone(), target.clone()]),
            },
            (None, _) => Err("give SOURCE and TARGET, --depth and TARGET, or --pairs"),
        }
    }

    /// Whether the source may be this file: a topic and a message need a bag.
    pub(super) fn fits(&self, source: &Path) -> bool {
        self.topic.is_none() && self.message.is_none() || is_bag(source)
    }

    /// Where the sensor stood, if the source is a view from one point.
    pub fn view_point(&self) -> Option<[f64; 3]> {
        self.view.or(self.depth.depth.is_some().then_some([0.0; 3]))
    }

    /// The options that help if the clouds' sizes differ.
    pub fn size_advice(&self, notes: &[Note]) -> String {
        match self.depth.depth {
            None => {
                "See --unit and --scale, or crop a source that shows more than the target".into()
            }
            Some(_) => self.depth.size_advice(notes),
        }
    }

    /// The option that helps with a note about the source.
    pub(super) fn note_advice(&self, note: &Note) -> String {
        match *note {
            Note::ViewPoint { at } if self.view.is_none() => {
                let [x, y, z] = at.map(|x| x * self.scale());
                format!("; if the sensor stood there: --view {x},{y},{z}")
            }
            // No array of points has so many columns.
            Note::LongerAxis { rows, .. } if rows > MOST_COLUMNS => {
                format!("; {OF_IMAGE}")
            }
            _ => String::new(),
        }
    }

    /// The factor by which the source is multiplied.
    pub(super) fn scale(&self) -> f64 {
        let unit = self.unit.map(|units| units.scale);
        self.scale.or(unit).unwrap_or(1.0)
    }

    /// Reads the source called `path`, with its background if it is a depth image.
    ///
    /// # Errors
    /// Files that cannot be read.
    pub fn read(&self, path: &Path, points: Option<usize>, seed: u64) -> anyhow::Result<Input> {
        let scale = self.scale();
        let Some((object, background)) = self.depth.read()? else {
            let source = self.read_cloud(path)?;
            return Ok(Input::of(source, path, scale, (points, seed))?);
        };
        let mut source = Input::of(object, path, scale, (points, seed))?;
        source.cloud.see(&background, scale);
        Ok(source)
    }

    fn read_cloud(&self, path: &Path) -> Result<CloudFile, CloudError> {
        let message = self.message.unwrap_or(MessageSelector::FIRST);
        match is_bag(path) {
            true => bag::read(path, self.topic.as_deref(), message),
            false => read_file(path),
        }
    }
}
