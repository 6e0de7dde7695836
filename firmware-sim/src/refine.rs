//! `firmware-sim refine`: asks robots to register clouds from files.

use crate::client;
use crate::node::ANY;
use crate::session::{SessionArgs, open};
use anyhow::{Context, bail};
use host_train::dataset::Point;
use host_train::dataset::cloud_file::read_cloud;
use host_train::dataset::pairs::PairSet;
use host_train::metrics::{GroundTruth, PairMetrics, Summary};
use host_train::register::within_capacity;
use reagent_core::Pose;
use reagent_core::dims::STEPS;
use reagent_core::wire::{CloudView, RefineReply, RefineRequest};
use serde_json::json;
use std::path::PathBuf;
use std::time::Instant;
use zenoh::Session;

/// Ask a robot for the pose that maps a source cloud onto a target cloud
///
/// Poses are in the clouds' own units. Clouds with more points than a robot takes are subsampled.
#[derive(clap::Args, Debug)]
pub struct RefineArgs {
    /// Fleet to ask (a-z A-Z 0-9 _ -)
    #[arg(long, value_name = "NAME")]
    pub fleet: String,
    /// Robot to ask, or "any" for the one with the least to do
    #[arg(long, value_name = "ID")]
    pub robot: String,
    /// Pairs to register, with their true poses
    #[arg(long, value_name = "FILE.h5", conflicts_with_all = ["source", "target"])]
    pub pairs: Option<PathBuf>,
    /// Cloud to move (.ply .pcd .xyz .off .obj .stl)
    #[arg(required_unless_present = "pairs", requires = "target")]
    pub source: Option<PathBuf>,
    /// Cloud that stays
    pub target: Option<PathBuf>,
    /// Refinement steps at most
    #[arg(long, value_name = "N", default_value_t = STEPS as u8)]
    pub steps: u8,
    /// Seed of the subsampling
    #[arg(long, value_name = "S", default_value_t = 42)]
    pub seed: u64,
    /// Write every answer as JSON: pose, verdict, steps, times (milliseconds), policy version
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// The network.
    #[command(flatten)]
    pub session: SessionArgs,
}

/// A robot's answer and how long it took from here.
#[derive(Debug)]
pub struct Answer {
    /// Who answered.
    pub robot: String,
    /// What.
    pub reply: RefineReply,
    /// From asking to knowing, milliseconds.
    pub round_trip_ms: f64,
}

impl Answer {
    fn json(&self) -> serde_json::Value {
        json!({
            "robot": self.robot,
            "target_from_source": self.reply.target_from_source,
            "verdict": self.reply.verdict.to_string(),
            "steps": self.reply.steps,
            "ms_robot": f64::from(self.reply.micros) / 1e3,
            "ms_round_trip": self.round_trip_ms,
            "policy_version": self.reply.policy_version,
        })
    }
}

impl RefineArgs {
    /// Runs the command.
    ///
    /// # Errors
    /// Files that cannot be read, no session, and the first request without a pose.
    pub async fn run(self) -> anyhow::Result<()> {
        let document = match (&self.pairs, &self.source, &self.target) {
            (Some(path), ..) => {
                let pairs = PairSet::load(path)?;
                let session = open(&self.session).await?;
                self.refine_pairs(&session, &pairs).await?
            }
            (None, Some(source), Some(target)) => {
                let clouds = [(0, source), (1, target)].map(|(index, path)| {
                    let cloud = read_cloud(path, self.seed)?;
                    anyhow::Ok(within_capacity(cloud.points, self.seed, index))
                });
                let [source, target] = clouds;
                let (source, target) = (source?, target?);
                let session = open(&self.session).await?;
                self.refine_one(&session, &source, &target).await?
            }
            _ => bail!("give --pairs FILE.h5, or SOURCE and TARGET"),
        };
        if let Some(path) = &self.json {
            let text = serde_json::to_string_pretty(&document)?;
            std::fs::write(path, text + "\n")
                .with_context(|| format!("cannot write {}", path.display()))?;
        }
        Ok(())
    }

    async fn ask(
        &self,
        session: &Session,
        id: u64,
        source: &[Point],
        target: &[Point],
    ) -> anyhow::Result<Answer> {
        let robot = match self.robot.as_str() {
            ANY => client::any_robot(session, &self.fleet).await?,
            robot => robot.to_owned(),
        };
        Ok(ask(session, &self.fleet, robot, id, self.steps, source, target).await?)
    }

