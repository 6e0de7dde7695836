//! `host-train publish`

use super::witness::Witness;
use super::{
    Comparison, Gate, Halt, Provenance, PublishArgs, PublishError, Publisher, Reception, Stages,
    has_certificate, open_session, read_key,
};
use crate::dataset::pairs::PairSet;
use crate::policy::WeightFile;
use crate::random::SEED;
use crate::train::DataSource;
use crate::views::Views;
use crate::words::count;
use reagent_core::wire::{Manifest, PolicyId, PolicyName, Release};
use reagent_link::stop::stop_requested;
use sha2::{Digest, Sha256};
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::pin::pin;
use std::time::{Duration, SystemTime};

/// Views on which policies are compared, and points in each.
const VIEWS: usize = 300;
const POINTS: usize = 1024;

/// `host-train publish`: announces a policy and serves its chunks until Ctrl-C.
///
/// # Errors
/// See [`PublishError`].
pub async fn run(args: PublishArgs) -> Result<(), PublishError> {
    let key = read_key(&args.key)?;
    let file = WeightFile::load(&args.weights)?;
    let provenance = Provenance::read(args.run.as_deref(), args.evaluation.as_deref())?;
    let old = args.against.as_deref().map(WeightFile::load).transpose()?;
    if let (Some(on), Some(path), Some(old)) = (&args.evaluate, &args.against, &old) {
        compare(on, [old, &file], path, args.anyway)?;
    }
    let session = open_session(&args.session).await?;
    let mut publisher = Publisher::new(session, &args.fleet, key)?;
    publisher.provenance = provenance;
    publisher.epoch = args.epoch;
    // A router with access control silently drops what a certificate may not publish.
    if !args.store && has_certificate(&args.session)? {
        publisher.listener = Some(open_session(&args.session).await?);
    }
    let version = match args.policy_version {
        Some(version) => version,
        None => {
            let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
            let time = since_1970.map_or(1, |time| time.as_secs());
            publisher.default_version(time).await?
        }
    };
    let witness = Witness::start(&publisher, &args).await?;
    let policy = PolicyId {
        epoch: args.epoch,
        version,
        sha256: Sha256::digest(file.bytes()).into(),
    };
    // One for both, so that no signal is lost between them.
    let mut stop = pin!(stop_requested());
    let shipped = tokio::select! {
        Err(failed) = witness.follow() => Err(failed),
        stopped = &mut stop => {
            stopped.map_err(zenoh::Error::from)?;
            witness.ask().await?;
            return witness.end(stopped_early(&args, &witness, policy));
        }
        shipped = ship(&mut publisher, &witness, &args, version, file, old) => shipped,
    };
    match &shipped {
        // Robots that are away find the old policy when they come back.
        Err(taken_back @ PublishError::TakenBack { .. }) => {
            tracing::error!("{taken_back}; it is served until Ctrl-C");
        }
        Ok(()) if !args.store => {}
        _ => {
            witness.ask().await?;
            return witness.end(shipped);
        }
    }
    if args.wait > 0 {
        witness.tell_takes();
    }
    let stopped = tokio::select! {
        Err(failed) = witness.follow() => Err(failed),
        stopped = &mut stop => shipped.and(Ok(stopped.map_err(zenoh::Error::from)?)),
    };
    witness.end(stopped)
}

/// The end of a publisher that is stopped before it has told how robots receive the policy. Without stages, the policy is out
/// as soon as it is announced.
fn stopped_early(
    args: &PublishArgs,
    witness: &Witness,
    policy: PolicyId,
) -> Result<(), PublishError> {
    match args.stages.is_some() || args.store {
        false => Ok(()),
        true => Err(PublishError::Stopped {
            version: policy.release(),
            robots: witness.with_policy(policy),
        }),
    }
}

/// Publishes the policy as the arguments say, and reports the result.
async fn ship(
    publisher: &mut Publisher,
    witness: &Witness,
    args: &PublishArgs,
    version: u64,
    file: WeightFile,
    old: Option<WeightFile>,
) -> Result<(), PublishError> {
    let stem = args.weights.file_stem().unwrap_or_default();
    let name = fitting(&stem.to_string_lossy());
    let manifest = if let (Some(stages), Some(old)) = (&args.stages, old) {
        let manifest = publisher.prepare(version, &name, &file).await?;
        roll_out(publisher, witness, &manifest, [file, old], stages, args).await?
    } else {
        let manifest = match args.store {
            true => publisher.store(version, &name, &file).await?,
            false => publisher.publish(version, &name, file).await?,
        };
        witness.published(&manifest);
        manifest
    };
    let (verb, preposition, end) = match args.store {
        true => ("stored", "for", ""),
        false => ("serving", "to", "; Ctrl-C ends it"),
    };
    println!(
        "{verb} policy {name:?} version {} ({} bytes, SHA-256 {}) {preposition} fleet {:?}{end}",
        manifest.release(),
        manifest.length,
        const_hex::encode(manifest.sha256),
        args.fleet,
    );
    let public_key = publisher.key.verifying_key();
    println!(
        "robots that trust only this key: --trust {}",
        const_hex::encode(public_key.as_bytes())
    );
    tell_reception(publisher, &manifest, args).await
}

