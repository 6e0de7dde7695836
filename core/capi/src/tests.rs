use super::*;
use core::ptr::{null, null_mut};
use reagent_core::Pose;

mod depth;
mod far;
mod grid;
mod linked;
mod refused;
mod status;
#[cfg(feature = "pretrained-compact")]
mod steps;
mod whole;

fn memory() -> Box<ReagentMemory> {
    Box::new(ReagentMemory {
        words: [u64::MAX; REAGENT_MEMORY_WORDS],
    })
}

fn model() -> Box<ReagentModel> {
    Box::new(ReagentModel {
        words: [u64::MAX; REAGENT_MODEL_WORDS],
    })
}

fn workspace() -> Box<ReagentWorkspace> {
    Box::new(ReagentWorkspace {
        words: [u64::MAX; REAGENT_WORKSPACE_WORDS],
    })
}

/// A policy on a 4-byte boundary.
#[cfg(feature = "pretrained-compact")]
fn compact() -> &'static [u8] {
    reagent_core::Policy::pretrained_compact_bytes()
}

/// Points on a bracket's surface, in the order of a lattice; lattices with different offsets share no points.
fn bracket(offset: f32) -> Vec<[f32; 3]> {
    let point = |i: u16| {
        let [a, b] = [0.754_877_7, 0.569_840_3].map(|step| (f32::from(i) * step + offset).fract());
        match i % 3 {
            0 => [100.0 * a, 40.0 * b, 0.0],
            1 => [100.0 * a, 0.0, 60.0 * b],
            _ => [30.0 * a, 40.0, 20.0 * b],
        }
    };
    (0..600).map(point).collect()
}
