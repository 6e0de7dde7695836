//! Pairs drawn under conditions that differ from a protocol's, for sweeps.

use super::{POINTS, Protocol, SCAN_POINTS, choose};
use crate::augment::{
    JITTER_CLIP, JITTER_SIGMA, clutter, crop, jitter_by, misalign_by, random_rigid_within,
};
use crate::dataset::Model;
use crate::dataset::pairs::PairSet;
use crate::random::resample;
use crate::random::{Purpose, stream};

/// Streams for the parts of one pair.
const PARTS: u64 = 8;

/// How pairs are drawn where one condition of a protocol is varied.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conditions {
    /// Points of each cloud.
    pub points: usize,
    /// Standard deviation of the noise on every coordinate of both clouds.
    pub noise_sigma: f32,
    /// Clip of the noise.
    pub noise_clip: f32,
    /// Upper bound of each Euler angle of the offset, degrees.
    pub max_angle_deg: f32,
    /// Upper bound of each translation of the offset.
    pub max_shift: f32,
    /// Share of the source's points that are left on one side of a random plane.
    pub overlap: f32,
    /// Share of the source's points that are replaced by points uniform in the unit ball about the target's origin.
    pub outliers: f32,
}

impl Conditions {
    /// The conditions of a protocol that samples both clouds independently; `None` for the others.
    pub fn of(protocol: Protocol) -> Option<Conditions> {
        let noisy = Conditions {
            points: POINTS,
            noise_sigma: JITTER_SIGMA,
            noise_clip: JITTER_CLIP,
            max_angle_deg: 45.0,
            max_shift: 0.5,
            overlap: 1.0,
            outliers: 0.0,
        };
        match protocol {
            Protocol::M40Clean => None,
            Protocol::M40Models | Protocol::M40Categories => Some(noisy),
            Protocol::Scan => Some(Conditions {
                points: SCAN_POINTS,
                noise_sigma: 0.0,
                ..noisy
            }),
        }
    }
}

