//! Thinning: a deterministic choice of fewer points. They are spread as all points are, or evenly over space where
//! a cloud crowds in few places.

mod even;

use crate::dataset::Point;
use reagent_core::outliers::Bulk;
use std::cmp::Ordering;

/// Bits of a cell's coordinate along each axis.
const BITS: u32 = 21;
/// Points that are examined first, to see whether any lie far from all others.
const JUDGED: usize = 1 << 16;
/// Most stretches of the curve in which points are counted first.
const STRETCHES: usize = 1 << 18;

/// `count` of a cloud's points, none twice, or all if there are no more. The choice depends neither on the points'
/// order nor on a seed.
///
/// The points are spread as all are, unless the cloud is as uneven as a lidar's scan, which is dense near the
/// sensor: two scans would then fit where sensor lies on sensor. Such clouds are thinned evenly over space. Points
/// that lie far from all others, such as markers of invalid returns, keep their share and do not affect the rest.
pub fn thin(points: &[Point], count: usize) -> Vec<Point> {
    if points.len() <= count {
        return points.to_vec();
    }
    let Some([near, far]) = near_and_far(points) else {
        return thin_near(points, count);
    };
    let share = (far.len() as u64 * count as u64).div_ceil(points.len() as u64) as usize;
    let mut thinned = thin_near(&near, count - share);
    thinned.extend(spread_as_all(&far, share));
    thinned
}

/// Splits off the points that lie far from all others: (near, far). `None` if there are none.
fn near_and_far(points: &[Point]) -> Option<[Vec<Point>; 2]> {
    let bulk = bulk(points);
    if bulk == Bulk::ALL {
        return None;
    }
    let (near, far) = points.iter().partition(|&&point| bulk.holds(point));
    Some([near, far])
}

/// Which points do not lie far from all others.
pub fn bulk(points: &[Point]) -> Bulk {
    let of = |count: usize| Bulk::of(points, &mut vec![0; count]);
    let some = points.len().min(JUDGED);
    // If a sample of the points has no gap, the rest hardly has one.
    match of(some) {
        bulk if bulk == Bulk::ALL || some == points.len() => bulk,
        _ => of(points.len()),
    }
}

fn thin_near(points: &[Point], count: usize) -> Vec<Point> {
    let as_all = spread_as_all(points, count);
    if as_all.len() == points.len() || !even::is_uneven(&as_all) {
        return as_all;
    }
    match even::one_a_cell(points, count) {
        Some(of_cells) if of_cells.len() > count => spread_as_all(&of_cells, count),
        Some(of_cells) => of_cells,
        None => as_all,
    }
}

/// `count` points at equal steps along a Z-order curve (Morton 1966) through a larger cloud. Every region keeps its
/// share of the points to within one, which a random draw leaves to chance.
fn spread_as_all(points: &[Point], count: usize) -> Vec<Point> {
    if points.len() <= count {
        return points.to_vec();
    }
    let code = curve(points);
    // The middle of each of `count` equal stretches.
    // In 64 bits: products of millions of points overflow the browser's usize of 32.
    let step = |i: usize| ((2 * i as u64 + 1) * points.len() as u64 / (2 * count as u64)) as usize;
    // Points are counted by the first bits of their codes; only stretches from which a point is taken are sorted.
    let stretches = points.len().next_power_of_two().min(STRETCHES);
    let place_bits = 3 * BITS - stretches.ilog2();
    let stretch: Vec<u32> = points
        .iter()
        .map(|p| (code(p) >> place_bits) as u32)
        .collect();
    let mut ends = vec![0usize; stretches];
    for &of in &stretch {
        ends[of as usize] += 1;
    }
    for i in 1..stretches {
        ends[i] += ends[i - 1];
    }
    let from: Vec<usize> = (0..count)
        .map(|i| ends.partition_point(|&end| end <= step(i)))
        .collect();
    let mut is_taken = vec![false; stretches];
    for &of in &from {
        is_taken[of] = true;
    }
    let taken = points.iter().zip(&stretch);
    let taken = taken.filter(|&(_, &of)| is_taken[of as usize]);
    let mut order: Vec<(u64, Point)> = taken.map(|(p, _)| (code(p), *p)).collect();
    order.sort_unstable_by(along);
    // Number of points in skipped stretches before a place.
    let (mut passed, mut left_out) = (0, 0);
    let places = from.into_iter().enumerate().map(|(i, of)| {
        for stretch in passed..of {
            if !is_taken[stretch] {
                left_out += ends[stretch] - stretch.checked_sub(1).map_or(0, |last| ends[last]);
            }
        }
        passed = of;
        step(i) - left_out
    });
    places.map(|place| order[place].1).collect()
}

