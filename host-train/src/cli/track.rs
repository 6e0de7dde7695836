//! `host-train track`

use super::bad_usage;
use super::output::{check_files, write_text};
use super::register::input::{Input, Units};
use super::register::{Initial, factor, view_point};
use crate::dataset::cloud_file::bag::{Bag, is_bag};
use crate::dataset::cloud_file::{CloudError, CloudFile, EXTENSIONS, extension, read_file};
use crate::dataset::ros::point_cloud2::Time;
use crate::measure::metrics::quantile;
use crate::policy::WeightFile;
use crate::pose64::{Pose64, Position};
use crate::random::seeds;
use crate::register::Memory;
use crate::register::document::Open;
use crate::register::request::Request;
use crate::register::track::{POINTS, Tracked, Tracking, bundled_policy};
use crate::words::count;
use anyhow::bail;
use clap::Args;
use reagent_core::dims::MAX_POINTS;
use reagent_core::track::TrackState;
use reagent_link::log::one_line;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use walkdir::WalkDir;

/// Follow an object through a sequence of clouds and print a JSON line for each
///
/// Each cloud is refined by closest points from the last pose. At first, and where the result is probably not right, it
/// is registered as `register` does. If that is not right either, the object is lost and is looked for in each of the
/// next clouds: alternately from the last pose with far more uncertainty and from anywhere. Each line says whether the
/// object is tracked, found or lost, and gives the pose of the cloud on the model, its probability, what was done last
/// and the time without reading files; stderr ends with a summary.
///
/// Exit status: 0 whether the object was seen or not, 1 if a file cannot be read, 2 on bad usage.
#[derive(Debug, Args)]
pub(super) struct TrackArgs {
    /// Cloud or mesh of the object
    model: PathBuf,
    /// Clouds in the order in which they were seen: files, ROS 2 bags (.mcap or their folder) with every message of a
    /// topic, and folders, whose clouds are taken in the order of their names
    #[arg(required = true)]
    scans: Vec<PathBuf>,
    /// Policy, as for `register` [default: "views-compact" with --view, else "compact"]
    #[arg(long, value_name = "FILE.rgw|NAME")]
    weights: Option<PathBuf>,
    /// Where to start: none (turned in any way), identity, 12 numbers separated by commas (rows of [R | t]), or a file with them
    #[arg(
        long,
        value_name = "START",
        allow_hyphen_values = true,
        default_value = "identity"
    )]
    init: Initial,
    /// Unit of the clouds if the model is in metres, or units of both: in:mm
    #[arg(long, value_name = "UNIT[:UNIT]", conflicts_with = "scale")]
    unit: Option<Units>,
    /// Factor by which the clouds are multiplied before anything else
    #[arg(long, value_name = "FACTOR", value_parser = factor)]
    scale: Option<f64>,
    /// For bags: the topic of the clouds [default: the only one that has any]
    #[arg(long, value_name = "/TOPIC")]
    topic: Option<String>,
    /// Most points of each cloud that are used; fewer take less time
    #[arg(long, value_name = "N", default_value_t = POINTS as u32, value_parser = clap::value_parser!(u32).range(16..=MAX_POINTS as i64))]
    points: u32,
    /// Where the sensor stood in the clouds' coordinates, scaled, three numbers separated by commas, or "origin": each
    /// cloud is a view from there
    #[arg(long, value_name = "X,Y,Z", value_parser = view_point, allow_hyphen_values = true)]
    view: Option<[f64; 3]>,
    /// Write the lines to this file instead of standard output
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// A line of the output.
#[derive(Serialize)]
struct Line {
    source: String,
    #[serde(flatten)]
    message: Option<Message>,
    state: String,
    #[serde(flatten)]
    done: Option<Done>,
    /// Why the cloud was not registered.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
    ms: f64,
}

/// The message of a bag that a line is about.
#[derive(Clone, Copy, Serialize)]
struct Message {
    message: u64,
    /// Time stamp of a message with a cloud.
    #[serde(skip_serializing_if = "Option::is_none")]
    stamp: Option<Time>,
}

/// The last registration and its result.
#[derive(Serialize)]
struct Done {
    mode: String,
    verdict: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    probability: Option<f32>,
    /// The pose, unless the object is lost.
    #[serde(skip_serializing_if = "Option::is_none")]
    target_from_source: Option<[[f64; 4]; 3]>,
    /// What the shape leaves undetermined in the pose, if poses were compared.
    #[serde(skip_serializing_if = "Option::is_none")]
    undetermined: Option<Open>,
}

impl Line {
    fn new(
        (path, message): (&Path, Option<Message>),
        tracked: anyhow::Result<(Tracked, Origins)>,
        time: Duration,
    ) -> Line {
        let state = |(tracked, _): &(Tracked, Origins)| tracked.state;
        Line {
            source: path.display().to_string(),
            message,
            state: tracked.as_ref().map_or(TrackState::Lost, state).to_string(),
            error: tracked.as_ref().err().map(|e| one_line(e.as_ref())),
            done: tracked.ok().map(Done::of),
            ms: time.as_secs_f64() * 1e3,
        }
    }
}

/// The origins that source and target were relative to.
type Origins = [Position; 2];

