//! Nearest points of one surface to those of another.

use super::boxes::{bounds_of, largest};
use super::keys::Keys;
use super::{BLOCK, Surface};
use crate::dims::SURFACE_POINTS;
use crate::kernels::{BATCH, Batch, Isa, RUN};
use crate::pose::Pose;
use glam::Vec3;

/// Bit of a place that says that no point was within the limit.
const BEYOND: u16 = 1 << 15;
const _: () = assert!(SURFACE_POINTS <= BEYOND as usize);

/// A point's nearest point of the other surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Match {
    /// Place of the point.
    pub(crate) of: usize,
    /// Place of the nearest point of the other surface; none where it is not within the limit.
    pub(crate) to: Option<usize>,
}

/// Which points of another surface are nearest to a surface's, by when they were looked for last.
#[derive(Clone, Debug)]
pub(crate) struct Matching {
    /// After [`Self::find`], the squared distances that it found.
    pub(crate) keys: Keys,
    /// Points of the surface.
    len: usize,
    /// Every how many-th point was matched last; 0 where none was yet.
    every: usize,
    /// Whether all points were matched at least once.
    is_known: bool,
    /// Of each point: the place of the other surface's point that was nearest when one was found last, and [`BEYOND`] where none was
    /// within the limit since.
    place: [u16; SURFACE_POINTS],
}

impl Matching {
    /// Of no surface. All bits are zero.
    pub(crate) const EMPTY: Matching = Matching {
        keys: Keys::ZERO,
        len: 0,
        every: 0,
        is_known: false,
        place: [0; SURFACE_POINTS],
    };

    /// Forgets what was found: the surfaces are others.
    pub(crate) fn forget(&mut self) {
        (self.len, self.every, self.is_known) = (0, 0, false);
    }

    /// Finds the nearest point of `other` to every `every`-th point of a surface, seen under `pose`, if it is nearer than the root of
    /// `limit`. What was nearest under another pose shortens the search.
    pub(crate) fn find(
        &mut self,
        isa: Isa,
        [surface, other]: [&Surface; 2],
        pose: Pose,
        every: usize,
        limit: f32,
    ) {
        let every = every.max(1);
        (self.len, self.every) = (surface.len, every);
        let of_batch = BATCH * every;
        let points = surface.points().chunks(of_batch);
        let places = self.place.chunks_mut(of_batch);
        let (keys, _) = self.keys.0.as_chunks_mut::<BATCH>();
        let mut batch = Batch::EMPTY;
        for ((points, places), keys) in points.zip(places).zip(keys) {
            load(&mut batch, &mut every_nth(points, every, pose));
            (batch.nearest, batch.place) = ([limit; BATCH], [0; BATCH]);
            if self.is_known {
                let places = places.iter().step_by(every);
                other.show_known(&mut batch, places.map(|place| place & !BEYOND));
            }
            other.nearest(isa, &mut batch);
            let found = batch.place.iter().zip(&batch.nearest);
            for (place, (&found, &squared)) in places.iter_mut().step_by(every).zip(found) {
                *place = found as u16 | if squared < limit { 0 } else { BEYOND };
            }
            *keys = batch.nearest.map(f32::to_bits); // in the order of the distances: they are not negative
        }
        self.is_known |= every == 1;
    }

    /// At most so large is the median squared distance from `other` of every `every`-th point, seen under `pose`: that of the
    /// points that were nearest when they were matched last.
    pub(crate) fn largest_median(
        &mut self,
        [surface, other]: [&Surface; 2],
        pose: Pose,
        every: usize,
    ) -> f32 {
        if !self.is_known {
            return f32::INFINITY;
        }
        let every = every.max(1);
        let mut count = 0;
        let points = every_nth(surface.points(), every, pose);
        let places = self.place.iter().step_by(every);
        for ((key, p), &place) in self.keys.0.iter_mut().zip(points).zip(places) {
            let (q, _) = other.at((place & !BEYOND).into());
            *key = (p - q).length_squared().to_bits();
            count += 1;
        }
        self.keys.select(count, count / 2)
    }

