//! Why a roll-out stops.

use super::Reception;
use reagent_core::wire::PolicyId;
use std::fmt;

/// Why a roll-out stops.
#[derive(Clone, Debug, PartialEq)]
pub enum Halt {
    /// Robots could not take the policy.
    NotTaken(Reception),
    /// The robots that have it gave too few poses to judge it.
    Unknown {
        /// Poses given since all of them have had it.
        poses: u64,
        /// Poses wanted.
        wanted: u64,
        /// Robots of the stage that are no longer there.
        gone: Vec<String>,
    },
    /// A robot runs another policy of this version, or a newer one, and takes this one no longer.
    Overtaken {
        /// The robot.
        robot: String,
        /// What it runs.
        policy: PolicyId,
    },
    /// No pose converged, with either policy, which tells nothing of the new one.
    NoneConverged(String),
    /// The robots that have it do worse.
    Worse(String),
}

impl fmt::Display for Halt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Halt::NotTaken(reception) => {
                let robots: Vec<&str> = reception.failed().map(|(robot, _)| &**robot).collect();
                let (robots, reception) = (robots.join(","), reception.one_line());
                write!(
                    f,
                    "{reception}; if that is the robot's fault alone, go on without it: --except {robots}"
                )
            }
            Halt::Unknown {
                poses,
                wanted,
                gone,
            } => {
                write!(
                    f,
                    "{poses} poses with the new policy where {wanted} are needed to judge it"
                )?;
                match gone.is_empty() {
                    true => Ok(()),
                    false => write!(f, "; no longer there: {}", gone.join(", ")),
                }
            }
            Halt::Overtaken { robot, policy } => write!(
                f,
                "somebody else publishes to this fleet: {robot} runs version {} (SHA-256 {})",
                policy.release(),
                const_hex::encode(policy.sha256)
            ),
            Halt::NoneConverged(figures) => write!(
                f,
                "no pose converged, which tells nothing of the new policy; ask for verified or polished poses of what the robots see: {figures}"
            ),
            Halt::Worse(why) => f.write_str(why),
        }
    }
}
