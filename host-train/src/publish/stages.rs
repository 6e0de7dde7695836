//! The parts of a fleet that get a policy one after the other.

use reagent_core::wire::Manifest;
use std::str::FromStr;

/// Parts of a fleet, each larger than the one before it as far as that can be told without the fleet's size.
#[derive(Clone, Debug, PartialEq)]
pub struct Stages(pub(super) Vec<Stage>);

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Stage {
    Robots(usize),
    Percent(f64),
}

impl FromStr for Stages {
    type Err = String;

    /// Parses numbers of robots and percentages, separated by commas.
    fn from_str(text: &str) -> Result<Stages, String> {
        let stage = |part: &str| {
            let stage = match part.strip_suffix('%') {
                Some(percent) => percent.parse().ok().map(Stage::Percent),
                None => part.parse().ok().map(Stage::Robots),
            };
            match stage {
                Some(Stage::Percent(percent)) if !(percent > 0.0 && percent <= 100.0) => None,
                Some(Stage::Robots(0)) => None,
                stage => stage,
            }
        };
        let wrong = |part: &str| {
            format!("{part:?}: give numbers of robots and percentages, such as 1,10%,100%")
        };
        let parts = text
            .split(',')
            .map(|part| stage(part.trim()).ok_or_else(|| wrong(part)));
        let stages: Vec<Stage> = parts.collect::<Result<_, _>>()?;
        match stages.is_sorted_by(|before, next| before.may_precede(*next)) {
            true => Ok(Stages(stages)),
            false => Err(format!(
                "{text:?}: each stage must be larger than the one before it"
            )),
        }
    }
}

impl Stage {
    /// Whether the next stage may be larger; for a number and a percentage that depends on the fleet.
    fn may_precede(self, next: Stage) -> bool {
        match (self, next) {
            (Stage::Robots(a), Stage::Robots(b)) => a < b,
            (Stage::Percent(a), Stage::Percent(b)) => a < b,
            (Stage::Percent(percent), Stage::Robots(_)) => percent < 100.0,
            (Stage::Robots(_), Stage::Percent(_)) => true,
        }
    }

    /// Number of robots in a fleet of this size.
    fn robots(self, fleet: usize) -> usize {
        match self {
            Stage::Robots(robots) => robots.min(fleet),
            Stage::Percent(percent) => (fleet as f64 * percent / 100.0).ceil() as usize,
        }
    }
}

/// The largest draw that a stage of the fleet reaches.
pub(super) fn reach(manifest: &Manifest, stage: Stage, robots: &[&String]) -> u32 {
    let mut draws: Vec<_> = robots.iter().map(|robot| manifest.draw(robot)).collect();
    draws.sort_unstable();
    let wanted = stage.robots(draws.len());
    match draws.get(wanted.saturating_sub(1)) {
        Some(&last) if wanted < draws.len() => last,
        _ => u32::MAX,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_are_numbers_and_percentages() {
        let stages: Stages = "1, 10%,100%".parse().expect("stages");
        let counts: Vec<_> = stages.0.iter().map(|stage| stage.robots(25)).collect();
        assert_eq!(counts, [1, 3, 25]);
        for wrong in [
            "", "0", "1,,2", "101%", "-1", "nan%", "0%", "x", "1,1", "2,1", "10%,5%", "100%,1",
        ] {
            assert!(wrong.parse::<Stages>().is_err(), "{wrong}");
        }
    }
}
