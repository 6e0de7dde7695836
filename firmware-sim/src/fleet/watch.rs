//! `firmware-sim fleet watch`: a running fleet, as it changes.
#![allow(
    clippy::disallowed_types,
    reason = "the clock of who watches, not of a robot"
)]

use super::table::Table;
use crate::client::{Client, Heard};
use crate::session::{SessionArgs, certificates, has_certificate, open};
use anyhow::{bail, ensure};
use reagent_core::verdict::Verdict;
use reagent_core::wire::{PolicyId, Status, WhyNot};
use reagent_link::metrics::{Figures, MetricsArgs, Robot};
use reagent_link::name::name;
use reagent_link::print::reader_gone;
use reagent_link::stop::stop_requested;
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use std::pin::pin;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

/// Least time between two drawings in place, or between two lines of JSON.
const FRAME: Duration = Duration::from_millis(500);

/// Show a running fleet: policies, queues and verdicts of its robots, until Ctrl-C
#[derive(clap::Args, Clone, Debug)]
pub struct WatchArgs {
    /// Fleet to watch (a-z A-Z 0-9 _ -)
    #[arg(long, value_name = "NAME", value_parser = name)]
    pub fleet: String,
    /// Print one table and end; with status 1 if no robot is there
    #[arg(long)]
    pub once: bool,
    /// Print the fleet as a line of JSON whenever something has changed, instead of a table
    #[arg(long)]
    pub json: bool,
    /// With --once: end with status 1 unless robots are there, all have one policy, none refused one, no two have the same name, and none
    /// reports a fault, such as a deleted state directory or a certificate that has expired
    #[arg(long, requires = "once")]
    pub check: bool,
    /// Where metrics are served.
    #[command(flatten)]
    pub metrics: MetricsArgs,
    /// The network.
    #[command(flatten)]
    pub session: SessionArgs,
}

impl WatchArgs {
    /// Runs the command. It ends when nobody reads its output any more, unless it serves metrics.
    ///
    /// # Errors
    /// No session; with `--once`, that no robot is there; with `--check`, anything else that is wrong with the fleet.
    pub async fn run(self) -> anyhow::Result<()> {
        let client = Client::new(open(&self.session).await?, &self.fleet).await?;
        client.follow_robots().await?;
        let client = Arc::new(client);
        let certificates = Arc::new(certificates(&self.session)?);
        let (watched, shown) = (client.clone(), certificates.clone());
        let figures = move || Figures {
            robots: watched.heard().iter().map(figures).collect(),
            certificates: shown.read(),
            wrong: check(&watched.heard()).err().map(|error| error.to_string()),
        };
        let _metrics = self.metrics.serve(figures).await?;
        let mut changes = client.changes();
        // A router with access control silently drops what a certificate may not hear.
        let nobody = match has_certificate(&self.session)? {
            true => "no robot is there, or the router does not let this certificate see robots",
            false => "no robot is there",
        };
        if client.heard().is_empty() && !self.once {
            tracing::warn!("{nobody}");
        }
        let mut table = Table::new();
        let pause = if table.is_live() || self.json {
            FRAME
        } else {
            20 * FRAME
        };
        // One for all turns, so that no signal is lost between them.
        let mut stop = pin!(stop_requested());
        loop {
            changes.mark_unchanged();
            match self.json {
                true => println!("{}", document(&client.heard())),
                false => table.draw(&client),
            }
            if self.once {
                ensure!(!client.heard().is_empty(), "{nobody}");
                return if self.check {
                    check(&client.heard())
                } else {
                    Ok(())
                };
            }
            if reader_gone() && self.metrics.metrics.is_none() {
                return Ok(());
            }
            let next = async {
                tokio::time::sleep(pause).await;
                if self.json {
                    // The client exists as long as this function runs.
                    changes.changed().await.ok();
                }
            };
            tokio::select! {
                () = next => {}
                ended = &mut stop => return Ok(ended?),
            }
        }
    }
}

/// A fleet as JSON. Times are seconds since 1970.
fn document(robots: &[Heard]) -> Value {
    let robots: Vec<_> = robots.iter().map(robot).collect();
    json!({ "time": seconds(SystemTime::now()), "robots": robots })
}

fn figures(heard: &Heard) -> Robot {
    Robot {
        name: heard.robot.clone(),
        status: heard.status,
        online: heard.offline_since.is_none(),
        duplicate: heard.duplicate,
    }
}

