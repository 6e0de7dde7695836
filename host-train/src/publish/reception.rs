//! The fleet's reception of a policy: which robots take it, which do not, and why.

use crate::words::count;
use reagent_core::wire::{self, Manifest, Message, NotTaken, PolicyId, Status, WhyNot, keys};
use std::collections::BTreeMap;
use std::fmt;
use zenoh::sample::Sample;

/// A robot and the status that it reported.
#[derive(Clone, Debug, PartialEq)]
pub struct Heard {
    /// Its name.
    pub robot: String,
    /// Its status.
    pub status: Status,
}

impl Heard {
    pub(super) fn read(sample: &Sample) -> Option<Heard> {
        let robot = keys::robot_of(sample.key_expr().as_str())?.to_owned();
        match wire::decode(&sample.payload().to_bytes()) {
            Ok(Message::Status(status)) => Some(Heard { robot, status }),
            _ => None,
        }
    }

    /// Whether the robot runs the policy file of this SHA-256, under whatever version.
    pub(super) fn runs_file(&self, sha256: [u8; 32]) -> bool {
        let policy = self.status.policy;
        policy.is_some_and(|policy| policy.sha256 == sha256)
    }
}

/// The robots' reception of one policy.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reception {
    /// Robots that run it.
    pub taken: Vec<String>,
    /// Robots that gave a reason for not running it.
    pub refused: Vec<(String, WhyNot)>,
    /// Robots that have reported nothing about it, and what they run.
    pub silent: Vec<(String, Option<PolicyId>)>,
    /// Robots that have left before they reported anything about it.
    pub left: Vec<String>,
}

impl Reception {
    /// Sorts the robots by what they say of a policy. A refusal that was reported `before` it was announced, perhaps by another
    /// publisher, does not count as an answer to this announcement, nor does "not yet" from a robot whose turn it is.
    /// A robot with another policy of this version or a newer one has given its answer.
    pub(super) fn of(
        robots: &BTreeMap<String, Status>,
        manifest: &Manifest,
        before: &BTreeMap<String, Status>,
    ) -> Reception {
        let policy = manifest.id();
        let is_old = |robot: &str, not: NotTaken| match not.reason {
            WhyNot::NotYet => manifest.reaches(robot),
            _ => before.get(robot).and_then(|before| before.not_taken) == Some(not),
        };
        let mut reception = Reception::default();
        for (robot, status) in robots {
            let said = status.not_taken.filter(|not| not.policy == policy);
            let said = said.filter(|&not| !is_old(robot, not));
            let robot = robot.clone();
            match (said, status.policy) {
                (_, Some(runs)) if runs == policy => reception.taken.push(robot),
                (Some(not), _) => reception.refused.push((robot, not.reason)),
                (None, Some(runs)) if runs.release() >= policy.release() => {
                    let why = WhyNot::NotNewer(runs.release());
                    reception.refused.push((robot, why));
                }
                (None, runs) => reception.silent.push((robot, runs)),
            }
        }
        reception
    }

    /// The same, where some of the silent robots `have_left`.
    pub(super) fn where_left(mut self, has_left: impl Fn(&str) -> bool) -> Reception {
        let left = self.silent.extract_if(.., |(robot, _)| has_left(robot));
        self.left = left.map(|(robot, _)| robot).collect();
        self
    }

    /// Whether a robot is among those that are there.
    pub(super) fn names(&self, robot: &str) -> bool {
        let mut refused = self.refused.iter().map(|(name, _)| name);
        let mut silent = self.silent.iter().map(|(name, _)| name);
        self.taken.iter().any(|name| name == robot)
            || refused.any(|name| name == robot)
            || silent.any(|name| name == robot)
    }

    /// Whether every robot that is online runs it.
    pub fn is_complete(&self) -> bool {
        self.refused.is_empty() && self.silent.is_empty()
    }

    /// Robots that should have taken the policy and could not.
    pub(super) fn failed(&self) -> impl Iterator<Item = &(String, WhyNot)> {
        self.refused
            .iter()
            .filter(|(_, why)| *why != WhyNot::NotYet)
    }

    /// A possible reason why robots have not heard of it.
    pub(super) fn why_silent(&self, certificate: bool) -> &'static str {
        match (self.silent.is_empty(), certificate) {
            (true, _) => "",
            (false, true) => "; the router may not let this certificate publish",
            (false, false) => "; is the robot's link in order, and is it of this version?",
        }
    }

    /// The reception on one line, as errors are.
    pub(super) fn one_line(&self) -> String {
        self.to_string().replace('\n', "; ")
    }
}

