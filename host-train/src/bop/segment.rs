//! Source clouds from a depth image and a mask.

use crate::dataset::Point;
use crate::dataset::depth::DepthImage;
use crate::random::Rng;
use crate::random::resample;
use rand::RngExt;

/// The paper's training segments: a patch around a random pixel of the object. `ceil(count * foreground)` points are
/// the object's pixels nearest to it in the image, the others the nearest pixels outside of the mask. This simulates
/// occlusion and an imprecise mask at once.
///
/// If there are fewer pixels than asked for, all are taken, and some are repeated. If nothing lies outside of the mask
/// (a rendering without background), all points are from the object. `None` if no pixel of the object has a depth.
pub fn patch(
    rng: &mut Rng,
    seen: &DepthImage,
    count: usize,
    foreground: f64,
) -> Option<Vec<Point>> {
    let (inside, outside) = (seen.pixels(true), seen.pixels(false));
    if inside.is_empty() {
        return None;
    }
    let centre = inside[rng.random_range(0..inside.len())];
    let wanted = if outside.is_empty() {
        count
    } else {
        ((count as f64 * foreground).ceil() as usize).min(count)
    };
    let mut take = |pixels: Vec<u32>, count: usize| -> Vec<Point> {
        let nearest = nearest(pixels, centre, seen.camera.size[0], count);
        let points: Vec<Point> = nearest.into_iter().map(|p| seen.point(p)).collect();
        resample(rng, &points, count)
    };
    let mut points = take(inside, wanted);
    points.extend(take(outside, count - wanted));
    Some(points)
}

/// The paper's test segments: `count` random points inside the mask, some repeated if there are fewer. `None` if there
/// are none.
pub fn inside(rng: &mut Rng, seen: &DepthImage, count: usize) -> Option<Vec<Point>> {
    let pixels = seen.pixels(true);
    let points: Vec<Point> = pixels.into_iter().map(|p| seen.point(p)).collect();
    (!points.is_empty()).then(|| resample(rng, &points, count))
}

/// The `count` pixels that are nearest to `centre` in an image of `width` columns.
fn nearest(mut pixels: Vec<u32>, centre: u32, width: usize, count: usize) -> Vec<u32> {
    if pixels.len() > count && count > 0 {
        let place = |p: u32| (i64::from(p) % width as i64, i64::from(p) / width as i64);
        let (x, y) = place(centre);
        // The pixel's own number breaks ties.
        pixels.select_nth_unstable_by_key(count - 1, |&p| {
            let (u, v) = place(p);
            ((u - x).pow(2) + (v - y).pow(2), p)
        });
    }
    pixels.truncate(count);
    pixels.sort_unstable();
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_pixels_are_taken() {
        let all: Vec<u32> = (0..100).collect();
        assert_eq!(nearest(all.clone(), 44, 10, 5), [34, 43, 44, 45, 54]);
        assert_eq!(nearest(all.clone(), 0, 10, 3), [0, 1, 10]);
        assert_eq!(nearest(all.clone(), 0, 10, 0), [0u32; 0]);
        assert_eq!(nearest(all.clone(), 7, 10, 200), all);
    }
}
