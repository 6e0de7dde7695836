//! The paper's tables as text.

use crate::measure::agreement::Agreement;
use crate::measure::eval::{Outcome, Row, StepRow};
use crate::measure::method::Contestant;
use crate::measure::sweep::Varied;
use clap::ValueEnum;
use std::fmt::Write;

const COLUMNS: &str = "MAE R     MAE t    ISO R     ISO t    ADI AUC   CD~       ISO R med   recall   AD<.10 <.05 <.02   T med   T p95";
const UNITS: &str = "deg                deg                %         x1e-3     deg         %        %                  ms      ms";

/// One row for each method, in the paper's column order.
pub(super) fn methods(outcomes: &[Outcome], of_views: bool) -> String {
    let width = outcomes
        .iter()
        .map(|o| o.name.len())
        .max()
        .unwrap_or(0)
        .max("method".len());
    let mut text = format!("{:width$}  {COLUMNS}\n{:width$}  {UNITS}\n", "method", "");
    for outcome in outcomes {
        let label = format!("{:width$}", outcome.name);
        row(&mut text, &label, &outcome.row, of_views);
    }
    text
}

/// One row for each step, like the paper's step-by-step table; times are cumulative.
pub(super) fn steps(name: &str, rows: &[StepRow], of_views: bool) -> String {
    let mut text = format!("{name}, step by step\nstep  {COLUMNS}\n      {UNITS}\n");
    for StepRow { step, row: values } in rows {
        let label = if *step == 0 {
            "init".into()
        } else {
            step.to_string()
        };
        row(&mut text, &format!("{label:4}"), values, of_views);
    }
    text
}

/// A line of shares, one for each step.
pub(super) fn agreement(name: &str, found: &Agreement) -> String {
    let percent = found
        .equal
        .iter()
        .map(|share| format!(" {:.0}", 100.0 * share));
    format!(
        "{name} acts as {} on these percent of axes in each step, along the way of the latter:{}\n",
        found.along,
        percent.collect::<String>()
    )
}

/// A block for each value: quartiles and means of every method, in the contestants' order.
pub(super) fn varied(varied: &Varied, contestants: &[Contestant<'_>]) -> String {
    let names = contestants.iter().map(|c| c.name.as_str());
    let width = names
        .clone()
        .map(str::len)
        .max()
        .unwrap_or(0)
        .max("method".len());
    let value = varied.vary.to_possible_value().expect("no value is hidden");
    let mut text = format!(
        "{}, {}; {} pairs a value\n{:>8}  {:width$}  \
         ISO R, deg: q1      median   q3       mean     ISO t: q1       median   q3       mean     \
         ADI AUC   recall\n",
        value.get_name(),
        varied.unit,
        varied.pairs,
        "value",
        "method",
    );
    let steps = varied.methods.values().next().map_or(0, Vec::len);
    for step in 0..steps {
        for name in names.clone() {
            let Some(at) = varied.methods.get(name).and_then(|all| all.get(step)) else {
                continue;
            };
            let s = &at.summary.summary;
            let ([r1, r2, r3], [t1, t2, t3]) = (s.quartiles.r_iso_deg, s.quartiles.t_iso);
            let line = format!(
                "{:>8}  {name:width$}  {r1:<18.3}  {r2:<7.3}  {r3:<7.3}  {:<7.3}  {t1:<13.4}  {t2:<7.4}  {t3:<7.4}  {:<7.4}  {:<8.1}  {:.0}",
                at.value,
                s.r_iso_deg,
                s.t_iso,
                s.adi_auc_pct,
                100.0 * s.recall_r5_t005,
            );
            writeln!(text, "{line}").expect("writing to a string cannot fail");
        }
    }
    text
}

/// For views the modified Chamfer distance is left out: the hidden parts of a target are far from them in any pose.
fn row(text: &mut String, label: &str, row: &Row, of_views: bool) {
    let s = &row.summary;
    let chamfer = match of_views {
        true => "-".into(),
        false => format!("{:.4}", 1e3 * s.chamfer_mod),
    };
    writeln!(
        text,
        "{label}  {:<9.3} {:<8.4} {:<9.3} {:<8.4} {:<9.1} {chamfer:<9} {:<11.3} {:<8.0} {:<18} {:<7.2} {:.2}",
        s.r_mae_deg,
        s.t_mae,
        s.r_iso_deg,
        s.t_iso,
        s.adi_auc_pct,
        s.r_iso_median_deg,
        100.0 * s.recall_r5_t005,
        format!("{:.1} {:.1} {:.1}", s.ad10_pct, s.ad05_pct, s.ad02_pct),
        row.ms_median,
        row.ms_p95,
    )
    .expect("writing to a string cannot fail");
}
