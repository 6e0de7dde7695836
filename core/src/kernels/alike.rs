//! Finds which of many feature vectors are close to one, in lanes.
//!
//! As in [`super::lanes`]: the same on every kernel.

#![allow(unsafe_code)]

use super::Isa;
use super::lanes::{LANES, Lanes, Row};
use super::on_lanes::on_lanes;

/// A vector of four features.
type Four = [f32; 4];

/// See [`Isa::alike`].
#[inline(always)]
fn alike<L: Lanes>(rows: &[[Row; 4]], of: &Four, most: &Four, bits: &mut [u32]) {
    for (rows, bits) in rows.iter().zip(bits) {
        *bits = 0;
        for lane in (0..LANES).step_by(L::COUNT) {
            let mut alike = u32::MAX;
            for ((row, &of), &most) in rows.iter().zip(of).zip(most) {
                let (row, of) = (L::load(row, lane), L::all(of));
                alike &= (row - of).max(of - row).below(L::all(most));
                if alike == 0 {
                    break;
                }
            }
            *bits |= alike << lane;
        }
    }
}

impl Isa {
    /// Sets a bit for each lane whose four features all differ from those of `of` by less than `most`.
    pub fn alike(self, rows: &[[Row; 4]], of: &Four, most: &Four, bits: &mut [u32]) {
        on_lanes!(
            self,
            alike(rows: &[[Row; 4]], of: &Four, most: &Four, bits: &mut [u32])
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polish::tests::Numbers;

    #[test]
    fn every_kernel_finds_those_that_are_alike() {
        let mut numbers = Numbers(7);
        let mut rows = [[[0.0; LANES]; 4]; 5];
        for x in rows.as_flattened_mut().as_flattened_mut() {
            *x = numbers.next();
        }
        // At the limit, which is not below it, and at infinity.
        (rows[0][1][3], rows[2][0][15]) = (0.1 + 0.75, f32::INFINITY);
        let (of, most) = ([0.3, 0.1, -0.2, 0.0], [0.5, 0.75, 0.5, 0.75]);
        let is_alike =
            |rows: &[Row; 4], lane: usize| (0..4).all(|k| (rows[k][lane] - of[k]).abs() < most[k]);
        let expected = rows.each_ref().map(|rows| {
            let bits = (0..LANES).map(|lane| u32::from(is_alike(rows, lane)) << lane);
            bits.sum::<u32>()
        });
        assert!(expected.iter().any(|&bits| bits != 0));
        for isa in Isa::all() {
            let mut bits = [u32::MAX; 5];
            isa.alike(&rows, &of, &most, &mut bits);
            assert_eq!(bits, expected, "{}", isa.name());
        }
    }
}
