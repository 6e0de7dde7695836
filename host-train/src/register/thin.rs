//! Thinning: fewer points of a cloud, spread as all of them are, the same ones every time.

use crate::dataset::Point;

/// Bits of a cell's place along each axis.
const BITS: u32 = 21;

/// `count` of the points, none twice, or all where there are no more. They are taken at equal steps along a
/// Z-order curve (Morton 1966) through the cloud: every region keeps its share of the points to within one,
/// where a random draw leaves the share to chance. The order of the points does not matter, nor does any seed.
pub fn thin(points: &[Point], count: usize) -> Vec<Point> {
    if points.len() <= count {
        return points.to_vec();
    }
    let mut low = [f32::INFINITY; 3];
    let mut high = [f32::NEG_INFINITY; 3];
    for point in points {
        for axis in 0..3 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    // Cubic cells: the longest side has all of them.
    let side = (0..3)
        .map(|axis| high[axis] - low[axis])
        .fold(0.0, f32::max);
    let cells = ((1u64 << BITS) - 1) as f64;
    let code = |point: &Point| {
        let place = |axis: usize| {
            let along = f64::from(point[axis] - low[axis]) / f64::from(side).max(f64::MIN_POSITIVE);
            spread((along * cells) as u64)
        };
        place(0) | place(1) << 1 | place(2) << 2
    };
    let mut order: Vec<(u64, Point)> = points.iter().map(|p| (code(p), *p)).collect();
    order.sort_unstable_by(|a, b| {
        let places = || (0..3).map(|axis| a.1[axis].total_cmp(&b.1[axis]));
        places().fold(a.0.cmp(&b.0), |order, next| order.then(next))
    });
    // The middle of each of `count` equal stretches.
    let step = |i: usize| (2 * i + 1) * points.len() / (2 * count);
    (0..count).map(|i| order[step(i)].1).collect()
}

/// The lowest 21 bits, two zeros after each.
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
