//! The order of a fleet's policies, and why a robot did not take one.

use crate::verdict::{VERDICTS, Verdict};
use serde::{Deserialize, Serialize};

/// The place of a policy among those shipped to its fleet. A robot takes only later ones. To go back from a version that should
/// not have been shipped, ship it in a greater epoch, under the same signature.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize,
)]
pub struct Release {
    /// Versions of different epochs are not comparable.
    pub epoch: u32,
    /// Grows within an epoch.
    pub version: u64,
}

impl Release {
    /// The greatest version; as seconds since 1970, it lasts until 2106.
    pub const MAX_VERSION: u64 = u32::MAX as u64;
    /// Largest step from one version of an epoch to the next; as seconds, eight and a half years.
    pub const MAX_VERSION_STEP: u64 = 1 << 28;
    /// Largest step from one epoch to the next.
    pub const MAX_EPOCH_STEP: u32 = 1000;

    /// Whether this is so far ahead of `last`, the latest release known (the default if there is none), that it must be a
    /// mistake. Taking it would leave no versions for later policies.
    pub fn is_far_ahead_of(self, last: Release) -> bool {
        let same_epoch = self.epoch == last.epoch && last.version > 0;
        self.version > Self::MAX_VERSION
            || same_epoch && self.version.saturating_sub(last.version) > Self::MAX_VERSION_STEP
            || self.epoch.saturating_sub(last.epoch) > Self::MAX_EPOCH_STEP
    }
}

impl core::fmt::Display for Release {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.epoch {
            0 => write!(f, "{}", self.version),
            epoch => write!(f, "{} of epoch {epoch}", self.version),
        }
    }
}

/// Which policy a robot runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PolicyId {
    /// The manifest's epoch.
    pub epoch: u32,
    /// The manifest's version.
    pub version: u64,
    /// SHA-256 of the policy file.
    pub sha256: [u8; 32],
}

impl PolicyId {
    /// Its place among the policies shipped to the fleet.
    pub fn release(&self) -> Release {
        Release {
            epoch: self.epoch,
            version: self.version,
        }
    }
}

/// A policy that was announced to a robot and not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NotTaken {
    /// What its manifest says, which nobody vouches for; zeros if the manifest cannot be read.
    pub policy: PolicyId,
    /// Why it was not taken.
    pub reason: WhyNot,
}

/// Why a policy was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum WhyNot {
    /// The announcement is not a signed manifest of this protocol version.
    Malformed,
    /// The signature does not match the key.
    Signature,
    /// The robot does not trust the key.
    Untrusted,
    /// This release or a later one is or was in use.
    NotNewer(Release),
    /// The release is too far ahead of this one, the latest in use.
    FarAhead(Release),
    /// The policy goes to a part of the fleet first, and this robot is not in it.
    NotYet,
    /// The robot does not run files of this format, shape or length.
    Incompatible,
    /// The file did not arrive completely.
    NotFetched,
    /// The file is not the manifest's, or is not a policy.
    Damaged,
    /// The policy acts differently on the robot from where it was made.
    SelfTest,
    /// The robot's board did not take it.
    Board,
    /// The robot cannot store it.
    NotKept,
}

impl core::fmt::Display for WhyNot {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let text = match self {
            WhyNot::Malformed => "the announcement is no signed manifest that it can read",
            WhyNot::Signature => "the signature is wrong",
            WhyNot::Untrusted => "it does not trust the signing key",
            WhyNot::NotNewer(last) => {
                return write!(f, "version {last} is or was in use, and it never goes back");
            }
            WhyNot::FarAhead(last) => {
                return write!(
                    f,
                    "the version is too far ahead of {last}, which was in use"
                );
            }
            WhyNot::NotYet => "it goes to other robots first",
            WhyNot::Incompatible => "it does not run files of this format, shape or length",
            WhyNot::NotFetched => "the file did not come as a whole",
            WhyNot::Damaged => "the file is not that of the manifest, or no policy",
            WhyNot::SelfTest => "the self-test failed: the policy acts otherwise there",
            WhyNot::Board => "its board did not take it",
            WhyNot::NotKept => "it cannot keep it: its flash or state directory failed",
        };
        f.write_str(text)
    }
}

