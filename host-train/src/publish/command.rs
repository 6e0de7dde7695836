//! `host-train publish`

use super::{Provenance, PublishError, Publisher, SessionArgs, open_session, read_key};
use crate::export::WeightFile;
use reagent_core::wire::PolicyName;
use reagent_core::wire::keys::Hex;
use std::path::PathBuf;
use std::time::SystemTime;

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
    #[arg(long, value_name = "NAME")]
    pub fleet: String,
    /// Version of the policy; robots take only newer ones. Default: the time, in seconds since 1970.
    #[arg(long, value_name = "N")]
    pub policy_version: Option<u64>,
    /// Run that the policy came from; the SHA-256 of its training data goes into the manifest.
    #[arg(long, value_name = "RUN_DIR")]
    pub run: Option<PathBuf>,
    /// Put the policy into the storage of a router, and end: it is served from there.
    #[arg(long)]
    pub store: bool,
    /// Record of the policy's evaluation, such as the JSON of `eval`; its SHA-256 goes into the manifest.
    #[arg(long, value_name = "FILE")]
    pub evaluation: Option<PathBuf>,
    /// The network.
    #[command(flatten)]
    pub session: SessionArgs,
}

/// `host-train publish`: announces a policy and serves its chunks until Ctrl-C.
///
/// # Errors
/// See [`PublishError`].
pub async fn run(args: PublishArgs) -> Result<(), PublishError> {
    let key = read_key(&args.key)?;
    let file = WeightFile::load(&args.weights)?;
    let stem = args.weights.file_stem().unwrap_or_default();
    let name = fitting(&stem.to_string_lossy());
    let version = args.policy_version.unwrap_or_else(|| {
        let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        since_1970.map_or(1, |time| time.as_secs())
    });
    let provenance = Provenance::read(args.run.as_deref(), args.evaluation.as_deref())?;
    let session = open_session(&args.session).await?;
    let public_key = key.verifying_key().to_bytes();
    let mut publisher = Publisher::new(session, &args.fleet, key)?;
    publisher.provenance = provenance;
    let stored = args.store;
    let manifest = match stored {
        true => publisher.store(version, &name, &file).await?,
        false => publisher.publish(version, &name, file).await?,
    };
    println!(
        "{} policy {name:?} version {version} ({} bytes, SHA-256 {}) {} fleet {:?}{}",
        if stored { "stored" } else { "serving" },
        manifest.length,
        Hex(&manifest.sha256),
        if stored { "for" } else { "to" },
        args.fleet,
        if stored { "" } else { "; Ctrl-C ends it" },
    );
    println!(
        "robots that trust only this key: --trust {}",
        Hex(&public_key)
    );
    if !stored {
        tokio::signal::ctrl_c().await.map_err(zenoh::Error::from)?;
    }
    Ok(())
}

/// As much of a file's name as a manifest holds.
fn fitting(stem: &str) -> String {
    let mut name = PolicyName::new();
    stem.chars().try_for_each(|c| name.push(c)).ok();
    name.as_str().into()
}
