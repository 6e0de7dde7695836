//! Losses of pairs of nearest points, and the comparison of two poses point by point.

use glam::Vec3;

/// Distance along the surface that sampling alone explains, in neighbourhood radii.
pub(crate) const GAP: f32 = 0.3;
/// Distance from a surface at which a point's loss is one half, in neighbourhood radii.
pub(crate) const SURFACE: f32 = 0.1;
/// The same for the distance between points.
pub(crate) const POINT: f32 = 0.1;
/// Share of the loss that measures the distance between points. It is small, but where clouds share points it tells which turn
/// of a surface of revolution is meant.
pub(crate) const POINT_SHARE: f32 = 0.25;
/// Loss from which on a point counts as unmatched: that at half a neighbourhood's radius.
const UNMATCHED: f32 = 0.96;

/// Loss of a point beyond an edge of the other surface. `EDGE` says how far inward the nearest point's neighbours lie on
/// average, in radii: inside the surface, and at an edge. The weighted mean of half a disc is at 0.34.
pub(crate) const BEYOND_EDGE: f32 = 0.3;
const EDGE: [f32; 2] = [0.1, 0.3];

/// Most points of one cloud by which poses are compared.
pub(crate) const COMPARED: usize = 1024;
/// Most poses that are compared.
pub(crate) const CONTENDERS: usize = 8;

/// Loss of a point that lies `apart` from its nearest point on a surface, whose `normal` is given there and whose
/// neighbourhoods have this `radius`: 0 on the surface, 1/2 at a distance of `scale` radii, 1 far away.
///
/// `kernels/losses.rs` has the same in lanes, and tests compare the two. A single number as a lane would need more code than it saves.
#[inline(always)]
pub(crate) fn of_surface(apart: Vec3, normal: Vec3, radius: f32, scale: f32) -> f32 {
    let across = normal.dot(apart);
    let along = libm::sqrtf((apart.length_squared() - across * across).max(0.0));
    let beyond = (along - GAP * radius).max(0.0);
    saturating(across * across + beyond * beyond, scale * radius)
}

/// Whether the loss of such a point is below one half.
pub(crate) fn is_on_surface(apart: Vec3, normal: Vec3, radius: f32) -> bool {
    of_surface(apart, normal, radius, SURFACE) < 0.5
}

/// Whether it is at most three times as far away as that.
pub(crate) fn is_near_surface(apart: Vec3, normal: Vec3, radius: f32) -> bool {
    of_surface(apart, normal, radius, 3.0 * SURFACE) < 0.5
}

/// Limits a loss below 1 beyond an edge, past which the surface may go on unseen. The point lies `apart` from its nearest point
/// on the surface, whose neighbours lie `inward` of it on average, in radii.
#[inline(always)]
pub(crate) fn beyond_edge(loss: f32, apart: Vec3, inward: Vec3) -> f32 {
    let [within, at_edge] = EDGE;
    let outward = -inward.dot(apart) / libm::sqrtf(apart.length_squared().max(1e-12));
    let share = ((outward - within) / (at_edge - within)).clamp(0.0, 1.0);
    loss.min(1.0 - share * (1.0 - BEYOND_EDGE))
}

/// `d² / (d² + c²)` (Geman and McClure).
#[inline(always)]
fn saturating(squared: f32, half: f32) -> f32 {
    squared / (squared + (half * half).max(1e-12))
}

/// Losses of both clouds' points under several poses, in units of 1/255.
#[derive(Clone, Debug)]
pub(crate) struct Losses {
    of: [[u8; 2 * COMPARED]; CONTENDERS],
    len: [u16; CONTENDERS],
}

impl Losses {
    /// Losses of no pose. All bits are zero.
    pub(crate) const EMPTY: Losses = Losses {
        of: [[0; 2 * COMPARED]; CONTENDERS],
        len: [0; CONTENDERS],
    };

    /// Keeps the losses under one pose: the source's points, then the target's, each evenly thinned to at most [`COMPARED`].
    pub(crate) fn keep(
        &mut self,
        contender: usize,
        losses: [impl ExactSizeIterator<Item = f32>; 2],
    ) {
        let (Some(row), Some(len)) = (self.of.get_mut(contender), self.len.get_mut(contender))
        else {
            return;
        };
        let mut places = row.iter_mut();
        *len = 0;
        for losses in losses {
            let count = losses.len().max(COMPARED);
            let upto = |i: usize| i * COMPARED / count;
            let some = losses.enumerate().filter(|&(i, _)| upto(i) < upto(i + 1));
            for ((_, loss), place) in some.zip(&mut places) {
                *place = (255.0 * loss + 0.5) as u8;
                *len += 1;
            }
        }
    }

    /// Copies the losses of one pose to another.
    pub(crate) fn copy(&mut self, from: usize, to: usize) {
        if from < CONTENDERS && to < CONTENDERS {
            self.of.copy_within(from..=from, to);
            self.len.copy_within(from..=from, to);
        }
    }

    fn row(&self, contender: usize) -> &[u8] {
        let len = self.len.get(contender).copied().unwrap_or(0);
        let row = self.of.get(contender).map_or(&[][..], |row| &row[..]);
        row.get(..usize::from(len)).unwrap_or(&[])
    }

    /// How much more pose `of` loses than pose `over`, summed over all points, and the sum of squares. The sum over the root of
    /// the squares is a score in standard errors.
    pub(crate) fn excess(&self, of: usize, over: usize) -> Excess {
        self.excess_where(of, over, u8::MAX)
    }

    /// The same over the points matched under pose `of`, where it claims that the clouds overlap.
    pub(crate) fn excess_where_matched(&self, of: usize, over: usize) -> Excess {
        self.excess_where(of, over, (255.0 * UNMATCHED) as u8)
    }

    /// Share of all points that are matched under a pose.
    pub(crate) fn matched(&self, of: usize) -> f32 {
        let row = self.row(of);
        let matched = row.iter().filter(|&&a| a <= (255.0 * UNMATCHED) as u8);
        matched.count() as f32 / row.len().max(1) as f32
    }

    fn excess_where(&self, of: usize, over: usize, most: u8) -> Excess {
        let (mut sum, mut squares) = (0i64, 0i64);
        let pairs = self.row(of).iter().zip(self.row(over));
        for (&a, &b) in pairs.filter(|&(&a, _)| a <= most) {
            let d = i64::from(a) - i64::from(b);
            sum += d;
            squares += d * d;
        }
        Excess {
            sum: sum as f32 / 255.0,
            squares: squares as f32 / (255.0 * 255.0),
        }
    }
}

/// See [`Losses::excess`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Excess {
    sum: f32,
    squares: f32,
}

impl Excess {
    /// The excess in standard errors of the sum.
    pub(crate) fn score(&self) -> f32 {
        self.sum / libm::sqrtf(self.squares.max(1.0))
    }
}
