//! What the numbers in the project's files are called, their units and digits.

/// How a number is named and printed.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Metric {
    /// Name for people.
    pub label: String,
    /// Unit after scaling; empty for normalised lengths and plain numbers.
    pub unit: &'static str,
    /// Digits after the point.
    pub digits: usize,
    /// Factor between the stored number and the printed one.
    pub factor: f64,
    /// Which end is good, if either.
    pub better: Better,
    /// Whether charts show it on a logarithmic axis.
    pub log: bool,
}

/// Which end of a metric is good.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Better {
    Lower,
    Higher,
    Neither,
}

impl Metric {
    /// The metric stored under `key`; of an unknown one, name and unit are guessed from the key.
    pub(crate) fn of(key: &str) -> Metric {
        use Better::{Higher, Lower, Neither};
        let (label, unit, digits, factor, better, log) = match key {
            "r_mae_deg" => ("MAE R", "deg", 3, 1.0, Lower, true),
            "t_mae" => ("MAE t", "", 4, 1.0, Lower, true),
            "r_iso_deg" => ("ISO R", "deg", 3, 1.0, Lower, true),
            "r_iso_median_deg" => ("ISO R median", "deg", 3, 1.0, Lower, true),
            "t_iso" => ("ISO t", "", 4, 1.0, Lower, true),
            "t_iso_median" => ("ISO t median", "", 4, 1.0, Lower, true),
            "adi" => ("ADI", "% of diameter", 2, 100.0, Lower, true),
            "add" => ("ADD", "% of diameter", 2, 100.0, Lower, true),
            "adi_auc_pct" => ("ADI AUC", "%", 1, 1.0, Higher, false),
            "add_auc_pct" => ("ADD AUC", "%", 1, 1.0, Higher, false),
            "chamfer_mod" => ("modified CD", "1e-3", 4, 1e3, Lower, true),
            "chamfer_mod_median" => ("modified CD median", "1e-3", 4, 1e3, Lower, true),
            "recall_r5_t005" => ("recall", "%", 1, 100.0, Higher, false),
            "ms_median" => ("time median", "ms", 2, 1.0, Lower, true),
            "ms_p95" => ("time p95", "ms", 2, 1.0, Lower, true),
            "ad_10" => ("AD < 0.10 d", "%", 1, 1.0, Higher, false),
            "ad_05" => ("AD < 0.05 d", "%", 1, 1.0, Higher, false),
            "ad_02" => ("AD < 0.02 d", "%", 1, 1.0, Higher, false),
            "ar" => ("AR", "%", 1, 1.0, Higher, false),
            "ar_vsd" => ("AR VSD", "%", 1, 1.0, Higher, false),
            "ar_mssd" => ("AR MSSD", "%", 1, 1.0, Higher, false),
            "ar_mspd" => ("AR MSPD", "%", 1, 1.0, Higher, false),
            "pairs" => ("pairs", "", 0, 1.0, Neither, false),
            "loss" => ("loss", "", 3, 1.0, Lower, false),
            "agreement" => ("agreement with the expert", "%", 1, 100.0, Higher, false),
            "agreement_axes" => (
                "agreement with the expert by axis",
                "%",
                1,
                100.0,
                Higher,
                false,
            ),
            "clip_fraction" => ("clipped share of ratios", "%", 1, 100.0, Neither, false),
            "action_histogram" => ("step sizes chosen", "%", 1, 100.0, Neither, false),
            "lr" => ("learning rate", "", 6, 1.0, Neither, true),
            "gradient_norm" => ("gradient norm", "", 3, 1.0, Neither, true),
            "samples_per_s" => ("training speed", "samples/s", 0, 1.0, Higher, false),
            _ => return Metric::guess(key),
        };
        Metric {
            label: label.into(),
            unit,
            digits,
            factor,
            better,
            log,
        }
    }

    fn guess(key: &str) -> Metric {
        let units = [
            ("_deg", "deg"),
            ("_rad", "rad"),
            ("_pct", "%"),
            ("_ms", "ms"),
            ("_mm", "mm"),
            ("_m", "m"),
        ];
        let found = units
            .iter()
            .find_map(|(suffix, unit)| key.strip_suffix(suffix).map(|stem| (stem, *unit)));
        let (stem, unit) = found.unwrap_or((key, ""));
        Metric {
            label: stem.replace(['_', '.'], " "),
            unit,
            digits: if unit == "%" { 1 } else { 3 },
            factor: 1.0,
            better: Better::Neither,
            log: false,
        }
    }

    /// The number as it is printed: scaled, fixed digits; a dash for none.
    pub(crate) fn print(&self, value: f64) -> String {
        let value = value * self.factor;
        if value.is_finite() {
            format!("{value:.*}", self.digits)
        } else {
            "–".into()
        }
    }

    /// Name and unit.
    pub(crate) fn titled(&self) -> String {
        match self.unit {
            "" => self.label.clone(),
            unit => format!("{}, {unit}", self.label),
        }
    }
}

/// Columns in the order of the paper's tables; others follow by name.
const ORDER: [&str; 23] = [
    "pairs",
    "ad_10",
    "ad_05",
    "ad_02",
    "ar_vsd",
    "ar_mssd",
    "ar_mspd",
    "ar",
    "r_mae_deg",
    "t_mae",
    "r_iso_deg",
    "t_iso",
    "adi_auc_pct",
    "chamfer_mod",
    "recall_r5_t005",
    "r_iso_median_deg",
    "t_iso_median",
    "chamfer_mod_median",
    "add_auc_pct",
    "adi",
    "add",
    "ms_median",
    "ms_p95",
];

/// Place of a key in the paper's order; after all others for those that are not in it.
pub(crate) fn place(key: &str) -> usize {
    ORDER.iter().position(|k| *k == key).unwrap_or(ORDER.len())
}

/// Sorts keys into the paper's order.
pub(crate) fn sort(keys: &mut [String]) {
    keys.sort_by(|a, b| place(a).cmp(&place(b)).then_with(|| a.cmp(b)));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_units_and_fixed_digits() {
        let recall = Metric::of("recall_r5_t005");
        assert_eq!((recall.print(0.775), recall.unit), ("77.5".to_owned(), "%"));
        assert_eq!(Metric::of("chamfer_mod").print(0.0012345), "1.2345");
        assert_eq!(Metric::of("anything").print(f64::NAN), "–");
        let unknown = Metric::of("ad_010d_pct");
        assert_eq!(
            (unknown.label.as_str(), unknown.unit, unknown.digits),
            ("ad 010d", "%", 1)
        );
    }

    #[test]
    fn columns_come_in_the_papers_order() {
        let mut keys = ["ms_p95", "zeta", "alpha", "t_mae", "r_mae_deg"].map(String::from);
        sort(&mut keys);
        assert_eq!(keys, ["r_mae_deg", "t_mae", "ms_p95", "alpha", "zeta"]);
    }
}
