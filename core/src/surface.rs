//! A cloud as a sampled surface: points in spatial order, boxes around runs of them, and normals.

use crate::cells::{bounds, compare, cut};
use crate::dims::SURFACE_POINTS;
use crate::kernels::{BATCH, Batch, Corners, Isa, Moments, RUN};
use crate::outliers::Bulk;
use crate::pose::Pose;
use crate::solve::{principal_axes, smallest_direction};
use glam::{Mat3, Vec3};

/// Points of one box.
const BLOCK: usize = 32;
const BLOCKS: usize = SURFACE_POINTS / BLOCK;
const RUNS: usize = SURFACE_POINTS / RUN;
/// Points of a cell, of whole blocks.
const CELL: usize = 128;
/// Points of a neighbourhood, in the median: what [`Surface::radius`] holds.
const NEIGHBOURS: usize = 24;
/// Radius within which a normal is estimated, in radii of a neighbourhood.
const NORMAL_RADIUS: f32 = 0.85;

/// The boxes of all blocks, one row an axis: distances to all of them are found in lanes.
#[derive(Clone, Debug)]
struct Boxes {
    low: [[f32; BLOCKS]; 3],
    high: [[f32; BLOCKS]; 3],
}

impl Boxes {
    /// Of no blocks. All bits are zero.
    const ZERO: Boxes = Boxes {
        low: [[0.0; BLOCKS]; 3],
        high: [[0.0; BLOCKS]; 3],
    };

    fn set(&mut self, block: usize, [low, high]: Corners) {
        for (rows, corner) in [(&mut self.low, low), (&mut self.high, high)] {
            for (row, x) in rows.iter_mut().zip(corner) {
                if let Some(place) = row.get_mut(block) {
                    *place = x;
                }
            }
        }
    }

    /// Squared distance of the first `blocks` from a box.
    fn gaps(&self, [low, high]: &Corners, blocks: usize) -> [f32; BLOCKS] {
        let mut gaps = [0.0f32; BLOCKS];
        let corners = low.iter().zip(high);
        for ((low, high), (&l, &h)) in self.low.iter().zip(&self.high).zip(corners) {
            let boxes = gaps.iter_mut().zip(low).zip(high).take(blocks);
            for ((gap, &low), &high) in boxes {
                let (below, above) = (l - high, low - h);
                let d = if below > above { below } else { above };
                let d = if d > 0.0 { d } else { 0.0 };
                *gap += d * d;
            }
        }
        gaps
    }
}

/// A point's nearest point of the other surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Match {
    /// Place of the point.
    pub(crate) of: usize,
    /// Place of the nearest point of the other surface.
    pub(crate) to: usize,
}

/// See the module. Lengths are in a frame of the caller's.
#[derive(Clone, Debug)]
pub(crate) struct Surface {
    len: usize,
    points: [[f32; 3]; SURFACE_POINTS],
    normals: [[f32; 3]; SURFACE_POINTS],
    boxes: Boxes,
    /// The boxes of runs of points within the blocks.
    runs: [Corners; RUNS],
    /// Share of the cloud's points that were left out as outliers.
    pub(crate) left_out: f32,
    /// Radius about a point that holds [`NEIGHBOURS`] others, in the median.
    pub(crate) radius: f32,
    /// What a median is selected from: after [`Self::match_to`], the squared
    /// distances that it found.
    keys: [u32; SURFACE_POINTS],
    /// Every how many-th point was matched last; 0 where none was yet.
    every: usize,
    /// Whether all points were matched at least once.
    is_known: bool,
    /// Of each point: the place of the other surface's point that was nearest when it was matched last.
    place: [u16; SURFACE_POINTS],
}

impl Surface {
    /// Without points. All bits are zero, so that a static one takes no room in a program's file.
    pub(crate) const EMPTY: Surface = Surface {
        len: 0,
        points: [[0.0; 3]; SURFACE_POINTS],
        normals: [[0.0; 3]; SURFACE_POINTS],
        boxes: Boxes::ZERO,
        runs: [[[0.0; 3]; 2]; RUNS],
        left_out: 0.0,
        radius: 0.0,
        keys: [0; SURFACE_POINTS],
        every: 0,
        is_known: false,
        place: [0; SURFACE_POINTS],
    };

    /// The points, in spatial order.
    pub(crate) fn points(&self) -> &[[f32; 3]] {
        self.points.get(..self.len).unwrap_or(&[])
    }

    /// Places of about so many points, evenly spread over the order.
    pub(crate) fn sampled(&self, points: usize) -> impl Iterator<Item = usize> {
        let every = (self.len / points.max(1)).max(1);
        (0..self.len).step_by(every)
    }

