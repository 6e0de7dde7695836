//! Matching: for points of one surface, the nearest points of another.

use super::Surface;
use super::keys::Keys;
use crate::dims::SURFACE_POINTS;
use crate::kernels::{BEYOND, BLOCK, Batch, Bits, Boxed, Isa, NearestQuery, RUN};
use crate::pose::Pose;
use glam::Vec3;

/// A point and its nearest point of the other surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Match {
    /// Place of the point.
    pub(crate) of: usize,
    /// Place of the nearest point of the other surface; `None` if it is not within the limit.
    pub(crate) to: Option<usize>,
}

/// For each point of a surface, the nearest point of another when it was last searched for.
#[derive(Clone, Debug)]
pub(crate) struct Matching {
    /// Squared distances, after [`Self::find`].
    pub(crate) keys: Keys,
    /// Number of the surface's points.
    len: usize,
    /// Stride of the points matched last; 0 before the first matching.
    every: usize,
    /// Whether all points were matched at least once.
    is_known: bool,
    /// For each point, the place of the last nearest point found on the other surface, with [`BEYOND`] set if none was within
    /// the limit since.
    place: [u16; SURFACE_POINTS],
}

impl Matching {
    /// Matches of no surface. All bits are zero.
    pub(crate) const EMPTY: Matching = Matching {
        keys: Keys::ZERO,
        len: 0,
        every: 0,
        is_known: false,
        place: [0; SURFACE_POINTS],
    };

    /// Forgets all matches, because the surfaces change.
    pub(crate) fn forget(&mut self) {
        (self.len, self.every, self.is_known) = (0, 0, false);
    }

    /// Finds the nearest point of `other` that is not hidden to every `every`-th point of a surface under `pose`, if its squared
    /// distance is below `limit`. The nearest points under the last pose shorten the search.
    pub(crate) fn find(
        &mut self,
        isa: Isa,
        [surface, other]: [&Surface; 2],
        hidden: Option<&Bits>,
        pose: Pose,
        every: usize,
        limit: f32,
    ) {
        (self.len, self.every) = (surface.len, every.max(1));
        let (is_known, sought) = (self.is_known, self.sought(surface, pose));
        let (places, keys) = (&mut self.place, &mut self.keys.0);
        let other = Boxed {
            hidden,
            ..other.boxed()
        };
        isa.find(&sought, &other, is_known, limit, places, keys);
        self.is_known |= every <= 1;
    }

    /// The points to search for.
    fn sought<'a>(&self, surface: &'a Surface, pose: Pose) -> NearestQuery<'a> {
        NearestQuery {
            points: (&surface.points, surface.len),
            every: self.every.max(1),
            pose,
        }
    }

    /// Upper bound on the median squared distance from `other` of every `every`-th point under `pose`: the median to the points
    /// that were nearest when last matched.
    pub(crate) fn largest_median(
        &mut self,
        isa: Isa,
        [surface, other]: [&Surface; 2],
        pose: Pose,
        every: usize,
    ) -> f32 {
        if !self.is_known {
            return f32::INFINITY;
        }
        (self.len, self.every) = (surface.len, every.max(1));
        let sought = self.sought(surface, pose);
        isa.known(&sought, &other.points, &self.place, &mut self.keys.0);
        self.median_squared()
    }

    /// The matches that [`Self::find`] found.
    pub(crate) fn matches(&self) -> impl Iterator<Item = Match> {
        matches(&self.place, self.len, self.every)
    }

    /// Sets the keys to the losses of the points matched last, under the pose of that matching. `point_share` is the share of
    /// the loss that measures the distance between points.
    pub(crate) fn lose(
        &mut self,
        isa: Isa,
        [surface, other]: [&Surface; 2],
        pose: Pose,
        point_share: f32,
    ) {
        let sought = self.sought(surface, pose);
        let (to, radius) = (other.bare(), other.radius);
        isa.losses(
            &sought,
            to,
            radius,
            point_share,
            &self.place,
            &mut self.keys.0,
        );
    }

    /// The matches with their losses; once after [`Self::lose`].
    pub(crate) fn lost_mut(&mut self) -> impl Iterator<Item = (Match, &mut u32)> {
        matches(&self.place, self.len, self.every).zip(&mut self.keys.0)
    }

    /// The losses; as [`Self::lost_mut`].
    pub(crate) fn lost(&self) -> impl ExactSizeIterator<Item = f32> {
        let count = self.len.div_ceil(self.every.max(1));
        self.keys
            .0
            .iter()
            .take(count)
            .map(|&bits| f32::from_bits(bits))
    }

    /// Median squared distance of the matches, or the limit if that is smaller; once after [`Self::find`].
    pub(crate) fn median_squared(&mut self) -> f32 {
        let count = self.len.div_ceil(self.every.max(1));
        self.keys.select(count, count / 2)
    }
}

impl Surface {
    /// Place and squared distance of the nearest point, if that is below `limit`.
    pub(crate) fn nearest(&self, seen: Vec3, limit: f32) -> Option<(usize, f32)> {
        let (mut found, mut least) = (None, limit);
        let gaps = self.blocks.gaps(seen.to_array());
        let gaps = gaps.get(..self.len.div_ceil(BLOCK)).unwrap_or(&[]);
        // The nearest block first: then few others can hold a nearer point.
        let blocks = || gaps.iter().enumerate();
        let first = blocks().min_by(|(_, one), (_, other)| one.total_cmp(other));
        let others = blocks().filter(|(block, _)| first.is_none_or(|(first, _)| first != *block));
        for (block, &gap) in first.into_iter().chain(others) {
            if gap >= least {
                continue;
            }
            let runs = block * (BLOCK / RUN)..(block + 1) * (BLOCK / RUN);
            for (run, &[low, high]) in runs.clone().zip(self.runs.get(runs).unwrap_or(&[])) {
                let nearest = seen.clamp(low.into(), high.into());
                if seen.distance_squared(nearest) >= least {
                    continue;
                }
                let places = run * RUN..self.len.min((run + 1) * RUN);
                for (place, &point) in places.clone().zip(self.points.get(places).unwrap_or(&[])) {
                    let squared = seen.distance_squared(point.into());
                    if squared < least {
                        (found, least) = (Some(place), squared);
                    }
                }
            }
        }
        found.map(|place| (place, least))
    }
}

/// The matches of every `every`-th of `len` points, from the places of their nearest points.
fn matches(places: &[u16], len: usize, every: usize) -> impl Iterator<Item = Match> {
    let places = places.iter().enumerate().take(len);
    places.step_by(every.max(1)).map(|(of, &to)| Match {
        of,
        to: (to & BEYOND == 0).then_some(usize::from(to)),
    })
}

/// Fills the lanes of a batch with the next points, and the rest with the last one; returns how many points it took.
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
