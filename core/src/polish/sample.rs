//! A small sample of a surface's points with normals, in lanes, for searches over many poses.

use crate::kernels::{LANES, Oriented};
use crate::surface::Surface;

/// Most points in a sample.
const SAMPLED: usize = 512;

/// Points spread evenly over a surface; so is every prefix of them.
#[derive(Clone, Debug)]
pub(crate) struct Sample {
    len: usize,
    lanes: [Oriented; SAMPLED / LANES],
}

impl Sample {
    /// A sample of no surface. All bits are zero.
    pub(crate) const EMPTY: Sample = Sample {
        len: 0,
        lanes: [Oriented::ZERO; SAMPLED / LANES],
    };

    /// Samples a surface.
    pub(crate) fn fill(&mut self, surface: &Surface) {
        let all = surface.points().len();
        self.len = all.min(SAMPLED);
        let places = spread(self.len).map(|i| i * all / self.len.max(1));
        let mut places = places.map(|place| surface.at(place));
        for Oriented { points, normals } in &mut self.lanes {
            let ([x, y, z], [a, b, c]) = (points, normals);
            let lanes = x.iter_mut().zip(y).zip(z).zip(a).zip(b).zip(c);
            for (((((x, y), z), a), b), c) in lanes {
                let (point, normal) = places.next().unwrap_or_default();
                [*x, *y, *z] = point.to_array();
                [*a, *b, *c] = normal.to_array();
            }
        }
    }

    /// The first `points` points in lanes, and how many there are.
    pub(crate) fn first(&self, points: usize) -> (&[Oriented], usize) {
        let count = points.min(self.len);
        let lanes = self.lanes.get(..count.div_ceil(LANES)).unwrap_or(&[]);
        (lanes, count)
    }
}

/// The numbers from 0 to `below - 1`, each once, in bit-reversed order: the first lie far apart, and later ones between them.
fn spread(below: usize) -> impl Iterator<Item = usize> {
    let digits = below.next_power_of_two().trailing_zeros();
    let reversed = move |i: usize| {
        if digits == 0 {
            i
        } else {
            i.reverse_bits() >> (usize::BITS - digits)
        }
    };
    (0..below.next_power_of_two())
        .map(reversed)
        .filter(move |&i| i < below)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_once_and_the_first_are_far_apart() {
        for below in [0, 1, 2, 5, 96, 512] {
            let mut all: Vec<usize> = spread(below).collect();
            if below >= 96 {
                let mut first: Vec<usize> = all[..16].to_vec();
                first.sort_unstable();
                let apart = first.windows(2).map(|w| w[1] - w[0]);
                assert!(apart.min() >= Some(below / 32), "{first:?}");
            }
            all.sort_unstable();
            assert!(all.into_iter().eq(0..below));
        }
    }
}
