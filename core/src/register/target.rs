//! What a registration stores of its target.

use crate::dims::{FEATURES, HEAD, TARGETS_KEPT};
use crate::float::{self, TargetHalf};
use crate::numbers::Numbers;
use crate::quant::{self, TargetSums};

/// The target's feature, and its share of the heads' first layers if that is cached.
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
    /// No target yet.
    pub(super) const NONE: Target = Target(Numbers::Int8(QuantTarget::ZERO));

    /// The target seen by an f32 network, if it is one.
    pub(super) fn as_floats(&self) -> Option<&FloatTarget> {
        match &self.0 {
            Numbers::F32(target) => Some(target),
            Numbers::Int8(_) => None,
        }
    }

    /// The target seen by an integer network, if it is one.
    pub(super) fn as_integers(&self) -> Option<&QuantTarget> {
        match &self.0 {
            Numbers::Int8(target) => Some(target),
            Numbers::F32(_) => None,
        }
    }

    /// The target for an f32 network, zeroed if it held the other format.
    pub(super) fn floats(&mut self) -> &mut FloatTarget {
        self.0.floats(|| FloatTarget {
            feature: [0.0; FEATURES],
            halves: [[0.0; HEAD[0]]; TARGETS_KEPT],
        })
    }

    /// The target for an integer network, zeroed if it held the other format.
    pub(super) fn integers(&mut self) -> &mut QuantTarget {
        self.0.integers(|| QuantTarget::ZERO)
    }
}