/// Position of a point along the curve.
fn curve(points: &[Point]) -> impl Fn(&Point) -> u64 {
    // Cells are cubes; their number is that along the longest side.
    let (low, side) = bounds(points);
    let cells = ((1u64 << BITS) - 1) as f64;
    move |point| {
        let place = |axis: usize| {
            let along = f64::from(point[axis] - low[axis]) / f64::from(side).max(f64::MIN_POSITIVE);
            spread((along * cells) as u64)
        };
        place(0) | place(1) << 1 | place(2) << 2
    }
}

/// The lowest corner and the longest side of the bounding box.
fn bounds(points: &[Point]) -> (Point, f32) {
    let mut low = [f32::INFINITY; 3];
    let mut high = [f32::NEG_INFINITY; 3];
    for point in points {
        for axis in 0..3 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    let sides = (0..3).map(|axis| high[axis] - low[axis]);
    (low, sides.fold(0.0, f32::max))
}

/// Order along the curve; points of one cell by their coordinates.
fn along(a: &(u64, Point), b: &(u64, Point)) -> Ordering {
    let places = || (0..3).map(|axis| a.1[axis].total_cmp(&b.1[axis]));
    a.0.cmp(&b.0)
        .then_with(|| places().fold(Ordering::Equal, Ordering::then))
}

/// The lowest 21 bits of `x`, with two zeros after each.
fn spread(x: u64) -> u64 {
    let x = x & 0x1f_ffff;
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, stream};
    use rand::RngExt;

    fn cloud(count: usize) -> Vec<Point> {
        let rng = &mut stream(3, Purpose::Pairs, 0);
        let point = |_| std::array::from_fn(|_| rng.random_range(-1.0..1.0));
        (0..count).map(point).collect()
    }

    #[test]
    fn points_are_taken_once_whatever_their_order() {
        let points = cloud(5000);
        let some = thin(&points, 700);
        let mut sorted: Vec<[u32; 3]> = some.iter().map(|p| p.map(f32::to_bits)).collect();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), 700);
        assert!(some.iter().all(|p| points.contains(p)));
        let mut reversed = points.clone();
        reversed.reverse();
        assert_eq!(thin(&reversed, 700), some);
        assert_eq!(thin(&points[..700], 700), points[..700]);
        assert_eq!(thin(&points, 1).len(), 1);
        assert_eq!(thin(&[[1.0; 3]; 9], 4), [[1.0; 3]; 4]);
    }

    #[test]
    fn marks_of_what_is_invalid_keep_their_share_and_the_rest_its_places() {
        let near = cloud(6000);
        let marks = [[1e9; 3], [-9999.0, 0.0, 0.0]].map(|mark| vec![mark; 1000]);
        let thinned = thin(&[&marks[0][..], &near, &marks[1]].concat(), 1000);
        let is_mark = |p: &&Point| p[0].abs() > 100.0;
        assert_eq!(
            (thinned.len(), thinned.iter().filter(is_mark).count()),
            (1000, 250)
        );
        assert_eq!(thinned[..750], thin(&near, 750));
    }

    #[test]
    fn counting_first_takes_what_sorting_all_would() {
        let mut points = cloud(20_000);
        // Many points in one place, and then one that shrinks all others to a corner of the box.
        points[..3000].fill([0.25; 3]);
        for far in [0.0, 1e6] {
            points[0] = [far; 3];
            let code = curve(&points);
            let mut sorted: Vec<_> = points.iter().map(|p| (code(p), *p)).collect();
            sorted.sort_by(along);
            for count in [19_999, 12_000, 700, 3, 1] {
                let every = |i: usize| sorted[(2 * i + 1) * points.len() / (2 * count)].1;
                let expected: Vec<Point> = (0..count).map(every).collect();
                assert_eq!(spread_as_all(&points, count), expected, "{far} {count}");
            }
        }
    }

    /// A random draw of 2000 has 250 in an octant, give or take 15.
    #[test]
    fn every_region_keeps_its_share() {
        let points = cloud(100_000);
        let share = |points: &[Point], octant: usize| {
            let inside =
                |p: &&Point| (0..3).all(|axis| (p[axis] > 0.0) == (octant >> axis & 1 == 1));
            points.iter().filter(inside).count() as f64 / points.len() as f64
        };
        let some = thin(&points, 2000);
        for octant in 0..8 {
            let (before, after) = (share(&points, octant), share(&some, octant));
            assert!((before - after).abs() < 2.5e-3, "{before} became {after}");
        }
    }
}
