//! Nearest points on a surface whose points lie in boxes, with queries in lanes.
//!
//! As in [`super::lanes`], the bits are the same on every kernel. A box no nearer than the nearest point so far holds no nearer
//! point, however distances round: both distances are the same sums of ordered differences.

#![allow(unsafe_code)]

use super::Isa;
use super::boxes::{BLOCKS, Boxed, RUN, bounds, largest, squared_gap};
use super::hidden::has;
use super::lanes::{LANES, Lanes, Places, Row, Seen, Vectors};
use super::on_lanes::on_lanes;
use super::{BATCH, Batch, Corners};
use crate::dims::SURFACE_POINTS;
use crate::pose::Pose;

/// Bit of a place that says that no point was within the limit.
pub const BEYOND: u16 = 1 << 15;
const _: () = assert!(SURFACE_POINTS <= BEYOND as usize && BATCH == LANES);

/// Points whose nearest points on another surface are sought.
#[derive(Clone, Copy, Debug)]
pub struct NearestQuery<'a> {
    /// Points of a surface, and their number.
    pub points: (&'a Places, usize),
    /// Stride of the points sought; at least 1.
    pub every: usize,
    /// The pose applied to them.
    pub pose: Pose,
}

impl NearestQuery<'_> {
    /// Number of points sought.
    #[inline(always)]
    pub(super) fn count(&self) -> usize {
        self.points
            .1
            .min(SURFACE_POINTS)
            .div_ceil(self.every.max(1))
    }

    /// Places of a batch of `count` points from `first` on; lanes beyond repeat the last.
    #[inline(always)]
    pub(super) fn places(&self, first: usize, count: usize) -> [u16; LANES] {
        let mut places = [0; LANES];
        for (i, place) in places.iter_mut().enumerate() {
            *place = ((first + i.min(count - 1)) * self.every) as u16;
        }
        places
    }
}

/// Squared distances from transformed points to the points at `places`.
#[inline(always)]
fn apart<L: Lanes>(at: &[Row; 3], of: &Places, places: &[u16; LANES], lane: usize) -> L {
    let apart = Vectors::<L>::load(at, lane) - L::gather(of, places, lane);
    apart.dot(apart)
}

/// Transforms the points at `places` by a pose.
#[inline(always)]
fn see<L: Lanes>(seen: &Seen<L>, points: &Places, places: &[u16; LANES], at: &mut [Row; 3]) {
    for lane in (0..LANES).step_by(L::COUNT) {
        let p = seen.point(L::gather(points, places, lane));
        let [x, y, z] = at;
        p.x.store(x, lane);
        p.y.store(y, lane);
        p.z.store(z, lane);
    }
}

/// See [`Isa::find`].
#[inline(always)]
fn find<L: Lanes>(
    sought: &NearestQuery<'_>,
    other: &Boxed<'_>,
    is_known: bool,
    limit: f32,
    places: &mut [u16; SURFACE_POINTS],
    keys: &mut [u32; SURFACE_POINTS],
) {
    let seen = Seen::<L>::under(&sought.pose);
    let mut batch = Batch::EMPTY;
    let all = sought.count();
    for (first, keys) in (0..all).step_by(BATCH).zip(keys.as_chunks_mut().0) {
        let keys: &mut [u32; BATCH] = keys;
        let count = BATCH.min(all - first);
        let of = sought.places(first, count);
        see(&seen, sought.points.0, &of, &mut batch.at);
        (batch.nearest, batch.place) = ([limit; BATCH], [0; BATCH]);
        if is_known {
            let mut known = [0; LANES];
            for (known, &of) in known.iter_mut().zip(&of) {
                *known = places[usize::from(of) % SURFACE_POINTS] & !BEYOND;
            }
            for lane in (0..LANES).step_by(L::COUNT) {
                let squared: L = apart(&batch.at, other.points.0, &known, lane);
                squared.min(L::all(limit)).store(&mut batch.nearest, lane);
            }
            for (place, known) in batch.place.iter_mut().zip(known) {
                *place = known.into();
            }
            if let Some(hidden) = other.hidden {
                for (nearest, known) in batch.nearest.iter_mut().zip(known) {
                    if has(hidden, known.into()) {
                        *nearest = limit;
                    }
                }
            }
        }
        search::<L>(&mut batch, other);
        for i in 0..count {
            let beyond = if batch.nearest[i] < limit { 0 } else { BEYOND };
            places[usize::from(of[i]) % SURFACE_POINTS] = batch.place[i] as u16 | beyond;
        }
        for (key, nearest) in keys.iter_mut().zip(&batch.nearest) {
            *key = nearest.to_bits(); // non-negative floats order as their bits do
        }
    }
}

