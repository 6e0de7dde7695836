//! Codes of features and of the heads' hidden layers.

use super::WIDE_MAX;

/// Codes of 13 bits in two planes of bytes: the upper seven bits, then the lower six.
#[derive(Clone, Debug, PartialEq)]
pub struct Wide<const N: usize> {
    high: [u8; N],
    low: [u8; N],
}

impl<const N: usize> Wide<N> {
    pub(crate) const ZERO: Self = Wide {
        high: [0; N],
        low: [0; N],
    };

    /// Both planes of the first `n` codes.
    pub(super) fn planes(&self, n: usize) -> [&[u8]; 2] {
        [&self.high, &self.low].map(|plane| plane.get(..n).unwrap_or(plane))
    }

    /// Stores a 16-bit number in place of a code.
    pub(super) fn put(&mut self, at: usize, number: usize) {
        if let (Some(high), Some(low)) = (self.high.get_mut(at), self.low.get_mut(at)) {
            [*high, *low] = (number as u16).to_be_bytes();
        }
    }

    /// The numbers that [`Wide::put`] stored.
    pub(super) fn numbers(&self) -> impl Iterator<Item = usize> {
        let pairs = self.high.iter().zip(&self.low);
        pairs.map(|(&high, &low)| usize::from(u16::from_be_bytes([high, low])))
    }

    pub(super) fn set(&mut self, codes: impl Iterator<Item = i64>) {
        for ((high, low), code) in self.high.iter_mut().zip(&mut self.low).zip(codes) {
            let code = code.clamp(0, i64::from(WIDE_MAX));
            *high = (code >> 6) as u8;
            *low = (code & 63) as u8;
        }
    }
}