    /// Point and normal at a place, zero where there is none.
    pub(crate) fn at(&self, place: usize) -> (Vec3, Vec3) {
        match (self.points.get(place), self.normals.get(place)) {
            (Some(&point), Some(&normal)) => (Vec3::from_array(point), Vec3::from_array(normal)),
            _ => (Vec3::ZERO, Vec3::ZERO),
        }
    }

    /// Where a cloud's points are that [`Self::fill`] is to take.
    pub(crate) fn bulk(&mut self, cloud: &[[f32; 3]]) -> Bulk {
        Bulk::of(cloud, &mut self.keys)
    }

    /// Takes the distinct points of the bulk of a cloud, `(point - centre) * factor`, evenly thinned to the capacity, and
    /// estimates normals.
    pub(crate) fn fill(
        &mut self,
        isa: Isa,
        cloud: &[[f32; 3]],
        bulk: Bulk,
        centre: Vec3,
        factor: f32,
    ) {
        let n = cloud.len().min(SURFACE_POINTS);
        let at = |i: usize| cloud.get(i * cloud.len() / n.max(1)).copied();
        let at = |i: usize| at(i).unwrap_or_default();
        let seen = |i: usize| (Vec3::from_array(at(i)) - centre) * factor;
        let kept = (0..n).filter(|&i| bulk.holds(at(i)));
        (self.every, self.is_known) = (0, false);
        let mut count = 0;
        for (place, i) in self.points.iter_mut().zip(kept) {
            *place = seen(i).to_array();
            count += 1;
        }
        self.left_out = (n - count) as f32 / n.max(1) as f32;
        self.len = put_in_order(self.points.get_mut(..count).unwrap_or(&mut []));
        self.enclose();
        self.radius = self.neighbourhood();
        self.estimate_normals(isa);
    }

    /// Finds the boxes.
    fn enclose(&mut self) {
        let points = self.points.get(..self.len).unwrap_or(&[]);
        let corners =
            |points: &[[f32; 3]]| bounds(points, |&p| Vec3::from_array(p)).map(|v| v.to_array());
        for (place, run) in self.runs.iter_mut().zip(points.chunks(RUN)) {
            *place = corners(run);
        }
        for (block, points) in points.chunks(BLOCK).enumerate() {
            self.boxes.set(block, corners(points));
        }
    }

    /// Takes the mirror image, x the other way around; twice is the same again, to the bit.
    pub(crate) fn mirror(&mut self) {
        let vectors = self.points.iter_mut().chain(&mut self.normals);
        vectors.for_each(|[x, _, _]| *x = -*x);
        let ([low, _, _], [high, _, _]) = (&mut self.boxes.low, &mut self.boxes.high);
        for (low, high) in low.iter_mut().zip(high) {
            (*low, *high) = (-*high, -*low);
        }
        for [[low, _, _], [high, _, _]] in &mut self.runs {
            (*low, *high) = (-*high, -*low);
        }
    }

    /// Principal axes of the points.
    pub(crate) fn axes(&self) -> Mat3 {
        let mut sums = [0.0f32; 6];
        for &[x, y, z] in self.points() {
            let products = [x * x, y * y, z * z, x * y, x * z, y * z];
            sums.iter_mut()
                .zip(products)
                .for_each(|(sum, product)| *sum += product);
        }
        principal_axes(sums)
    }

    /// Finds the nearest point of `other` to every `every`-th point, seen under `pose`. Where none is nearer than the root of
    /// `limit`, any may be found; what was nearest under another pose shortens the search.
    pub(crate) fn match_to(
        &mut self,
        isa: Isa,
        other: &Surface,
        pose: Pose,
        every: usize,
        limit: f32,
    ) {
        let every = every.max(1);
        self.every = every;
        let of_batch = BATCH * every;
        let points = self.points.get(..self.len).unwrap_or(&[]).chunks(of_batch);
        let places = self.place.chunks_mut(of_batch);
        let (keys, _) = self.keys.as_chunks_mut::<BATCH>();
        let mut batch = Batch::EMPTY;
        for ((points, places), keys) in points.zip(places).zip(keys) {
            load(&mut batch, &mut every_nth(points, every, pose));
            batch.nearest = [f32::INFINITY; BATCH];
            if self.is_known {
                other.show_known(&mut batch, places.iter().step_by(every));
            }
            other.nearest(isa, &mut batch, limit);
            for (place, found) in places.iter_mut().step_by(every).zip(batch.place) {
                *place = found as u16;
            }
            *keys = batch.nearest.map(f32::to_bits); // in the order of the distances: they are not negative
        }
        self.is_known |= every == 1;
    }