    async fn refine_one(
        &self,
        session: &Session,
        source: &[Point],
        target: &[Point],
    ) -> anyhow::Result<serde_json::Value> {
        let answer = self.ask(session, 1, source, target).await?;
        let reply = &answer.reply;
        for row in reply.target_from_source {
            println!("{}", row.map(|x| format!("{x:12.6}")).join(" "));
        }
        println!(
            "{} after {} steps, {:.1} ms on robot {} (policy version {}), {:.1} ms with the network",
            reply.verdict,
            reply.steps,
            f64::from(reply.micros) / 1e3,
            answer.robot,
            reply.policy_version,
            answer.round_trip_ms,
        );
        Ok(answer.json())
    }

    async fn refine_pairs(
        &self,
        session: &Session,
        pairs: &PairSet,
    ) -> anyhow::Result<serde_json::Value> {
        let (mut answers, mut before, mut after) = (Vec::new(), Vec::new(), Vec::new());
        for index in 0..pairs.source.len() {
            let cloud = |clouds: &[Vec<Point>], number: u64| {
                within_capacity(clouds[index].clone(), self.seed, 2 * index as u64 + number)
            };
            let (source, target) = (cloud(&pairs.source, 0), cloud(&pairs.target, 1));
            let answer = self.ask(session, index as u64 + 1, &source, &target).await;
            let answer = answer.with_context(|| format!("pair {index}"))?;
            let [initial, refined] = errors(pairs, index, &answer.reply)?;
            before.push(initial);
            after.push(refined);
            answers.push(answer.json());
        }
        println!("{}", Row::HEADER);
        println!("{}", Row::new("initial", &before));
        println!("{}", Row::new("refined", &after));
        Ok(json!({ "pairs": answers }))
    }
}

/// Asks one robot for one pose.
///
/// # Errors
/// As [`client::refine`].
pub async fn ask(
    session: &Session,
    fleet: &str,
    robot: String,
    id: u64,
    max_steps: u8,
    source: &[Point],
    target: &[Point],
) -> Result<Answer, client::RefineError> {
    let request = RefineRequest {
        id,
        max_steps,
        initial: None,
        source: CloudView::of(source),
        target: CloudView::of(target),
    };
    let asked = Instant::now();
    let reply = client::refine(session, fleet, &robot, &request).await?;
    Ok(Answer {
        robot,
        reply,
        round_trip_ms: asked.elapsed().as_secs_f64() * 1e3,
    })
}

/// Errors of a pair before and after a robot's answer.
///
/// # Errors
/// Pairs that the metrics refuse.
pub fn errors(
    pairs: &PairSet,
    index: usize,
    reply: &RefineReply,
) -> anyhow::Result<[PairMetrics; 2]> {
    let truth = GroundTruth::new(
        &pairs.source[index],
        &pairs.target[index],
        pairs.raw.as_ref().map(|raw| raw[index].as_slice()),
        pairs.target_from_source[index],
    )
    .with_context(|| format!("pair {index}"))?;
    let refined = Pose::from_rows(reply.target_from_source);
    Ok([Pose::IDENTITY, refined].map(|pose| truth.measure(pose)))
}

/// A line of the tables that `refine` and `demo` print.
#[derive(Debug)]
pub struct Row {
    name: String,
    pairs: usize,
    /// Over all of them.
    pub summary: Summary,
}

impl Row {
    /// What the columns are.
    pub const HEADER: &str = "                      pairs   ISO R deg          ISO t              recall\n                              median    mean     median   mean     (5 deg, .05)";

    /// The errors of some pairs.
    pub fn new(name: &str, pairs: &[PairMetrics]) -> Row {
        Row {
            name: name.into(),
            pairs: pairs.len(),
            summary: Summary::of(pairs),
        }
    }
}

impl std::fmt::Display for Row {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let s = &self.summary;
        write!(
            f,
            "{:20} {:6} {:9.2} {:7.2} {:10.4} {:6.4} {:10.0} %",
            self.name,
            self.pairs,
            s.r_iso_median_deg,
            s.r_iso_deg,
            s.t_iso_median,
            s.t_iso,
            100.0 * s.recall_r5_t005,
        )
    }
}
