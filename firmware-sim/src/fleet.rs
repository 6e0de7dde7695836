//! `firmware-sim fleet`: routers, many robots, an update and a load of requests, on one machine over loopback.

mod figures;
mod routers;
mod table;
mod watch;

pub use watch::WatchArgs;

use crate::client::Client;
use crate::demo::join;
use crate::node::{Node, NodeConfig};
use crate::policy::Trust;
use crate::refine::{Answer, ask};
use anyhow::{Context, ensure};
use ed25519_dalek::SigningKey;
use figures::Times;
use host_train::cli::{check_outputs, write_json};
use host_train::dataset::pairs::PairSet;
use host_train::dataset::procedural;
use host_train::policy::WeightFile;
use host_train::protocol::{self, Protocol};
use host_train::publish::Publisher;
use host_train::random::SEED;
use reagent_core::wire::{CloudView, Mode, RefineRequest};
use reagent_link::session::endpoint;
use reagent_link::stop::stop_requested;
use routers::{Routers, peak_memory_mib};
use serde_json::json;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use table::Table;
use tokio::task::JoinSet;

const FLEET: &str = "fleet";
/// Robots that start at once.
const STARTING: usize = 8;
/// Robots of one router, which takes 1000 sessions.
const PER_ROUTER: u16 = 900;
/// Shapes in the requests.
const PAIRS: usize = 16;
/// A robot that has not taken the policy within this time has failed.
const UPDATE_TIME: Duration = Duration::from_secs(600);
/// Time between two drawings of the table.
const FRAME: Duration = Duration::from_millis(500);

/// Run a whole fleet on this machine: routers, robots, an update and a load of requests, with their times
///
/// Every robot has a Zenoh session of its own to one of the routers over loopback. The robots fetch a policy of 2.5 MB in
/// 8-bit integers. Then one client asks for poses, first one at a time, then several at once.
#[derive(clap::Args, Clone, Debug)]
#[command(args_conflicts_with_subcommands = true)]
pub struct FleetArgs {
    #[command(subcommand)]
    command: Option<Command>,
    /// How many robots
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u16).range(1..))]
    pub robots: u16,
    /// How many routers, each a process of its own, for at most 900 robots each
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=16))]
    pub routers: u16,
    /// Requests one at a time, and as many again under load
    #[arg(long, value_name = "N", default_value_t = 500, value_parser = clap::value_parser!(u64).range(1..))]
    pub requests: u64,
    /// Requests in flight at once under load
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..))]
    pub in_flight: u16,
    /// Policy to ship [default: the bundled one, in 8-bit integers]
    #[arg(long, value_name = "FILE.rgw")]
    pub weights: Option<PathBuf>,
    /// Endpoint of the first router, for `fleet watch` [default: a free port]
    #[arg(long, value_name = "ENDPOINT", value_parser = endpoint)]
    pub listen: Option<String>,
    /// Seed of shapes, poses and noise
    #[arg(long, value_name = "S", default_value_t = SEED)]
    pub seed: u64,
    /// Write the numbers as JSON (milliseconds)
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

#[derive(clap::Subcommand, Clone, Debug)]
enum Command {
    Watch(WatchArgs),
}

impl FleetArgs {
    /// Runs the command.
    ///
    /// # Errors
    /// Anything that fails, including a robot's refusal.
    pub async fn run(mut self) -> anyhow::Result<()> {
        if let Some(Command::Watch(args)) = self.command.take() {
            return args.run().await;
        }
        // When asked to end, this process ends its routers, too.
        tokio::select! {
            outcome = self.work() => outcome,
            stopped = stop_requested() => Ok(stopped?),
        }
    }

