//! Requantisation: from 32-bit sums back to codes.

/// A fixed-point factor: `factor | shift << 16`, with `shift` 1 to 31 and `factor` below 2^15.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Requantise(pub u32);

impl Requantise {
    /// The nearest fixed-point factor of at most `bits` bits (up to 15) to a positive `value`, and its exact value.
    pub fn nearest(value: f64, bits: u32) -> (Requantise, f64) {
        let mut shift = 1;
        let most = f64::from((1u32 << bits) - 1);
        while shift < 31 && libm::round(value * power_of_two(shift + 1)) <= most {
            shift += 1;
        }
        let factor = libm::round(value * power_of_two(shift)).clamp(1.0, most);
        (
            Requantise(factor as u32 | shift << 16),
            factor / power_of_two(shift),
        )
    }

    pub(crate) fn factor(self) -> u32 {
        self.0 & 0xffff
    }

    fn shift(self) -> u32 {
        self.0 >> 16
    }

    pub(crate) fn half(self) -> i64 {
        (1 << self.shift()) >> 1
    }

    pub(crate) fn is_sound(self) -> bool {
        (1..=31).contains(&self.shift()) && (1..1 << 15).contains(&self.factor())
    }

    /// `R(a) = floor((a * factor + 2^(shift - 1)) / 2^shift)`, in 64 bits.
    #[inline(always)]
    pub fn apply(self, a: i32) -> i64 {
        (i64::from(a) * i64::from(self.factor()) + self.half()) >> self.shift()
    }

    /// `R(a)` in 32 bits, where the product is known to fit, clamped to `0..=most`.
    #[inline(always)]
    pub(crate) fn apply_32(self, a: i32, most: i32) -> i32 {
        let scaled = a
            .wrapping_mul(self.factor() as i32)
            .wrapping_add(self.half() as i32)
            .wrapping_shr(self.shift());
        scaled.clamp(0, most)
    }
}

fn power_of_two(shift: u32) -> f64 {
    (1u64 << shift) as f64
}
