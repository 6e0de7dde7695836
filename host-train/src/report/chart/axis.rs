//! Axes: ranges and ticks, linear or logarithmic, as coordinates of the drawing library.

use plotters::coord::ranged1d::{
    KeyPointHint, KeyPointWeight, NoDefaultFormatting, Ranged, ValueFormatter,
};
use std::ops::Range;

/// An axis: what it shows, and how.
#[derive(Clone, Debug, Default)]
pub(crate) struct Axis {
    /// Name and unit.
    pub label: String,
    /// Logarithmic; values that are not positive count as the smallest positive one.
    pub log: bool,
    /// Fixed range instead of the data's.
    pub range: Option<(f64, f64)>,
}

impl Axis {
    /// A linear axis over its data.
    pub(crate) fn linear(label: impl Into<String>) -> Axis {
        Axis {
            label: label.into(),
            ..Axis::default()
        }
    }
}

/// An axis fitted to values.
#[derive(Clone, Debug)]
pub(crate) struct Fitted {
    log: bool,
    /// Smallest value that a logarithmic axis shows.
    floor: f64,
    /// Ends; their logarithms where the axis is logarithmic.
    ends: (f64, f64),
    /// Values and texts of the ticks.
    pub ticks: Vec<(f64, String)>,
}

/// Decades that a logarithmic axis shows at most.
const DECADES: f64 = 8.0;

impl Fitted {
    /// The axis for finite values.
    pub(crate) fn new(axis: &Axis, values: impl Iterator<Item = f64> + Clone) -> Fitted {
        let finite = values.filter(|v| v.is_finite());
        let highest = finite.clone().fold(f64::NEG_INFINITY, f64::max);
        let positive = finite
            .clone()
            .filter(|v| *v > 0.0)
            .fold(f64::INFINITY, f64::min);
        if axis.log && positive.is_finite() {
            let floor = positive.max(highest * 10f64.powf(-DECADES));
            return Fitted::logarithmic(floor, highest.max(floor));
        }
        let lowest = finite.fold(f64::INFINITY, f64::min);
        let (mut low, mut high) = match axis.range {
            Some(range) => range,
            None if lowest <= highest => (lowest, highest),
            None => (0.0, 1.0),
        };
        if axis.range.is_none() {
            let from_zero = low >= 0.0 && low <= 0.6 * high;
            if high - low <= 1e-9 * high.abs() {
                // A single value: room on both sides.
                let room = if high == 0.0 { 1.0 } else { 0.5 * high.abs() };
                (low, high) = (low - room, high + room);
            }
            let pad = 0.05 * (high - low);
            low = if from_zero { 0.0 } else { low - pad };
            high += pad;
        }
        let step = nice_step((high - low) / 3.5);
        let first = (low / step).ceil() as i64;
        let last = (high / step + 1e-9).floor() as i64;
        let digits = (-step.log10().floor()).max(0.0) as usize;
        let ticks = (first..=last)
            .map(|i| {
                let at = i as f64 * step;
                (at, number(at, digits))
            })
            .collect();
        Fitted {
            log: false,
            floor: f64::NEG_INFINITY,
            ends: (low, high),
            ticks,
        }
    }

    fn logarithmic(floor: f64, highest: f64) -> Fitted {
        let (low, high) = (floor.log10() - 0.1, highest.log10() + 0.1);
        let span = high - low;
        let parts: &[f64] = match span {
            s if s < 1.2 => &[1.0, 2.0, 3.0, 5.0, 7.0],
            s if s < 2.5 => &[1.0, 2.0, 5.0],
            _ => &[1.0],
        };
        let every = if span > 5.0 { 2 } else { 1 };
        let ticks = (low.floor() as i32..=high.ceil() as i32)
            .filter(|decade| decade % every == 0)
            .flat_map(|decade| parts.iter().map(move |part| (decade, *part)))
            .map(|(decade, part)| (decade, part, part * 10f64.powi(decade)))
            .filter(|(_, _, value)| (low..=high).contains(&value.log10()))
            .map(|(decade, part, value)| {
                let text = if (-4..5).contains(&decade) {
                    number(value, (-decade).max(0) as usize)
                } else {
                    format!("{part}e{decade}")
                };
                (value, text)
            })
            .collect();
        Fitted {
            log: true,
            floor,
            ends: (low, high),
            ticks,
        }
    }

