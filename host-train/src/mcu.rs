//! What a registration costs on microcontrollers, as counted in QEMU: flash, RAM, instructions. Simulated
//! instructions are not cycles of silicon: memory, caches and dual issue are not in them.

use crate::board::{
    Board, BoardError, Kind, Simulation, build_image, check_simulator, flash_content,
};
use crate::dataset::procedural;
use crate::export::{ExportError, WeightFile};
use crate::image::{self, ImageError};
use crate::latency::CALIBRATION;
use crate::nn::{Parameters, Shape};
use crate::protocol::{self, Protocol};
use crate::publish;
use reagent_core::dims::{CLOUD_BYTES, STEPS};
use reagent_core::wire::{self, CloudView, Message, REQUEST_OVERHEAD_BYTES, RefineRequest};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use std::path::Path;

/// Points of each cloud.
const POINTS: usize = 1024;

/// Why nothing could be measured.
#[derive(Debug, thiserror::Error)]
pub enum McuError {
    /// The board.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The image.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// An image that can panic.
    #[error("the image can panic: {0} is linked")]
    Panics(String),
    /// The policy.
    #[error(transparent)]
    Export(#[from] ExportError),
    /// The flash's file.
    #[error("cannot write {path}: {reason}")]
    Flash {
        /// The file.
        path: String,
        /// What the system said.
        reason: std::io::Error,
    },
    /// The board's answer.
    #[error("the board refused: {0}")]
    Refused(wire::Reason),
}

/// What one board needs for a registration of 1024 points in ten steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Budget {
    /// Its name.
    pub board: String,
    /// Widths of the policy's network.
    pub network: String,
    /// Flash of the policy.
    pub policy_bytes: usize,
    /// Flash of a program that registers and nothing else: the library, start-up code and vectors.
    pub library_bytes: usize,
    /// Flash of the whole program of the simulated board, frames and serial line included.
    pub program_bytes: usize,
    /// RAM of both clouds.
    pub cloud_bytes: usize,
    /// RAM of everything but the stack, clouds included.
    pub static_bytes: usize,
    /// RAM that the stack has reached.
    pub stack_bytes: usize,
    /// Multiply-adds.
    pub multiply_adds: u64,
    /// Instructions, simulated.
    pub instructions: u64,
    /// Instructions of the longest slice of the work, simulated: nothing else runs for as long.
    pub slice_instructions: u64,
    /// Instructions of the target's embedding by its multiply-adds.
    pub instructions_per_multiply_add: f64,
}

/// Every board with the policy, and with one of the compact shape, in 8 bits: untrained, since what is in the
/// weights costs nothing.
///
/// # Errors
/// See [`McuError`].
pub fn measure_all(file: &WeightFile, seed: u64) -> Result<Vec<Budget>, McuError> {
    check_simulator()?;
    let models = procedural::models(seed, CALIBRATION);
    let pairs = protocol::draw(&models, Protocol::M40Models, CALIBRATION, seed);
    let in_bytes = |parameters| WeightFile::from_parameters_int8(&parameters, &pairs);
    let given = match file.parameters(seed) {
        Ok(parameters) => &in_bytes(parameters)?,
        Err(ExportError::Integers) => file,
        Err(error) => return Err(error.into()),
    };
    let compact = in_bytes(Parameters::random(Shape::COMPACT, seed))?;
    let mut budgets = Vec::new();
    for (policy, kind) in [given, &compact]
        .into_iter()
        .flat_map(|policy| Kind::ALL.map(|kind| (policy, kind)))
    {
        budgets.push(measure(kind, policy, &pairs.source[0], &pairs.target[0])?);
    }
    Ok(budgets)
}

/// Runs a registration on a simulated board that counts instructions.
fn measure(
    kind: Kind,
    policy: &WeightFile,
    source: &[[f32; 3]],
    target: &[[f32; 3]],
) -> Result<Budget, McuError> {
    let manifest = publish::manifest(1, "", policy).expect("no name is short enough");
    let image = build_image(kind)?;
    let library = image::read(&image.with_file_name("registration"))?;
    for image in [&image::read(&image)?, &library] {
        if let Some(symbol) = image.panics.first() {
            return Err(McuError::Panics(symbol.clone()));
        }
    }
    let flash = std::env::temp_dir().join(format!("reagent-{}-{kind:?}", std::process::id()));
    let written = std::fs::write(&flash, flash_content(&manifest, policy.bytes()));
    written.map_err(|reason| McuError::Flash {
        path: flash.display().to_string(),
        reason,
    })?;
    let report = run(kind, &image, &flash, source, target);
    std::fs::remove_file(&flash).ok();
    let report = report?;

    let instructions = |ticks: u32| u64::from(ticks) * 1_000_000_000 / u64::from(report.hertz);
    let shape = policy.policy().shape;
    let embedding = (POINTS * shape.macs_per_point()) as u64;
    let target = embedding + shape.macs_half() as u64;
    let steps = STEPS as u64;
    let total = instructions(report.target_ticks) + steps * instructions(report.step_ticks);
    Ok(Budget {
        board: kind.name().to_owned(),
        network: widths(&shape),
        policy_bytes: policy.bytes().len(),
        library_bytes: library.flash_bytes,
        program_bytes: report.program_bytes as usize,
        cloud_bytes: CLOUD_BYTES,
        static_bytes: report.static_bytes as usize,
        stack_bytes: report.stack_bytes as usize,
        multiply_adds: target + steps * (embedding + shape.macs_step() as u64),
        instructions: total,
        slice_instructions: instructions(report.slice_ticks),
        instructions_per_multiply_add: instructions(report.target_ticks) as f64 / target as f64,
    })
}