/// Draws `count` pairs under the given conditions, of the models that [`draw`](super::draw) would take. Every part
/// of a pair has a random stream of its own. Pairs of equal seed and index therefore have the same points,
/// directions and noise draws under all conditions; only their size or number differs.
pub fn draw_under(models: &[Model], conditions: &Conditions, count: usize, seed: u64) -> PairSet {
    let mut set = PairSet::default();
    for (i, model) in choose(models, count, seed).enumerate() {
        let part = |part: u64| stream(seed, Purpose::Sweep, PARTS * i as u64 + part);
        let (whole, k) = (&model.points, conditions.points);
        let sampled = |mut rng| {
            // All points in a random order: fewer points are the first of more.
            let mut drawn = resample(&mut rng, whole, k.max(whole.len()));
            drawn.truncate(k);
            drawn
        };
        let (mut source, target) = (sampled(part(0)), sampled(part(1)));
        crop(&mut part(2), &mut source, conditions.overlap);
        clutter(&mut part(3), &mut source, conditions.outliers);
        let max_angle = conditions.max_angle_deg.to_radians();
        let offset = random_rigid_within(&mut part(4), max_angle, conditions.max_shift);
        let mut sample = misalign_by(offset, source, target);
        let (sigma, clip) = (conditions.noise_sigma, conditions.noise_clip);
        jitter_by(&mut part(5), &mut sample.source, sigma, clip);
        jitter_by(&mut part(6), &mut sample.target, sigma, clip);
        set.push(sample, whole.clone(), model.label);
    }
    set
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Point;
    use crate::measure::metrics::GroundTruth;
    use crate::protocol::tests::models;

    const NOISY: Conditions = Conditions {
        points: 1024,
        noise_sigma: 0.01,
        noise_clip: 0.05,
        max_angle_deg: 45.0,
        max_shift: 0.5,
        overlap: 1.0,
        outliers: 0.0,
    };

    #[test]
    fn the_protocol_s_own_conditions_draw_its_distribution() {
        let models = models(2, 2048);
        assert_eq!(Conditions::of(Protocol::M40Models), Some(NOISY));
        for (protocol, points, largest) in [
            (Protocol::M40Models, 1024, 1e-3),
            (Protocol::Scan, 2048, 1e-9),
        ] {
            let conditions = Conditions::of(protocol).expect("independent samples");
            let set = draw_under(&models, &conditions, 2, 5);
            let raw = set.raw.as_ref().map(|raw| raw[1].as_slice());
            let truth = set.target_from_source[1];
            let pair = GroundTruth::new(&set.source[1], &set.target[1], raw, truth);
            let chamfer = pair.expect("valid").measure(truth).chamfer_mod;
            assert!(chamfer < largest, "{protocol:?}: {chamfer}");
            assert_eq!(set.source[1].len(), points, "{protocol:?}");
        }
    }

    #[test]
    fn conditions_share_points_directions_and_noise() {
        let models = models(1, 2048);
        let draw = |conditions: Conditions| draw_under(&models, &conditions, 1, 5);
        let base = draw(NOISY);
        let moved = |conditions| {
            let set: PairSet = draw(conditions);
            let back = set.target_from_source[0];
            let points = set.source[0].iter().map(|&p| back.apply(p.into()));
            (points.collect::<Vec<_>>(), set)
        };
        let near = |a: &[glam::Vec3], b: &[glam::Vec3], tolerance: f32| {
            a.iter().zip(b).all(|(a, b)| a.distance(*b) < tolerance)
        };
        let (plain, _) = moved(NOISY);
        let (noisier, _) = moved(Conditions {
            noise_sigma: 0.02,
            noise_clip: 0.1,
            ..NOISY
        });
        assert!(near(&plain, &noisier, 0.1) && plain != noisier);
        let (_, turned) = moved(Conditions {
            max_angle_deg: 90.0,
            ..NOISY
        });
        assert_eq!(turned.target, base.target);
        let angle = |set: &PairSet| {
            let angles = reagent_core::pose::euler_from_rotation(
                &set.target_from_source[0].inverse().rotation,
            );
            angles.to_array()
        };
        for (a, b) in angle(&turned).into_iter().zip(angle(&base)) {
            assert!((a - 2.0 * b).abs() < 1e-4, "twice the angle: {a}, {b}");
        }
        let (fewer, _) = moved(Conditions {
            points: 100,
            noise_sigma: 0.0,
            ..NOISY
        });
        let (clean, _) = moved(Conditions {
            noise_sigma: 0.0,
            ..NOISY
        });
        assert!(
            fewer.len() == 100 && near(&fewer, &clean, 1e-5),
            "the first of more"
        );
    }

    #[test]
    fn sources_are_cropped_and_cluttered() {
        let models = models(1, 2048);
        let source = |overlap, outliers| {
            let conditions = Conditions {
                overlap,
                outliers,
                noise_sigma: 0.0,
                max_angle_deg: 0.0,
                max_shift: 0.0,
                ..NOISY
            };
            draw_under(&models, &conditions, 1, 5).source.remove(0)
        };
        let whole = source(1.0, 0.0);
        let half = source(0.5, 0.0);
        assert_eq!(half.len(), 512);
        // A plane lies between what is kept and what is gone.
        let mut cropped = whole.clone();
        let rng = || stream(1, Purpose::Sweep, 0);
        crop(&mut rng(), &mut cropped, 0.3);
        let normal = crate::augment::random_direction(&mut rng());
        let height = |p: &&Point| normal.dot(glam::Vec3::from(**p));
        let (kept, gone): (Vec<&Point>, Vec<&Point>) =
            whole.iter().partition(|p| cropped.contains(p));
        let highest = kept.iter().map(height).fold(f32::NEG_INFINITY, f32::max);
        let lowest = gone.iter().map(height).fold(f32::INFINITY, f32::min);
        assert!(highest < lowest && kept.len() == 308, "{highest} {lowest}");

        let (some, more) = (source(1.0, 0.25), source(1.0, 0.5));
        let strange = |cloud: &[[f32; 3]]| cloud.iter().filter(|p| !whole.contains(p)).count();
        assert_eq!((strange(&some), strange(&more)), (256, 512));
        assert_eq!(some[..256], more[..256]);
        assert!(
            more.iter()
                .take(512)
                .all(|&p| glam::Vec3::from(p).length() <= 1.0)
        );
        assert_eq!(source(1e-6, 0.0).len(), 1, "never empty");
    }
}
