//! The paper's tables as text.

use crate::eval::{Outcome, Row, StepRow};
use std::fmt::Write;

const COLUMNS: &str =
    "MAE R     MAE t    ISO R     ISO t    ADI AUC   CD~       ISO R med   recall   T med   T p95";
const UNITS: &str =
    "deg                deg                %         x1e-3     deg         %        ms      ms";

/// One row a method, in the paper's column order.
pub(super) fn methods(outcomes: &[Outcome]) -> String {
    let width = outcomes
        .iter()
        .map(|o| o.name.len())
        .max()
        .unwrap_or(0)
        .max("method".len());
    let mut text = format!("{:width$}  {COLUMNS}\n{:width$}  {UNITS}\n", "method", "");
    for outcome in outcomes {
        row(&mut text, &format!("{:width$}", outcome.name), &outcome.row);
    }
    text
}

/// One row a step, as the paper's step-by-step table; times are cumulative.
pub(super) fn steps(name: &str, rows: &[StepRow]) -> String {
    let mut text = format!("{name}, step by step\nstep  {COLUMNS}\n      {UNITS}\n");
    for StepRow { step, row: values } in rows {
        let label = if *step == 0 {
            "init".into()
        } else {
            step.to_string()
        };
        row(&mut text, &format!("{label:4}"), values);
    }
    text
}

fn row(text: &mut String, label: &str, row: &Row) {
    let s = &row.summary;
    writeln!(
        text,
        "{label}  {:<9.3} {:<8.4} {:<9.3} {:<8.4} {:<9.1} {:<9.4} {:<11.3} {:<8.0} {:<7.2} {:.2}",
        s.r_mae_deg,
        s.t_mae,
        s.r_iso_deg,
        s.t_iso,
        s.adi_auc_pct,
        1e3 * s.chamfer_mod,
        s.r_iso_median_deg,
        100.0 * s.recall_r5_t005,
        row.ms_median,
        row.ms_p95,
    )
    .expect("writing to a string cannot fail");
}
