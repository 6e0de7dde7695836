//! What registration and refinement cost on microcontrollers, as counted in QEMU: flash, RAM, instructions.
//! Simulated instructions are not cycles of silicon: they leave out memory, caches and dual issue.

use crate::dataset::procedural;
use crate::measure::elf::{self, ImageError};
use crate::measure::latency::CALIBRATION;
use crate::policy::manifest::manifest;
use crate::policy::{ExportError, WeightFile};
use crate::protocol::{self, Protocol};
use crate::register::in_order;
use reagent_core::Policy;
use reagent_core::budget::{
    CLOUD_BYTES, CODE_BUDGET, COMPACT_FLASH_BUDGET, COMPACT_MULTIPLY_ADD_BUDGET,
    CORTEX_M7_INSTRUCTION_BUDGET, CORTEX_M55_INSTRUCTION_BUDGET, FLASH_BUDGET, GRID_RAM_BUDGET,
    MULTIPLY_ADD_BUDGET, RAM_BUDGET, STACK_BUDGET,
};
use reagent_core::dims::STEPS;
use reagent_core::grid::Grid;
use reagent_core::wire::{self, CloudView, Message, REQUEST_OVERHEAD_BYTES, RefineRequest};
use reagent_link::board::{
    Board, BoardError, Clouds, Kind, Simulation, build_image, check_simulator, flash_content,
};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use std::path::Path;

mod refinement;
mod table;

pub use refinement::Refinement;
pub use table::with_tables;

/// Points of each cloud.
const POINTS: usize = 1024;

/// Why nothing could be measured.
#[derive(Debug, thiserror::Error)]
pub enum McuError {
    /// The board could not be run.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The image could not be inspected.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The image can panic.
    #[error("the image can panic: {0} is linked")]
    Panics(String),
    /// The policy could not be converted to 8 bits.
    #[error(transparent)]
    Export(#[from] ExportError),
    /// The flash's file could not be written.
    #[error("cannot write {path}: {reason}")]
    Flash {
        /// The file.
        path: String,
        /// What the system said.
        reason: std::io::Error,
    },
    /// The board refused the request.
    #[error("the board refused: {0}")]
    Refused(wire::Reason),
}

/// What one board needs for a registration of 1024 points in ten steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Budget {
    /// Name of the board.
    pub board: String,
    /// Widths of the policy's network.
    pub network: String,
    /// Flash of the policy, bytes.
    pub policy_bytes: usize,
    /// Flash of a program that registers and nothing else: the library, start-up code and vectors.
    pub library_bytes: usize,
    /// Flash of the whole program of the simulated board, frames and serial line included.
    pub program_bytes: usize,
    /// RAM of both clouds, bytes.
    pub cloud_bytes: usize,
    /// RAM of everything but the stack, clouds included, bytes.
    pub static_bytes: usize,
    /// Largest extent of the stack, bytes.
    pub stack_bytes: usize,
    /// RAM of the image whose clouds are 16-bit grid codes, stack included, bytes.
    pub grid_ram_bytes: usize,
    /// Multiply-adds of a registration if every step looks at all points.
    pub multiply_adds: u64,
    /// Simulated instructions of a registration.
    pub instructions: u64,
    /// Simulated instructions of the longest slice of the work, the longest time for which nothing else runs.
    pub slice_instructions: u64,
    /// Simulated instructions of the target's embedding, divided by its multiply-adds.
    pub instructions_per_multiply_add: f64,
}

/// All measurements.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Registration, by board and policy.
    pub registration: Vec<Budget>,
    /// Refinement, by board.
    pub refinement: Vec<Refinement>,
}

/// Measures registration on every board, in 8 bits, with the given policy and the compact one, and then refinement.
///
/// # Errors
/// See [`McuError`].
pub fn measure_all(file: &WeightFile, seed: u64) -> Result<Measured, McuError> {
    check_simulator()?;
    let models = procedural::models(seed, CALIBRATION);
    let pairs = protocol::draw(&models, Protocol::M40Models, CALIBRATION, seed);
    let given = match file.parameters(seed) {
        Ok(parameters) => {
            let integers = WeightFile::from_parameters_int8(&parameters, &pairs)?;
            &integers.run_like(&file.policy())
        }
        Err(ExportError::Integers) => file,
        Err(error) => return Err(error.into()),
    };
    let compact = WeightFile::from_bytes(Policy::pretrained_compact_bytes());
    let compact = compact.expect("a test checks the linked policy");
    let mut registration = Vec::new();
    for (policy, kind) in [given, &compact]
        .into_iter()
        .flat_map(|policy| Kind::ALL.map(|kind| (policy, kind)))
    {
        registration.push(measure(kind, policy, &pairs.source[0], &pairs.target[0])?);
    }
    let refinement = Kind::ALL.map(|kind| refinement::measure(kind, &pairs));
    Ok(Measured {
        registration,
        refinement: refinement.into_iter().collect::<Result<_, _>>()?,
    })
}