fn robot(heard: &Heard) -> Value {
    let Status {
        served,
        refused,
        in_hand,
        verdicts,
        not_taken,
        policy,
        health,
        ..
    } = heard.status;
    let verdicts = Verdict::ALL.iter().zip(verdicts);
    let verdicts: Map<_, _> = verdicts
        .map(|(v, count)| (v.to_string(), count.into()))
        .collect();
    let not_taken = not_taken.map(|not| {
        let (policy, reason) = (id(&not.policy), not.reason.to_string());
        json!({ "policy": policy, "reason": reason })
    });
    json!({
        "robot": heard.robot,
        "online": heard.offline_since.is_none(),
        "offline_since": heard.offline_since.map(seconds),
        "duplicate": heard.duplicate,
        "policy": policy.as_ref().map(id),
        "not_taken": not_taken,
        "in_hand": in_hand,
        "served": served,
        "refused": refused,
        "verdicts": verdicts,
        "faults": health.faults().collect::<Vec<_>>(),
    })
}

fn id(policy: &PolicyId) -> Value {
    let sha256 = const_hex::encode(policy.sha256);
    json!({ "epoch": policy.epoch, "version": policy.version, "sha256": sha256 })
}

fn seconds(time: SystemTime) -> u64 {
    time.duration_since(SystemTime::UNIX_EPOCH)
        .map_or(0, |time| time.as_secs())
}

/// What is wrong with a fleet, if anything is.
fn check(robots: &[Heard]) -> anyhow::Result<()> {
    let named = |which: fn(&Heard) -> bool| {
        let names = robots.iter().filter(|heard| which(heard));
        names
            .map(|heard| heard.robot.as_str())
            .collect::<Vec<_>>()
            .join(", ")
    };
    for (what, robots) in [
        ("offline", named(|heard| heard.offline_since.is_some())),
        (
            "without a policy",
            named(|heard| heard.status.policy.is_none()),
        ),
        (
            "with a policy refused",
            named(|heard| {
                heard
                    .status
                    .not_taken
                    .is_some_and(|not| not.reason != WhyNot::NotYet)
            }),
        ),
        ("two of one name", named(|heard| heard.duplicate)),
        (
            "without their state directories",
            named(|heard| heard.status.health.state_lost),
        ),
        (
            "with certificates that do not hold",
            named(|heard| heard.status.health.certificate_invalid),
        ),
    ] {
        if !robots.is_empty() {
            bail!("{what}: {robots}");
        }
    }
    let policies: BTreeSet<_> = robots
        .iter()
        .map(|heard| heard.status.policy.map(|p| p.sha256))
        .collect();
    match policies.len() {
        0 => bail!("no robot is there"),
        1 => Ok(()),
        many => bail!("{many} policies are in use"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use reagent_core::wire::{Health, NotTaken};

    fn heard(robot: &str, version: u64) -> Heard {
        let policy = PolicyId {
            version,
            sha256: [version as u8; 32],
            ..PolicyId::default()
        };
        Heard {
            robot: robot.into(),
            status: Status {
                policy: Some(policy),
                ..Status::default()
            },
            duplicate: false,
            offline_since: None,
        }
    }

    #[test]
    fn a_fleet_is_healthy_where_all_run_one_policy() {
        let wrong = |robots: &[Heard]| check(robots).expect_err("it is not").to_string();
        assert!(check(&[heard("a", 1), heard("b", 1)]).is_ok());
        assert_eq!(wrong(&[]), "no robot is there");
        assert_eq!(
            wrong(&[heard("a", 1), heard("b", 2)]),
            "2 policies are in use"
        );
        let mut away = heard("b", 1);
        away.offline_since = Some(SystemTime::now());
        assert_eq!(wrong(&[heard("a", 1), away]), "offline: b");
        let mut refuses = heard("b", 1);
        refuses.status.not_taken = Some(NotTaken {
            policy: PolicyId::default(),
            reason: WhyNot::SelfTest,
        });
        assert_eq!(wrong(&[refuses.clone()]), "with a policy refused: b");
        for (state_lost, what) in [
            (true, "without their state directories: b"),
            (false, "with certificates that do not hold: b"),
        ] {
            let mut unwell = heard("b", 1);
            unwell.status.health = Health {
                state_lost,
                certificate_invalid: !state_lost,
            };
            assert_eq!(wrong(&[heard("a", 1), unwell.clone()]), what);
            let faults = &document(&[unwell])["robots"][0]["faults"];
            assert_eq!(faults.as_array().map(Vec::len), Some(1), "{faults}");
        }
        let document = document(&[refuses]);
        assert_eq!(document["robots"][0]["policy"]["version"], 1);
        let reason = document["robots"][0]["not_taken"]["reason"].as_str();
        assert!(
            reason.is_some_and(|reason| reason.contains("self-test")),
            "{document}"
        );
    }
}
