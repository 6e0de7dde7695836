//! `firmware-sim demo`: a host, three robots and their policies, on one machine over loopback.

mod scene;

use crate::client::Client;
use crate::node::{Node, NodeConfig};
use crate::policy::Trust;
use crate::refine::{Row, ask, errors};
use crate::session::{SessionArgs, open, unused_endpoint};
use anyhow::{Context, bail};
use ed25519_dalek::SigningKey;
use host_train::cli::{check_outputs, write_json};
use host_train::measure::metrics::PairMetrics;
use host_train::policy::WeightFile;
use host_train::publish::Publisher;
use host_train::random::SEED;
use host_train::train::fine_tune;
use reagent_core::wire::{CHUNK_BYTES, CloudView, Manifest, Mode, RefineRequest};
use scene::Scene;
use serde_json::json;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use zenoh::Session;

const FLEET: &str = "demo";
const ROBOTS: [&str; 3] = ["r1", "r2", "r3"];
/// A robot that has not taken a policy within this time has failed.
const UPDATE_TIMEOUT: Duration = Duration::from_secs(30);

/// The whole story on one machine: publish a policy, refine, train it further, publish again, refine
///
/// A host and three robots, each with a Zenoh session of its own, talk over loopback. Without arguments the
/// robots see parts in rendered single depth views; nothing is downloaded.
#[derive(clap::Args, Debug)]
pub struct DemoArgs {
    /// Time to train the second policy, seconds
    #[arg(long, value_name = "N", default_value_t = 60)]
    pub seconds: u64,
    /// Real pairs to refine instead of views of built-in parts
    #[arg(long, value_name = "FILE.h5", conflicts_with = "data")]
    pub pairs: Option<PathBuf>,
    /// Real clouds instead (modelnet40_ply_hdf5_2048 layout): trains on the training split, refines
    /// pairs drawn from the test split
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// First policy, in f32 [default: the bundled one; for built-in parts the one for views, in 8-bit integers]
    #[arg(long, value_name = "FILE.rgw")]
    pub weights: Option<PathBuf>,
    /// Pairs that each robot refines, at most
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u64).range(1..))]
    pub per_robot: u64,
    /// Seed of shapes, poses, noise and training
    #[arg(long, value_name = "S", default_value_t = SEED)]
    pub seed: u64,
    /// Write the table as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// What one robot reached with one policy.
#[derive(Default)]
struct Round {
    initial: Vec<PairMetrics>,
    /// Errors of the policy alone.
    policy: Vec<PairMetrics>,
    /// Errors after refinement and comparison with other poses.
    verified: Vec<PairMetrics>,
}

impl DemoArgs {
    /// Runs the demo.
    ///
    /// # Errors
    /// Anything that fails, including a robot's refusal.
    pub async fn run(self) -> anyhow::Result<()> {
        let started = Instant::now();
        check_outputs([&self.json])?;
        let scene = Scene::of(&self)?;
        println!("{}", scene.description);

        let endpoint = unused_endpoint().context("no loopback port is free")?;
        let host = open(&SessionArgs {
            listen: vec![endpoint.clone()],
            ..SessionArgs::default()
        })
        .await?;
        let operator = Client::new(join(&endpoint).await?, FLEET).await?;
        let mut robots = Vec::new();
        let key = SigningKey::from_bytes(&rand_seed(self.seed));
        for robot in ROBOTS {
            let config = NodeConfig {
                fleet: FLEET.into(),
                robot: robot.into(),
                trust: Trust::Keys(vec![key.verifying_key()]),
                state: None,
            };
            robots.push(Node::start(join(&endpoint).await?, config).await?);
        }
        println!(
            "robots {} are up on {endpoint}, without a policy; they trust the host's key only",
            ROBOTS.join(", ")
        );

        let mut publisher = Publisher::new(host, FLEET, key)?;
        ship(&mut publisher, &robots, 1, "first", scene.first.clone()).await?;
        let before = refine_all(&operator, &scene, 1).await?;
        let second = scene.finished(self.train(&scene).await?)?;
        let comparison = scene.compare(&scene.first, &second)?;
        println!("host: version 2 against version 1 on pairs that neither saw: {comparison}");
        let after = if comparison.is_worse() {
            println!("host: version 2 is worse and is not published");
            None
        } else {
            ship(&mut publisher, &robots, 2, "fine-tuned", second).await?;
            Some(refine_all(&operator, &scene, 2).await?)
        };

        let document = table(&before, after.as_deref());
        println!("done in {:.0} s", started.elapsed().as_secs_f32());
        if let Some(path) = &self.json {
            write_json(path, &document)?;
        }
        Ok(())
    }

    async fn train(&self, scene: &Scene) -> anyhow::Result<WeightFile> {
        println!(
            "training the policy for {} s on {}",
            self.seconds, scene.training_description
        );
        let (budget, seed) = (Duration::from_secs(self.seconds), self.seed);
        let (start, sample) = (scene.start.clone(), scene.training.clone());
        let training = tokio::task::spawn_blocking(move || {
            let started = Instant::now();
            let mut reported = 0;
            fine_tune(
                &start,
                |rng, i| sample(rng, i),
                budget,
                seed,
                |updates, loss| {
                    let tens = started.elapsed().as_secs() / 10;
                    if tens > reported {
                        reported = tens;
                        println!("  {:3} s: {updates} updates, loss {loss:.3}", 10 * tens);
                    }
                },
            )
        });
        Ok(training.await.context("the training thread ended")??)
    }
}