/// Ships to one part of the fleet after the other, and withdraws a policy that does worse.
async fn roll_out(
    publisher: &mut Publisher,
    witness: &Witness,
    manifest: &Manifest,
    [file, old]: [WeightFile; 2],
    stages: &Stages,
    args: &PublishArgs,
) -> Result<Manifest, PublishError> {
    let gate = Gate {
        poses: args.gate_poses,
        wait: Duration::from_secs(args.gate_wait),
        except: args.except.clone(),
        old: Sha256::digest(old.bytes()).into(),
        anyway: args.anyway,
    };
    publisher.check_old(manifest, gate.old).await?;
    witness.published(manifest);
    println!("version {} goes out in stages", manifest.release());
    let told = |line: String| println!("{line}");
    let outcome = publisher
        .roll_out(manifest, &file, stages, &gate, told)
        .await?;
    let halt = match outcome {
        Ok(announced) => return Ok(announced),
        // Robots take neither this policy nor the old one any more.
        Err(halt @ Halt::Overtaken { .. }) => {
            let version = manifest.release();
            return Err(PublishError::Halted { halt, version });
        }
        Err(halt) => halt,
    };
    let (halt, worse) = (Box::new(halt), manifest.release());
    let back = take_back(publisher, witness, worse, old, args).await;
    let mut robots = witness.with_policy(manifest.id());
    Err(match back {
        Ok((version, reception)) => {
            robots.retain(|robot| !reception.names(robot));
            PublishError::TakenBack {
                halt,
                version,
                reception: Box::new(reception),
                away: robots,
            }
        }
        Err(reason) => PublishError::NotTakenBack {
            halt,
            reason: Box::new(reason),
            version: worse,
            robots,
        },
    })
}

/// Publishes the old policy again. Returns its version, and the robots' reception of it.
async fn take_back(
    publisher: &mut Publisher,
    witness: &Witness,
    worse: Release,
    old: WeightFile,
    args: &PublishArgs,
) -> Result<(Release, Reception), PublishError> {
    let back = publisher.publish_over(worse, "taken-back", old).await?;
    witness.published(&back);
    let wait = Duration::from_secs(args.wait);
    let reception = publisher.reception(&back, wait).await?;
    Ok((back.release(), reception))
}

/// Compares the policy with the one before it, and reports the result.
fn compare(
    on: &DataSource,
    [old, new]: [&WeightFile; 2],
    path: &Path,
    anyway: bool,
) -> Result<(), PublishError> {
    let failed = |reason: String| PublishError::Evaluation {
        path: on.to_string().into(),
        reason,
    };
    let set = match on {
        DataSource::Views(meshes) => Views::load(meshes, SEED).map(|views| {
            let mut set = PairSet::default();
            views.draw(VIEWS, POINTS, SEED, &mut set);
            set
        }),
        DataSource::Directory(path) if path.is_dir() => {
            let reason = "is a folder; give a file of pairs, or views:DIR";
            return Err(failed(reason.into()));
        }
        DataSource::Directory(path) => PairSet::load(path),
        _ => return Err(failed("give a file of pairs, or views:DIR".into())),
    };
    let set = set.map_err(|error| failed(error.to_string()))?;
    let comparison = Comparison::of(old, new, &set);
    let comparison = comparison.map_err(|error| failed(error.to_string()))?;
    println!("against {}: {comparison}", path.display());
    let can_tell = comparison.can_tell();
    if anyway || can_tell && !comparison.is_worse() {
        return Ok(());
    }
    let (why, refused) = match can_tell {
        false => {
            let pairs = count(comparison.pairs, "pair", "pairs");
            let right = comparison.right.old;
            let why = format!(
                "{} gets {right} of {pairs} right, which cannot tell whether the new policy is worse",
                path.display()
            );
            let old = path.into();
            (why, PublishError::TooFewPairs { old, pairs, right })
        }
        true => {
            let old = path.into();
            let why = "it is worse".into();
            (why, PublishError::Worse { old, comparison })
        }
    };
    match confirmed(&why) {
        true => Ok(()),
        false => Err(refused),
    }
}

/// Asks the user, if there is a terminal.
fn confirmed(why: &str) -> bool {
    if !std::io::stdin().is_terminal() {
        return false;
    }
    print!("{why}; publish it all the same? [y/N] ");
    std::io::stdout().flush().ok();
    let mut answer = String::new();
    std::io::stdin().read_line(&mut answer).is_ok() && answer.trim().eq_ignore_ascii_case("y")
}

/// Reports how the robots receive the policy.
async fn tell_reception(
    publisher: &Publisher,
    manifest: &Manifest,
    args: &PublishArgs,
) -> Result<(), PublishError> {
    if args.wait == 0 {
        return Ok(());
    }
    let wait = Duration::from_secs(args.wait);
    let reception = publisher.reception(manifest, wait).await?;
    let nobody = reception.taken.is_empty() && !reception.is_complete();
    if nobody || args.store && !reception.refused.is_empty() {
        return Err(PublishError::NotTaken {
            reception,
            certificate: has_certificate(&args.session)?,
        });
    }
    println!("{reception}");
    Ok(())
}

/// A file's name, cut to the length that a manifest holds.
fn fitting(stem: &str) -> String {
    let mut name = PolicyName::new();
    stem.chars().try_for_each(|c| name.push(c)).ok();
    name.as_str().into()
}
