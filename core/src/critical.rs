//! Critical points of a cloud (PointNet's critical set): the points that reach the maximum of some channel of the feature. The
//! others could be left out. A cloud of 1024 points has about 280. They hardly change while the cloud turns by a few degrees,
//! so between full scans a registration may look at them alone ([`crate::Policy::rescan`]).

use crate::dims::MAX_POINTS;

/// Points marked by one word.
const WORD: usize = u32::BITS as usize;

/// A set of points of a cloud, one bit each.
#[derive(Clone, Debug)]
pub(crate) struct Critical([u32; MAX_POINTS / WORD]);

const _: () = assert!(MAX_POINTS.is_multiple_of(WORD) && MAX_POINTS <= 1 << u16::BITS);

impl Critical {
    /// The empty set.
    pub(crate) const NONE: Critical = Critical([0; MAX_POINTS / WORD]);

    pub(crate) fn clear(&mut self) {
        self.0.fill(0);
    }

    pub(crate) fn insert(&mut self, point: usize) {
        if let Some(word) = self.0.get_mut(point / WORD) {
            *word |= 1 << (point % WORD);
        }
    }

    /// The first marked point from `point` on.
    pub(crate) fn next(&self, point: usize) -> Option<usize> {
        let mut rest = u32::MAX << (point % WORD);
        for (i, word) in self.0.iter().enumerate().skip(point / WORD) {
            let marked = word & rest;
            if marked != 0 {
                return Some(i * WORD + marked.trailing_zeros() as usize);
            }
            rest = u32::MAX;
        }
        None
    }

    /// Number of marked points.
    pub(crate) fn len(&self) -> usize {
        self.0.iter().map(|word| word.count_ones() as usize).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn points_are_found_in_order(points in proptest::collection::btree_set(0..MAX_POINTS, 0..40)) {
            let mut critical = Critical::NONE;
            for &point in &points {
                critical.insert(point);
            }
            critical.insert(MAX_POINTS);
            prop_assert_eq!(critical.len(), points.len());
            let mut from = 0;
            for &point in &points {
                prop_assert_eq!(critical.next(from), Some(point));
                prop_assert_eq!(critical.next(point), Some(point));
                from = point + 1;
            }
            prop_assert_eq!(critical.next(from), None);
            critical.clear();
            prop_assert_eq!(critical.next(0), None);
        }
    }
}
