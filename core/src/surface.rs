//! A cloud as a sampled surface: points in spatial order, boxes around runs of them, and normals.

use crate::dims::SURFACE_POINTS;
use crate::kernels::{BATCH, Batch, Isa, Moments};
use crate::outliers::Bulk;
use crate::pose::Pose;
use crate::solve::{principal_axes, smallest_direction};
use glam::{Mat3, Vec3};

/// Points of one box.
const BLOCK: usize = 32;
const BLOCKS: usize = SURFACE_POINTS / BLOCK;
/// Bits of a point's index in a sort key.
const INDEX_BITS: u32 = 12;
/// Points of a neighbourhood, in the median: what [`Surface::radius`] holds.
const NEIGHBOURS: usize = 24;
/// Radius within which a normal is estimated, in radii of a neighbourhood.
const NORMAL_RADIUS: f32 = 0.85;

/// An axis-parallel box.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: [f32; 3],
    high: [f32; 3],
}

impl Bounds {
    const EMPTY: Bounds = Bounds {
        low: [f32::INFINITY; 3],
        high: [f32::NEG_INFINITY; 3],
    };

    fn add(&mut self, p: [f32; 3]) {
        for ((low, high), x) in self.low.iter_mut().zip(&mut self.high).zip(p) {
            *low = low.min(x);
            *high = high.max(x);
        }
    }
}

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

    fn set(&mut self, block: usize, bounds: &Bounds) {
        for (rows, corner) in [(&mut self.low, bounds.low), (&mut self.high, bounds.high)] {
            for (row, x) in rows.iter_mut().zip(corner) {
                if let Some(place) = row.get_mut(block) {
                    *place = x;
                }
            }
        }
    }

    /// Squared distance of the first `blocks` from a box.
    fn gaps(&self, from: &Bounds, blocks: usize) -> [f32; BLOCKS] {
        let mut gaps = [0.0f32; BLOCKS];
        let corners = from.low.iter().zip(&from.high);
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
    /// Share of the cloud's points that were left out as outliers.
    pub(crate) left_out: f32,
    /// Radius about a point that holds [`NEIGHBOURS`] others, in the median.
    pub(crate) radius: f32,
    /// Sort keys while the surface is filled, then what a median is selected from.
    keys: [u32; SURFACE_POINTS],
    /// Every how many-th point was matched last; 0 where none was yet.
    every: usize,
    place: [u16; SURFACE_POINTS],
    squared: [f32; SURFACE_POINTS],
}

impl Surface {
    /// Without points. All bits are zero, so that a static one takes no room in a program's file.
    pub(crate) const EMPTY: Surface = Surface {
        len: 0,
        points: [[0.0; 3]; SURFACE_POINTS],
        normals: [[0.0; 3]; SURFACE_POINTS],
        boxes: Boxes::ZERO,
        left_out: 0.0,
        radius: 0.0,
        keys: [0; SURFACE_POINTS],
        every: 0,
        place: [0; SURFACE_POINTS],
        squared: [0.0; SURFACE_POINTS],
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
        let get = |of: &[[f32; 3]]| Vec3::from_array(of.get(place).copied().unwrap_or_default());
        (get(&self.points), get(&self.normals))
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
        self.every = 0;
        let mut around = Bounds::EMPTY;
        let mut count = 0;
        for i in kept.clone() {
            around.add(seen(i).to_array());
            count += 1;
        }
        self.left_out = (n - count) as f32 / n.max(1) as f32;
        let low = Vec3::from_array(around.low);
        let extent = (Vec3::from_array(around.high) - low).max_element();
        let cells = if extent > 0.0 { 63.999 / extent } else { 0.0 };
        for (key, i) in self.keys.iter_mut().zip(kept) {
            let cell = ((seen(i) - low) * cells).to_array();
            let [x, y, z] = cell.map(|x| spread(x as u32 & 63));
            *key = (x | y << 1 | z << 2) << INDEX_BITS | i as u32;
        }
        if let Some(keys) = self.keys.get_mut(..count) {
            keys.sort_unstable();
        }
        let mut bounds = Bounds::EMPTY;
        // A point that comes again says nothing new; equal points are in one cell, and so in one run of keys.
        let (mut len, mut run, mut cell) = (0, 0, u32::MAX);
        for k in 0..count {
            let key = self.keys.get(k).copied().unwrap_or_default();
            let point = seen((key & ((1 << INDEX_BITS) - 1)) as usize).to_array();
            if key >> INDEX_BITS != cell {
                (cell, run) = (key >> INDEX_BITS, len);
            }
            let known = self.points.get(run..len).unwrap_or(&[]);
            if known.contains(&point) {
                continue;
            }
            if let Some(place) = self.points.get_mut(len) {
                *place = point;
                if len % BLOCK == 0 {
                    bounds = Bounds::EMPTY;
                }
                bounds.add(point);
                self.boxes.set(len / BLOCK, &bounds);
                len += 1;
            }
        }
        self.len = len;
        self.radius = self.neighbourhood();
        self.estimate_normals(isa);
    }