/// One line for all robots that have taken it, then one for each other robot.
impl fmt::Display for Reception {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Reception {
            taken,
            refused,
            silent,
            left,
        } = self;
        let robots = taken.len() + refused.len() + silent.len() + left.len();
        if robots == 0 {
            return write!(f, "no robot is there; it waits for those that come");
        }
        let robots = count(robots, "robot", "robots");
        write!(f, "taken by {} of {robots}", taken.len())?;
        if !taken.is_empty() {
            write!(f, ": {}", taken.join(", "))?;
        }
        for (robot, why) in refused {
            write!(f, "\nnot taken by {robot}: {why}")?;
        }
        for (robot, policy) in silent {
            match policy {
                Some(policy) => write!(
                    f,
                    "\nno word of it from {robot}, which runs version {}",
                    policy.release()
                )?,
                None => write!(f, "\nno word of it from {robot}, which has no policy")?,
            }
        }
        match left.is_empty() {
            true => Ok(()),
            false => write!(f, "\nno longer there: {}", left.join(", ")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::WeightFile;
    use crate::policy::manifest::manifest as manifest_of;
    use crate::publish::PublishError;

    fn status(policy: Option<PolicyId>, not_taken: Option<(PolicyId, WhyNot)>) -> Status {
        Status {
            policy,
            not_taken: not_taken.map(|(policy, reason)| NotTaken { policy, reason }),
            ..Status::default()
        }
    }

    /// A manifest, and its policy's id under this version and the one before it.
    fn manifest() -> (Manifest, [PolicyId; 2]) {
        let file = WeightFile::pretrained();
        let manifest = manifest_of(2, "second", &file).expect("a good policy");
        let id = manifest.id();
        (manifest, [PolicyId { version: 1, ..id }, id])
    }

    #[test]
    fn a_reception_says_who_took_it_and_who_did_not_and_why() {
        let (manifest, [old, new]) = manifest();
        let robots = BTreeMap::from([
            ("a".into(), status(Some(new), None)),
            (
                "b".into(),
                status(Some(old), Some((new, WhyNot::Untrusted))),
            ),
            ("c".into(), status(None, Some((old, WhyNot::SelfTest)))),
            ("d".into(), status(Some(old), None)),
        ]);
        let reception = Reception::of(&robots, &manifest, &BTreeMap::new());
        assert!(!reception.is_complete());
        let lines = "taken by 1 of 4 robots: a\n\
                     not taken by b: it does not trust the signing key\n\
                     no word of it from c, which has no policy\n\
                     no word of it from d, which runs version 1";
        assert_eq!(reception.to_string(), lines);
        assert_eq!(reception.one_line(), lines.replace('\n', "; "));
        let said = |reception, certificate| {
            let not_taken = PublishError::NotTaken {
                reception,
                certificate,
            };
            not_taken.to_string()
        };
        let error = |reception| said(reception, true);
        let silent = said(reception.clone(), false);
        assert!(!silent.contains("certificate"), "{silent}");
        let silent = error(reception.clone());
        assert!(silent.ends_with("let this certificate publish"), "{silent}");
        let left = reception.clone().where_left(|robot| robot == "d");
        let lines = lines.replace(
            "no word of it from d, which runs version 1",
            "no longer there: d",
        );
        assert_eq!(left.to_string(), lines);
        assert!(!left.names("d"));
        // A robot that refuses it has heard of it.
        let refused = Reception {
            silent: Vec::new(),
            ..reception
        };
        assert_eq!(error(refused.clone()), refused.one_line());
        let nobody = Reception::default().to_string();
        assert!(nobody.starts_with("no robot is there"), "{nobody}");
    }

    #[test]
    fn a_robot_with_a_newer_policy_has_given_its_answer() {
        let (manifest, [_, new]) = manifest();
        let newer = PolicyId { version: 3, ..new };
        let robots = BTreeMap::from([("a".to_owned(), status(Some(newer), None))]);
        let reception = Reception::of(&robots, &manifest, &BTreeMap::new());
        let why = WhyNot::NotNewer(newer.release());
        assert_eq!(reception.refused, [("a".to_owned(), why)]);
    }

    #[test]
    fn what_was_said_before_is_no_word_of_it() {
        let (manifest, [_, new]) = manifest();
        let robots = BTreeMap::from([
            ("a".to_owned(), status(None, Some((new, WhyNot::Untrusted)))),
            ("b".to_owned(), status(None, Some((new, WhyNot::NotKept)))),
            ("c".to_owned(), status(None, Some((new, WhyNot::NotYet)))),
        ]);
        let untrusted = status(None, Some((new, WhyNot::Untrusted)));
        let before = ["a", "b"].map(|robot| (robot.to_owned(), untrusted));
        let names = |manifest: &Manifest, before: BTreeMap<_, _>| {
            let reception = Reception::of(&robots, manifest, &before);
            let silent = reception.silent.into_iter().map(|(robot, _)| robot);
            silent.collect::<Vec<_>>()
        };
        assert_eq!(names(&manifest, before.into()), ["a", "c"]);
        assert_eq!(names(&manifest, BTreeMap::new()), ["c"]);
        // "Not yet" is the answer where it goes to no robot yet.
        let nobody_yet = Manifest {
            reach: 0,
            ..manifest
        };
        assert_eq!(names(&nobody_yet, BTreeMap::new()), [""; 0]);
    }
}
