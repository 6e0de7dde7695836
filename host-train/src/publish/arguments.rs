//! The arguments of `host-train publish`.

use super::{SessionArgs, Stages};
use crate::train::DataSource;
use reagent_link::metrics::MetricsArgs;
use reagent_link::name::name;
use std::path::PathBuf;

/// Serve a policy to a fleet until Ctrl-C.
#[derive(clap::Args, Clone, Debug)]
pub struct PublishArgs {
    /// Policy file to ship.
    #[arg(long, value_name = "FILE.rgw")]
    pub weights: PathBuf,
    /// Signing key, as `host-train keygen` makes it.
    #[arg(long, value_name = "SIGNING_KEY")]
    pub key: PathBuf,
    /// Fleet to ship to.
    #[arg(long, value_name = "NAME", value_parser = name)]
    pub fleet: String,
    /// Version of the policy; robots take only newer ones. Default: the time, in seconds since 1970; or one more than
    /// the newest version, if that was counted by hand and the time is too far ahead of it.
    #[arg(long, value_name = "N")]
    pub policy_version: Option<u64>,
    /// Epoch of the version, signed with it. A greater epoch starts the versions anew, which is the way back from a
    /// version that should never have been. Every later policy needs it, too.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub epoch: u32,
    /// Seconds that robots have to take the policy before those that have not are named; 0 does not wait, and reports
    /// nothing about them.
    #[arg(long, value_name = "SECONDS", default_value_t = 60)]
    pub wait: u64,
    /// Run that the policy came from; the SHA-256 of its training data goes into the manifest.
    #[arg(long, value_name = "RUN_DIR")]
    pub run: Option<PathBuf>,
    /// Put the policy into a router's storage and exit; it is served from there.
    #[arg(long)]
    pub store: bool,
    /// Record of the policy's evaluation, such as the JSON of `eval`; its SHA-256 goes into the manifest.
    #[arg(long, value_name = "FILE")]
    pub evaluation: Option<PathBuf>,
    /// Ship to parts of the fleet one after the other, such as 1,10%,100%. If robots do worse with the policy than they
    /// did with --against, or than the others do, or if nothing tells how they do, the latter is published again under
    /// the next version, and served until Ctrl-C; the status is then 1.
    #[arg(
        long,
        value_name = "LIST",
        requires = "against",
        conflicts_with = "store"
    )]
    pub stages: Option<Stages>,
    /// Poses that the robots of a stage must give, together, once they have the policy, before the next stage.
    #[arg(long, value_name = "N", default_value_t = 100, requires = "stages")]
    pub gate_poses: u64,
    /// How long a stage may take to give them, seconds.
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 3600,
        requires = "stages"
    )]
    pub gate_wait: u64,
    /// Robots that need not take the policy, such as one whose flash is broken: names, separated by commas.
    #[arg(
        long,
        value_name = "ROBOTS",
        value_delimiter = ',',
        requires = "stages"
    )]
    pub except: Vec<String>,
    /// Pairs, or meshes to render 300 views of, on which the policy is compared with the one before it; a worse policy
    /// is not published.
    #[arg(long, value_name = "FILE.h5|views:DIR", requires = "against")]
    pub evaluate: Option<DataSource>,
    /// The policy before it, for --evaluate and --stages; with --stages, a robot must run it.
    #[arg(long, value_name = "FILE.rgw")]
    pub against: Option<PathBuf>,
    /// Publish even a policy that --evaluate calls worse, or cannot tell; without this option the user is asked, if there
    /// is a terminal. With --stages, go on even where robots do worse.
    #[arg(long, requires = "against")]
    pub anyway: bool,
    /// File that grows by a line of JSON whenever a policy is published, whenever a robot runs or refuses another one, and
    /// whenever a robot goes away: who ran what when.
    #[arg(long, value_name = "FILE.jsonl")]
    pub history: Option<PathBuf>,
    /// Where its figures are served.
    #[command(flatten)]
    pub metrics: MetricsArgs,
    /// The network.
    #[command(flatten)]
    pub session: SessionArgs,
}