    /// Takes the mirror image, x the other way around; twice is the same again, to the bit.
    pub(crate) fn mirror(&mut self) {
        let vectors = self.points.iter_mut().chain(&mut self.normals);
        vectors.for_each(|[x, _, _]| *x = -*x);
        let ([low, _, _], [high, _, _]) = (&mut self.boxes.low, &mut self.boxes.high);
        for (low, high) in low.iter_mut().zip(high) {
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

    /// Finds the nearest point of `other` to every `every`-th point, seen under `pose`.
    pub(crate) fn match_to(&mut self, isa: Isa, other: &Surface, pose: Pose, every: usize) {
        let every = every.max(1);
        // What was nearest under the last pose is near now.
        let is_known = self.every == every;
        self.every = every;
        let sampled = self.points.iter().take(self.len).step_by(every);
        let mut seen = sampled.map(|&p| pose.apply(Vec3::from_array(p)));
        let (places, _) = self.place.as_chunks_mut::<BATCH>();
        let (squared, _) = self.squared.as_chunks_mut::<BATCH>();
        let mut batch = Batch::EMPTY;
        for (places, squared) in places.iter_mut().zip(squared) {
            if load(&mut batch, &mut seen) == 0 {
                return;
            }
            batch.nearest = [f32::INFINITY; BATCH];
            if is_known {
                other.show_known(&mut batch, places);
            }
            other.nearest(isa, &mut batch);
            *places = batch.place.map(|place| place as u16);
            *squared = batch.nearest;
        }
    }

    /// What [`Self::match_to`] found.
    pub(crate) fn matches(&self) -> impl Iterator<Item = Match> {
        let count = self.len.div_ceil(self.every.max(1));
        let found = self.place.iter().enumerate().take(count);
        found.map(|(k, &to)| Match {
            of: k * self.every,
            to: usize::from(to),
        })
    }

    /// Median squared distance of the matches.
    pub(crate) fn median_squared(&mut self) -> f32 {
        let count = self.len.div_ceil(self.every.max(1));
        for (key, squared) in self.keys.iter_mut().zip(&self.squared).take(count) {
            *key = squared.to_bits(); // in the order of the distances: they are not negative
        }
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

    /// Shows each lane of a batch one point that may be near.
    fn show_known(&self, batch: &mut Batch, places: &[u16; BATCH]) {
        let Batch { at, nearest, place } = batch;
        let [x, y, z] = at;
        let lanes = x.iter().zip(y).zip(z).zip(nearest).zip(place).zip(places);
        for (((((x, y), z), nearest), place), &known) in lanes {
            if let Some(&[a, b, c]) = self.points().get(usize::from(known)) {
                let (dx, dy, dz) = (*x - a, *y - b, *z - c);
                (*nearest, *place) = (dx * dx + dy * dy + dz * dz, known.into());
            }
        }
    }

    /// Nearest points to a batch, all of whose lanes are set, by distances that are known already or infinite.
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
            let (_, start) = starts.fold((f32::INFINITY, 0), |a, b| nearer(&a, b));
            if let Some(points) = self.points().get(start..) {
                let points = points.get(..BLOCK).unwrap_or(points);
                isa.show(batch, points, start as u32);
                worst = largest(&batch.nearest);
            }
            shown = start;
        }
        for (&gap, (start, points)) in gaps.iter().zip(self.blocks()) {
            if gap < worst && start != shown {
                isa.show(batch, points, start as u32);
                worst = largest(&batch.nearest);
            }
        }
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

fn bounds_of(batch: &Batch) -> Bounds {
    let negated = batch.at.map(|row| row.map(|x| -x));
    Bounds {
        low: negated.each_ref().map(|row| -largest(row)),
        high: batch.at.each_ref().map(largest),
    }
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

/// Two zero bits between the six lowest bits.
fn spread(x: u32) -> u32 {
    let x = (x | x << 8) & 0x0300_f00f;
    let x = (x | x << 4) & 0x030c_30c3;
    (x | x << 2) & 0x0924_9249
}
