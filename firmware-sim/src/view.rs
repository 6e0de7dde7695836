//! The state of a node as others see it.

use crate::policy::UpdateError;
use reagent_core::verdict::VERDICTS;
use reagent_core::wire::{Health, Manifest, NotTaken, PolicyId, RefineReply, Status, Tally};
use reagent_link::metrics::Robot;
use std::sync::Arc;

/// A node's state. [`crate::node::Node::watch`] follows its changes.
#[derive(Clone, Debug, Default)]
pub struct View {
    /// The policy in use.
    pub policy: Option<Manifest>,
    /// Policies refused since the start.
    pub updates_refused: u64,
    /// Why the last of them was refused.
    pub last_refusal: Option<Arc<UpdateError>>,
    /// The last refusal as others are told it, until a policy is taken.
    pub not_taken: Option<NotTaken>,
    /// What the policy in use has done.
    pub tally: Tally,
    /// Whether the state directory was deleted or replaced.
    pub state_lost: bool,
    /// Whether a certificate of its session does not hold by this machine's clock.
    pub certificate_invalid: bool,
    /// Routers that the node is connected to; `None` before the first one.
    pub routers: Option<usize>,
    /// Requests answered with a pose.
    pub served: u64,
    /// Requests refused.
    pub refused: u64,
    /// Requests running or waiting.
    pub in_hand: u16,
    /// Requests that their clients took back or abandoned.
    pub taken_back: u64,
    /// Poses by verdict, in the order of [`reagent_core::Verdict::ALL`].
    pub verdicts: [u32; VERDICTS],
    /// A random number, drawn at the node's start.
    pub instance: u32,
    /// Whether another robot of the same name has been seen.
    pub duplicate: bool,
}

impl View {
    /// The status frame that others receive.
    pub fn status(&self) -> Status {
        Status {
            policy: self.policy.as_ref().map(Manifest::id),
            served: self.served,
            refused: self.refused,
            in_hand: self.in_hand,
            instance: self.instance,
            verdicts: self.verdicts,
            not_taken: self.not_taken,
            tally: self.tally,
            health: Health {
                state_lost: self.state_lost,
                certificate_invalid: self.certificate_invalid,
            },
        }
    }

    /// The status as metrics of the robot of this name.
    pub fn figures(&self, robot: &str) -> Robot {
        Robot {
            name: robot.into(),
            status: self.status(),
            online: true,
            duplicate: self.duplicate,
        }
    }

    /// What is wrong with the robot, if anything is.
    pub fn wrong(&self) -> Option<String> {
        let faults = [
            (self.policy.is_none(), "no policy"),
            (self.state_lost, "the state directory is gone"),
            (self.duplicate, "another robot has this name"),
            (self.routers == Some(0), "no router"),
        ];
        let wrong: Vec<_> = faults
            .iter()
            .filter(|(is, _)| *is)
            .map(|(_, what)| *what)
            .collect();
        (!wrong.is_empty()).then(|| wrong.join(", "))
    }

    pub(crate) fn use_policy(&mut self, manifest: Manifest) {
        self.policy = Some(manifest);
        self.not_taken = None;
        self.tally = Tally::default();
    }

    /// Counts a refusal. `policy` is the announced policy, or `None` for the one in flash, about which nobody waits for word.
    pub(crate) fn refuse_policy(&mut self, policy: Option<PolicyId>, error: UpdateError) {
        self.updates_refused += 1;
        let reason = error.why();
        self.not_taken = policy.map(|policy| NotTaken { policy, reason });
        self.last_refusal = Some(Arc::new(error));
    }

    /// Counts an answer; `reached` is as for [`Tally::count`].
    pub(crate) fn count_served(&mut self, reply: &RefineReply, reached: Option<bool>) {
        self.served += 1;
        let RefineReply { verdict, .. } = *reply;
        // A pose that was found without the policy says nothing about the policy.
        if reply.steps > 0 {
            let tally = &mut self.tally;
            tally.count(verdict, reply.probability, reply.micros, reached);
        }
        let of_kind = self.verdicts.get_mut(verdict as usize);
        of_kind.into_iter().for_each(|count| *count += 1);
        self.in_hand = self.in_hand.saturating_sub(1);
    }

    pub(crate) fn count_taken_back(&mut self) {
        self.taken_back += 1;
        self.in_hand = self.in_hand.saturating_sub(1);
    }

    pub(crate) fn count_refused(&mut self) {
        self.refused += 1;
        self.in_hand = self.in_hand.saturating_sub(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use reagent_core::Verdict;
    use reagent_core::wire::Mode;

    #[test]
    fn what_is_found_without_the_policy_does_not_speak_for_it() {
        let mut view = View::default();
        for (mode, steps) in [(Mode::Refine, 0), (Mode::Verify, 0), (Mode::Polish, 10)] {
            let reply = RefineReply {
                id: 1,
                target_from_source: [[0.0; 4]; 3],
                steps,
                mode,
                verdict: Verdict::Converged,
                probability: Some(0.9),
                fit: None,
                waited_micros: 0,
                micros: 1000,
                policy_version: 1,
            };
            view.count_served(&reply, Some(true));
        }
        assert_eq!((view.served, view.tally.poses()), (3, 1));
        assert_eq!((view.tally.refined, view.tally.reached), (1, 1));
    }

    #[test]
    fn a_robot_is_well_with_a_policy_a_router_and_its_state() {
        let mut view = View::default();
        let wrong = |view: &View| view.wrong().unwrap_or_default();
        assert_eq!(wrong(&view), "no policy");
        view.routers = Some(1);
        assert_eq!(wrong(&view), "no policy");
        view.routers = Some(0);
        view.state_lost = true;
        let all = "no policy, the state directory is gone, no router";
        assert_eq!(wrong(&view), all);
    }
}