    /// At most so large is the median squared distance from `other` of every `every`-th point, seen under `pose`: that of the
    /// points that were nearest when they were matched last.
    pub(crate) fn largest_median(&mut self, other: &Surface, pose: Pose, every: usize) -> f32 {
        if !self.is_known {
            return f32::INFINITY;
        }
        let every = every.max(1);
        let mut count = 0;
        let points = every_nth(self.points.get(..self.len).unwrap_or(&[]), every, pose);
        let places = self.place.iter().step_by(every);
        for ((key, p), &place) in self.keys.iter_mut().zip(points).zip(places) {
            let (q, _) = other.at(place.into());
            *key = (p - q).length_squared().to_bits();
            count += 1;
        }
        self.select(count, count / 2)
    }

    /// What [`Self::match_to`] found.
    pub(crate) fn matches(&self) -> impl Iterator<Item = Match> {
        let places = self.place.iter().enumerate().take(self.len);
        places.step_by(self.every.max(1)).map(|(of, &to)| Match {
            of,
            to: usize::from(to),
        })
    }

    /// Median squared distance of the matches, once after [`Self::match_to`].
    pub(crate) fn median_squared(&mut self) -> f32 {
        let count = self.len.div_ceil(self.every.max(1));
        self.select(count, count / 2)
    }

    /// Distance from the centroid that nine in ten points keep.
    pub(crate) fn extent(&mut self) -> f32 {
        let centre = crate::pose::centroid(self.points());
        for (key, &p) in self.keys.iter_mut().zip(&self.points).take(self.len) {
            *key = (Vec3::from_array(p) - centre).length_squared().to_bits();
        }
        libm::sqrtf(self.select(self.len, self.len * 9 / 10))
    }

    /// The `k`-th smallest of the first `count` keys, as what it stands for.
    fn select(&mut self, count: usize, k: usize) -> f32 {
        match self.keys.get_mut(..count) {
            Some(keys) if k < count => f32::from_bits(*keys.select_nth_unstable(k).1),
            _ => 0.0,
        }
    }

    /// Blocks: the place of the first point, and the points.
    fn blocks(&self) -> impl Iterator<Item = (usize, &[[f32; 3]])> {
        (0..).step_by(BLOCK).zip(self.points().chunks(BLOCK))
    }

    /// Shows each lane of a batch one point that may be near; those beyond the last, that of the last.
    pub(crate) fn show_known<'a>(
        &self,
        batch: &mut Batch,
        mut places: impl Iterator<Item = &'a u16>,
    ) {
        let Batch { at, nearest, place } = batch;
        let [x, y, z] = at;
        let mut known = 0;
        for ((((x, y), z), nearest), place) in x.iter().zip(y).zip(z).zip(nearest).zip(place) {
            known = places.next().copied().unwrap_or(known);
            if let Some(&[a, b, c]) = self.points().get(usize::from(known)) {
                let (dx, dy, dz) = (*x - a, *y - b, *z - c);
                (*nearest, *place) = (dx * dx + dy * dy + dz * dz, known.into());
            }
        }
    }

    /// Nearest points to a batch, all of whose lanes are set, by distances that are known already or infinite; where no point
    /// is nearer than the root of `limit`, any.
    pub(crate) fn nearest(&self, isa: Isa, batch: &mut Batch, limit: f32) {
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
            self.show(isa, batch, shown, f32::INFINITY);
            worst = largest(&batch.nearest);
        }
        for (&gap, (start, _)) in gaps.iter().zip(self.blocks()) {
            if gap < worst && gap < limit && start != shown {
                self.show(isa, batch, start, limit);
                worst = largest(&batch.nearest);
            }
        }
    }

    /// Shows the block that starts at a place to a batch.
    fn show(&self, isa: Isa, batch: &mut Batch, start: usize, limit: f32) {
        let points = self.points().get(start..).unwrap_or(&[]);
        let points = points.get(..BLOCK).unwrap_or(points);
        let runs = self.runs.get(start / RUN..).unwrap_or(&[]);
        isa.show(batch, points, runs, start as u32, limit);
    }

    /// See [`Self::radius`]; of some of the points.
    fn neighbourhood(&mut self) -> f32 {
        const SAMPLES: usize = 32;
        let n = self.len;
        let mut found = [0.0f32; SAMPLES];
        for (s, found) in found.iter_mut().enumerate() {
            let (q, _) = self.at((2 * s + 1) * n / (2 * SAMPLES));
            for (key, &p) in self.keys.iter_mut().zip(&self.points).take(n) {
                *key = (Vec3::from_array(p) - q).length_squared().to_bits();
            }
            *found = self.select(n, NEIGHBOURS.min(n.saturating_sub(1)));
        }
        found.sort_unstable_by(f32::total_cmp);
        libm::sqrtf(found.get(SAMPLES / 2).copied().unwrap_or(0.0))
    }

    /// Estimates all normals.
    fn estimate_normals(&mut self, isa: Isa) {
        let radius = NORMAL_RADIUS * self.radius;
        let squared = radius * radius;
        let share = if squared > 0.0 { 1.0 / squared } else { 0.0 };
        for start in (0..self.len).step_by(BATCH) {
            let mut batch = Batch::EMPTY;
            let points = self.points().get(start..).unwrap_or(&[]);
            load(&mut batch, &mut points.iter().map(|&p| Vec3::from_array(p)));
            let gaps = self
                .boxes
                .gaps(&bounds_of(&batch), self.len.div_ceil(BLOCK));
            let mut sums = Moments::ZERO;
            for (&gap, (_, points)) in gaps.iter().zip(self.blocks()) {
                if gap < squared {
                    isa.moments(&batch.at, points, share, &mut sums);
                }
            }
            let end = self.len.min(start + BATCH);
            for (lane, normal) in self.normals.iter_mut().take(end).skip(start).enumerate() {
                let m = sums
                    .0
                    .each_ref()
                    .map(|row| row.get(lane).copied().unwrap_or(0.0));
                *normal = normal_of(m);
            }
        }
    }
}

