//! Points that no surface explains: marks of "invalid" such as -9999, pixels that fly, another thing far away.

use crate::select::{select, sort};
use glam::Vec3;

/// Share of the points that are believed: others are left out where a gap lies between them.
const BELIEVED: f32 = 0.75;
/// How much farther than the farthest of those kept the nearest left out is.
const GAP: f32 = 3.0;
/// Below so many points a gap is chance.
const FEWEST: usize = 48;

/// Where a cloud's points are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bulk {
    centre: Vec3,
    squared: f32,
}

impl Bulk {
    /// Everywhere.
    pub(crate) const ALL: Bulk = Bulk {
        centre: Vec3::ZERO,
        squared: f32::INFINITY,
    };

    /// Of a cloud, of which at most as many points are looked at as there are `keys`.
    pub(crate) fn of(cloud: &[[f32; 3]], keys: &mut [u32]) -> Bulk {
        let n = cloud.len().min(keys.len());
        let Some(keys) = keys.get_mut(..n).filter(|_| n >= FEWEST) else {
            return Bulk::ALL;
        };
        let seen = |i: usize| cloud.get(i * cloud.len() / n).copied().unwrap_or_default();
        let centre = [0, 1, 2].map(|axis: usize| {
            for (i, key) in keys.iter_mut().enumerate() {
                *key = ordered(seen(i).get(axis).copied().unwrap_or_default());
            }
            unordered(select(keys, n / 2, u32::cmp).unwrap_or_default())
        });
        let centre = Vec3::from_array(centre);
        let mut farthest = 0.0f32;
        for (i, key) in keys.iter_mut().enumerate() {
            let squared = (Vec3::from_array(seen(i)) - centre).length_squared();
            farthest = farthest.max(squared);
            *key = squared.to_bits(); // in the order of the distances: they are not negative
        }
        let believed = (BELIEVED * n as f32) as usize;
        select(keys, believed, u32::cmp);
        let Some((&mut believed, others)) =
            keys.get_mut(believed..).and_then(<[u32]>::split_first_mut)
        else {
            return Bulk::ALL;
        };
        if farthest <= GAP * GAP * f32::from_bits(believed) {
            return Bulk::ALL;
        }
        sort(others, u32::cmp);
        let mut kept = f32::from_bits(believed);
        for squared in others.iter().copied().map(f32::from_bits) {
            if kept > 0.0 && squared > GAP * GAP * kept {
                return Bulk {
                    centre,
                    squared: kept,
                };
            }
            kept = squared;
        }
        Bulk::ALL
    }

    /// Whether a point is kept.
    pub(crate) fn holds(&self, point: [f32; 3]) -> bool {
        (Vec3::from_array(point) - self.centre).length_squared() <= self.squared
    }

    /// The points kept.
    pub(crate) fn kept(&self, cloud: &[[f32; 3]]) -> impl Iterator<Item = [f32; 3]> + Clone {
        cloud.iter().copied().filter(|&point| self.holds(point))
    }
}

/// A key in the order of numbers.
pub(crate) fn ordered(x: f32) -> u32 {
    let bits = x.to_bits();
    if bits >> 31 == 1 {
        !bits
    } else {
        bits | 1 << 31
    }
}

/// The number of a key.
pub(crate) fn unordered(key: u32) -> f32 {
    f32::from_bits(if key >> 31 == 1 {
        key & !(1 << 31)
    } else {
        !key
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polish::tests::part;

    fn left_out(cloud: &[[f32; 3]]) -> usize {
        let bulk = Bulk::of(cloud, &mut [0; 2048]);
        cloud.iter().filter(|&&p| !bulk.holds(p)).count()
    }

    #[test]
    fn marks_of_what_is_invalid_are_left_out_and_nothing_else() {
        let whole = part(400, 1);
        assert_eq!(left_out(&whole), 0);
        for (mark, count) in [
            ([-9999.0; 3], 40),
            ([1e9, 0.0, 0.0], 90),
            ([9.0, -7.0, 8.0], 1),
        ] {
            let mut cloud = whole.clone();
            cloud[..count].fill(mark);
            assert_eq!(left_out(&cloud), count, "{mark:?}");
        }
        let mut half = whole.clone();
        half[..200].fill([50.0; 3]);
        assert_eq!(left_out(&half), 0, "nobody knows which half is meant");
        assert_eq!(left_out(&[[1.0; 3]; 100]), 0);
        assert_eq!(left_out(&whole[..20]), 0);
    }

    #[test]
    fn keys_are_in_the_order_of_numbers() {
        let numbers = [-1e10, -1.0, -0.0, 0.0, 1e-30, 2.0, 1e10];
        assert!(numbers.map(ordered).is_sorted());
        assert_eq!(numbers.map(|x| unordered(ordered(x))), numbers);
    }
}
