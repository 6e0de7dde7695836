//! `firmware-sim`: a simulated robot, a client that asks robots, and the whole story as a demo.

use clap::{ArgGroup, Parser, Subcommand};
use ed25519_dalek::VerifyingKey;
use firmware_sim::board::{Board, Clouds, Kind, Simulation, build_image, check_simulator};
use firmware_sim::node::{ANY, Node, NodeConfig, NodeError};
use firmware_sim::policy::Trust;
use firmware_sim::session::{SessionArgs, certificates, has_certificate, open};
use reagent_link::log::{LogArgs, parse};
use reagent_link::metrics::{Figures, MetricsArgs};
use reagent_link::name::name;
use reagent_link::stop::stop_requested;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

/// How often a robot looks at its certificates.
const LOOK_INTERVAL: Duration = Duration::from_secs(60);

/// Simulated robots that fetch policies and answer refinement requests over Zenoh.
#[derive(Debug, Parser)]
#[command(version, propagate_version = true)]
struct Cli {
    #[command(flatten)]
    log: LogArgs,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Node(NodeArgs),
    Router(RouterArgs),
    #[cfg(feature = "demo")]
    Refine(Box<firmware_sim::refine::RefineArgs>),
    #[cfg(feature = "demo")]
    Demo(firmware_sim::demo::DemoArgs),
    #[cfg(feature = "demo")]
    Fleet(firmware_sim::fleet::FleetArgs),
    #[cfg(feature = "demo")]
    Ros(firmware_sim::ros::RosArgs),
}

/// Be a robot: fetch the fleet's policy, verify it, and answer refine requests until Ctrl-C
#[derive(clap::Args, Debug)]
#[command(group(ArgGroup::new("whose").args(["trust", "trust_any"]).required(true).multiple(true)))]
struct NodeArgs {
    /// Fleet it belongs to (a-z A-Z 0-9 _ -)
    #[arg(long, value_name = "NAME", value_parser = name)]
    fleet: String,
    /// Its own name in the fleet
    #[arg(long, value_name = "ID", value_parser = own_name)]
    robot: String,
    /// Public key (64 hexadecimal digits) whose policies it accepts; may be repeated
    #[arg(long, value_name = "HEX", value_parser = public_key)]
    trust: Vec<VerifyingKey>,
    /// Accept policies signed by any key: whoever reaches the network then decides what the robot does
    #[arg(long, conflicts_with = "trust")]
    trust_any: bool,
    /// Directory that keeps the policy across restarts [default: none]
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// Let a simulated microcontroller do the work. Its image is built and run in QEMU, and takes policies in int8 and
    /// clouds of at most 1024 points [default: this program does the work]
    #[arg(long, value_enum, value_name = "BOARD")]
    board: Option<Kind>,
    /// Format of the clouds that the board has memory for
    #[arg(
        long,
        value_enum,
        value_name = "CLOUDS",
        default_value = "floats",
        requires = "board"
    )]
    board_clouds: Clouds,
    #[command(flatten)]
    metrics: MetricsArgs,
    #[command(flatten)]
    session: SessionArgs,
}

/// Be a Zenoh router until Ctrl-C, for when zenohd is not installed: without plugins, with the same configuration
#[derive(clap::Args, Debug)]
struct RouterArgs {
    #[command(flatten)]
    session: SessionArgs,
}

impl RouterArgs {
    async fn run(self) -> anyhow::Result<()> {
        let router = open(&self.session).await?;
        let _certificates = certificates(&self.session)?;
        tracing::info!("router {} is up", router.zid());
        Ok(stop_requested().await?)
    }
}

impl NodeArgs {
    async fn run(self) -> anyhow::Result<()> {
        let board = self.board.map(|kind| start_board(kind, self.board_clouds));
        let board = board.transpose()?;
        let session = open(&self.session).await?;
        let config = NodeConfig {
            fleet: self.fleet,
            robot: self.robot,
            trust: match self.trust_any {
                true => Trust::AnyKey,
                false => Trust::Keys(self.trust),
            },
            state: self.state,
        };
        tracing::info!("robot {} of fleet {}", config.robot, config.fleet);
        let node = Node::start_with(session, config, board).await?;
        // A router with access control silently drops what a certificate may not say.
        if has_certificate(&self.session)? {
            node.check_heard(&open(&self.session).await?).await?;
        }
        let (view, robot) = (node.watch(), node.name().to_owned());
        let certificates = Arc::new(certificates(&self.session)?);
        let shown = certificates.clone();
        let figures = move || {
            let view = view.borrow();
            Figures {
                robots: vec![view.figures(&robot)],
                certificates: shown.read(),
                wrong: view.wrong(),
            }
        };
        let _metrics = self.metrics.serve(figures).await?;
        let looking = async {
            let mut minutes = tokio::time::interval(LOOK_INTERVAL);
            loop {
                minutes.tick().await;
                node.note_certificates(certificates.hold());
            }
        };
        tokio::select! {
            () = looking => Ok(()),
            stopped = stop_requested() => Ok(stopped?),
        }
    }
}

fn start_board(kind: Kind, clouds: Clouds) -> anyhow::Result<Board> {
    check_simulator()?;
    tracing::info!("building the image for {}", kind.target());
    let image = build_image(kind, clouds)?;
    let mut board = Board::start(kind, &image, Simulation::default())?;
    let (_, report) = board.status_and_report()?;
    tracing::info!(
        "the board runs: {} bytes of program, {} bytes of RAM beside the stack",
        report.program_bytes,
        report.static_bytes
    );
    Ok(board)
}

/// Refuses names that no robot may have.
fn own_name(text: &str) -> Result<String, String> {
    match text {
        ANY => Err(NodeError::Reserved.to_string()),
        _ => name(text).map_err(|error| error.to_string()),
    }
}

fn public_key(digits: &str) -> Result<VerifyingKey, String> {
    let key = const_hex::decode_to_array(digits)
        .map_err(|_| "give 64 hexadecimal digits, as `host-train keygen` prints them")?;
    let key = VerifyingKey::from_bytes(&key).map_err(|_| "not an ed25519 public key")?;
    match key.is_weak() {
        true => Err("a weak ed25519 public key, for which anybody signs".into()),
        false => Ok(key),
    }
}

fn main() -> ExitCode {
    let cli: Cli = parse();
    let level = match cli.command {
        Command::Node(_) | Command::Router(_) => {
            "warn,zenoh=error,zenoh_transport=error,zenoh_link_tcp=error,firmware_sim=info,reagent_link=info"
        }
        // Such a command says all it has to say in its result or in its one line of error. What Zenoh logs does not matter to
        // either, such as a status that overtook the declaration of its key on a new connection.
        #[cfg(feature = "demo")]
        _ => "warn,zenoh=off,firmware_sim=error",
    };
    cli.log.start(level);
    let outcome = tokio::runtime::Runtime::new()
        .map_err(anyhow::Error::from)
        .and_then(|runtime| runtime.block_on(run(cli.command)));
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            cli.log.failed(error.as_ref());
            #[cfg(feature = "demo")]
            return ExitCode::from(host_train::cli::status(&error));
            #[cfg(not(feature = "demo"))]
            ExitCode::FAILURE
        }
    }
}

async fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Node(args) => args.run().await,
        Command::Router(args) => args.run().await,
        #[cfg(feature = "demo")]
        Command::Refine(args) => args.run().await,
        #[cfg(feature = "demo")]
        Command::Demo(args) => args.run().await,
        #[cfg(feature = "demo")]
        Command::Fleet(args) => args.run().await,
        #[cfg(feature = "demo")]
        Command::Ros(args) => args.run().await,
    }
}
