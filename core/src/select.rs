//! Selection of the k-th smallest item, and sorting. If items that compare as equal are identical to the bit, the results are
//! the same on every target.
//!
//! The standard library's algorithms are faster on hosts, but the compiler leaves panics in them.

use core::cmp::Ordering;
use core::mem::swap;

/// Moves the `k`-th smallest item to index `k`, with no larger item before it and no smaller one after it, and returns it.
/// `None` if there are too few items.
pub(crate) fn select<T: Copy>(
    items: &mut [T],
    k: usize,
    compare: impl Fn(&T, &T) -> Ordering + Copy,
) -> Option<T> {
    if k >= items.len() {
        return None;
    }
    if cfg!(target_os = "none") {
        quickselect(items, k, compare);
    } else {
        items.select_nth_unstable_by(k, compare);
    }
    items.get(k).copied()
}

/// Sorts items.
pub(crate) fn sort<T: Copy>(items: &mut [T], compare: impl Fn(&T, &T) -> Ordering + Copy) {
    if cfg!(target_os = "none") {
        quicksort(items, compare);
    } else {
        items.sort_unstable_by(compare);
    }
}

/// Quicksort with the median as pivot, so its depth is logarithmic.
fn quicksort<T: Copy>(items: &mut [T], compare: impl Fn(&T, &T) -> Ordering + Copy) {
    let half = items.len() / 2;
    if half == 0 {
        return;
    }
    quickselect(items, half, compare);
    if let Some((below, above)) = items.split_at_mut_checked(half) {
        quicksort(below, compare);
        quicksort(above, compare);
    }
}

/// Quickselect (Hoare 1961) with the median of three as pivot.
fn quickselect<T: Copy>(
    mut items: &mut [T],
    mut k: usize,
    compare: impl Fn(&T, &T) -> Ordering + Copy,
) {
    while let Some(pivot) = median_of_three(items, compare) {
        let smaller = partition(items, |item| compare(item, &pivot).is_lt());
        let Some((below, others)) = items.split_at_mut_checked(smaller) else {
            return;
        };
        if k < smaller {
            items = below;
            continue;
        }
        k -= smaller;
        let equal = partition(others, |item| compare(item, &pivot).is_eq());
        let Some(above) = others.get_mut(equal..).filter(|_| k >= equal) else {
            return;
        };
        k -= equal;
        items = above;
    }
}

/// The median of the first, the middle and the last item; `None` if there are none.
fn median_of_three<T: Copy>(items: &[T], compare: impl Fn(&T, &T) -> Ordering) -> Option<T> {
    let (first, last) = (items.first()?, items.last()?);
    let middle = items.get(items.len() / 2)?;
    let [low, high] = if compare(first, last).is_le() {
        [first, last]
    } else {
        [last, first]
    };
    Some(if compare(middle, low).is_lt() {
        *low
    } else if compare(high, middle).is_lt() {
        *high
    } else {
        *middle
    })
}

/// Moves the items that satisfy `is_first` to the front; returns how many there are.
fn partition<T>(items: &mut [T], is_first: impl Fn(&T) -> bool) -> usize {
    let mut count = 0;
    let mut rest = items.iter_mut();
    while let Some(item) = rest.next() {
        if !is_first(item) {
            let Some(other) = rest.rfind(|item| is_first(item)) else {
                break;
            };
            swap(item, other);
        }
        count += 1;
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn both_select_and_sort_the_same(mut items in proptest::collection::vec(0u32..50, 1..200), k in any::<usize>()) {
            let k = k % items.len();
            let mut sorted = items.clone();
            sorted.sort_unstable();
            prop_assert_eq!(select(&mut items.clone(), k, u32::cmp), Some(sorted[k]));
            quickselect(&mut items, k, u32::cmp);
            let (below, above) = items.split_at(k);
            prop_assert_eq!(above[0], sorted[k]);
            prop_assert!(below.iter().all(|&item| item <= sorted[k]));
            prop_assert!(above.iter().all(|&item| item >= sorted[k]));
            quicksort(&mut items, u32::cmp);
            prop_assert_eq!(&items, &sorted);
            sort(&mut items, u32::cmp);
            prop_assert_eq!(&items, &sorted);
        }
    }

    #[test]
    fn none_is_selected_where_there_are_fewer() {
        assert_eq!(select(&mut [3, 1], 2, u32::cmp), None);
        assert_eq!(select(&mut [], 0, u32::cmp), None);
    }
}
