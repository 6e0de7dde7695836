//! `host-train register`

mod depth;
mod initial;
pub(super) mod input;
mod one;
mod pairs;
mod series;
mod source;
mod text;

pub use initial::Initial;
pub use input::{Input, Units};
pub use source::SourceArgs;

use super::output::check_files;
use super::{BelowProbability, bad_usage, probability};
use crate::cli::source::positive;
use crate::dataset::cloud_file::{STANDARD, check_cloud, check_output, check_place};
use crate::policy::{REAGENT, VIEWS, WeightFile};
use crate::random::seeds;
use crate::register::dense::Dense;
use crate::register::deviations::Deviations;
use crate::register::document::Document;
use crate::register::request::{Done, Request};
use crate::register::{Memory, Start};
use anyhow::{Context, bail};
use clap::Args;
use pairs::Pair;
use reagent_core::dims::{MAX_POINTS, STEPS};
use reagent_core::pipeline::Mode;
use source::OF_BAG;
use std::path::{Path, PathBuf};

/// Register a source cloud to a target cloud and print the pose
///
/// The pose maps the source onto the target, in the clouds' own unit and coordinates. Both clouds must be in the
/// same unit of length, or --unit or --scale says what the source is in. The policy sees the clouds normalised:
/// the target's mean at the origin, its farthest point at 1; clouds that lie far from the origin of their
/// coordinates are registered relative to a point of their own.
///
/// Files: .ply .pcd .xyz .txt .asc .csv .pts .npy .off .obj .stl, and .mcap or the folder of a ROS 2 bag; `-` is
/// standard input or output. A mesh is sampled at 2048 points of its surface; a cloud of more than 4096 points is
/// thinned to 2048. The last refinement uses up to 20,000. Invalid points (NaN, infinite, beyond 1e12) are left out.
/// Whatever a reader left out or had to interpret is reported on stderr and listed by --json.
///
/// The probability is that the pose is right, up to what is named as undetermined: an axis about which the clouds may
/// be turned, a direction along which they may be moved, or other poses that fit as well. Mode fast does not judge the
/// pose: its verdict says how the steps ended.
///
/// Exit status: 0 with a pose, 1 without, 2 on bad usage, 3 where --fail-below was not reached.
#[derive(Debug, Args)]
pub(super) struct RegisterArgs {
    /// Policy: a file, a run directory (its best), or a bundled one: "reagent" (f32), "reagent-int8" (the same in 8-bit
    /// integers), "compact" (int8), and for single depth views "views", "views-compact" (int8)
    /// [default: "views" where all sources are views from known points, as with --view or --depth, else "reagent"]
    #[arg(long, value_name = "FILE.rgw|NAME")]
    weights: Option<PathBuf>,
    /// Cloud to move; leave it out with --depth
    #[arg(required_unless_present_any = ["pairs", "depth"])]
    source: Option<PathBuf>,
    /// Cloud that stays
    #[arg(required_unless_present_any = ["pairs", "depth"])]
    target: Option<PathBuf>,
    /// Register many pairs, and print one JSON line each: a folder with NAME_source.EXT and NAME_target.EXT, or a
    /// list with two paths a line, relative to the list's folder, and the three coordinates of --view where a source
    /// has a view point of its own
    #[arg(long, value_name = "FOLDER|LIST", conflicts_with_all = ["source", "target", "out", "trace", "html", "series", "matrix"])]
    pairs: Option<PathBuf>,
    /// Where to start: none (turned in any way), identity, 12 numbers separated by commas (rows of [R | t]), or a
    /// file with them: .txt, .json, also what --json wrote. May be given several times, and a file may hold several
    /// poses: each is tried, and the most probable pose wins [default: identity]
    #[arg(long, value_name = "START", allow_hyphen_values = true)]
    init: Vec<Initial>,
    /// How far off the starts may be, as standard deviations: degrees, and lengths along and across the view in the target's
    /// units, such as 15,20,5; inf for what is unknown. Among poses that fit as well, the one nearest to the start wins
    /// [default: 34 degrees, .35 target radii]
    #[arg(long, value_name = "DEG,ALONG,ACROSS")]
    uncertainty: Option<Deviations>,
    /// How many different poses to report: the most probable is the result, the others, as many as there are, follow in
    /// the text and under "others" in --json, with their fits [default: 1]
    #[arg(long, value_name = "K", value_parser = positive())]
    best: Option<usize>,
    /// Most points of each cloud that the policy sees [default: 4096, or 2048 where there are more]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(16..=MAX_POINTS as i64))]
    points: Option<u32>,
    /// Most steps of the policy; 0 leaves it out, and the start is refined and compared instead [default: 10]
    #[arg(long, value_name = "N", value_parser = steps)]
    steps: Option<usize>,
    /// What to do: fast (the policy's steps alone), polish (then closest points), verify or best (then compared with
    /// other poses), refine (closest points from the start, without the policy)
    #[arg(long, value_name = "MODE", default_value_t = Mode::Verify)]
    mode: Mode,
    #[command(flatten)]
    sources: SourceArgs,
    /// Whether to finally refine the pose on all points, up to 20,000 of each cloud; not in mode fast
    #[arg(long, value_enum, value_name = "WHEN", default_value_t = Dense::Auto)]
    dense: Dense,
    /// Write the source, moved onto the target, with its normals, colours and intensities: .ply .pcd .xyz .npy, or for
    /// a mesh .ply .obj .off .stl
    #[arg(long, value_name = "ALIGNED.ply")]
    out: Option<PathBuf>,
    /// Write one JSON line with clouds and initial pose, then one for each step: action ids, signed steps, pose,
    /// probabilities; `report` shows it. Coordinates are those that the policy started from; if they are relative to points
    /// near the clouds, these are under "origins"
    #[arg(long, value_name = "FILE")]
    trace: Option<PathBuf>,
    /// Write a page to look at, one HTML file: the clouds, which can be turned, step by step, and the verdict
    #[arg(long, value_name = "FILE.html")]
    html: Option<PathBuf>,
    /// Write a folder of .ply files for programs that show clouds: target.ply, and source_000.ply and so on, the source
    /// in its initial pose, after each step, and in the final pose, in the target's coordinates
    #[arg(long, value_name = "FOLDER")]
    series: Option<PathBuf>,
    /// Write pose, verdict, probability, stages, notes and time (milliseconds) as JSON; for --pairs, one line each
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the pose as a 4x4 matrix, four numbers a line
    #[arg(long, value_name = "FILE.txt")]
    matrix: Option<PathBuf>,
    /// Exit with status 3 if the probability that the pose is right, up to what is undetermined, is below this; no
    /// probability reaches 1
    #[arg(long, value_name = "P", value_parser = probability)]
    fail_below: Option<f32>,
}

