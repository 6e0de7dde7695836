//! `firmware-sim refine`: asks robots to register clouds from files.

mod absence;
mod answer;
mod sent;
mod table;
mod traces;

pub use answer::{Answer, ask};
pub(crate) use table::{Row, errors};

use crate::client::{Client, RefineError};
use crate::session::{SessionArgs, has_certificate, open};
use absence::Absence;
use anyhow::bail;
use host_train::cli::{
    BelowProbability, Initial, Input, SourceArgs, check_outputs, probability, write_json,
};
use host_train::dataset::pairs::{PairSet, Symmetry};
use host_train::measure::metrics::PairMetrics;
use host_train::random::{SEED, seeds};
use host_train::register::background::nearest_per_cell;
use host_train::register::sentences::{Remark, UP_TO, outcome};
use host_train::register::{Start, in_order, within_capacity};
use reagent_core::dims::STEPS;
use reagent_core::verdict::Percent;
use reagent_core::wire::{Cloud, CloudView, Mode, Reason, RefineReply, RefineRequest};
use reagent_core::{Grid, Pose};
use reagent_link::log::one_line;
use reagent_link::name::name;
use sent::Sent;
use serde_json::json;
use std::path::PathBuf;
use std::time::Duration;
use traces::Traces;

/// Ask a robot for the pose that maps a source cloud onto a target cloud
///
/// Poses are in the clouds' own units and coordinates. A cloud far from the origin is sent relative to a point of its own,
/// which is added back in f64. Clouds with more points than a robot takes are thinned.
#[derive(clap::Args, Clone, Debug)]
pub struct RefineArgs {
    /// Fleet to ask (a-z A-Z 0-9 _ -)
    #[arg(long, value_name = "NAME", value_parser = name)]
    pub fleet: String,
    /// Robot to ask, or "any" for the one with the least to do
    #[arg(long, value_name = "ID", value_parser = name)]
    pub robot: String,
    /// Pairs to register, with their true poses
    #[arg(
        long,
        value_name = "FILE.h5",
        conflicts_with_all = ["source", "target", "unit", "scale", "view", "topic", "message"]
    )]
    pub pairs: Option<PathBuf>,
    /// Cloud to move (.ply .pcd .xyz .txt .asc .csv .pts .npy .off .obj .stl .mcap). Omit it with --depth
    #[arg(required_unless_present_any = ["pairs", "depth"])]
    pub source: Option<PathBuf>,
    /// Cloud that stays
    #[arg(required_unless_present_any = ["pairs", "depth"])]
    pub target: Option<PathBuf>,
    /// Options for the source.
    #[command(flatten)]
    pub sources: SourceArgs,
    /// Refinement steps at most
    #[arg(long, value_name = "N", default_value_t = STEPS as u8)]
    pub steps: u8,
    /// What follows the policy's steps: fast (nothing), polish (closest points), verify (also compared with other poses), best (the
    /// most that the robot has memory for); or refine (closest points from the start, without the policy) [default: best]
    #[arg(long, value_name = "MODE")]
    pub mode: Option<Mode>,
    /// Where to start: none (turned in any way), identity, 12 numbers separated by commas (rows of [R | t]), or a file
    /// with them, also what --json wrote [default: identity]
    #[arg(long, value_name = "POSE", allow_hyphen_values = true)]
    pub init: Option<Initial>,
    /// Time that the robot has for each answer, seconds; simulated boards need a minute and more
    #[arg(long, value_name = "SECONDS", default_value = "10", value_parser = seconds)]
    pub deadline: Duration,
    /// How coordinates are sent: i16 halves the bytes, and rounds to 1/65534 of a cloud's longest side
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t = CloudFormat::F32)]
    pub cloud_format: CloudFormat,
    /// Write what the robot did, step by step, for `host-train replay`
    #[arg(long, value_name = "FILE")]
    pub trace: Option<PathBuf>,
    /// Seed of the thinning
    #[arg(long, value_name = "S", default_value_t = SEED)]
    pub seed: u64,
    /// Write every answer as JSON: pose, verdict, steps, times (milliseconds), policy version
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Exit with status 3 if the probability that a pose is right, up to what is undetermined, is below this; no
    /// probability reaches 1, and mode fast gives none
    #[arg(long, value_name = "P", value_parser = probability)]
    pub fail_below: Option<f32>,
    /// The network.
    #[command(flatten)]
    pub session: SessionArgs,
}

/// How coordinates are sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum CloudFormat {
    /// As they are
    F32,
    /// As codes on a grid
    I16,
}

/// A time in seconds, at least a millisecond.
fn seconds(text: &str) -> Result<Duration, String> {
    let number = text.parse().ok();
    let time = number.and_then(|number| Duration::try_from_secs_f64(number).ok());
    let allowed = Duration::from_millis(1)..=Duration::from_secs(3600);
    let time = time.filter(|time| allowed.contains(time));
    time.ok_or_else(|| "give .001 to 3600 seconds".into())
}

