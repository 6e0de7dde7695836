//! A depth camera's and a segmentation network's view of an exact image.
//!
//! Depth noise is a Kinect's, as measured by Nguyen, Izadi and Lovell (Modeling Kinect Sensor Noise for Improved 3D
//! Reconstruction and Tracking, 3DIMPVT 2012). Along the ray its standard deviation is `1.2 + 1.9 (z - 0.4)²` mm at a
//! depth of z m; across it, .8 of a pixel at 640 columns, which mixes the depths on both sides of an edge. Depths next
//! to an edge are often missing.

use super::scene::Rendered;
use crate::random::Rng;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

/// Standard deviation of the lateral noise, pixels of an image of 640 columns.
const LATERAL_SIGMA: f32 = 0.8;
/// Neighbouring depths that differ by more than this are an edge.
const EDGE_MM: f32 = 20.0;
/// Share of the pixels at an edge that have no depth.
const MISSING_AT_EDGE: f64 = 0.3;
/// Share of all pixels that have no depth.
const MISSING: f64 = 0.005;

fn normal(rng: &mut Rng) -> f32 {
    StandardNormal.sample(rng)
}

/// A depth camera.
#[derive(Clone, Copy, Debug)]
pub struct Sensor {
    /// Factor on all of its noise.
    pub noise: f32,
    /// Lateral noise, standard deviation in pixels.
    pub lateral: f32,
    /// Quantisation step at 1 m, millimetres, growing with the square of the distance as for a disparity; 0 for none.
    pub step_mm: f32,
    /// Share of the pixels at an edge with a depth between its two sides.
    pub flying: f32,
    /// Share of the pixels with a random depth.
    pub stray: f32,
}

impl Sensor {
    /// The Kinect's noise alone, for images of so many columns.
    pub fn kinect(noise: f32, columns: usize) -> Sensor {
        Sensor {
            noise,
            lateral: LATERAL_SIGMA * noise * columns as f32 / 640.0,
            step_mm: 0.0,
            flying: 0.0,
            stray: 0.0,
        }
    }

    /// A random sensor for one training view.
    pub fn draw(rng: &mut Rng) -> Sensor {
        Sensor {
            noise: rng.random_range(0.2..1.4),
            lateral: rng.random_range(0.0..0.7),
            step_mm: rng.random_range(0.0..3.0),
            flying: rng.random_range(0.0..0.2),
            stray: rng.random_range(0.0..0.005),
        }
    }

    /// The depth that it measures at a pixel of an exact image, millimetres; 0 for no depth in either.
    pub fn read(
        &self,
        depths: &impl Fn(usize, usize) -> f32,
        [width, height]: [usize; 2],
        [column, row]: [usize; 2],
        rng: &mut Rng,
    ) -> f32 {
        // A Kinect takes these draws, and no others, for every pixel.
        let (du, dv, dz) = (normal(rng), normal(rng), normal(rng));
        let dropped: f64 = rng.random();
        let near = |x: usize, shift: f32, size: usize| {
            (x as f32 + (self.lateral * shift).round()).clamp(0.0, size as f32 - 1.0) as usize
        };
        let mut z = depths(near(column, du, width), near(row, dv, height));
        let here = depths(column, row);
        let beyond = [
            (column.saturating_sub(1), row),
            ((column + 1).min(width - 1), row),
            (column, row.saturating_sub(1)),
            (column, (row + 1).min(height - 1)),
        ]
        .into_iter()
        .map(|(u, v)| depths(u, v))
        .find(|depth| (depth - here).abs() > EDGE_MM);
        let share = if beyond.is_some() {
            MISSING_AT_EDGE
        } else {
            MISSING
        };
        let missing = f64::from(self.noise).clamp(0.0, 1.0);
        if !(z > 0.0 && dropped >= missing * share) {
            return 0.0;
        }
        if self.flying > 0.0
            && let Some(beyond) = beyond.filter(|&depth| depth > 0.0)
            && rng.random::<f32>() < self.flying
        {
            z += (beyond - z) * rng.random::<f32>();
        }
        if self.stray > 0.0 && rng.random::<f32>() < self.stray {
            z *= rng.random_range(0.5..4.0f32);
        }
        let sigma = 1.2 + 1.9 * (z / 1000.0 - 0.4).powi(2);
        z = (z + self.noise * sigma * dz).max(0.0);
        if self.step_mm > 0.0 {
            let step = self.step_mm * (z / 1000.0).powi(2);
            z = (z / step.max(0.01)).round() * step.max(0.01);
        }
        z
    }
}

