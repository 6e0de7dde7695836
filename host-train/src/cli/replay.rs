//! `host-train replay`: repeats what a robot did.

use crate::policy::{BUNDLED, WeightFile};
use crate::register::replay::{ReplayError, replay};
use crate::words::count;
use anyhow::bail;
use std::path::PathBuf;

/// Repeat what robots did, from their traces, and say whether every bit comes out the same
///
/// With a policy in 8-bit integers it does on every machine; with one in f32 only on the same kernels, which are used
/// if this machine has them.
#[derive(clap::Args, Debug)]
pub(super) struct ReplayArgs {
    /// Traces, as `firmware-sim refine --trace` writes them
    file: PathBuf,
    /// Policies that the robots had, found by their SHA-256, besides those built in: reagent, reagent-int8, views,
    /// compact and views-compact
    #[arg(long, value_name = "FILE.rgw", num_args = 1..)]
    weights: Vec<PathBuf>,
}

impl ReplayArgs {
    pub(super) fn run(self) -> anyhow::Result<()> {
        let mut policies: Vec<WeightFile> = BUNDLED
            .iter()
            .filter_map(|(name, _)| WeightFile::bundled(name.as_ref()))
            .collect();
        for path in &self.weights {
            policies.push(WeightFile::load(path)?);
        }
        let bytes = std::fs::read(&self.file).map_err(|source| ReplayError::Io {
            path: self.file.clone(),
            source,
        })?;
        let replayed = replay(&bytes, &policies)?;
        let mut different = 0;
        for (number, again) in (1..).zip(&replayed) {
            let [robot, here] = &again.kernels;
            let kernels = match robot == here {
                true => format!("kernels {robot}"),
                false => format!("kernels {robot} there, {here} here"),
            };
            let outcome = match &again.difference {
                None => "equal in every bit".to_owned(),
                Some(difference) => {
                    different += 1;
                    format!("DIFFERENT: {difference}")
                }
            };
            println!(
                "trace {number}: request {}, policy version {}, {}, mode {}, {kernels}: {outcome}",
                again.id,
                again.policy_version,
                count(again.steps, "step", "steps"),
                again.mode
            );
        }
        if different > 0 {
            bail!(
                "{different} of {} came out otherwise here",
                count(replayed.len(), "trace", "traces")
            );
        }
        let traces = count(replayed.len(), "trace", "traces");
        println!("{traces}, all equal");
        Ok(())
    }
}