/// A client and what it asks with.
struct Asking {
    client: Client,
    args: RefineArgs,
    start: Start,
    traces: Option<Traces>,
}

impl RefineArgs {
    /// Runs the command.
    ///
    /// # Errors
    /// Files that cannot be read, no session, and requests without a pose. With several pairs, all of them are asked first.
    pub async fn run(self) -> anyhow::Result<()> {
        // Check that the files can be written before any robot is asked.
        check_outputs([&self.trace, &self.json])?;
        if let Some(path) = &self.pairs {
            let pairs = PairSet::load(path)?;
            if pairs.symmetries.is_some() {
                Symmetry::keep_beside(path, [&self.trace, &self.json])?;
            }
            return self.start().await?.refine_pairs(&pairs).await;
        }
        let clouds = self.read()?;
        self.start().await?.refine_one(clouds).await
    }

    /// Reads source and target as `host-train register` does.
    fn read(&self) -> anyhow::Result<[Sent; 2]> {
        let files = self.sources.files([&self.source, &self.target]);
        let [source, target] = files.map_err(anyhow::Error::msg)?;
        let view_point = self.sources.view_point();
        let [of_source, of_target] = seeds(self.seed);
        let seen = self.sources.read(&source, None, of_source)?.cloud;
        let mut model = Input::read(&target, 1.0, None, of_target)?.cloud;
        if view_point.is_some() {
            model.notice_missing_faces();
        }
        let tells_sides = view_point.is_some() && self.mode != Some(Mode::Fast);
        let mut seen = Sent::of(seen, &source, view_point, false);
        let model = Sent::of(model, &target, None, tells_sides);
        if let Some(view_point) = seen.view_point {
            // Send only the background that counts.
            let clouds = [seen.points.as_slice(), &model.points];
            seen.background = nearest_per_cell(clouds, view_point.into(), &seen.background)?;
        }
        Ok([seen, model])
    }

    async fn start(&self) -> anyhow::Result<Asking> {
        let start = self
            .init
            .clone()
            .map_or(Ok(Start::Identity), Initial::load)?;
        let client = Client::new(open(&self.session).await?, &self.fleet).await?;
        let traces = match &self.trace {
            Some(path) => Some(Traces::start(&client, &self.fleet, path).await?),
            None => None,
        };
        Ok(Asking {
            client,
            args: self.clone(),
            start,
            traces,
        })
    }
}

impl Asking {
    /// Prints text: to standard error where JSON goes to standard output.
    fn say(&self, text: &str) {
        match &self.args.json {
            Some(path) if path.as_os_str() == "-" => eprintln!("{text}"),
            _ => println!("{text}"),
        }
    }

    /// Writes the files that were asked for.
    fn write(&self, document: &serde_json::Value) -> anyhow::Result<()> {
        if let Some(traces) = &self.traces {
            traces.write()?;
        }
        match &self.args.json {
            Some(path) => write_json(path, document),
            None => Ok(()),
        }
    }

    async fn ask(&mut self, id: u64, [source, target]: [&Sent; 2]) -> anyhow::Result<Answer> {
        let initial = self.start.near(source.origin, target.origin);
        let clouds = [&source.points, &target.points, &source.background];
        let mut on_grids = [const { None }; 3];
        if self.args.cloud_format == CloudFormat::I16 {
            let clouds = on_grids.iter_mut().zip(clouds);
            for (on_grid, cloud) in clouds.filter(|(_, cloud)| !cloud.is_empty()) {
                let grid = Grid::of(cloud)?;
                let codes: Vec<_> = cloud.iter().map(|&point| grid.encode(point)).collect();
                *on_grid = Some((grid, codes));
            }
        }
        let view = |k: usize| match &on_grids[k] {
            None => CloudView::of(clouds[k]),
            Some((grid, codes)) => CloudView::on_grid(*grid, codes),
        };
        let request = RefineRequest {
            budget_ms: u32::try_from(self.args.deadline.as_millis()).unwrap_or(u32::MAX),
            mode: self.args.mode.unwrap_or_default(),
            max_steps: self.args.steps,
            trace: self.traces.is_some(),
            initial: (initial != Pose::IDENTITY).then(|| initial.to_rows()),
            anywhere: self.start == Start::None,
            view_point: source.view_point,
            background: view(2),
            outward: CloudView::of(&target.outward),
            ..RefineRequest::new(id, view(0), view(1))
        };
        let mut answer = ask(&self.client, &self.args.robot, &request).await;
        if let Err(RefineError::Refused { robot, refusal }) = &answer
            && let Reason::TooManyPoints(Cloud::Background, _) = refusal.reason
        {
            eprintln!(
                "robot {robot} has no memory for a background or for which way a mesh faces; it is asked without them"
            );
            let clouds_alone = RefineRequest {
                background: CloudView::of(&[]),
                outward: CloudView::of(&[]),
                ..request
            };
            answer = ask(&self.client, &self.args.robot, &clouds_alone).await;
        }
        let answer = match answer {
            Err(error @ RefineError::NoRobot { .. }) if has_certificate(&self.args.session)? => {
                bail!(
                    "{error} The router may not let this certificate ask robots: a client has its own"
                )
            }
            answer => answer?,
        };
        if let Some(traces) = &mut self.traces {
            traces.take(&answer.robot, id).await?;
        }
        Ok(answer)
    }