/// Runs registrations on two simulated boards: one that counts instructions, one whose clouds are on a grid.
fn measure(
    kind: Kind,
    policy: &WeightFile,
    source: &[[f32; 3]],
    target: &[[f32; 3]],
) -> Result<Budget, McuError> {
    let [source, target] = [source, target].map(|cloud| in_order(cloud.to_vec()));
    let manifest = manifest(1, "", policy).expect("no name is short enough");
    let image = build_image(kind, Clouds::Floats)?;
    let grid_image = build_image(kind, Clouds::Grid)?;
    let library = elf::read(&image.with_file_name("registration"))?;
    for image in [&elf::read(&image)?, &elf::read(&grid_image)?, &library] {
        cannot_panic(image)?;
    }
    let flash = std::env::temp_dir().join(format!("reagent-{}-{kind:?}", std::process::id()));
    let written = std::fs::write(&flash, flash_content(&manifest, policy.bytes()));
    written.map_err(|reason| McuError::Flash {
        path: flash.display().to_string(),
        reason,
    })?;
    let mut simulation = Simulation {
        flash: Some(&flash),
        count_instructions: true,
    };
    let floats = [&source, &target].map(|cloud| CloudView::of(cloud));
    let report = run(kind, &image, simulation, floats);
    simulation.count_instructions = false;
    let [source, target] = [&source, &target].map(|cloud| on_grid(cloud));
    let codes = [&source, &target].map(|(grid, codes)| CloudView::on_grid(*grid, codes));
    let on_grid = run(kind, &grid_image, simulation, codes);
    std::fs::remove_file(&flash).ok();
    let (report, on_grid) = (report?, on_grid?);

    let instructions = |ticks: u32| instructions(ticks, &report);
    let shape = policy.policy().shape;
    let target = POINTS * shape.macs_per_point();
    let total = instructions(report.target_ticks) + instructions(report.steps_ticks);
    Ok(Budget {
        board: kind.name().to_owned(),
        network: widths(&shape),
        policy_bytes: policy.bytes().len(),
        library_bytes: library.flash_bytes,
        program_bytes: report.program_bytes as usize,
        cloud_bytes: CLOUD_BYTES,
        static_bytes: report.static_bytes as usize,
        stack_bytes: report.stack_bytes as usize,
        grid_ram_bytes: (on_grid.static_bytes + on_grid.stack_bytes) as usize,
        multiply_adds: shape.macs_registration(POINTS, STEPS),
        instructions: total,
        slice_instructions: instructions(report.slice_ticks),
        instructions_per_multiply_add: instructions(report.target_ticks) as f64 / target as f64,
    })
}

/// Refuses an image that can panic.
fn cannot_panic(image: &elf::Image) -> Result<(), McuError> {
    match image.panics.first() {
        Some(symbol) => Err(McuError::Panics(symbol.clone())),
        None => Ok(()),
    }
}

fn widths(shape: &reagent_core::Shape) -> String {
    let widths = shape.embed.iter().chain(&shape.head);
    let widths: Vec<String> = widths.map(usize::to_string).collect();
    widths.join("-")
}

/// Encodes a cloud on its finest grid.
fn on_grid(cloud: &[[f32; 3]]) -> (Grid, Vec<[i16; 3]>) {
    let grid = Grid::of(cloud).expect("drawn clouds are finite");
    let codes = cloud.iter().map(|&point| grid.encode(point)).collect();
    (grid, codes)
}

