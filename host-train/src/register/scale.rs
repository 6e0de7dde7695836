//! Detects a source that is somewhat larger or smaller than the target, for example from a wrong calibration.
//!
//! Sizes alone tell little: they also differ for a part, for a crowded view, and for points of uneven density. The
//! evidence is that the source fits far better once it is scaled.

use crate::dataset::Point;
use reagent_core::polish::{Refined, Refiner, Residual, Workspace};
use reagent_core::pose::centroid;
use reagent_core::{Error, Pose};

/// Relative difference of sizes that counts as none: points drawn anew from one surface differ by about as much.
const ALIKE: f32 = 0.05;
/// Relative steps of the factor, each tried while it helps.
const STEPS: [f32; 3] = [0.06, 0.03, 0.015];
/// How often each step is taken at most.
const REACH: usize = 4;
/// Share of the source's points on the target's surface above which little is to be gained.
const ON_SURFACE: f32 = 0.85;
/// Scaling must leave at most this share of the source's residual, and not enlarge the target's. Of some 1,200
/// pairs of one size, whole or seen in part, nine in ten kept 97 % of it, and only one fell as low as this.
const LEFT: f32 = 0.88;

/// Size of the source relative to the target, if the source fits far better once that is undone.
///
/// # Errors
/// Clouds that the core refuses.
pub fn other_size(
    workspace: &mut Workspace,
    [source, target]: [&[Point]; 2],
    found: &Refined,
) -> Result<Option<f32>, Error> {
    let before = found.residual;
    if found.overlap > ON_SURFACE {
        return Ok(None);
    }
    let mut fit = |factor: f32| -> Result<Residual, Error> {
        let (scaled, begin) = scaled(source, found.target_from_source, factor);
        let mut refiner = Refiner::new(&scaled, target, workspace)?;
        Ok(refiner.polish(begin)?.residual)
    };
    let mut best = (1.0, before);
    // The ratio of sizes is a first guess, right for whole clouds.
    let ratio = found.extents_ratio;
    if !is_alike(ratio) {
        let residual = fit(ratio)?;
        if residual.mean() < before.mean() {
            best = (ratio, residual);
        }
    }
    for step in STEPS {
        for _ in 0..REACH {
            let (centre, least) = best;
            for factor in [centre * (1.0 - step), centre * (1.0 + step)] {
                let residual = fit(factor)?;
                if residual.source < best.1.source {
                    best = (factor, residual);
                }
            }
            if best.1 == least {
                break;
            }
        }
        // If the longest step does not help, shorter ones stay within what counts as alike.
        if best.0 == 1.0 {
            return Ok(None);
        }
    }
    let (factor, after) = best;
    let is_explained = after.source < LEFT * before.source && after.target <= before.target;
    Ok((is_explained && !is_alike(factor)).then_some(factor))
}

fn is_alike(factor: f32) -> bool {
    (factor - 1.0).abs() <= ALIKE
}

/// The source divided by a factor, and the pose that keeps its centroid where it was.
fn scaled(source: &[Point], pose: Pose, factor: f32) -> (Vec<Point>, Pose) {
    let smaller = |point: &Point| point.map(|x| x / factor);
    let centre = centroid(source);
    let pose = Pose {
        translation: pose.apply(centre) - pose.rotation * (centre / factor),
        ..pose
    };
    (source.iter().map(smaller).collect(), pose)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::cloud_file::Note;
    use crate::dataset::procedural;
    use crate::policy::WeightFile;
    use crate::random::{Purpose, stream};
    use crate::register::Memory;
    use crate::register::document::Document;
    use crate::register::prepared::Prepared;
    use crate::register::request::{Done, Request};
    use crate::register::sentences::Remark;
    use glam::Vec3;
    use rand_distr::{Distribution, Normal};
    use reagent_core::pose::rotation_from_euler;
    use std::path::Path;

    /// Two noisy samples of one shape; the source is turned.
    fn pair(number: u64, noise: f32) -> [Vec<Point>; 2] {
        let mesh = procedural::shape(1, number).mesh;
        let noise = Normal::new(0.0, noise).expect("a deviation");
        let rotation = rotation_from_euler(Vec3::new(0.3, -0.2, 0.25));
        [0, 1].map(|cloud| {
            let rng = &mut stream(7, Purpose::Surface, 2 * number + cloud);
            let drawn = mesh.sample(700, rng);
            let turned = |point: Point| match cloud {
                0 => (rotation * Vec3::from(point)).to_array(),
                _ => point,
            };
            let moved = |point: Point| turned(point).map(|x| x + noise.sample(rng));
            drawn.into_iter().map(moved).collect()
        })
    }

    fn register(source: &[Point], target: &[Point]) -> (Done, Document) {
        let name = Path::new("cloud");
        let [source, target] =
            [source, target].map(|cloud| Prepared::of_points(cloud, name, None).expect("a cloud"));
        let file = WeightFile::pretrained();
        let memory = &mut Memory::new();
        let done = Request::default().register(file.policy(), memory, &source, &target);
        let done = done.expect("two clouds");
        let document = Document::new([&source, &target], &done, 1.0);
        (done, document)
    }

    #[test]
    fn another_size_is_told_and_by_how_much() {
        let mut told = Vec::new();
        for number in 0..8 {
            let [source, target] = pair(number, 0.0);
            for factor in [0.88, 1.12] {
                let other: Vec<Point> = source.iter().map(|p| p.map(|x| factor * x)).collect();
                let (done, document) = register(&other, &target);
                let Some(times) = done.other_size else {
                    continue;
                };
                told.push(times / factor);
                assert!(Remark::all(&done).contains(&Remark::OtherSize(times)));
                let noted = document.notes.last().expect("a note");
                assert_eq!(
                    (noted.of, &noted.note),
                    ("source", &Note::OtherSize { times })
                );
                let words = format!("it is {times:.2} times as large as the target: check its");
                assert!(noted.text.starts_with(&words), "{}", noted.text);
            }
        }
        // With so few points, some sizes are alike by chance, and some pairs fit little better.
        assert!(told.len() >= 8, "of 16: {told:?}");
        assert!(told.iter().all(|x| (x - 1.0).abs() < 0.03), "{told:?}");
    }

    #[test]
    fn another_size_is_told_of_a_part_that_was_seen() {
        let mut told = Vec::new();
        for number in 0..8 {
            let [mut source, target] = pair(number, 0.0);
            source.sort_by(|a, b| a[0].total_cmp(&b[0]));
            let part = source[..400].iter();
            let other: Vec<Point> = part.map(|p| p.map(|x| 1.12 * x)).collect();
            let (done, _) = register(&other, &target);
            told.extend(done.other_size.map(|times| times / 1.12));
        }
        assert!(told.len() >= 4, "of 8: {told:?}");
        assert!(told.iter().all(|x| (x - 1.0).abs() < 0.06), "{told:?}");
    }

    #[test]
    fn of_one_size_nothing_is_told_whatever_is_seen_of_it() {
        for number in 0..8 {
            for noise in [0.0, 0.01] {
                let [source, target] = pair(number, noise);
                let mut part = source.clone();
                part.sort_by(|a, b| a[0].total_cmp(&b[0]));
                // A part of the shape, and twice as many points in one half.
                let dense = [&part[..350], &source].concat();
                for seen in [&source, &part[..500], &dense[..]] {
                    let (done, document) = register(seen, &target);
                    assert_eq!(done.other_size, None, "{number} {noise}");
                    assert_eq!(document.notes, []);
                }
            }
        }
    }
}