/// Largest number of steps that is accepted: more than anyone needs.
const MOST_STEPS: usize = 1_000_000;

/// The message about `--best` and several starts in mode fast.
const NO_FITS: &str =
    "mode fast does not compare poses: take another mode for --best and for several starts";

/// The message about a start from anywhere in mode refine.
const FROM_NOWHERE: &str = "mode refine begins with closest points, which need a pose to start from: give --init a pose or identity, or take mode verify for --init none";

pub(super) fn factor(text: &str) -> anyhow::Result<f64> {
    match text.parse::<f64>() {
        Ok(factor) if (1e-12..=1e12).contains(&factor) => Ok(factor),
        _ => bail!("a scale is a number from 1e-12 to 1e12"),
    }
}

pub(super) fn view_point(text: &str) -> anyhow::Result<[f64; 3]> {
    if text == "origin" {
        return Ok([0.0; 3]);
    }
    let numbers: Option<Vec<f64>> = text.split(',').map(|x| x.trim().parse().ok()).collect();
    match numbers.unwrap_or_default().as_slice() {
        &[x, y, z] if [x, y, z].iter().all(|x| x.is_finite()) => Ok([x, y, z]),
        _ => bail!("a view point is three finite numbers separated by commas, or \"origin\""),
    }
}

fn steps(text: &str) -> anyhow::Result<usize> {
    match text.parse() {
        Ok(steps @ 0..=MOST_STEPS) => Ok(steps),
        _ => bail!("steps are a whole number from 0 to {MOST_STEPS}"),
    }
}

/// A registered pair.
struct Pairing {
    inputs: [Input; 2],
    done: Done,
}

impl RegisterArgs {
    pub(super) fn run(self, seed: u64) -> anyhow::Result<()> {
        self.check();
        if let Some(path) = &self.out {
            check_output(path)?;
        }
        check_files(self.inputs(), self.outputs())?;
        if let Some(folder) = &self.series {
            series::make_folder(folder)?;
        }
        let pairs = match &self.pairs {
            Some(list) => Some(pairs::find(list)?),
            None => None,
        };
        let given = pairs.iter().flatten().flatten();
        if let Some(pair) = given.clone().find(|pair| !self.sources.fits(&pair.source)) {
            let named = pair.source.display();
            bad_usage("register", &format!("{OF_BAG}, and --pairs names {named}"));
        }
        let mut of_views = pairs.iter().flatten().flatten();
        let are_views = pairs.is_some() && of_views.all(|pair| pair.view_point.is_some());
        let weights = WeightFile::load(self.policy(are_views))?;
        let mut starts = Vec::new();
        for initial in &self.init {
            starts.extend(initial.clone().load_all()?);
        }
        if starts.is_empty() {
            starts.push(Start::Identity);
        }
        if self.mode == Mode::Fast && starts.len() > 1 {
            bad_usage("register", NO_FITS);
        }
        if let Some(pairs) = &pairs {
            return self.run_pairs(&weights, &starts, pairs, seed);
        }
        let [source, target] = match self.sources.files([&self.source, &self.target]) {
            Ok(files) => files,
            Err(said) => bad_usage("register", said),
        };
        let pair = Pair {
            source,
            target,
            view_point: None,
        };
        self.run_one(&weights, &starts, &pair, seed)
    }