/// The depths that the sensor measures, millimetres, 0 for none. `noise` scales all of its noise; 0 gives the exact depths.
pub fn observe(rendered: &Rendered, noise: f32, rng: &mut Rng) -> Vec<f32> {
    let [width, height] = rendered.size;
    let depths = |column: usize, row: usize| {
        let inverse = rendered.inverse_depths[row * width + column];
        if inverse > 0.0 { 1.0 / inverse } else { 0.0 }
    };
    let sensor = Sensor::kinect(noise, width);
    (0..width * height)
        .map(|pixel| sensor.read(&depths, rendered.size, [pixel % width, pixel / width], rng))
        .collect()
}

/// A mask as an estimator would give it: the true one displaced by some per cent of its extent, eroded or dilated by up
/// to two pixels, and in three of ten cases with a round part missing. If less than a third of the true mask would be
/// left, the true one is returned.
pub fn estimated_mask(mask: &[bool], size: [usize; 2], rng: &mut Rng) -> Vec<bool> {
    let [left, top, columns, rows] = bounding_box(mask, size);
    let extent = columns.max(rows) as f32;
    let shift = [normal(rng), normal(rng)].map(|x| (0.03 * extent * x).round() as i64);
    let radius: i64 = rng.random_range(-2..=2);
    let bitten = rng.random_bool(0.3);
    let bite_radius = extent * rng.random_range(0.1..0.3);
    let bite = [
        left as f32 + columns as f32 * rng.random::<f32>(),
        top as f32 + rows as f32 * rng.random::<f32>(),
    ];

    let [width, height] = size.map(|n| n as i64);
    let at = |u: i64, v: i64| {
        let inside = (0..width).contains(&u) && (0..height).contains(&v);
        inside && mask[(v * width + u) as usize]
    };
    let offsets = |radius: i64| {
        (-radius..=radius)
            .flat_map(move |y| (-radius..=radius).map(move |x| (x, y)))
            .filter(move |(x, y)| x * x + y * y <= radius * radius)
    };
    let pixel = |i: i64| {
        let (u, v) = (i % width, i / width);
        let (x, y) = (u - shift[0], v - shift[1]);
        let inside = if radius < 0 {
            offsets(-radius).all(|(dx, dy)| at(x + dx, y + dy))
        } else {
            offsets(radius).any(|(dx, dy)| at(x + dx, y + dy))
        };
        let distance = (u as f32 - bite[0]).hypot(v as f32 - bite[1]);
        inside && !(bitten && distance < bite_radius)
    };
    let estimated: Vec<bool> = (0..width * height).map(pixel).collect();
    let kept = mask.iter().zip(&estimated).filter(|(a, b)| **a && **b);
    let whole = mask.iter().filter(|inside| **inside).count();
    if 3 * kept.count() >= whole {
        estimated
    } else {
        mask.to_vec()
    }
}

/// The smallest rectangle around a mask: left, top, columns, rows; -1, -1, -1, -1 for an empty one, as in BOP.
pub fn bounding_box(mask: &[bool], size: [usize; 2]) -> [i64; 4] {
    let pixels = mask.iter().enumerate().filter(|(_, inside)| **inside);
    let places = pixels.map(|(i, _)| ((i % size[0]) as i64, (i / size[0]) as i64));
    let bounds = places.fold(None, |bounds: Option<[i64; 4]>, (u, v)| {
        let [l, t, r, b] = bounds.unwrap_or([u, v, u, v]);
        Some([l.min(u), t.min(v), r.max(u), b.max(v)])
    });
    bounds.map_or([-1; 4], |[l, t, r, b]| [l, t, r - l + 1, b - t + 1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, stream};

    #[test]
    fn estimated_masks_overlap_the_true_ones() {
        let size = [80, 60];
        let disc = |i: usize| ((i % 80) as f32 - 40.0).hypot((i / 80) as f32 - 30.0) < 15.0;
        let mask: Vec<bool> = (0..80 * 60).map(disc).collect();
        assert_eq!(bounding_box(&mask, size), [26, 16, 29, 29]);
        let mut overlap = Vec::new();
        for k in 0..50 {
            let estimated = estimated_mask(&mask, size, &mut stream(1, Purpose::Scene, k));
            let both = mask.iter().zip(&estimated);
            let (mut and, mut or) = (0.0, 0.0);
            for (&a, &b) in both {
                and += f32::from(u8::from(a && b));
                or += f32::from(u8::from(a || b));
            }
            overlap.push(and / or);
        }
        let mean = overlap.iter().sum::<f32>() / 50.0;
        assert!((0.75..0.95).contains(&mean), "{mean}");
        let empty = estimated_mask(&[false; 4800], size, &mut stream(1, Purpose::Scene, 0));
        assert!(!empty.contains(&true));
        assert_eq!(bounding_box(&empty, size), [-1; 4]);
    }
}