fn normal_of([w, x, y, z, xx, yy, zz, xy, xz, yz]: [f32; 10]) -> [f32; 3] {
    if w <= 0.0 {
        return [0.0; 3];
    }
    let f = 1.0 / w;
    let (x, y, z) = (x * f, y * f, z * f);
    smallest_direction([
        xx * f - x * x,
        yy * f - y * y,
        zz * f - z * z,
        xy * f - x * y,
        xz * f - x * z,
        yz * f - y * z,
    ])
    .to_array()
}

/// Puts points in spatial order, each once; how many differ. Of every run, block and cell of a power of two, points lie
/// together.
fn put_in_order(points: &mut [[f32; 3]]) -> usize {
    let at = |p: &[f32; 3]| Vec3::from_array(*p);
    let by_coordinates = |a: &[f32; 3], b: &[f32; 3]| compare(0, at(a), at(b));
    points.sort_unstable_by(by_coordinates);
    // A point that comes again says nothing new.
    let mut len = 0usize;
    for k in 0..points.len() {
        let before = len.checked_sub(1).and_then(|last| points.get(last));
        let point = points.get(k).copied();
        if let (Some(point), true) = (point, before != point.as_ref())
            && let Some(place) = points.get_mut(len)
        {
            *place = point;
            len += 1;
        }
    }
    let points = points.get_mut(..len).unwrap_or(&mut []);
    cut(points, CELL, at);
    for cell in points.chunks_mut(CELL) {
        cut(cell, RUN, at);
    }
    for run in points.chunks_mut(RUN) {
        run.sort_unstable_by(|a, b| drawn(a).cmp(&drawn(b)).then_with(|| by_coordinates(a, b)));
    }
    len
}

/// A number drawn for a point, the same one every time.
fn drawn(point: &[f32; 3]) -> u32 {
    let mix = |sum: u32, x: &f32| {
        (sum ^ x.to_bits())
            .wrapping_mul(0x9e37_79b1)
            .rotate_left(13)
    };
    point.iter().fold(0, mix)
}

/// Every so many-th point, seen under a pose.
fn every_nth(points: &[[f32; 3]], every: usize, pose: Pose) -> impl Iterator<Item = Vec3> {
    let sampled = points.iter().step_by(every);
    sampled.map(move |&p| pose.apply(Vec3::from_array(p)))
}

/// Sets all lanes of a batch: to the next points, then to the last of them. Says how many there were.
fn load(batch: &mut Batch, points: &mut impl Iterator<Item = Vec3>) -> usize {
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

fn bounds_of(batch: &Batch) -> Corners {
    let negated = batch.at.map(|row| row.map(|x| -x));
    let low = negated.each_ref().map(|row| -largest(row));
    [low, batch.at.each_ref().map(largest)]
}

/// The largest of some numbers, in lanes.
fn largest(values: &[f32; BATCH]) -> f32 {
    let (chunks, _) = values.as_chunks::<4>();
    let mut lanes = [f32::NEG_INFINITY; 4];
    for chunk in chunks {
        for (most, &x) in lanes.iter_mut().zip(chunk) {
            *most = if x > *most { x } else { *most };
        }
    }
    let larger = |a: f32, b: f32| if a > b { a } else { b };
    let [a, b, c, d] = lanes;
    larger(larger(a, b), larger(c, d))
}

#[cfg(test)]
mod tests;
