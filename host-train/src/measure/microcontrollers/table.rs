//! Writes the measurements as tables into a page.

use super::{Budget, Measured, Refinement};

/// Marks in a page: where the table of registrations begins, where that of refinements begins, and where each ends.
const MARKS: [&str; 3] = [
    "<!-- host-train bench --mcu -->\n",
    "<!-- host-train bench --mcu refinement -->\n",
    "<!-- end -->\n",
];

/// `page` with its tables replaced; `None` where it has no place for them.
pub fn with_tables(page: &str, measured: &Measured) -> Option<String> {
    let [registration, refinement, _] = MARKS;
    let page = replaced(page, registration, &registrations(&measured.registration))?;
    replaced(&page, refinement, &refinements(&measured.refinement))
}

/// `page` with `table` between the mark `begin` and the next end.
fn replaced(page: &str, begin: &str, table: &str) -> Option<String> {
    let [.., end] = MARKS;
    let (before, rest) = page.split_once(begin)?;
    let (_, after) = rest.split_once(end)?;
    Some(format!("{before}{begin}{table}{end}{after}"))
}

/// A row of a table: its label, and the cell of a board.
type Row<T> = (&'static str, fn(&T) -> String);

fn registrations(budgets: &[Budget]) -> String {
    let rows: [Row<Budget>; 13] = [
        ("", |b| format!("{}, {}", b.board, b.network)),
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
        ("RAM, together, with clouds in 16 bits", |b| {
            grouped(b.grid_ram_bytes)
        }),
        ("multiply-adds, at most", |b| millions(b.multiply_adds)),
        ("instructions, simulated", |b| millions(b.instructions)),
        ("instructions of the longest slice", |b| {
            millions(b.slice_instructions)
        }),
        ("instructions per multiply-add of the embedding", |b| {
            format!("{:.3}", b.instructions_per_multiply_add)
        }),
    ];
    table(budgets, &rows)
}

fn refinements(budgets: &[Refinement]) -> String {
    let rows: [Row<Refinement>; 9] = [
        ("", |b| b.board.clone()),
        ("flash, the whole program", |b| grouped(b.program_bytes)),
        ("RAM, everything but the stack, clouds included", |b| {
            grouped(b.static_bytes)
        }),
        ("RAM, stack at its highest: refinement", |b| {
            grouped(b.stack_bytes)
        }),
        ("RAM, stack at its highest: verification", |b| {
            grouped(b.verify_stack_bytes)
        }),
        ("RAM, together", |b| grouped(b.ram_bytes())),
        ("instructions to make the target ready, once", |b| {
            millions(b.target_instructions)
        }),
        ("instructions of a refinement", |b| millions(b.instructions)),
        ("instructions of a verification", |b| {
            millions(b.verify_instructions)
        }),
    ];
    table(budgets, &rows)
}

/// A table in Markdown with a column for each board; the first row is its head.
fn table<T>(budgets: &[T], rows: &[Row<T>]) -> String {
    let row = |(what, cell): &Row<T>| {
        let cells: Vec<String> = budgets.iter().map(cell).collect();
        format!("| {what} | {} |\n", cells.join(" | "))
    };
    let mut lines: Vec<String> = rows.iter().map(row).collect();
    lines.insert(1, format!("{}|\n", "|---".repeat(budgets.len() + 1)));
    lines.concat()
}

/// Bytes with their thousands separated.
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
