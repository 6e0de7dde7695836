use super::*;

fn committed() -> Vec<Budget> {
    let file = include_str!("../../../../firmware-sim/cortex-m/budget.json");
    serde_json::from_str(file).expect("budgets")
}

/// What is said where one number of the first row is another.
fn said(change: impl Fn(&mut Budget)) -> Vec<String> {
    let mut now = committed();
    change(&mut now[0]);
    complaints(&now, &committed())
}

#[test]
fn what_is_committed_is_within_every_budget() {
    assert_eq!(complaints(&committed(), &committed()), [""; 0]);
    let limited: Vec<usize> = committed().iter().map(|b| limits(b).len()).collect();
    assert_eq!(limited, [7, 7, 6, 6]);
}

#[test]
fn a_twentieth_more_and_every_excess_are_told() {
    assert_eq!(said(|b| b.instructions += b.instructions / 30), [""; 0]);
    type Change = (fn(&mut Budget), &'static str);
    let changes: [Change; 8] = [
        (|b| b.instructions += b.instructions / 10, "instructions"),
        (|b| b.policy_bytes = FLASH_BUDGET + 1, "bytes of the policy"),
        (
            |b| b.library_bytes = CODE_BUDGET + 1,
            "bytes of the library",
        ),
        (|b| b.static_bytes += 4096, "bytes of RAM"),
        (
            |b| b.grid_ram_bytes = GRID_RAM_BUDGET + 1,
            "bytes of RAM on a grid",
        ),
        (|b| b.stack_bytes = STACK_BUDGET + 1, "bytes of stack"),
        (
            |b| b.multiply_adds = MULTIPLY_ADD_BUDGET + 1,
            "multiply-adds",
        ),
        (
            |b| b.instructions_per_multiply_add = CORTEX_M7_INSTRUCTION_BUDGET + 0.01,
            "instructions per multiply-add",
        ),
    ];
    for (change, what) in changes {
        let lines = said(change);
        assert!(lines.iter().any(|line| line.contains(what)), "{what}");
        assert!(
            lines
                .iter()
                .all(|line| line.starts_with("Cortex-M7, 64-128"))
        );
    }
}

#[test]
fn a_row_that_is_missing_is_told_on_either_side() {
    let all = committed();
    let missing = complaints(&all, &all[1..]);
    assert_eq!(missing, ["Cortex-M7, 64-128-1024-512-256: not in the file"]);
    let missing = complaints(&all[..3], &all);
    assert_eq!(missing, ["Cortex-M55, 64-64-384-128-64: not measured"]);
}
