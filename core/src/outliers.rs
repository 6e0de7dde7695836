//! Points that no surface explains: markers of invalid measurements such as -9999, flying pixels, another object far away. A
//! marker counts as one point however often it repeats: points equally far from the cloud's centre count once.

use crate::select::{select, sort};
use glam::Vec3;

/// Share of the distinct distances that is believed; points beyond it are left out if a gap separates them.
const BELIEVED: f32 = 0.75;
/// Ratio that makes a gap: distance of the nearest point left out over that of the farthest kept.
const GAP: f32 = 3.0;
/// With fewer points, a gap may be chance.
const FEWEST: usize = 48;

/// The ball in which a cloud's points are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bulk {
    centre: Vec3,
    squared: f32,
}

impl Bulk {
    /// All of space.
    pub const ALL: Bulk = Bulk {
        centre: Vec3::ZERO,
        squared: f32::INFINITY,
    };

    /// The bulk of a cloud `[N, 3]`, judged by at most as many of its points as there are `keys`.
    pub fn of(cloud: &[[f32; 3]], keys: &mut [u32]) -> Bulk {
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
        for (i, key) in keys.iter_mut().enumerate() {
            let squared = (Vec3::from_array(seen(i)) - centre).length_squared();
            *key = squared.to_bits(); // non-negative floats order as their bits do
        }
        sort(keys, u32::cmp);
        let distances = || {
            let mut last = None;
            let keys = keys.iter().copied();
            keys.filter(move |&key| last.replace(key) != Some(key))
                .map(f32::from_bits)
        };
        let count = distances().count();
        let believed = (BELIEVED * count as f32) as usize;
        let mut kept = 0.0;
        for (i, squared) in distances().enumerate() {
            if i > believed && count >= FEWEST && kept > 0.0 && squared > GAP * GAP * kept {
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
    pub fn holds(&self, point: [f32; 3]) -> bool {
        (Vec3::from_array(point) - self.centre).length_squared() <= self.squared
    }

    /// The points of a cloud that are kept.
    pub(crate) fn kept(&self, cloud: &[[f32; 3]]) -> impl Iterator<Item = [f32; 3]> + Clone {
        cloud.iter().copied().filter(|&point| self.holds(point))
    }
}

/// An integer key that orders as the float does.
pub(crate) fn ordered(x: f32) -> u32 {
    let bits = x.to_bits();
    if bits >> 31 == 1 {
        !bits
    } else {
        bits | 1 << 31
    }
}

/// The float of a key: the inverse of [`ordered`].
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
        // Nearly half of the points: the marker counts once.
        let mut half = whole.clone();
        half[..190].fill([50.0; 3]);
        assert_eq!(left_out(&half), 190);
        for (point, away) in half.iter_mut().zip(part(160, 7)) {
            *point = away.map(|x| x + 50.0);
        }
        half[160..190].copy_from_slice(&whole[160..190]);
        assert_eq!(left_out(&half), 0, "nobody knows which thing is meant");
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
