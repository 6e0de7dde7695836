//! Why a policy was not published.

use super::{Comparison, Halt, KeyError, Reception, SessionError, plain};
use crate::policy::ExportError;
use crate::train::TrainError;
use reagent_core::Error;
use reagent_core::wire::{PolicyId, Release};
use std::path::PathBuf;

/// Why a policy was not published.
#[derive(Debug, thiserror::Error)]
pub enum PublishError {
    /// The signing key cannot be read.
    #[error(transparent)]
    Key(#[from] KeyError),
    /// The session cannot be opened.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The metrics cannot be served.
    #[error(transparent)]
    Metrics(#[from] reagent_link::metrics::MetricsError),
    /// The policy file cannot be read, or is not a policy.
    #[error(transparent)]
    Weights(#[from] ExportError),
    /// A name cannot be used.
    #[error("{name:?}: {reason}")]
    Name {
        /// Name of a fleet or a policy.
        name: String,
        /// What is wrong with it.
        reason: Error,
    },
    /// The version belongs to an epoch that is over.
    #[error(
        "policy version {given} belongs to epoch {}, and {announced}, which {by}, is later whatever the version: give \
         --epoch {} with a greater version", .given.epoch, .announced.epoch
    )]
    Epoch {
        /// The release that was to be published.
        given: Release,
        /// The newest release so far.
        announced: Release,
        /// Who has it.
        by: String,
    },
    /// The version is not newer than the last one.
    #[error(
        "policy version {given} is not newer than {announced}, which {by}; give a higher --policy-version, or, where \
         that one should never have been, --epoch {} to begin anew", .announced.epoch.saturating_add(1)
    )]
    Version {
        /// The release that was to be published.
        given: Release,
        /// The newest release so far.
        announced: Release,
        /// Who has it.
        by: String,
    },
    /// The version leaves no versions for later policies.
    #[error("policy version {given} is too far ahead of {last}, the newest so far: {}", nearer(.given, .last))]
    FarAhead {
        /// The release that was to be published.
        given: Release,
        /// The newest release so far.
        last: Release,
    },
    /// The announcement reaches nobody.
    #[error(
        "nobody hears this publisher of fleet {fleet:?}: the router does not let its certificate publish; give it the \
         configuration that was made for the trainer, and see whether the fleet's name is right"
    )]
    Unheard {
        /// Name of the fleet.
        fleet: String,
    },
    /// Online robots should have taken the policy and have not.
    #[error("{}{}", .reception.one_line(), .reception.why_silent(*.certificate))]
    NotTaken {
        /// The robots' reception of it.
        reception: Reception,
        /// Whether the publisher shows a certificate, by which a router may limit it.
        certificate: bool,
    },
    /// The pairs for the comparison cannot be read or registered.
    #[error("{path}: {reason}")]
    Evaluation {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The policy is worse than the one before it.
    #[error(
        "not published, since it is worse than {old}: {comparison}; --anyway publishes it all the same"
    )]
    Worse {
        /// The policy before it.
        old: PathBuf,
        /// How they compare.
        comparison: Comparison,
    },
    /// So few right poses cannot tell which policy is worse.
    #[error(
        "not published: {old} gets {right} of {pairs} right, and with fewer than {} nothing can tell that the new policy is worse; \
         give more pairs of the kind that it registers; --anyway publishes it all the same",
        Comparison::fewest_pairs()
    )]
    TooFewPairs {
        /// The policy before it.
        old: PathBuf,
        /// Number of pairs, in words.
        pairs: String,
        /// Number of them that it gets right.
        right: usize,
    },
    /// There is no robot on which a stage could be judged.
    #[error(
        "no robot of fleet {fleet:?} is there, and without robots no stage can be judged: start them first, or publish \
         without --stages"
    )]
    Nobody {
        /// Name of the fleet.
        fleet: String,
    },
    /// No robot runs what is said to be the old policy.
    #[error(
        "no robot runs the policy of --against, SHA-256 {}: {robot} runs version {}, SHA-256 {}; give the file that \
         robots run", const_hex::encode(.old), .runs.release(), const_hex::encode(.runs.sha256)
    )]
    NotTheirs {
        /// SHA-256 of the file.
        old: [u8; 32],
        /// A robot.
        robot: String,
        /// What it runs.
        runs: PolicyId,
    },
    /// A roll-out cannot go on; the robots that have the policy keep it.
    #[error(
        "the roll-out halts: {halt}; the robots that have version {version} keep it; run again with a higher version \
         to go on"
    )]
    Halted {
        /// Why.
        halt: Halt,
        /// The version that was rolled out.
        version: Release,
    },
    /// A stage of the fleet does worse than before, or cannot be judged, and the old policy was published again.
    #[error(
        "the roll-out halts: {halt}; version {version} is the old policy again, {}{}",
        .reception.one_line(), still(.away)
    )]
    TakenBack {
        /// Why.
        halt: Box<Halt>,
        /// The old policy's new version.
        version: Release,
        /// Its reception by the robots that are there.
        reception: Box<Reception>,
        /// Other robots, which had taken the new policy.
        away: Vec<String>,
    },
    /// A stage of the fleet does worse than before, or cannot be judged, and keeps the policy.
    #[error(
        "the roll-out halts: {halt}; the old policy could not be published again: {reason}; robots that run version \
         {version}: {}", names(.robots)
    )]
    NotTakenBack {
        /// Why the roll-out halts.
        halt: Box<Halt>,
        /// Why the old policy is not there again.
        reason: Box<PublishError>,
        /// The version of the new policy.
        version: Release,
        /// Robots that run it.
        robots: Vec<String>,
    },
    /// The publisher was asked to end before all stages were judged, or the policy was stored.
    #[error("stopped before the end; robots that run version {version}, which is not judged: {}", names(.robots))]
    Stopped {
        /// The version that was to be published.
        version: Release,
        /// Robots that run it.
        robots: Vec<String>,
    },
    /// The storages have not kept the whole policy.
    #[error(
        "{stored} of {chunks} chunks came back from {key}; does a router keep reagent/v1/** in a storage?"
    )]
    NotStored {
        /// Chunks that came back as they were put.
        stored: usize,
        /// Chunks that were put.
        chunks: usize,
        /// Key expression of the chunks.
        key: String,
    },
    /// The run that the policy came from has no record.
    #[error(transparent)]
    Run(#[from] TrainError),
    /// The record of the evaluation, the hash in a run's record, or the history cannot be read.
    #[error("{path}: {reason}")]
    Record {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The session failed.
    #[error("zenoh: {}", plain(.0))]
    Zenoh(#[from] zenoh::Error),
}

/// The greatest version that is not too far ahead of `last`.
fn greatest_after(last: &Release) -> u64 {
    match last.version {
        0 => Release::MAX_VERSION,
        version => Release::MAX_VERSION.min(version.saturating_add(Release::MAX_VERSION_STEP)),
    }
}

/// A release that is not too far ahead.
fn nearer(given: &Release, last: &Release) -> String {
    let next = last.epoch.saturating_add(1);
    match given.epoch.saturating_sub(last.epoch) > Release::MAX_EPOCH_STEP {
        true => format!("its epoch is; the next one is --epoch {next}"),
        false => format!(
            "give a --policy-version of at most {}, or --epoch {next} to begin anew",
            greatest_after(last)
        ),
    }
}

fn names(robots: &[String]) -> String {
    match robots.is_empty() {
        true => "none".into(),
        false => robots.join(", "),
    }
}

/// Names the robots that still have a policy that was taken back.
fn still(away: &[String]) -> String {
    match away.is_empty() {
        true => String::new(),
        false => format!(
            "; still with the new policy and not there: {}",
            away.join(", ")
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_too_far_ahead_is_named() {
        let release = |epoch, version| Release { epoch, version };
        let said = |given| {
            let last = release(2, 7);
            PublishError::FarAhead { given, last }.to_string()
        };
        let of_epoch = said(release(u32::MAX, 8));
        assert!(
            of_epoch.ends_with("its epoch is; the next one is --epoch 3"),
            "{of_epoch}"
        );
        assert!(!of_epoch.contains("--policy-version"), "{of_epoch}");
        let of_version = said(release(2, u64::MAX));
        let least = "give a --policy-version of at most 268435463, or --epoch 3 to begin anew";
        assert!(of_version.ends_with(least), "{of_version}");
    }
}
