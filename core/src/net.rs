//! Working memory of the network, in either number format.

use crate::float::FloatScratch;
use crate::numbers::Numbers;
use crate::quant::QuantScratch;
use crate::weights::Network;

/// Working memory of one network evaluation; the caller owns it.
#[derive(Clone, Debug)]
pub struct Scratch {
    /// Memory for one number format at a time; both share the same place.
    memory: Numbers<FloatScratch, QuantScratch>,
    /// Counts the clouds whose embedding began here. The memory belongs to the last one.
    generation: u32,
}

impl Scratch {
    /// Zeroed working memory.
    pub const fn new() -> Self {
        Scratch {
            memory: Numbers::Int8(QuantScratch::ZERO),
            generation: 0,
        }
    }

    /// Prepares for the first points of a cloud; returns the new generation.
    pub(crate) fn claim(&mut self, network: &Network<'_>) -> u32 {
        match network {
            Numbers::Int8(_) => self.integers().clear(),
            Numbers::F32(_) => self.floats().feature.fill(f32::NEG_INFINITY),
        }
        self.generation = self.generation.wrapping_add(1);
        self.generation
    }

    /// The generation of the cloud whose embedding began last.
    pub(crate) fn generation(&self) -> u32 {
        self.generation
    }

    /// The memory of an f32 network, zeroed if it held the other format.
    pub(crate) fn floats(&mut self) -> &mut FloatScratch {
        self.memory.floats(FloatScratch::zero)
    }

    /// The memory of an integer network, zeroed if it held the other format.
    pub(crate) fn integers(&mut self) -> &mut QuantScratch {
        self.memory.integers(|| QuantScratch::ZERO)
    }
}

impl Default for Scratch {
    fn default() -> Self {
        Self::new()
    }
}
