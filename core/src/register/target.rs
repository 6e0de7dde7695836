//! What a registration keeps of its target.

use crate::dims::{FEATURES, HEAD, TARGETS_KEPT};
use crate::float::{self, TargetHalf};
use crate::numbers::Numbers;
use crate::quant::{self, TargetSums};

/// Feature of the target, and what it adds to the heads where that is kept.
#[derive(Clone, Debug)]
pub(super) struct Target(Numbers<FloatTarget, QuantTarget>);

/// In f32.
#[derive(Clone, Debug)]
pub(super) struct FloatTarget {
    pub(super) feature: float::Feature,
    pub(super) halves: [TargetHalf; TARGETS_KEPT],
}

/// In integers.
#[derive(Clone, Debug)]
pub(super) struct QuantTarget {
    pub(super) feature: quant::Feature,
    pub(super) sums: [TargetSums; TARGETS_KEPT],
}

impl QuantTarget {
    const ZERO: Self = QuantTarget {
        feature: quant::Feature::ZERO,
        sums: [[0; HEAD[0]]; TARGETS_KEPT],
    };
}

impl Target {
    /// None yet.
    pub(super) const NONE: Target = Target(Numbers::Int8(QuantTarget::ZERO));

    /// The one seen by a network in f32.
    pub(super) fn as_floats(&self) -> Option<&FloatTarget> {
        match &self.0 {
            Numbers::F32(target) => Some(target),
            Numbers::Int8(_) => None,
        }
    }

    /// The one seen by a network in integers.
    pub(super) fn as_integers(&self) -> Option<&QuantTarget> {
        match &self.0 {
            Numbers::Int8(target) => Some(target),
            Numbers::F32(_) => None,
        }
    }

    /// The place of one that a network in f32 sees.
    pub(super) fn floats(&mut self) -> &mut FloatTarget {
        self.0.floats(|| FloatTarget {
            feature: [0.0; FEATURES],
            halves: [[0.0; HEAD[0]]; TARGETS_KEPT],
        })
    }

    /// The place of one that a network in integers sees.
    pub(super) fn integers(&mut self) -> &mut QuantTarget {
        self.0.integers(|| QuantTarget::ZERO)
    }
}