    async fn work(&self) -> anyhow::Result<()> {
        check_outputs([&self.json])?;
        let policy = self.policy()?;
        let models = procedural::models(self.seed, PAIRS);
        let pairs = Arc::new(protocol::draw(
            &models,
            Protocol::M40Models,
            PAIRS,
            self.seed,
        ));
        ensure!(
            self.robots.div_ceil(PER_ROUTER) <= self.routers,
            "{} robots need {} --routers: each takes {PER_ROUTER}",
            self.robots,
            self.robots.div_ceil(PER_ROUTER)
        );
        let routers = Routers::start(self.routers.into(), self.listen.as_deref())?;
        let endpoint = routers.endpoints[0].clone();
        let key = SigningKey::from_bytes(
            &self
                .seed
                .to_le_bytes()
                .repeat(4)
                .try_into()
                .expect("32 bytes"),
        );
        let client = Arc::new(Client::new(join(&endpoint).await?, FLEET).await?);
        let mut publisher = Publisher::new(join(&endpoint).await?, FLEET, key.clone())?;

        let started = Instant::now();
        let robots = self.start_robots(&routers.endpoints, &key).await?;
        client.follow_robots().await?;
        println!(
            "{} robots are up on {endpoint} after {:.1} s; watch them: firmware-sim fleet watch --fleet {FLEET} --connect {endpoint}",
            robots.len(),
            started.elapsed().as_secs_f64()
        );
        let table = Arc::new(Mutex::new(Table::new()));
        let say = |text: String| table.lock().expect("no holder panics").say(&text);
        let (bytes, drawing) = (policy.bytes().len(), draw(table.clone(), client.clone()));
        let updates = update(&mut publisher, &robots, policy).await?;
        say(format!("update of {bytes} bytes each: {updates}"));
        let alone = self.load(&client, &pairs, 1).await?;
        say(format!("one request at a time: {alone}"));
        let loaded = self.load(&client, &pairs, self.in_flight.into()).await?;
        drawing.abort();
        say(format!("{} at once: {loaded}", self.in_flight));
        client.ask_for_statuses().await?;
        table.lock().expect("no holder panics").draw(&client);
        let memory = (peak_memory_mib("self"), routers.memory_mib());
        if let Some(robots) = memory.0 {
            println!(
                "memory at most: robots {robots} MiB, routers {:?} MiB",
                memory.1
            );
        }
        // Routers last: robots and clients tell them when they leave.
        drop((publisher, client, robots));
        if let Some(path) = &self.json {
            let document = json!({
                "robots": self.robots,
                "routers": self.routers,
                "memory_mib": { "robots": memory.0, "routers": memory.1 },
                "update_bytes": bytes,
                "update": updates.json(),
                "alone": alone.json(),
                "loaded": loaded.json(),
            });
            write_json(path, &document)?;
        }
        Ok(())
    }

    fn policy(&self) -> anyhow::Result<WeightFile> {
        if let Some(path) = &self.weights {
            return Ok(WeightFile::load(path)?);
        }
        let parameters = WeightFile::pretrained().parameters(self.seed)?;
        let models = procedural::models(self.seed, PAIRS);
        let calibration = protocol::draw(&models, Protocol::M40Models, PAIRS, self.seed);
        Ok(WeightFile::from_parameters_int8(&parameters, &calibration)?)
    }

    async fn start_robots(
        &self,
        endpoints: &[String],
        key: &SigningKey,
    ) -> anyhow::Result<Vec<Node>> {
        let (mut starting, mut robots) = (JoinSet::new(), Vec::new());
        for number in 1..=self.robots {
            if starting.len() == STARTING
                && let Some(node) = starting.join_next().await
            {
                robots.push(node??);
            }
            let config = NodeConfig {
                fleet: FLEET.into(),
                robot: format!("robot-{number:03}"),
                trust: Trust::Keys(vec![key.verifying_key()]),
                state: None,
            };
            let endpoint = endpoints[usize::from(number) % endpoints.len()].clone();
            starting.spawn(async move {
                anyhow::Ok(Node::start(join(&endpoint).await?, config).await?)
            });
        }
        while let Some(node) = starting.join_next().await {
            robots.push(node??);
        }
        Ok(robots)
    }