    /// Named places: category `i` of `names` spans `i - 0.5` to `i + 0.5`; `down` lets them begin at the
    /// far end of the axis.
    pub(crate) fn categories(names: &[String], down: bool) -> Fitted {
        let (first, last) = (-0.5, names.len() as f64 - 0.5);
        Fitted {
            log: false,
            floor: f64::NEG_INFINITY,
            ends: if down { (last, first) } else { (first, last) },
            ticks: names
                .iter()
                .enumerate()
                .map(|(i, name)| (i as f64, name.clone()))
                .collect(),
        }
    }

    /// Texts of the ticks.
    pub(crate) fn labels(&self) -> impl Iterator<Item = &str> {
        self.ticks.iter().map(|(_, text)| text.as_str())
    }

    /// Where on the axis a value is; 0 and 1 are its ends.
    fn place(&self, value: f64) -> f64 {
        let value = if self.log {
            value.max(self.floor).log10()
        } else {
            value
        };
        (value - self.ends.0) / (self.ends.1 - self.ends.0)
    }
}

impl Ranged for Fitted {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (from, to): (i32, i32)) -> i32 {
        from + (self.place(*value) * f64::from(to - from)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        match hint.weight() {
            KeyPointWeight::Bold => self.ticks.iter().map(|(value, _)| *value).collect(),
            KeyPointWeight::Any => Vec::new(),
        }
    }

    fn range(&self) -> Range<f64> {
        self.ends.0..self.ends.1
    }
}

impl ValueFormatter<f64> for Fitted {
    fn format_ext(&self, value: &f64) -> String {
        let tick = self.ticks.iter().find(|(tick, _)| tick == value);
        tick.map_or(String::new(), |(_, text)| text.clone())
    }
}

/// 1, 2 or 5 times a power of ten, not above `most`.
fn nice_step(most: f64) -> f64 {
    let power = 10f64.powf(most.log10().floor());
    let parts = [5.0, 2.0, 1.0];
    let part = parts.into_iter().find(|p| p * power <= most * 1.001);
    part.unwrap_or(1.0) * power
}

/// A number with a fixed number of digits, without a minus before zero.
fn number(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    match text.strip_prefix('-') {
        Some(rest) if rest.chars().all(|c| matches!(c, '0' | '.')) => rest.into(),
        _ => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(axis: &Axis, values: &[f64]) -> Vec<String> {
        let fitted = Fitted::new(axis, values.iter().copied());
        fitted.ticks.into_iter().map(|(_, text)| text).collect()
    }

    #[test]
    fn linear_ticks_are_round_and_cover_the_data() {
        let axis = Axis::linear("x");
        assert_eq!(texts(&axis, &[0.1, 9.7]), ["0", "2", "4", "6", "8", "10"]);
        assert_eq!(
            texts(&axis, &[0.0, 0.42]),
            ["0.0", "0.1", "0.2", "0.3", "0.4"]
        );
        assert_eq!(texts(&axis, &[3.0, f64::NAN, 3.0]).len(), 7);
        assert!(!texts(&axis, &[]).is_empty());
    }

    #[test]
    fn logarithmic_ticks_are_decades_and_zeros_stay_on_the_axis() {
        let axis = Axis {
            log: true,
            ..Axis::linear("x")
        };
        assert_eq!(texts(&axis, &[0.02, 150.0]), ["0.1", "1", "10", "100"]);
        let fitted = Fitted::new(&axis, [0.0, 0.1, 10.0].into_iter());
        assert!((fitted.place(0.0) - 0.1 / 2.2).abs() < 1e-9);
        assert_eq!(fitted.place(0.0), fitted.place(0.1));
        assert_eq!(fitted.map(&1.0, (100, 0)), 50);
        assert_eq!(fitted.format_ext(&1.0), "1");
    }
}