fn run(
    kind: Kind,
    image: &Path,
    simulation: Simulation<'_>,
    [source, target]: [CloudView<'_>; 2],
) -> Result<wire::Board, McuError> {
    let request = RefineRequest {
        max_steps: STEPS as u8,
        budget_ms: u32::MAX,
        ..RefineRequest::new(1, source, target)
    };
    let mut board = Board::start(kind, image, simulation)?;
    board.status_and_report()?;
    ask(&mut board, request)
}

/// Has a board serve a request, and returns its report afterwards.
fn ask(board: &mut Board, request: RefineRequest<'_>) -> Result<wire::Board, McuError> {
    let mut buffer = vec![0; REQUEST_OVERHEAD_BYTES + CLOUD_BYTES];
    let frame = wire::encode(&Message::RefineRequest(request), &mut buffer)
        .expect("drawn clouds have 1024 points");
    board
        .refine(frame, |_| ControlFlow::Continue(()))?
        .map_err(|refusal| McuError::Refused(refusal.reason))?;
    Ok(board.ask()?.1)
}

/// Converts a board's ticks to instructions.
fn instructions(ticks: u32, report: &wire::Board) -> u64 {
    u64::from(ticks) * 1_000_000_000 / u64::from(report.hertz)
}

/// Reasons not to commit these numbers, a line each: rows that are worse than in `before`, that only one of both
/// has, or that are over budget.
pub fn complaints(now: &Measured, before: &Measured) -> Vec<String> {
    let of_registration = rows(
        [&now.registration, &before.registration],
        |budget| format!("{}, {}", budget.board, budget.network),
        |now, before| regressions(&now.compared(), &before.compared()),
        |now| excesses(limits(now)),
    );
    let of_refinement = rows(
        [&now.refinement, &before.refinement],
        |budget| format!("{}, refinement", budget.board),
        |now, before| regressions(&now.compared(), &before.compared()),
        |now| excesses(now.limits()),
    );
    [of_registration, of_refinement].concat()
}

/// Complaints about rows, each preceded by the row's name.
fn rows<T>(
    [now, before]: [&[T]; 2],
    name: fn(&T) -> String,
    worse: fn(&T, &T) -> Vec<String>,
    over: fn(&T) -> Vec<String>,
) -> Vec<String> {
    let find = |budgets: &'_ [T], of: &T| budgets.iter().position(|row| name(row) == name(of));
    let mut lines = Vec::new();
    for budget in now {
        let worse = match find(before, budget) {
            Some(at) => worse(budget, &before[at]),
            None => vec!["not in the file".to_owned()],
        };
        let all = worse.into_iter().chain(over(budget));
        lines.extend(all.map(|line| format!("{}: {line}", name(budget))));
    }
    let gone = before.iter().filter(|before| find(now, before).is_none());
    lines.extend(gone.map(|before| format!("{}: not measured", name(before))));
    lines
}

/// A limit of [`reagent_core::budget`]: what is limited, the measured value, the allowed value.
pub type Limit = (&'static str, f64, f64);

/// The limits that the library promises for a board.
pub fn limits(budget: &Budget) -> Vec<Limit> {
    let compact = budget.network == widths(&reagent_core::Shape::COMPACT);
    let (flash, multiply_adds) = if compact {
        (COMPACT_FLASH_BUDGET, COMPACT_MULTIPLY_ADD_BUDGET)
    } else {
        (FLASH_BUDGET, MULTIPLY_ADD_BUDGET)
    };
    let ram = budget.static_bytes + budget.stack_bytes;
    let bytes = |what, bytes: usize, most: usize| (what, bytes as f64, most as f64);
    let mut limits = vec![
        bytes("bytes of the policy", budget.policy_bytes, flash),
        bytes("bytes of the library", budget.library_bytes, CODE_BUDGET),
        bytes("bytes of RAM", ram, RAM_BUDGET),
        bytes(
            "bytes of RAM on a grid",
            budget.grid_ram_bytes,
            GRID_RAM_BUDGET,
        ),
        bytes("bytes of stack", budget.stack_bytes, STACK_BUDGET),
        (
            "multiply-adds",
            budget.multiply_adds as f64,
            multiply_adds as f64,
        ),
    ];
    if budget.network == widths(&reagent_core::Shape::FULL) {
        let most = if budget.board == Kind::CortexM7.name() {
            CORTEX_M7_INSTRUCTION_BUDGET
        } else {
            CORTEX_M55_INSTRUCTION_BUDGET
        };
        let instructions = budget.instructions_per_multiply_add;
        limits.push(("instructions per multiply-add", instructions, most));
    }
    limits
}

/// The limits that are exceeded, a line each.
fn excesses(limits: Vec<Limit>) -> Vec<String> {
    let over = limits.into_iter().filter(|(_, now, most)| now > most);
    over.map(|(what, now, most)| format!("{now} {what}, at most {most} are allowed"))
        .collect()
}

/// A number that is compared with an earlier one, after its description.
type Compared = (&'static str, f64);

impl Budget {
    fn compared(&self) -> [Compared; 7] {
        [
            ("library bytes", self.library_bytes as f64),
            ("program bytes", self.program_bytes as f64),
            ("static bytes", self.static_bytes as f64),
            ("stack bytes", self.stack_bytes as f64),
            ("bytes of RAM on a grid", self.grid_ram_bytes as f64),
            ("instructions", self.instructions as f64),
            ("instructions of a slice", self.slice_instructions as f64),
        ]
    }
}

/// Numbers that are worse than in `before` by more than a twentieth, a line each.
fn regressions(now: &[Compared], before: &[Compared]) -> Vec<String> {
    now.iter()
        .zip(before)
        .filter(|((_, now), (_, before))| *now > *before * 1.05)
        .map(|((what, now), (_, before))| format!("{what}: {now} where {before} were committed"))
        .collect()
}

#[cfg(test)]
mod tests;
