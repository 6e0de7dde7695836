//! Working memory of the network, in whichever number format it is.

use crate::float::FloatScratch;
use crate::numbers::Numbers;
use crate::quant::QuantScratch;
use crate::weights::Network;

/// Working memory of one network evaluation; the caller owns it.
#[derive(Clone, Debug)]
pub struct Scratch {
    /// One of the number formats at a time, in the same place.
    memory: Numbers<FloatScratch, QuantScratch>,
    /// Counts the clouds whose embedding has begun here: the memory belongs to the last one.
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

    /// Makes it ready for the first points of a cloud; the new generation.
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

    /// The memory of a network in f32; zeroed where it was that of another.
    pub(crate) fn floats(&mut self) -> &mut FloatScratch {
        self.memory.floats(FloatScratch::zero)
    }

    /// The memory of a network in integers; zeroed where it was that of another.
    pub(crate) fn integers(&mut self) -> &mut QuantScratch {
        self.memory.integers(|| QuantScratch::ZERO)
    }
}

impl Default for Scratch {
    fn default() -> Self {
        Self::new()
    }
}