impl Done {
    fn of((Tracked { state, mode, done }, [source, target]): (Tracked, Origins)) -> Done {
        let answer = &done.found.answer;
        let rows = |pose| Pose64::of(pose, source, target).to_rows();
        let open = |found| Open::of(found, rows, target);
        Done {
            mode: mode.to_string(),
            verdict: answer.verdict.to_string(),
            probability: answer.probability,
            target_from_source: (state != TrackState::Lost).then(|| done.pose.to_rows()),
            undetermined: answer
                .refinement
                .as_ref()
                .and_then(open)
                .filter(|_| state != TrackState::Lost),
        }
    }
}

impl TrackArgs {
    pub(super) fn run(self, seed: u64) -> anyhow::Result<()> {
        let scans = scans(&self.scans, self.topic.as_deref())?;
        let has_bag = scans.iter().any(|scan| matches!(scan, Scan::Bag(..)));
        if self.topic.is_some() && !has_bag {
            bad_usage("track", "--topic is for bags (.mcap)");
        }
        check_files(self.scans.iter().chain([&self.model]), [&self.json])?;
        let bundled = Path::new(bundled_policy(self.view.is_some()));
        let weights = WeightFile::load(self.weights.as_deref().unwrap_or(bundled))?;
        let request = Request {
            start: self.init.clone().load()?,
            view_point: self.view,
            ..Request::default()
        };
        let scale = self.scale.or(self.unit.map(|units| units.scale));
        let points = Some(self.points as usize);
        let [of_sources, of_model] = seeds(seed);
        let model = Input::read(&self.model, 1.0, points, of_model)?.cloud;
        request.get_ready(&model);
        let mut memory = Box::new(Memory::new());
        let mut tracking = Tracking::new();
        let mut follow = |file: Result<CloudFile, CloudError>, path: &Path| {
            let source = file
                .and_then(|file| Input::of(file, path, scale.unwrap_or(1.0), (points, of_sources)));
            let source = source.inspect_err(|_| tracking.miss())?.cloud;
            let clouds = [&source, &model];
            let tracked = tracking.follow(&request, weights.policy(), &mut memory, clouds)?;
            anyhow::Ok((tracked, clouds.map(|cloud| cloud.origin)))
        };
        let (mut lines, mut text, mut unread) = (Vec::new(), String::new(), 0);
        let mut take = |of: (&Path, Option<Message>), label: &Path, file| {
            // An empty cloud counts as one without the object.
            unread +=
                usize::from(matches!(&file, Err(e) if !matches!(e, CloudError::Empty { .. })));
            let before = Instant::now();
            let tracked = follow(file, label);
            let line = Line::new(of, tracked, before.elapsed());
            let json = serde_json::to_string(&line)? + "\n";
            match self.json {
                Some(_) => text += &json,
                None => print!("{json}"),
            }
            lines.push(line);
            anyhow::Ok(())
        };
        for scan in &scans {
            let (path, bag) = match scan {
                Scan::File(path) => {
                    take((path, None), path, read_file(path))?;
                    continue;
                }
                Scan::Bag(path, bag) => (path, bag),
            };
            for message in bag.messages() {
                match message {
                    Ok(message) => {
                        let cloud = message.cloud();
                        let of = Message {
                            message: message.number,
                            stamp: cloud.as_ref().ok().map(|(_, stamp)| *stamp),
                        };
                        let cloud = cloud.map(|(cloud, _)| cloud);
                        take((path, Some(of)), &message.label, cloud)?;
                    }
                    Err(error) => take((path, None), path, Err(error.into()))?,
                }
            }
        }
        if let Some(path) = &self.json {
            write_text(path, &text)?;
        }
        eprintln!("{}", summary(&lines));
        match unread {
            0 => Ok(()),
            _ => bail!(
                "{unread} of {} could not be read",
                count(lines.len(), "cloud", "clouds")
            ),
        }
    }
}

/// A source of clouds.
enum Scan {
    File(PathBuf),
    /// A bag and its path.
    Bag(PathBuf, Bag),
}

/// Files and bags in their order; for folders, the clouds and bags in them, told by extension and ordered by name.
fn scans(paths: &[PathBuf], topic: Option<&str>) -> anyhow::Result<Vec<Scan>> {
    let scan = |path: PathBuf| {
        anyhow::Ok(match is_bag(&path) {
            true => Scan::Bag(path.clone(), Bag::open(&path, topic)?),
            false => Scan::File(path),
        })
    };
    let mut scans = Vec::new();
    for path in paths {
        if !path.is_dir() || is_bag(path) {
            scans.push(scan(path.clone())?);
            continue;
        }
        let before = scans.len();
        for entry in WalkDir::new(path).sort_by_file_name() {
            let path = entry?.into_path();
            if EXTENSIONS.contains(&extension(&path).as_str()) {
                scans.push(scan(path)?);
            }
        }
        if scans.len() == before {
            bail!(
                "{}: no clouds; give {}",
                path.display(),
                EXTENSIONS.join(" ")
            );
        }
    }
    Ok(scans)
}

/// Counts of clouds by state, and their times.
fn summary(lines: &[Line]) -> String {
    let in_state = |state: TrackState| {
        let lines = lines.iter();
        lines.filter(|line| line.state == state.to_string()).count()
    };
    let times: Vec<f64> = lines.iter().map(|line| line.ms).collect();
    let [median, p95, p99] = [0.5, 0.95, 0.99].map(|q| quantile(times.clone(), q));
    format!(
        "{}: {} tracked, {} found, {} lost; {median:.1} ms in the median, {p95:.1} p95, {p99:.1} p99",
        count(lines.len(), "cloud", "clouds"),
        in_state(TrackState::Tracked),
        in_state(TrackState::Found),
        in_state(TrackState::Lost),
    )
}