/// Publishes a policy and waits until every robot runs it.
async fn ship(
    publisher: &mut Publisher,
    robots: &[Node],
    version: u64,
    name: &str,
    file: WeightFile,
) -> anyhow::Result<()> {
    let started = Instant::now();
    let manifest: Manifest = publisher.publish(version, name, file).await?;
    println!(
        "host: published {name} policy, version {version}: {:.1} MB in {} chunks, SHA-256 {}…",
        f64::from(manifest.length) / 1e6,
        manifest.length.div_ceil(CHUNK_BYTES as u32),
        &const_hex::encode(manifest.sha256)[..16],
    );
    for (robot, node) in ROBOTS.iter().zip(robots) {
        let mut view = node.watch();
        let taken = view
            .wait_for(|view| view.policy.as_ref() == Some(&manifest) || view.updates_refused > 0);
        let view = tokio::time::timeout(UPDATE_TIMEOUT, taken).await;
        let view = view.with_context(|| format!("robot {robot} did not take the policy"))??;
        if let Some(error) = &view.last_refusal {
            bail!("robot {robot} refused the policy: {error}");
        }
        println!(
            "  {robot}: fetched, signature and hash verified, in use after {:.2} s",
            started.elapsed().as_secs_f32()
        );
    }
    Ok(())
}

/// Has every robot refine its share of the pairs, one after the other.
async fn refine_all(operator: &Client, scene: &Scene, version: u64) -> anyhow::Result<Vec<Round>> {
    let mut rounds = Vec::new();
    let share = scene.pairs.source.len() / ROBOTS.len();
    for (number, robot) in ROBOTS.iter().enumerate() {
        let mut round = Round::default();
        // The policy alone, then verified.
        let mut on_robot = [Vec::new(), Vec::new()];
        for index in number * share..(number + 1) * share {
            let (source, target) = (&scene.pairs.source[index], &scene.pairs.target[index]);
            let seen = scene.pairs.seen(index);
            for (turn, mode) in [Mode::Fast, Mode::Verify].into_iter().enumerate() {
                let id = version * 1_000_000 + 2 * index as u64 + turn as u64;
                let request = RefineRequest {
                    mode,
                    view_point: seen.map(|seen| seen.view_point),
                    ..RefineRequest::new(id, CloudView::of(source), CloudView::of(target))
                };
                let answer = ask(operator, robot, &request).await?;
                if answer.reply.policy_version != version {
                    let used = answer.reply.policy_version;
                    bail!("robot {robot} answered with policy {used}, not {version}");
                }
                let [initial, reached] = errors(&scene.pairs, index, &answer.reply)
                    .with_context(|| format!("pair {index}"))?;
                match mode {
                    Mode::Fast => {
                        round.initial.push(initial);
                        round.policy.push(reached);
                    }
                    _ => round.verified.push(reached),
                }
                on_robot[turn].push(f64::from(answer.reply.micros) / 1e3);
            }
        }
        let [policy, verified] = on_robot.each_mut().map(|ms| median(ms));
        println!(
            "  {robot}: {share} pairs refined with version {version}, median {policy:.1} ms on the robot, verified {verified:.1} ms"
        );
        rounds.push(round);
    }
    Ok(rounds)
}

/// Prints the errors of each robot, and returns them.
fn table(before: &[Round], after: Option<&[Round]>) -> serde_json::Value {
    println!("\n{}", Row::HEADER);
    let mut document = serde_json::Map::new();
    let mut print = |robot: &str, before: &Round, after: Option<&Round>| {
        let mut rows = vec![
            ("initial", &before.initial),
            ("version 1", &before.policy),
            ("version 1, verified", &before.verified),
        ];
        if let Some(after) = after {
            rows.push(("version 2", &after.policy));
            rows.push(("version 2, verified", &after.verified));
        }
        let mut errors = serde_json::Map::new();
        for (policy, pairs) in rows {
            let row = Row::new(&format!("{robot:3} {policy}"), pairs);
            println!("{row}");
            errors.insert(policy.into(), json!(row.summary));
        }
        document.insert(robot.into(), errors.into());
    };
    for (number, (robot, first)) in ROBOTS.iter().zip(before).enumerate() {
        print(robot, first, after.and_then(|after| after.get(number)));
    }
    print("all", &joined(before), after.map(joined).as_ref());
    document.into()
}

/// The pairs of all robots.
fn joined(rounds: &[Round]) -> Round {
    let all = |part: fn(&Round) -> &Vec<PairMetrics>| rounds.iter().flat_map(part).copied();
    Round {
        initial: all(|round| &round.initial).collect(),
        policy: all(|round| &round.policy).collect(),
        verified: all(|round| &round.verified).collect(),
    }
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// A session connected to a router.
pub(crate) async fn join(endpoint: &str) -> anyhow::Result<Session> {
    let args = SessionArgs {
        connect: vec![endpoint.into()],
        ..SessionArgs::default()
    };
    Ok(open(&args).await?)
}

/// A key for this demo only: whoever knows the seed knows the key.
fn rand_seed(seed: u64) -> [u8; 32] {
    let mut key = [0; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    key
}
