//! Clouds on a grid of 16-bit codes: half the bytes of f32, on the wire and in a robot's memory.
//!
//! A code `c` stands for the coordinate `origin + c * step`: one product and one sum, each rounded once, in this order and
//! without fused multiply-add. So every target decodes the same bits.

use crate::error::Error;

/// Largest code; the smallest is `-LARGEST`.
pub const LARGEST: i16 = i16::MAX;

/// Where the codes of a cloud lie in space.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Grid {
    /// Point of code `[0, 0, 0]`: the centre of the cloud's bounding box, in the cloud's units.
    pub origin: [f32; 3],
    /// Distance between neighbouring codes, the same along every axis, in the cloud's units.
    pub step: f32,
}

impl Grid {
    /// The finest grid whose codes cover the bounding box of `points [N, 3]`.
    ///
    /// A coordinate `x` of the cloud comes back from [`Grid::encode`] and [`Grid::decode`] within
    /// `0.51 * step + 2⁻²³ |x|`, where `step` is 1/65534 of the box's longest side (rounded up, and at least the
    /// smallest normal number). Decoded coordinates within that bound of the largest f32 may become infinite.
    ///
    /// # Errors
    /// [`Error::EmptyCloud`]; [`Error::NotFinite`] with the index of the first such point.
    pub fn of(points: &[[f32; 3]]) -> Result<Grid, Error> {
        if points.is_empty() {
            return Err(Error::EmptyCloud);
        }
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for (index, point) in points.iter().enumerate() {
            if !point.iter().all(|x| x.is_finite()) {
                return Err(Error::NotFinite { index });
            }
            for ((&x, low), high) in point.iter().zip(&mut low).zip(&mut high) {
                *low = low.min(x);
                *high = high.max(x);
            }
        }
        // In f64, nothing here overflows, and rounding is negligible.
        let mut reach = 0.0f64;
        let mut origin = [0.0f32; 3];
        for ((low, high), origin) in low.into_iter().zip(high).zip(&mut origin) {
            let (low, high) = (f64::from(low), f64::from(high));
            // Adding zero turns -0 into 0.
            *origin = (0.5 * (low + high)) as f32 + 0.0;
            let middle = f64::from(*origin);
            reach = reach.max(high - middle).max(middle - low);
        }
        let exact = reach / f64::from(LARGEST);
        let mut step = exact as f32;
        if f64::from(step) < exact {
            step = step.next_up();
        }
        Ok(Grid {
            origin,
            step: step.max(f32::MIN_POSITIVE),
        })
    }

    /// The nearest code to a point. Points beyond the grid get the nearest code on it; NaN gives 0.
    pub fn encode(&self, point: [f32; 3]) -> [i16; 3] {
        let mut codes = [0; 3];
        for ((code, x), origin) in codes.iter_mut().zip(point).zip(self.origin) {
            let steps = (f64::from(x) - f64::from(origin)) / f64::from(self.step);
            // The cast saturates, and takes NaN to 0.
            *code = (libm::round(steps) as i16).max(-LARGEST);
        }
        codes
    }

    /// The point of a code; not finite if the grid is not. [`crate::cloud::Cloud::check`] refuses such clouds.
    pub fn decode(&self, codes: [i16; 3]) -> [f32; 3] {
        let mut point = [0.0; 3];
        for ((x, code), origin) in point.iter_mut().zip(codes).zip(self.origin) {
            *x = origin + f32::from(code) * self.step;
        }
        point
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    #[test]
    fn codes_and_points_are_these() {
        let grid = Grid::of(&[[-1.0, 2.0, 5.0], [3.0, 2.5, 5.0]]).expect("a good cloud");
        assert_eq!(grid.origin, [1.0, 2.25, 5.0]);
        assert_eq!(grid.step.to_bits(), 0x3880_0101, "2/32767, rounded up");
        assert_eq!(grid.encode([-1.0, 2.5, 5.0]), [-32767, 4096, 0]);
        let bits = grid.decode([1, -2, 32767]).map(f32::to_bits);
        assert_eq!(bits, [0x3f80_0200, 0x400f_fe00, 0x40e0_0000]);
        // Beyond the grid, and NaN.
        let beyond = [f32::INFINITY, -1e30, f32::NAN];
        assert_eq!(grid.encode(beyond), [LARGEST, -LARGEST, 0]);
    }

    #[test]
    fn one_point_is_its_own_grid() {
        for point in [[0.1, -7.0, 1e30], [0.0; 3], [f32::MAX, f32::MIN, 0.0]] {
            let grid = Grid::of(&[point, point]).expect("a good cloud");
            assert_eq!(grid.encode(point), [0; 3]);
            assert_eq!(grid.decode([0; 3]), point);
            assert!(grid.step > 0.0);
        }
    }

    #[test]
    fn what_has_no_box_is_refused() {
        assert_eq!(Grid::of(&[]), Err(Error::EmptyCloud));
        let cloud = [[0.0; 3], [0.0, f32::NAN, f32::INFINITY]];
        assert_eq!(Grid::of(&cloud), Err(Error::NotFinite { index: 1 }));
    }

    /// Clouds of any size and place, flat ones among them.
    fn clouds() -> impl Strategy<Value = Vec<[f32; 3]>> {
        let unit = proptest::array::uniform3(-1.0f32..1.0);
        let points = proptest::collection::vec(unit, 1..40);
        let around = proptest::array::uniform3(-1.0f32..1.0);
        (points, around, -36i32..36, -36i32..36).prop_map(|(points, around, size, far)| {
            let (size, far) = (10f32.powi(size), 10f32.powi(far));
            let at = |point: [f32; 3]| core::array::from_fn(|a| around[a] * far + point[a] * size);
            points.into_iter().map(at).collect()
        })
    }

    proptest! {
        #[test]
        fn points_come_back_within_the_bound(cloud in clouds()) {
            let grid = Grid::of(&cloud).expect("finite");
            for &point in &cloud {
                let back = grid.decode(grid.encode(point));
                for (x, y) in point.into_iter().zip(back) {
                    let (x, y, step) = (f64::from(x), f64::from(y), f64::from(grid.step));
                    prop_assert!((x - y).abs() <= 0.51 * step + x.abs() / 8_388_608.0, "{} {}", x, y);
                }
            }
        }

        #[test]
        fn decoding_is_a_product_and_a_sum_each_rounded_once(
            origin in proptest::array::uniform3(-1e6f32..1e6),
            step in 1e-9f32..1e3,
            codes in proptest::array::uniform3(any::<i16>()),
        ) {
            // f64 holds the product of two f32 exactly, so the cast to f32 is the only rounding.
            let grid = Grid { origin, step };
            for ((x, code), origin) in grid.decode(codes).into_iter().zip(codes).zip(origin) {
                let product = (f64::from(code) * f64::from(step)) as f32;
                let sum = (f64::from(origin) + f64::from(product)) as f32;
                prop_assert_eq!(x.to_bits(), sum.to_bits());
            }
        }
    }
}