    /// Asks for poses, so many at once, and always asks the robot with the least to do.
    async fn load(
        &self,
        client: &Arc<Client>,
        pairs: &Arc<PairSet>,
        in_flight: usize,
    ) -> anyhow::Result<Load> {
        let started = Instant::now();
        let next = Arc::new(AtomicU64::new(0));
        let mut asking = JoinSet::new();
        for _ in 0..in_flight {
            let (client, pairs, next) = (client.clone(), pairs.clone(), next.clone());
            let total = self.requests;
            asking.spawn(async move {
                let (mut answers, mut failures) = (Vec::new(), Vec::new());
                loop {
                    let id = next.fetch_add(1, Ordering::Relaxed);
                    if id >= total {
                        return (answers, failures);
                    }
                    let pair = id as usize % pairs.source.len();
                    let clouds =
                        [&pairs.source[pair], &pairs.target[pair]].map(|c| CloudView::of(c));
                    let request = RefineRequest {
                        mode: Mode::Fast,
                        ..RefineRequest::new(id, clouds[0], clouds[1])
                    };
                    match ask(&client, crate::node::ANY, &request).await {
                        Ok(answer) => answers.push(answer),
                        Err(error) => failures.push(error.to_string()),
                    }
                }
            });
        }
        let (mut answers, mut failures) = (Vec::new(), Vec::new());
        for (some, failed) in asking.join_all().await {
            answers.extend(some);
            failures.extend(failed);
        }
        Ok(Load::of(&answers, failures, started.elapsed()))
    }
}

/// Publishes a policy and waits until every robot runs it. Returns each robot's time since the announcement.
async fn update(
    publisher: &mut Publisher,
    robots: &[Node],
    policy: WeightFile,
) -> anyhow::Result<Times> {
    let started = Instant::now();
    let manifest = publisher.publish(1, "fleet", policy).await?;
    let mut waiting = JoinSet::new();
    for node in robots {
        let (mut view, manifest) = (node.watch(), manifest.clone());
        waiting.spawn(async move {
            let taken = view.wait_for(|view| view.policy.as_ref() == Some(&manifest));
            let taken = tokio::time::timeout(UPDATE_TIME, taken).await;
            taken.context("a robot did not take the policy")??;
            anyhow::Ok(started.elapsed())
        });
    }
    let mut times = Vec::new();
    while let Some(time) = waiting.join_next().await {
        times.push(time??);
    }
    Ok(Times::of(times.iter().map(|time| time.as_secs_f64() * 1e3)))
}

/// Results of a load of requests.
struct Load {
    poses: usize,
    failures: Vec<String>,
    seconds: f64,
    /// From the request to the answer.
    round_trip: Times,
    /// The registration itself.
    compute: Times,
    /// In the robot's queue.
    queue: Times,
    /// Everything else: frames, network, router, threads.
    overhead: Times,
}

impl Load {
    fn of(answers: &[Answer], failures: Vec<String>, time: Duration) -> Load {
        let times = |time: fn(&Answer) -> f64| Times::of(answers.iter().map(time));
        Load {
            poses: answers.len(),
            failures,
            seconds: time.as_secs_f64(),
            round_trip: times(|a| a.round_trip_ms),
            compute: times(|a| f64::from(a.reply.micros) / 1e3),
            queue: times(|a| f64::from(a.reply.waited_micros) / 1e3),
            overhead: times(|a| {
                let on_robot = u64::from(a.reply.micros) + u64::from(a.reply.waited_micros);
                a.round_trip_ms - on_robot as f64 / 1e3
            }),
        }
    }

    fn json(&self) -> serde_json::Value {
        json!({
            "poses": self.poses,
            "failures": self.failures,
            "per_second": self.poses as f64 / self.seconds,
            "round_trip": self.round_trip.json(),
            "compute": self.compute.json(),
            "queue": self.queue.json(),
            "overhead": self.overhead.json(),
        })
    }
}

impl std::fmt::Display for Load {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let rate = self.poses as f64 / self.seconds;
        writeln!(f, "{} poses, {rate:.0} a second", self.poses)?;
        writeln!(f, "  round trip  {}", self.round_trip)?;
        writeln!(f, "  compute     {}", self.compute)?;
        writeln!(f, "  queue       {}", self.queue)?;
        write!(f, "  overhead    {}", self.overhead)?;
        if let Some(first) = self.failures.first() {
            write!(f, "\n  {} without a pose: {first}", self.failures.len())?;
        }
        Ok(())
    }
}

/// Draws the fleet while it works, if there is a terminal.
fn draw(table: Arc<Mutex<Table>>, client: Arc<Client>) -> tokio::task::JoinHandle<()> {
    tokio::spawn(async move {
        loop {
            {
                let mut table = table.lock().expect("no holder panics");
                if !table.is_live() {
                    return;
                }
                table.draw(&client);
            }
            tokio::time::sleep(FRAME).await;
        }
    })
}
