//! The self-test of a policy: what it must do on two clouds that every build can generate.
//!
//! Whoever ships a policy records its actions ([`Registrar::golden_actions`]); whoever receives it compares them
//! ([`Registrar::passes`]) before using it. An intact, signed policy file may still act differently on a machine: another
//! build, a kernel that is wrong there, failing memory.

use crate::dims::{LOGITS, STEPS};
use crate::error::Error;
use crate::frame::Frame;
use crate::pose::Pose;
use crate::register::Registrar;
use crate::steps::Action;

/// Points of each cloud.
pub const POINTS: usize = 128;
/// Bound on how far logits of two f32 kernels differ, relative to the largest; the true difference is smaller.
const CLOSE: f32 = 1e-4;
/// The motion applied to the source of the self-test.
const OFFSET: Action = Action {
    translation: [9, 2, 7],
    rotation: [10, 1, 8],
};

/// Actions of the first steps, up to the first that is not a clear choice.
pub type GoldenActions = heapless::Vec<Action, STEPS>;

/// Source and target of the self-test: an L-shaped bracket, moved by a fixed offset.
pub fn clouds() -> [[[f32; 3]; POINTS]; 2] {
    let mut clouds = [[[0.0; 3]; POINTS]; 2];
    let [source, target] = &mut clouds;
    clouds_in(source, target);
    clouds
}

/// As [`clouds`], in place.
pub fn clouds_in(source: &mut [[f32; 3]; POINTS], target: &mut [[f32; 3]; POINTS]) {
    let mut state = 1u32;
    let mut unit = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let offset = OFFSET.update();
    for (i, (point, moved)) in target.iter_mut().zip(source).enumerate() {
        let (u, v) = (1.2 * unit() - 0.6, 0.7 * unit());
        *point = if i % 2 == 0 { [u, v, 0.0] } else { [u, 0.0, v] };
        *moved = offset.apply((*point).into()).to_array();
    }
}

impl Registrar<'_, '_> {
    /// What this policy does on [`clouds`], up to the first step that is not a clear choice: there, f32 kernels may differ.
    ///
    /// # Errors
    /// None, since the clouds are valid; see [`Registrar::start`].
    pub fn golden_actions(&mut self) -> Result<GoldenActions, Error> {
        let [source, target] = clouds();
        let mut registration = self.start(&source, &target, Frame::IDENTITY, Pose::IDENTITY)?;
        let decision = self.policy.decision;
        let mut actions = GoldenActions::new();
        while !actions.is_full() {
            let step = self.step(&mut registration)?;
            let clear = |logits: &[f32; LOGITS]| {
                let most = logits.iter().fold(1.0, |most: f32, &x| most.max(x.abs()));
                decision.is_clear(logits, CLOSE * most)
            };
            if !clear(&step.logits_t) || !clear(&step.logits_r) {
                break;
            }
            // The loop condition ensures room.
            actions.push(step.action).ok();
        }
        Ok(actions)
    }

    /// Whether this policy takes the `expected` actions here.
    ///
    /// # Errors
    /// As [`Registrar::golden_actions`].
    pub fn passes(&mut self, expected: &[Action]) -> Result<bool, Error> {
        let [source, target] = clouds();
        let mut registration = self.start(&source, &target, Frame::IDENTITY, Pose::IDENTITY)?;
        for &action in expected {
            if self.step(&mut registration)?.action != action {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

#[cfg(all(test, feature = "pretrained"))]
mod tests {
    use super::*;
    use crate::kernels::Isa;
    use crate::net::Scratch;
    use crate::weights::Policy;

    #[test]
    fn every_kernel_takes_the_golden_actions() {
        let policy = || Policy::pretrained().expect("a sound policy");
        let mut scratch = Scratch::new();
        let actions = Registrar::with_isa(Isa::PORTABLE, policy(), &mut scratch)
            .golden_actions()
            .expect("two good clouds");
        assert!(actions.len() >= 2, "{actions:?}");
        for isa in Isa::all() {
            let mut registrar = Registrar::with_isa(isa, policy(), &mut scratch);
            assert_eq!(registrar.passes(&actions), Ok(true), "{}", isa.name());
            let mut other = actions.clone();
            other[1].rotation[2] ^= 1;
            assert_eq!(registrar.passes(&other), Ok(false), "{}", isa.name());
        }
    }
}