    /// What [`Self::find`] found.
    pub(crate) fn matches(&self) -> impl Iterator<Item = Match> {
        let places = self.place.iter().enumerate().take(self.len);
        places.step_by(self.every.max(1)).map(|(of, &to)| Match {
            of,
            to: (to & BEYOND == 0).then_some(usize::from(to)),
        })
    }

    /// Median squared distance of the matches, once after [`Self::find`]; the limit where it is not below that.
    pub(crate) fn median_squared(&mut self) -> f32 {
        let count = self.len.div_ceil(self.every.max(1));
        self.keys.select(count, count / 2)
    }
}

impl Surface {
    /// Shows each lane of a batch one point that may be near; those beyond the last, that of the last. Where it is not nearer than
    /// the limit its place is kept.
    pub(crate) fn show_known(&self, batch: &mut Batch, mut places: impl Iterator<Item = u16>) {
        let Batch { at, nearest, place } = batch;
        let [x, y, z] = at;
        let mut known = 0;
        for ((((x, y), z), nearest), place) in x.iter().zip(y).zip(z).zip(nearest).zip(place) {
            known = places.next().unwrap_or(known);
            if let Some(&[a, b, c]) = self.points().get(usize::from(known)) {
                let (dx, dy, dz) = (*x - a, *y - b, *z - c);
                let squared = dx * dx + dy * dy + dz * dz;
                *nearest = if squared < *nearest {
                    squared
                } else {
                    *nearest
                };
                *place = known.into();
            }
        }
    }

    /// Nearest points to a batch, all of whose lanes are set, by distances that are known already or a limit.
    pub(crate) fn nearest(&self, isa: Isa, batch: &mut Batch) {
        let gaps = self.boxes.gaps(&bounds_of(batch), self.len.div_ceil(BLOCK));
        let mut worst = largest(&batch.nearest);
        let mut shown = usize::MAX;
        if worst == f32::INFINITY {
            let nearer = |a: &(f32, usize), b: (f32, usize)| if b.0 < a.0 { b } else { *a };
            let starts = gaps
                .iter()
                .zip(self.blocks())
                .map(|(&gap, (start, _))| (gap, start));
            (_, shown) = starts.fold((f32::INFINITY, 0), |a, b| nearer(&a, b));
            self.show(isa, batch, shown);
            worst = largest(&batch.nearest);
        }
        for (&gap, (start, _)) in gaps.iter().zip(self.blocks()) {
            if gap < worst && start != shown {
                self.show(isa, batch, start);
                worst = largest(&batch.nearest);
            }
        }
    }

    /// Shows the block that starts at a place to a batch.
    fn show(&self, isa: Isa, batch: &mut Batch, start: usize) {
        let points = self.points().get(start..).unwrap_or(&[]);
        let points = points.get(..BLOCK).unwrap_or(points);
        let runs = self.runs.get(start / RUN..).unwrap_or(&[]);
        isa.show(batch, points, runs, start as u32);
    }
}

/// Every so many-th point, seen under a pose.
fn every_nth(points: &[[f32; 3]], every: usize, pose: Pose) -> impl Iterator<Item = Vec3> {
    let sampled = points.iter().step_by(every);
    sampled.map(move |&p| pose.apply(Vec3::from_array(p)))
}

/// Sets all lanes of a batch: to the next points, then to the last of them. Says how many there were.
pub(super) fn load(batch: &mut Batch, points: &mut impl Iterator<Item = Vec3>) -> usize {
    let mut count = 0;
    let mut last = Vec3::ZERO;
    let [xs, ys, zs] = &mut batch.at;
    for ((x, y), z) in xs.iter_mut().zip(ys).zip(zs) {
        if let Some(p) = points.next() {
            last = p;
            count += 1;
        }
        [*x, *y, *z] = last.to_array();
    }
    count
}