    /// The files named to be read.
    fn inputs(&self) -> impl Iterator<Item = &PathBuf> {
        let starts = self.init.iter().filter_map(|init| match init {
            Initial::File(path) => Some(path),
            Initial::Start(_) => None,
        });
        let named = [&self.source, &self.target, &self.pairs, &self.weights];
        let named = named.into_iter().flatten();
        named.chain(starts).chain(self.sources.depth.files())
    }

    /// Exits with status 2 if options contradict each other.
    fn check(&self) {
        let standard = |path: &&Option<PathBuf>| path.as_deref() == Some(Path::new(STANDARD));
        if self.outputs().into_iter().filter(standard).count() > 1 {
            bad_usage("register", "only one output can be standard output");
        }
        let files = self.init.iter().map(|init| match init {
            Initial::File(path) => Some(path.clone()),
            Initial::Start(_) => None,
        });
        let inputs: Vec<_> = files
            .chain([self.source.clone(), self.target.clone()])
            .collect();
        if inputs.iter().filter(standard).count() > 1 {
            bad_usage("register", "only one input can be standard input");
        }
        if self.mode == Mode::Fast && self.best.is_some_and(|best| best > 1) {
            bad_usage("register", NO_FITS);
        }
        if self.steps == Some(0) && self.mode == Mode::Fast {
            bad_usage(
                "register",
                "mode fast is the policy's steps alone: take another mode for --steps 0",
            );
        }
        if self.dense == Dense::Always && self.mode == Mode::Fast {
            bad_usage(
                "register",
                "mode fast ends with the policy's steps: take another mode for --dense always",
            );
        }
        if !self.mode.has_steps() {
            self.check_without_policy();
        }
        if self.fail_below.is_some() && self.mode == Mode::Fast {
            bad_usage(
                "register",
                "mode fast gives no probability for --fail-below",
            );
        }
    }

    /// The same for registrations without the policy.
    fn check_without_policy(&self) {
        if self.init.contains(&Initial::Start(Start::None)) {
            bad_usage("register", FROM_NOWHERE);
        }
        let given = [
            ("--steps", self.steps.is_some()),
            ("--weights", self.weights.is_some()),
        ];
        if let Some((option, _)) = given.into_iter().find(|&(_, given)| given) {
            let said = format!(
                "mode refine leaves the policy out: take another mode for {option}, or leave {option} out"
            );
            bad_usage("register", &said);
        }
    }

    fn outputs(&self) -> [&Option<PathBuf>; 5] {
        [&self.out, &self.trace, &self.html, &self.json, &self.matrix]
    }

    /// The policy's file or name; the default depends on whether all sources have known view points.
    fn policy(&self, are_views: bool) -> &Path {
        let fitting = match are_views || self.sources.view_point().is_some() {
            true => VIEWS,
            false => REAGENT,
        };
        self.weights.as_deref().unwrap_or(Path::new(fitting))
    }

    fn register(
        &self,
        weights: &WeightFile,
        starts: &[Start],
        pair: &Pair,
        seed: u64,
    ) -> anyhow::Result<Pairing> {
        let points = self.points.map(|count| count as usize);
        let [of_source, of_target] = seeds(seed);
        let (source, target) = rayon::join(
            || self.sources.read(&pair.source, points, of_source),
            || Input::read(&pair.target, 1.0, points, of_target),
        );
        let (source, mut target) = (source?, target?);
        if let Some(path) = &self.out {
            check_cloud(path, &source.file)?;
            check_place(path, &source.file, target.cloud.origin)?;
        }
        let view_point = pair.view_point.or(self.sources.view_point());
        if view_point.is_some() {
            target.cloud.notice_missing_faces();
        }
        let request = Request {
            start: starts[0],
            deviations: self.uncertainty,
            mode: self.mode,
            steps: self.steps.unwrap_or(STEPS),
            view_point,
            dense: self.dense,
        };
        let mut memory = Box::new(Memory::new());
        let clouds = [&source.cloud, &target.cloud];
        let best = self.best.unwrap_or(1);
        let go_on = || Ok::<_, reagent_core::Error>(());
        let done = request
            .register_from(starts, best, weights.policy(), &mut memory, clouds, go_on)
            .with_context(|| {
                format!(
                    "cannot register {} to {}",
                    pair.source.display(),
                    pair.target.display()
                )
            })?;
        Ok(Pairing {
            inputs: [source, target],
            done,
        })
    }

    fn document(&self, pairing: &Pairing) -> Document {
        let clouds = pairing.inputs.each_ref().map(|input| &input.cloud);
        let document = Document::new(clouds, &pairing.done, self.sources.scale());
        Document {
            others: document.others.filter(|_| self.best.is_some()),
            ..document
        }
    }

    /// Fails if a pose is less probable than `--fail-below` asks.
    fn judge<'a>(&self, done: impl Iterator<Item = &'a Done>) -> anyhow::Result<()> {
        let probabilities = done.map(|done| done.found.answer.probability);
        Ok(BelowProbability::check(probabilities, self.fail_below)?)
    }
}
