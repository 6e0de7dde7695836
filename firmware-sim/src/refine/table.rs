//! Errors of poses that robots gave, as a table.

use host_train::dataset::pairs::PairSet;
use host_train::measure::metrics::{GroundTruth, PairMetrics, Summary};
use reagent_core::Pose;
use reagent_core::wire::RefineReply;

/// The errors of a pair before and after a robot's answer.
///
/// # Errors
/// Pairs that the metrics refuse.
pub(crate) fn errors(
    pairs: &PairSet,
    index: usize,
    reply: &RefineReply,
) -> anyhow::Result<[PairMetrics; 2]> {
    let truth = GroundTruth::new(
        &pairs.source[index],
        &pairs.target[index],
        pairs.raw.as_ref().map(|raw| raw[index].as_slice()),
        pairs.target_from_source[index],
    )?;
    let refined = Pose::from_rows(reply.target_from_source);
    Ok([Pose::IDENTITY, refined].map(|pose| truth.measure(pose)))
}

/// A line of the tables that `refine` and `demo` print.
#[derive(Debug)]
pub(crate) struct Row {
    name: String,
    pairs: usize,
    /// Means over all pairs.
    pub(crate) summary: Summary,
}

impl Row {
    /// The names of the columns.
    pub(crate) const HEADER: &str = "                          pairs   ISO R deg          ISO t              recall          AD below\n                                  median    mean     median   mean     (5 deg, .05)    .10 .05 .02 d";

    /// The row for these errors.
    pub(crate) fn new(name: &str, pairs: &[PairMetrics]) -> Row {
        Row {
            name: name.into(),
            pairs: pairs.len(),
            summary: Summary::of(pairs),
        }
    }
}

impl std::fmt::Display for Row {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let s = &self.summary;
        write!(
            f,
            "{:24} {:6} {:9.2} {:7.2} {:10.4} {:6.4} {:10.0} % {:9.0} {:3.0} {:3.0} %",
            self.name,
            self.pairs,
            s.r_iso_median_deg,
            s.r_iso_deg,
            s.t_iso_median,
            s.t_iso,
            100.0 * s.recall_r5_t005,
            s.ad10_pct,
            s.ad05_pct,
            s.ad02_pct,
        )
    }
}
