//! What refinement costs beside registration: preparing the target, closest points, comparison with other poses.

use super::{Compared, Limit, McuError, ask, cannot_panic, instructions};
use crate::dataset::pairs::PairSet;
use crate::measure::elf;
use glam::Vec3;
use reagent_core::Pose;
use reagent_core::budget::{
    CORTEX_M7_REFINEMENT_BUDGET, CORTEX_M55_REFINEMENT_BUDGET, REFINEMENT_CODE_BUDGET,
    REFINEMENT_RAM_BUDGET, REFINEMENT_STACK_BUDGET,
};
use reagent_core::pose::{centroid, rotation_from_euler};
use reagent_core::wire::{CloudView, Mode, RefineRequest};
use reagent_link::board::{Board, Clouds, Kind, Simulation, build_image};
use serde::{Deserialize, Serialize};

/// What one board needs to refine the pose of clouds of 1024 points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Refinement {
    /// Name of the board.
    pub board: String,
    /// Flash of the whole program, verification, frames and serial line included, bytes.
    pub program_bytes: usize,
    /// RAM of everything but the stack, clouds included, bytes.
    pub static_bytes: usize,
    /// Largest extent of the stack in refinements, bytes.
    pub stack_bytes: usize,
    /// The same once a pose has been compared with others, too.
    pub verify_stack_bytes: usize,
    /// Simulated instructions to prepare the target, once for any number of sources.
    pub target_instructions: u64,
    /// Simulated instructions of a refinement with a prepared target.
    pub instructions: u64,
    /// Simulated instructions of a refinement with a prepared target and a comparison with other poses.
    pub verify_instructions: u64,
}

/// Refines a pose near the truth of the first pair, with a new and a prepared target, and compares it with others.
pub(super) fn measure(kind: Kind, pairs: &PairSet) -> Result<Refinement, McuError> {
    let image = build_image(kind, Clouds::Floats)?.with_file_name("refinement");
    cannot_panic(&elf::read(&image)?)?;
    let simulation = Simulation {
        flash: None,
        count_instructions: true,
    };
    let mut board = Board::start(kind, &image, simulation)?;
    board.status_and_report()?;
    let request = RefineRequest {
        initial: Some(near_truth(pairs).to_rows()),
        mode: Mode::Refine,
        ..RefineRequest::new(
            1,
            CloudView::of(&pairs.source[0]),
            CloudView::of(&pairs.target[0]),
        )
    };
    let first = ask(&mut board, request)?;
    let second = ask(&mut board, request)?;
    let verified = ask(
        &mut board,
        RefineRequest {
            mode: Mode::Verify,
            ..request
        },
    )?;
    let [whole, ready, verify] =
        [&first, &second, &verified].map(|report| instructions(report.steps_ticks, report));
    Ok(Refinement {
        board: kind.name().to_owned(),
        program_bytes: first.program_bytes as usize,
        static_bytes: first.static_bytes as usize,
        stack_bytes: second.stack_bytes as usize,
        verify_stack_bytes: verified.stack_bytes as usize,
        target_instructions: whole.saturating_sub(ready),
        instructions: ready,
        verify_instructions: verify,
    })
}

/// A pose off the truth by .1 radians about each axis and .05 of the radius along each, as in tracking.
fn near_truth(pairs: &PairSet) -> Pose {
    let off = Pose {
        rotation: rotation_from_euler(Vec3::splat(0.1)),
        translation: Vec3::splat(0.05),
    };
    off.to_global(centroid(&pairs.target[0]))
        .after(pairs.target_from_source[0])
}

impl Refinement {
    /// RAM, stack included.
    pub fn ram_bytes(&self) -> usize {
        self.static_bytes + self.verify_stack_bytes
    }

    /// The limits that the library promises for it.
    pub fn limits(&self) -> Vec<Limit> {
        let most = if self.board == Kind::CortexM7.name() {
            CORTEX_M7_REFINEMENT_BUDGET
        } else {
            CORTEX_M55_REFINEMENT_BUDGET
        };
        let limit = |what, now: usize, most: usize| (what, now as f64, most as f64);
        let instructions = |what, now: u64, most: u64| (what, now as f64, most as f64);
        let names = [
            "instructions to make a target ready",
            "instructions of a refinement",
            "instructions of a verification",
        ];
        let [target, refine, verify] = names;
        vec![
            limit(
                "bytes of the program",
                self.program_bytes,
                REFINEMENT_CODE_BUDGET,
            ),
            limit("bytes of RAM", self.ram_bytes(), REFINEMENT_RAM_BUDGET),
            limit(
                "bytes of stack",
                self.verify_stack_bytes,
                REFINEMENT_STACK_BUDGET,
            ),
            instructions(target, self.target_instructions, most[0]),
            instructions(refine, self.instructions, most[1]),
            instructions(verify, self.verify_instructions, most[2]),
        ]
    }

    pub(super) fn compared(&self) -> [Compared; 7] {
        [
            ("program bytes", self.program_bytes as f64),
            ("static bytes", self.static_bytes as f64),
            ("stack bytes", self.stack_bytes as f64),
            (
                "stack bytes of a verification",
                self.verify_stack_bytes as f64,
            ),
            (
                "instructions to make a target ready",
                self.target_instructions as f64,
            ),
            ("instructions", self.instructions as f64),
            (
                "instructions of a verification",
                self.verify_instructions as f64,
            ),
        ]
    }
}
