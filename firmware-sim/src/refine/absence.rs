//! A robot that is away for so long that the pairs of a batch wait for it no longer.

use super::RefineArgs;
use crate::client::{Client, RefineError};
use crate::node::ANY;
use reagent_core::wire::keys;
use std::time::Instant;

/// What a batch knows of the absence of its robot.
pub(super) struct Absence {
    /// When the batch began.
    begun: Instant,
    is_told: bool,
}

impl Absence {
    pub(super) fn new() -> Absence {
        Absence {
            begun: Instant::now(),
            is_told: false,
        }
    }

    /// What a pair would say that waited for the robot, if that has been away for as long as a pair waits. A robot that was never
    /// heard and has not answered has been away since the batch began. Of any robot, another one may come at any time.
    pub(super) fn error(
        &self,
        client: &Client,
        args: &RefineArgs,
        has_answered: bool,
    ) -> Option<RefineError> {
        let (robot, fleet) = (&args.robot, &args.fleet);
        if robot == ANY {
            return None;
        }
        let away = match client.has_heard(robot) {
            true => client.away(robot),
            false => (!has_answered).then(|| self.begun.elapsed()),
        };
        let waited = away.filter(|&away| away >= args.deadline)?;
        let key = keys::refine(fleet, robot).ok()?.to_string();
        Some(RefineError::NoRobot { key, waited })
    }

    /// Calls `say` the first time.
    pub(super) fn tell(&mut self, say: impl FnOnce()) {
        if !std::mem::replace(&mut self.is_told, true) {
            say();
        }
    }

    /// What is said then.
    pub(super) fn line(args: &RefineArgs) -> String {
        format!(
            "robot {} has been away for longer than the deadline: pairs do not wait for it until it is back",
            args.robot
        )
    }
}