/// See [`Isa::known`].
#[inline(always)]
fn known<L: Lanes>(
    sought: &NearestQuery<'_>,
    other: &Places,
    places: &[u16; SURFACE_POINTS],
    keys: &mut [u32; SURFACE_POINTS],
) {
    let seen = Seen::<L>::under(&sought.pose);
    let mut at = [[0.0; LANES]; 3];
    let all = sought.count();
    for (first, keys) in (0..all).step_by(BATCH).zip(keys.as_chunks_mut().0) {
        let keys: &mut [u32; BATCH] = keys;
        let of = sought.places(first, BATCH.min(all - first));
        see(&seen, sought.points.0, &of, &mut at);
        let mut known = [0; LANES];
        for (known, &of) in known.iter_mut().zip(&of) {
            *known = places[usize::from(of) % SURFACE_POINTS] & !BEYOND;
        }
        let mut squared = [0.0; LANES];
        for lane in (0..LANES).step_by(L::COUNT) {
            apart::<L>(&at, other, &known, lane).store(&mut squared, lane);
        }
        for (key, squared) in keys.iter_mut().zip(squared) {
            *key = squared.to_bits();
        }
    }
}

/// See [`Isa::nearest`].
#[inline(always)]
fn search<L: Lanes>(batch: &mut Batch, other: &Boxed<'_>) {
    let gaps = other.gaps::<L>(&bounds::<L>(&batch.at));
    let mut worst = largest::<L>(&batch.nearest);
    let mut shown = BLOCKS;
    if worst == f32::INFINITY {
        // The nearest block first, so that the others have something to be compared with.
        let mut least = gaps[0];
        shown = 0;
        for (block, &gap) in gaps.iter().enumerate().take(other.count()).skip(1) {
            if gap < least {
                (shown, least) = (block, gap);
            }
        }
        show::<L>(batch, other, shown);
        worst = largest::<L>(&batch.nearest);
    }
    for first in (0..other.count()).step_by(LANES) {
        let mut near = other.below::<L>(&gaps, first, worst);
        while near != 0 {
            let block = first + near.trailing_zeros() as usize;
            near &= near - 1;
            if gaps[block % BLOCKS] < worst && block != shown && !other.is_hidden(block) {
                show::<L>(batch, other, block);
                worst = largest::<L>(&batch.nearest);
            }
        }
    }
}

/// Compares a batch with the points of a block, run by run.
#[inline(always)]
fn show<L: Lanes>(batch: &mut Batch, other: &Boxed<'_>, block: usize) {
    let (points, of_block) = (other.points.0, other.places(block));
    for lane in (0..LANES).step_by(L::COUNT) {
        let at = Vectors::<L>::load(&batch.at, lane);
        let mut best = L::load(&batch.nearest, lane);
        let mut place = L::load_counts(&batch.place, lane);
        for first in of_block.clone().step_by(RUN) {
            let run = points.get(first..of_block.end.min(first + RUN));
            let (Some(corners), Some(run)) = (other.runs.get(first / RUN), run) else {
                break;
            };
            let hidden = other.hidden_in(first / RUN);
            if hidden == u8::MAX || !reaches(at, best, corners) {
                continue;
            }
            if hidden == 0 {
                for (here, &point) in (first..).zip(run) {
                    let apart = at - Vectors::all(point);
                    (best, place) = best.keep_less(place, apart.dot(apart), here as u32);
                }
                continue;
            }
            for (here, &point) in (first..).zip(run) {
                if hidden >> (here % RUN) & 1 == 0 {
                    let apart = at - Vectors::all(point);
                    (best, place) = best.keep_less(place, apart.dot(apart), here as u32);
                }
            }
        }
        best.store(&mut batch.nearest, lane);
        L::store_counts(place, &mut batch.place, lane);
    }
}

/// Whether a box may hold a point nearer to some lane than its nearest so far.
#[inline(always)]
fn reaches<L: Lanes>(at: Vectors<L>, nearest: L, &[low, high]: &Corners) -> bool {
    let (below, above) = (Vectors::all(low) - at, at - Vectors::all(high));
    squared_gap(below, above).below(nearest) != 0
}

impl Isa {
    /// Finds the nearest point of another surface that is not hidden to each point sought, if its squared distance is below
    /// `limit`. With `is_known`, `places` holds points that may be near. Writes the place of each point's nearest at the point's
    /// own place, or sets [`BEYOND`] on an old place; and writes to `keys`, in order, the bits of the squared distances, or of
    /// the limit.
    pub fn find(
        self,
        sought: &NearestQuery<'_>,
        other: &Boxed<'_>,
        is_known: bool,
        limit: f32,
        places: &mut [u16; SURFACE_POINTS],
        keys: &mut [u32; SURFACE_POINTS],
    ) {
        on_lanes!(
            self,
            find(
                sought: &NearestQuery<'_>,
                other: &Boxed<'_>,
                is_known: bool,
                limit: f32,
                places: &mut [u16; SURFACE_POINTS],
                keys: &mut [u32; SURFACE_POINTS],
            )
        );
    }

    /// Writes to `keys` the bits of the squared distances from the points sought to those in `places`.
    pub fn known(
        self,
        sought: &NearestQuery<'_>,
        other: &Places,
        places: &[u16; SURFACE_POINTS],
        keys: &mut [u32; SURFACE_POINTS],
    ) {
        on_lanes!(
            self,
            known(
                sought: &NearestQuery<'_>,
                other: &Places,
                places: &[u16; SURFACE_POINTS],
                keys: &mut [u32; SURFACE_POINTS],
            )
        );
    }

    /// Updates the nearest points of a batch with points that are nearer than those found so far.
    pub fn nearest(self, batch: &mut Batch, other: &Boxed<'_>) {
        on_lanes!(self, search(batch: &mut Batch, other: &Boxed<'_>));
    }
}
