//! Nearest points of a surface whose points lie in boxes, points in lanes.
//!
//! As in [`super::lanes`]: the same bits on every kernel. No point of a box that does not reach nearer than the nearest so far is
//! nearer, however its distance is rounded: both are the same sums of differences, and those are ordered.

#![allow(unsafe_code)]

use super::Isa;
#[cfg(target_arch = "x86_64")]
use super::Kind;
use super::boxes::{BLOCKS, Boxed, RUN, bounds, largest, squared_gap};
use super::lanes::{LANES, Lanes, Places, Row, Seen, Vectors};
use super::on_lanes::on_lanes;
use super::{BATCH, Batch, Corners};
use crate::dims::SURFACE_POINTS;
use crate::pose::Pose;

/// Bit of a place that says that no point was within the limit.
pub const BEYOND: u16 = 1 << 15;
const _: () = assert!(SURFACE_POINTS <= BEYOND as usize && BATCH == LANES);

/// Points that are looked for on another surface.
#[derive(Clone, Copy, Debug)]
pub struct Sought<'a> {
    /// Points of a surface, and how many there are.
    pub points: (&'a Places, usize),
    /// Every so many-th of them is looked for; at least 1.
    pub every: usize,
    /// The pose under which they are seen.
    pub pose: Pose,
}

impl Sought<'_> {
    /// How many there are.
    #[inline(always)]
    pub(super) fn count(&self) -> usize {
        self.points
            .1
            .min(SURFACE_POINTS)
            .div_ceil(self.every.max(1))
    }

    /// Places of a batch of `count`, from one on; those beyond the last as the last.
    #[inline(always)]
    pub(super) fn places(&self, first: usize, count: usize) -> [u16; LANES] {
        let mut places = [0; LANES];
        for (i, place) in places.iter_mut().enumerate() {
            *place = ((first + i.min(count - 1)) * self.every) as u16;
        }
        places
    }
}

/// Squared distances of seen points from those at such places.
#[inline(always)]
fn apart<L: Lanes>(at: &[Row; 3], of: &Places, places: &[u16; LANES], lane: usize) -> L {
    let apart = Vectors::<L>::load(at, lane) - L::gather(of, places, lane);
    apart.dot(apart)
}

/// Sees points at such places under a pose.
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
    sought: &Sought<'_>,
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
        }
        search::<L>(&mut batch, other);
        for i in 0..count {
            let beyond = if batch.nearest[i] < limit { 0 } else { BEYOND };
            places[usize::from(of[i]) % SURFACE_POINTS] = batch.place[i] as u16 | beyond;
        }
        for (key, nearest) in keys.iter_mut().zip(&batch.nearest) {
            *key = nearest.to_bits(); // in the order of the distances: they are not negative
        }
    }
}

/// See [`Isa::known`].
#[inline(always)]
fn known<L: Lanes>(
    sought: &Sought<'_>,
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
        // The nearest block gives the others something to be compared with.
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
            if gaps[block % BLOCKS] < worst && block != shown {
                show::<L>(batch, other, block);
                worst = largest::<L>(&batch.nearest);
            }
        }
    }
}

/// Shows the points of a block to a batch, in runs.
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
            if !reaches(at, best, corners) {
                continue;
            }
            for (here, &point) in (first..).zip(run) {
                let apart = at - Vectors::all(point);
                (best, place) = best.keep_less(place, apart.dot(apart), here as u32);
            }
        }
        best.store(&mut batch.nearest, lane);
        L::store_counts(place, &mut batch.place, lane);
    }
}

/// Whether a box reaches nearer to one of some points than its nearest so far.
#[inline(always)]
fn reaches<L: Lanes>(at: Vectors<L>, nearest: L, &[low, high]: &Corners) -> bool {
    let (below, above) = (Vectors::all(low) - at, at - Vectors::all(high));
    squared_gap(below, above).below(nearest) != 0
}

impl Isa {
    /// Finds the nearest point of another surface to each of the points sought, if it is nearer than the root of `limit`; where
    /// `is_known`, `places` are those of points that may be near. Sets, at its own place, the place of each point's nearest, else
    /// [`BEYOND`] beside what was there, and as keys, one after the other, the bits of the squared distances, else of the limit.
    pub fn find(
        self,
        sought: &Sought<'_>,
        other: &Boxed<'_>,
        is_known: bool,
        limit: f32,
        places: &mut [u16; SURFACE_POINTS],
        keys: &mut [u32; SURFACE_POINTS],
    ) {
        on_lanes!(
            self,
            find(
                sought: &Sought<'_>,
                other: &Boxed<'_>,
                is_known: bool,
                limit: f32,
                places: &mut [u16; SURFACE_POINTS],
                keys: &mut [u32; SURFACE_POINTS],
            )
        );
    }

    /// Sets as keys the bits of the squared distances of the points sought from those that `places` name.
    pub fn known(
        self,
        sought: &Sought<'_>,
        other: &Places,
        places: &[u16; SURFACE_POINTS],
        keys: &mut [u32; SURFACE_POINTS],
    ) {
        on_lanes!(
            self,
            known(
                sought: &Sought<'_>,
                other: &Places,
                places: &[u16; SURFACE_POINTS],
                keys: &mut [u32; SURFACE_POINTS],
            )
        );
    }

    /// Finds the nearest points to a batch, of those that are nearer than what stands there.
    pub fn nearest(self, batch: &mut Batch, other: &Boxed<'_>) {
        on_lanes!(self, search(batch: &mut Batch, other: &Boxed<'_>));
    }
}
