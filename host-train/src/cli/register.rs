//! `host-train register`

use super::output::{write_json, write_text};
use super::source;
use crate::dataset::Point;
use crate::dataset::cloud_file::{check_output, read_cloud, write_cloud};
use crate::export::WeightFile;
use crate::refine::{Mode, Refinement};
use crate::register::{Registered, SUBSAMPLE, register, within_capacity};
use crate::trace::{self, Header, Traced};
use anyhow::{Context, bail};
use clap::Args;
use reagent_core::dims::{MAX_POINTS, STEPS};
use reagent_core::polish::Refined;
use reagent_core::{Frame, Pose};
use serde::Serialize;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Instant;

/// Longest pose file that is read.
const POSE_BYTES: u64 = 64 * 1024;

/// Register a source cloud to a target cloud and print the pose
///
/// Both clouds must be in the same unit of length; the pose and the trace are in it too. The policy sees the
/// clouds normalised: the target's mean at the origin, its farthest point at 1. Files: .ply .pcd .xyz .npy .off
/// .obj .stl. Of a mesh, 2048 points of its surface are used; of a cloud with more than 4096 points, 2048 of
/// its points. Points with NaN in a .pcd, pixels without depth, are left out.
#[derive(Debug, Args)]
pub(super) struct RegisterArgs {
    /// Policy [default: the bundled one]
    #[arg(long, value_name = "FILE.rgw")]
    weights: Option<PathBuf>,
    /// Cloud to move
    source: PathBuf,
    /// Cloud that stays
    target: PathBuf,
    /// Where to start: 12 numbers separated by commas (rows of [R | t]), or a file with them (.json, .txt)
    /// [default: identity]
    #[arg(long, value_name = "POSE", allow_hyphen_values = true)]
    init: Option<Initial>,
    /// Refinement steps at most
    #[arg(long, value_name = "N", default_value_t = STEPS, value_parser = source::positive())]
    steps: usize,
    /// What follows the policy's steps
    #[arg(long, value_enum, value_name = "MODE", default_value_t = Mode::Verify)]
    mode: Mode,
    /// Write the source, moved onto the target: .ply .pcd .npy (with normals where it has them) or .xyz
    #[arg(long, value_name = "ALIGNED.ply")]
    out: Option<PathBuf>,
    /// Write one JSON line with clouds and initial pose, then one a step: action ids, signed steps, pose,
    /// probabilities; `report` shows it
    #[arg(long, value_name = "FILE")]
    trace: Option<PathBuf>,
    /// Write pose, verdict, steps and time (milliseconds) as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// A pose on the command line, or the file that holds it.
#[derive(Clone, Debug, PartialEq)]
pub enum Initial {
    /// On the command line.
    Pose(Pose),
    /// In this file.
    File(PathBuf),
}

impl FromStr for Initial {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> anyhow::Result<Initial> {
        if text.contains(',') {
            Ok(Initial::Pose(parse_pose(text)?))
        } else {
            Ok(Initial::File(text.into()))
        }
    }
}

impl Initial {
    /// The pose.
    ///
    /// # Errors
    /// A file that cannot be read, or holds no pose.
    pub fn load(self) -> anyhow::Result<Pose> {
        match self {
            Initial::Pose(pose) => Ok(pose),
            Initial::File(path) => {
                let read = || {
                    let mut text = String::new();
                    File::open(&path)?
                        .take(POSE_BYTES)
                        .read_to_string(&mut text)?;
                    parse_pose(&text)
                };
                read().with_context(|| format!("initial pose {}", path.display()))
            }
        }
    }
}

/// Twelve numbers, the rows of `[R | t]`, or sixteen with the row 0 0 0 1; brackets, commas and white
/// space separate them, as JSON arrays and text files do.
fn parse_pose(text: &str) -> anyhow::Result<Pose> {
    let numbers = text
        .split(|c: char| c.is_whitespace() || matches!(c, ',' | '[' | ']'))
        .filter(|word| !word.is_empty())
        .map(|word| {
            word.parse::<f32>()
                .with_context(|| format!("\"{word}\" is not a number"))
        })
        .collect::<anyhow::Result<Vec<f32>>>()?;
    let (rows, rest) = numbers.as_chunks::<4>();
    let pose = match (rows, rest) {
        ([a, b, c], []) | ([a, b, c, [0.0, 0.0, 0.0, 1.0]], []) => Pose::from_rows([*a, *b, *c]),
        _ => bail!(
            "a pose is 12 numbers, the rows of [R | t]; there are {}",
            numbers.len()
        ),
    };
    Ok(pose.checked()?)
}

impl RegisterArgs {
    pub(super) fn run(self, seed: u64) -> anyhow::Result<()> {
        if let Some(path) = &self.out {
            check_output(path)?;
        }
        let weights = WeightFile::load_or_pretrained(self.weights.as_deref())?;
        let initial = self.init.map_or(Ok(Pose::IDENTITY), Initial::load)?;
        // Seeds of their own: a mesh registered to itself must not be sampled at the very same points.
        let source_all = read_cloud(&self.source, seed)?;
        let target_all = read_cloud(&self.target, seed.wrapping_add(1))?;
        let source = fit(&self.source, source_all.points.clone(), seed, 0);
        let target = fit(&self.target, target_all.points, seed, 1);
        note_units(&source, &target);

        let start = Instant::now();
        let found = register(
            weights.policy(),
            &source,
            &target,
            initial,
            self.steps,
            self.mode,
        )
        .with_context(|| {
            format!(
                "cannot register {} to {}",
                self.source.display(),
                self.target.display()
            )
        })?;
        let ms = start.elapsed().as_secs_f64() * 1e3;
        let pose = found.target_from_source;

        print!("{}", report(&found, ms));
        if let Some(path) = &self.out {
            write_cloud(path, &source_all.moved(&pose))?;
        }
        if let Some(path) = &self.trace {
            let traced = Traced {
                header: Header {
                    name: format!("{} to {}", file_name(&self.source), file_name(&self.target)),
                    policy: self.weights.as_deref().map_or("reagent".into(), stem),
                    source: source.clone(),
                    target: target.clone(),
                    truth: None,
                    initial: initial.to_rows(),
                },
                steps: found.trace.clone(),
            };
            write_text(path, &trace::to_text(&[traced])?)?;
        }
        if let Some(path) = &self.json {
            let document = Document {
                target_from_source: pose.to_rows(),
                verdict: found.verdict.to_string(),
                steps: found.trace.len(),
                stages: Stages::of(&found),
                ms,
                source_points: source.len(),
                target_points: target.len(),
            };
            write_json(path, &document)?;
        }
        Ok(())
    }
}

/// Last part of a path.
fn file_name(path: &Path) -> String {
    path.file_name()
        .unwrap_or(path.as_os_str())
        .to_string_lossy()
        .into_owned()
}

/// Name under which a policy is reported.
fn stem(path: &Path) -> String {
    file_name(&path.with_extension(""))
}

/// What `--json` writes.
#[derive(Serialize)]
struct Document {
    target_from_source: [[f32; 4]; 3],
    verdict: String,
    steps: usize,
    #[serde(flatten)]
    stages: Stages,
    ms: f64,
    source_points: usize,
    target_points: usize,
}

/// What the stages found.
#[derive(Serialize)]
struct Stages {
    policy: PolicyStage,
    #[serde(skip_serializing_if = "Option::is_none")]
    polish: Option<RefinedStage>,
    #[serde(skip_serializing_if = "Option::is_none")]
    verify: Option<RefinedStage>,
    /// That the pose is within 5 degrees and .05 target radii.
    #[serde(skip_serializing_if = "Option::is_none")]
    probability: Option<f32>,
}

#[derive(Serialize)]
struct PolicyStage {
    target_from_source: [[f32; 4]; 3],
    verdict: String,
}

#[derive(Serialize)]
struct RefinedStage {
    target_from_source: [[f32; 4]; 3],
    /// Of the source's points to the target, and of the target's to the source.
    residual: [f32; 2],
    iterations: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    hypotheses: Option<usize>,
}

impl Stages {
    fn of(found: &Registered) -> Stages {
        let (verdict, pose) = found.policy;
        let stage = |refined: &Refined, hypotheses| RefinedStage {
            target_from_source: refined.target_from_source.to_rows(),
            residual: [refined.residual.source, refined.residual.target],
            iterations: refined.iterations,
            hypotheses,
        };
        let refinement = found.refinement.as_ref();
        Stages {
            policy: PolicyStage {
                target_from_source: pose.to_rows(),
                verdict: verdict.to_string(),
            },
            polish: refinement.map(|r| stage(&r.polished, None)),
            verify: refinement.and_then(|r| {
                r.hypotheses
                    .map(|hypotheses| stage(&r.refined, Some(hypotheses)))
            }),
            probability: refinement.map(|r| r.evidence.probability()),
        }
    }
}

/// The cloud within the core's capacity; says so where points are left out.
fn fit(path: &Path, points: Vec<Point>, seed: u64, index: u64) -> Vec<Point> {
    if points.len() > MAX_POINTS {
        eprintln!(
            "{}: {} points exceed the capacity of {MAX_POINTS}; {SUBSAMPLE} of them are used",
            path.display(),
            points.len(),
        );
    }
    within_capacity(points, seed, index)
}

/// Says so where the clouds differ in size as millimetres and metres do.
fn note_units(source: &[Point], target: &[Point]) {
    let size = |points: &[Point]| Frame::of(points).map_or(0.0, |frame| frame.scale);
    let ratio = size(source) / size(target);
    if ratio.is_normal() && !(0.02..50.0).contains(&ratio) {
        eprintln!(
            "the source is {ratio:.3} times as large as the target; are both in the same unit of length?"
        );
    }
}

fn report(found: &Registered, ms: f64) -> String {
    let mut text = String::from("target_from_source, rows of [R | t] in the clouds' units:\n");
    for row in found.target_from_source.to_rows() {
        text += &row.map(|x| format!("{x:12.6}")).join(" ");
        text += "\n";
    }
    text += &format!(
        "policy: {} after {} steps\n",
        found.policy.0,
        found.trace.len()
    );
    if let Some(refinement) = &found.refinement {
        text += &refinement_report(refinement);
    }
    text + &format!("{}, {ms:.1} ms\n", found.verdict)
}

/// A line a stage.
fn refinement_report(found: &Refinement) -> String {
    let residual = |r: &Refined| {
        format!(
            "residual {:.3} (source {:.3}, target {:.3})",
            r.residual.mean(),
            r.residual.source,
            r.residual.target
        )
    };
    let mut text = format!(
        "polish: {} after {} iterations\n",
        residual(&found.polished),
        found.polished.iterations
    );
    match found.hypotheses {
        None => {}
        Some(0) => text += "verify: explained by how the clouds are sampled\n",
        Some(tried) => {
            let kept = if found.refined == found.polished {
                "kept"
            } else {
                "replaced"
            };
            text += &format!(
                "verify: {kept} against {tried} other poses, {}\n",
                residual(&found.refined)
            );
        }
    }
    let percent = 100.0 * found.evidence.probability();
    text + &format!("right within 5 degrees and .05 target radii: {percent:.0} %\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use proptest::prelude::*;

    #[test]
    fn poses_are_read_from_numbers_and_json() {
        let turned = "0,-1,0,.5, 1,0,0,-2, 0,0,1,3";
        let pose = parse_pose(turned).expect("twelve numbers");
        assert_eq!(pose.translation, Vec3::new(0.5, -2.0, 3.0));
        let json = "[[0,-1,0,0.5],[1,0,0,-2],[0,0,1,3]]\n";
        assert_eq!(parse_pose(json).expect("twelve numbers"), pose);
        let text = "0 -1 0 .5\n1 0 0 -2\n0 0 1 3\n0 0 0 1\n";
        assert_eq!(parse_pose(text).expect("sixteen numbers"), pose);
    }

    #[test]
    fn what_is_no_pose_is_refused_with_the_reason() {
        let reason = |text: &str| format!("{:#}", parse_pose(text).expect_err("not a pose"));
        assert!(reason("1,2,3").contains("there are 3"));
        assert!(reason("1,0,0,0,0,one,0,0,0,0,1,0").contains("\"one\" is not a number"));
        assert!(reason("2,0,0,0,0,1,0,0,0,0,1,0").contains("rigid"));
        assert!(reason("1,0,0,nan,0,1,0,0,0,0,1,0").contains("pose"));
    }

    proptest! {
        #[test]
        fn no_text_is_more_than_refused(text in r"[-+.,0-9eEnaif\[\] \n]{0,80}", numbers in prop::collection::vec(any::<f32>(), 0..18)) {
            let listed: Vec<String> = numbers.iter().map(f32::to_string).collect();
            for text in [text, listed.join(",")] {
                if let Ok(pose) = parse_pose(&text) {
                    prop_assert!(pose.translation.is_finite() && pose.rotation.is_finite());
                }
            }
        }
    }
}