fn widths(shape: &reagent_core::Shape) -> String {
    let widths = shape.embed.iter().chain(&shape.head);
    let widths: Vec<String> = widths.map(usize::to_string).collect();
    widths.join("-")
}

/// Two steps: the others are alike.
fn run(
    kind: Kind,
    image: &Path,
    flash: &Path,
    source: &[[f32; 3]],
    target: &[[f32; 3]],
) -> Result<wire::Board, McuError> {
    let simulation = Simulation {
        flash: Some(flash),
        count_instructions: true,
    };
    let request = RefineRequest {
        max_steps: 2,
        budget_ms: u32::MAX,
        ..RefineRequest::new(1, CloudView::of(source), CloudView::of(target))
    };
    let mut buffer = vec![0; REQUEST_OVERHEAD_BYTES + CLOUD_BYTES];
    let frame = wire::encode(&Message::RefineRequest(request), &mut buffer)
        .expect("drawn clouds have 1024 points");
    let mut board = Board::start(kind, image, simulation)?;
    board.status_and_report()?;
    board
        .refine(frame, |_| ControlFlow::Continue(()))?
        .map_err(|refusal| McuError::Refused(refusal.reason))?;
    Ok(board.ask()?.1)
}

/// What has become worse than `before` by more than a twentieth, a line each.
pub fn regressions(now: &Budget, before: &Budget) -> Vec<String> {
    let bytes = |what: fn(&Budget) -> usize| (what(now) as f64, what(before) as f64);
    let numbers = [
        ("library bytes", bytes(|b| b.library_bytes)),
        ("program bytes", bytes(|b| b.program_bytes)),
        ("static bytes", bytes(|b| b.static_bytes)),
        ("stack bytes", bytes(|b| b.stack_bytes)),
        (
            "instructions",
            (now.instructions as f64, before.instructions as f64),
        ),
        (
            "instructions of a slice",
            (
                now.slice_instructions as f64,
                before.slice_instructions as f64,
            ),
        ),
    ];
    numbers
        .into_iter()
        .filter(|(_, (now, before))| *now > *before * 1.05)
        .map(|(what, (now, before))| format!("{what}: {now} where {before} were committed"))
        .collect()
}

/// Where the table begins in a page, and where it ends.
const MARKS: [&str; 2] = ["<!-- host-train bench --mcu -->\n", "<!-- end -->\n"];

/// `page` with its table replaced; `None` where it has no place for one.
pub fn with_table(page: &str, budgets: &[Budget]) -> Option<String> {
    let [begin, end] = MARKS;
    let (before, rest) = page.split_once(begin)?;
    let (_, after) = rest.split_once(end)?;
    Some(format!("{before}{begin}{}{end}{after}", table(budgets)))
}

/// A row of the table: what it is, and its cell for a board.
type Row = (&'static str, fn(&Budget) -> String);

/// A table in Markdown, a column for each board.
fn table(budgets: &[Budget]) -> String {
    let rows: [Row; 10] = [
        ("flash, policy", |b| grouped(b.policy_bytes)),
        (
            "flash, library: a program that registers and nothing else",
            |b| grouped(b.library_bytes),
        ),
        ("flash, the simulated board's whole program", |b| {
            grouped(b.program_bytes)
        }),
        ("RAM, clouds", |b| grouped(b.cloud_bytes)),
        ("RAM, everything but the stack, clouds included", |b| {
            grouped(b.static_bytes)
        }),
        ("RAM, stack at its highest", |b| grouped(b.stack_bytes)),
        ("RAM, together", |b| grouped(b.static_bytes + b.stack_bytes)),
        ("multiply-adds", |b| millions(b.multiply_adds)),
        ("instructions, simulated", |b| millions(b.instructions)),
        ("instructions of the longest slice", |b| {
            millions(b.slice_instructions)
        }),
    ];
    let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
    let row = |(what, cell): &Row| {
        let cells = budgets.iter().map(cell);
        line([(*what).to_owned()].into_iter().chain(cells).collect())
    };
    let mut text = row(&("", |b| format!("{}, {}", b.board, b.network)));
    text += &"|---".repeat(budgets.len() + 1);
    text += "|\n";
    text.extend(rows.iter().map(row));
    text += &row(&("instructions per multiply-add of the embedding", |b| {
        format!("{:.3}", b.instructions_per_multiply_add)
    }));
    text
}

/// Bytes with their thousands apart.
fn grouped(bytes: usize) -> String {
    let digits = bytes.to_string();
    let groups: Vec<&str> = digits
        .as_bytes()
        .rchunks(3)
        .rev()
        .map(|group| std::str::from_utf8(group).unwrap_or_default())
        .collect();
    format!("{} B", groups.join(" "))
}

fn millions(count: u64) -> String {
    format!("{:.1} M", count as f64 / 1e6)
}
