//! How far from the truth a start may be, in a caller's units.

use reagent_core::start::Uncertainty;
use std::str::FromStr;

/// Standard deviations of a start; infinite for what is unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviations {
    /// Of the rotation about the object's centre, degrees.
    pub degrees: f32,
    /// Of the object's centre along the viewing axis, in the target's units.
    pub along: f32,
    /// Of the centre across that axis, in the target's units.
    pub across: f32,
}

impl Deviations {
    /// The same for the core: radians and target radii.
    pub(super) fn in_radii(self, radius: f32) -> Uncertainty {
        Uncertainty {
            rotation_rad: self.degrees.to_radians(),
            along: self.along / radius,
            across: self.across / radius,
        }
    }
}

impl FromStr for Deviations {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Deviations, &'static str> {
        let numbers: Option<Vec<f32>> = text.split(',').map(|x| x.trim().parse().ok()).collect();
        match numbers.unwrap_or_default()[..] {
            [degrees, along, across] if [degrees, along, across].iter().all(|&x| x >= 0.0) => {
                Ok(Deviations {
                    degrees,
                    along,
                    across,
                })
            }
            _ => Err(
                "expected three numbers separated by commas, none negative, inf for the unknown: degrees, and lengths \
                 along and across the view in the target's units",
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_numbers_are_deviations_in_degrees_and_in_the_targets_units() {
        let given: Deviations = "90, 30,inf".parse().expect("three numbers");
        let Uncertainty {
            rotation_rad,
            along,
            across,
        } = given.in_radii(60.0);
        assert_eq!((along, across), (0.5, f32::INFINITY));
        assert!((rotation_rad - std::f32::consts::FRAC_PI_2).abs() < 1e-6);
        for bad in ["", "10", "1,2", "1,2,3,4", "1,-2,3", "1,nan,3", "a,b,c"] {
            assert!(bad.parse::<Deviations>().is_err(), "{bad}");
        }
    }
}
