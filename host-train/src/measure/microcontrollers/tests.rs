use super::*;

fn committed() -> Measured {
    let file = include_str!("../../../../firmware-sim/cortex-m/budget.json");
    serde_json::from_str(file).expect("budgets")
}

/// Complaints after a change to the first row.
fn said(change: impl Fn(&mut Budget)) -> Vec<String> {
    let mut now = committed();
    change(&mut now.registration[0]);
    complaints(&now, &committed())
}

#[test]
fn what_is_committed_is_within_every_budget() {
    assert_eq!(complaints(&committed(), &committed()), [""; 0]);
    let Measured {
        registration,
        refinement,
    } = committed();
    let limited: Vec<usize> = registration.iter().map(|b| limits(b).len()).collect();
    assert_eq!(limited, [7, 7, 6, 6]);
    let limited: Vec<usize> = refinement.iter().map(|b| b.limits().len()).collect();
    assert_eq!(limited, [6, 6]);
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
fn so_are_those_of_a_refinement() {
    let said = |change: fn(&mut Refinement)| {
        let mut now = committed();
        change(&mut now.refinement[1]);
        complaints(&now, &committed())
    };
    assert_eq!(said(|b| b.instructions += b.instructions / 30), [""; 0]);
    type Change = (fn(&mut Refinement), &'static str);
    let changes: [Change; 7] = [
        (|b| b.program_bytes *= 2, "bytes of the program"),
        (|b| b.static_bytes += 1 << 20, "bytes of RAM"),
        (|b| b.stack_bytes *= 2, "stack bytes"),
        (|b| b.verify_stack_bytes *= 2, "bytes of stack"),
        (|b| b.target_instructions *= 2, "to make a target ready"),
        (|b| b.instructions *= 2, "instructions of a refinement"),
        (
            |b| b.verify_instructions *= 2,
            "instructions of a verification",
        ),
    ];
    for (change, what) in changes {
        let lines = said(change);
        assert!(lines.iter().any(|line| line.contains(what)), "{what}");
        let of = |line: &String| line.starts_with("Cortex-M55, refinement: ");
        assert!(lines.iter().all(of), "{lines:?}");
    }
}

#[test]
fn a_row_that_is_missing_is_told_on_either_side() {
    let all = committed();
    let [mut without_first, mut without_last] = [all.clone(), all.clone()];
    without_first.registration.remove(0);
    without_first.refinement.remove(0);
    assert_eq!(
        complaints(&all, &without_first),
        [
            "Cortex-M7, 64-128-1024-512-256: not in the file",
            "Cortex-M7, refinement: not in the file"
        ]
    );
    without_last.registration.pop();
    without_last.refinement.pop();
    assert_eq!(
        complaints(&without_last, &all),
        [
            "Cortex-M55, 64-64-384-128-64: not measured",
            "Cortex-M55, refinement: not measured"
        ]
    );
}