    async fn refine_one(&mut self, clouds: [Sent; 2]) -> anyhow::Result<()> {
        let answer = self.ask(1, clouds.each_ref()).await?;
        let (reply, origins) = (&answer.reply, clouds.each_ref().map(|cloud| cloud.origin));
        self.say(&answer.pose(origins).to_string());
        let remarks = reply.fit.map(|fit| Remark::on_fit(reply.verdict, &fit));
        let remarks = remarks.unwrap_or_default();
        for remark in &remarks {
            let advice = match remark {
                Remark::SizesDiffer(_) => {
                    format!(" {}", self.args.sources.size_advice(&clouds[0].notes))
                }
                _ => String::new(),
            };
            self.say(&format!(
                "{}{advice}",
                remark.sentence(["source", "target"])
            ));
        }
        let up_to = match remarks.iter().any(Remark::is_open) {
            true => UP_TO,
            false => "",
        };
        let refined = reply.probability.map_or(String::new(), |probability| {
            format!(
                " ({} likely to be right{up_to}; mode {})",
                Percent(probability),
                reply.mode
            )
        });
        self.say(&format!(
            "{}{refined} after {} steps, {:.1} ms on robot {} (policy version {}), {:.1} ms with the network",
            outcome(reply.verdict, reply.probability),
            reply.steps,
            f64::from(reply.micros) / 1e3,
            answer.robot,
            reply.policy_version,
            answer.round_trip_ms,
        ));
        self.write(&answer.json(origins))?;
        self.judge([reply])
    }

    /// Fails if a pose is less probable than `--fail-below` asks.
    fn judge<'r>(&self, replies: impl IntoIterator<Item = &'r RefineReply>) -> anyhow::Result<()> {
        let probabilities = replies.into_iter().map(|reply| reply.probability);
        Ok(BelowProbability::check(
            probabilities,
            self.args.fail_below,
        )?)
    }

    async fn refine_pairs(&mut self, pairs: &PairSet) -> anyhow::Result<()> {
        let (mut answers, mut before, mut after) = (Vec::new(), Vec::new(), Vec::new());
        let (mut first, mut replies) = (None, Vec::new());
        self.client.follow_robots().await?;
        let mut absence = Absence::new();
        for index in 0..pairs.source.len() {
            let answer = match absence.error(&self.client, &self.args, !replies.is_empty()) {
                None => self.refine_pair(pairs, index).await,
                Some(error) => {
                    absence.tell(|| self.say(&Absence::line(&self.args)));
                    Err(error.into())
                }
            };
            match answer {
                Ok((answer, [initial, refined])) => {
                    before.push(initial);
                    after.push(refined);
                    answers.push(answer.json([[0.0; 3]; 2]));
                    replies.push(answer.reply);
                }
                // The next pair may be answered by another robot, or by one that restarts.
                Err(error) => {
                    let why = one_line(error.as_ref());
                    self.say(&format!("pair {index}: {why}"));
                    answers.push(json!({ "error": why }));
                    first.get_or_insert(error.context(format!("pair {index}")));
                }
            }
        }
        if !after.is_empty() {
            self.say(Row::HEADER);
            self.say(&Row::new("initial", &before).to_string());
            self.say(&Row::new("refined", &after).to_string());
        }
        self.write(&json!({ "pairs": answers }))?;
        match first {
            None => self.judge(&replies),
            Some(error) => Err(error.context(format!(
                "{} of {} pairs without a pose, the first",
                answers.len() - after.len(),
                answers.len()
            ))),
        }
    }

    /// A robot's answer to a pair, and the pair's errors before and after it.
    async fn refine_pair(
        &mut self,
        pairs: &PairSet,
        index: usize,
    ) -> anyhow::Result<(Answer, [PairMetrics; 2])> {
        let view_point = pairs.seen(index).map(|seen| seen.view_point);
        let clouds = [&pairs.source, &pairs.target].map(|clouds| Sent {
            points: in_order(within_capacity(&clouds[index])),
            origin: [0.0; 3],
            view_point,
            background: Vec::new(),
            outward: Vec::new(),
            notes: Vec::new(),
        });
        let answer = self.ask(index as u64 + 1, clouds.each_ref()).await?;
        let errors = errors(pairs, index, &answer.reply)?;
        Ok((answer, errors))
    }
}