/// What a robot's policy has done since the robot took it into use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tally {
    /// Poses by verdict, in the order of [`Verdict`].
    pub verdicts: [u32; VERDICTS],
    /// Poses whose probability is known.
    pub judged: u32,
    /// Sum of these probabilities, in millionths.
    pub probability_millionths: u64,
    /// Sum of the times of all poses, in microseconds.
    pub micros: u64,
    /// Converged poses that were refined after the policy's steps.
    pub refined: u32,
    /// Of these, those that the policy itself had reached, so that refinement corrected little.
    pub reached: u32,
}

impl Tally {
    /// Counts a pose: its verdict, its probability if known, its time, and whether the policy itself had reached it if
    /// it converged and was refined.
    pub fn count(
        &mut self,
        verdict: Verdict,
        probability: Option<f32>,
        micros: u32,
        reached: Option<bool>,
    ) {
        if let Some(count) = self.verdicts.get_mut(verdict as usize) {
            *count = count.saturating_add(1);
        }
        if let Some(probability) = probability {
            self.judged = self.judged.saturating_add(1);
            // The cast turns NaN into 0.
            self.probability_millionths += (probability.clamp(0.0, 1.0) * 1e6) as u64;
        }
        self.micros += u64::from(micros);
        if let Some(reached) = reached {
            self.refined = self.refined.saturating_add(1);
            self.reached = self.reached.saturating_add(reached.into());
        }
    }

    /// Number of poses.
    pub fn poses(&self) -> u64 {
        self.verdicts.iter().map(|&count| u64::from(count)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn release(epoch: u32, version: u64) -> Release {
        Release { epoch, version }
    }

    #[test]
    fn epochs_come_before_versions() {
        assert!(release(1, 1) > release(0, u64::MAX));
        assert!(release(1, 2) > release(1, 1));
        assert_eq!(std::format!("{}", release(0, 7)), "7");
        assert_eq!(std::format!("{}", release(2, 7)), "7 of epoch 2");
    }

    #[test]
    fn what_leaves_no_room_for_later_policies_is_far_ahead() {
        let now = 1_795_000_000;
        let none = Release::default();
        for (next, last, far) in [
            (release(0, 1), none, false),
            (release(0, now), none, false),
            (release(0, u64::MAX), none, true),
            (release(0, u64::from(u32::MAX) + 1), none, true),
            (release(0, 8), release(0, 7), false),
            (release(0, now), release(0, 7), true),
            (release(0, now + (1 << 28)), release(0, now), false),
            (release(0, now + (1 << 28) + 1), release(0, now), true),
            (release(1, now), release(0, 7), false),
            (release(1, u64::MAX), release(0, 7), true),
            (release(1000, 1), none, false),
            (release(1001, 1), none, true),
            (release(u32::MAX, 1), release(7, 1), true),
            // A release that is behind is not ahead.
            (release(0, 1), release(3, now), false),
        ] {
            assert_eq!(next.is_far_ahead_of(last), far, "{next} after {last}");
        }
    }

    #[test]
    fn a_tally_counts_what_is_no_number_as_nothing() {
        let mut tally = Tally::default();
        tally.count(Verdict::Converged, Some(0.5), 10, Some(true));
        tally.count(Verdict::StepLimit, Some(f32::NAN), 20, None);
        tally.count(Verdict::Converged, None, 30, Some(false));
        assert_eq!((tally.poses(), tally.judged), (3, 2));
        assert_eq!((tally.refined, tally.reached), (2, 1));
        assert_eq!((tally.probability_millionths, tally.micros), (500_000, 60));
    }
}
