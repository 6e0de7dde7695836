//! The kinds of pairs that a verdict is fitted to.

use crate::augment::{crop, random_direction};
use crate::dataset::pairs::PairSet;
use crate::dataset::{Model, Point};
use crate::protocol::{Conditions, Protocol, draw, draw_under};
use crate::random::{Purpose, Rng, stream};
use crate::views::Views;
use glam::Vec3;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use serde::Serialize;

/// How the pairs of a set were drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The noisy protocol.
    Noisy,
    /// The noisy protocol with few points.
    Sparse,
    /// Equal clouds without noise.
    Clean,
    /// Sources of which a plane cuts off three tenths.
    Part,
    /// Parts of both clouds, each cut off by a plane of its own.
    Parts,
    /// The noisy protocol with distorted sources.
    Rough,
    /// Partial sources that are distorted.
    RoughPart,
    /// Targets of another mesh.
    Wrong,
    /// Parts of another mesh.
    WrongParts,
    /// Rendered views.
    View,
    /// Rendered views that are distorted.
    RoughView,
    /// Rendered views of another mesh.
    WrongView,
    /// [`Kind::View`] with the view point known.
    SeenView,
    /// [`Kind::RoughView`] with the view point known.
    SeenRoughView,
    /// [`Kind::WrongView`] with the view point known.
    SeenWrongView,
}

/// Numbers of points of source and target in [`Kind::Sparse`]; each combination serves an equal number of pairs.
const SPARSE: [[usize; 2]; 5] = [[64, 64], [64, 200], [96, 200], [128, 128], [256, 256]];
/// Share of a cloud that a plane leaves; where both clouds are cut, each share serves an equal number of pairs.
const PART: f32 = 0.7;
const PARTS: [f32; 2] = [0.7, 0.55];
/// Points of each cloud of a view.
const VIEW: usize = 1024;
/// Standard deviation of the noise on distorted sources, in sizes of the source; its logarithm is uniform.
const ROUGH_NOISE: [f32; 2] = [0.002, 0.015];
/// Largest bend of distorted sources, in sizes of the source.
const ROUGH_BEND: f32 = 0.02;

impl Kind {
    /// All of them.
    pub const ALL: [Kind; 15] = [
        Kind::Noisy,
        Kind::Sparse,
        Kind::Clean,
        Kind::Part,
        Kind::Parts,
        Kind::Rough,
        Kind::RoughPart,
        Kind::Wrong,
        Kind::WrongParts,
        Kind::View,
        Kind::RoughView,
        Kind::WrongView,
        Kind::SeenView,
        Kind::SeenRoughView,
        Kind::SeenWrongView,
    ];

    /// The kind of the same pairs without a view point, if this kind has one.
    fn blind(self) -> Option<Kind> {
        match self {
            Kind::SeenView => Some(Kind::View),
            Kind::SeenRoughView => Some(Kind::RoughView),
            Kind::SeenWrongView => Some(Kind::WrongView),
            _ => None,
        }
    }

    /// Whether the clouds show different things, so that no pose is right.
    pub fn is_wrong(self) -> bool {
        let kind = self.blind().unwrap_or(self);
        matches!(kind, Kind::Wrong | Kind::WrongParts | Kind::WrongView)
    }

    /// Whether the sources are single views.
    pub(super) fn is_view(self) -> bool {
        let kind = self.blind().unwrap_or(self);
        matches!(kind, Kind::View | Kind::RoughView | Kind::WrongView)
    }

    /// Draws `count` pairs.
    pub(super) fn draw(self, models: &[Model], views: &Views, count: usize, seed: u64) -> PairSet {
        let mut set = match self.blind() {
            Some(kind) => return kind.drawn(models, views, count, seed),
            None => self.drawn(models, views, count, seed),
        };
        set.seen.fill(None);
        set
    }

    /// The same; views keep their view points.
    fn drawn(self, models: &[Model], views: &Views, count: usize, seed: u64) -> PairSet {
        // Each kind has a stream of its own.
        let seed = seed + self as u64;
        let noisy = Conditions::of(Protocol::M40Models).expect("it samples independently");
        let under = |conditions: Conditions, count| draw_under(models, &conditions, count, seed);
        let parts_of = |overlap: f32, count| under(Conditions { overlap, ..noisy }, count);
        let mut set = match self {
            Kind::Noisy | Kind::Rough | Kind::Wrong => {
                draw(models, Protocol::M40Models, count, seed)
            }
            Kind::Clean => draw(models, Protocol::M40Clean, count, seed),
            Kind::Sparse => {
                let mut set = PairSet::default();
                for [source, points] in SPARSE {
                    let conditions = Conditions { points, ..noisy };
                    let mut some = under(conditions, count.div_ceil(SPARSE.len()));
                    some.source
                        .iter_mut()
                        .for_each(|cloud| cloud.truncate(source));
                    set.extend(some);
                }
                set
            }
            Kind::Part | Kind::RoughPart => parts_of(PART, count),
            Kind::Parts | Kind::WrongParts => {
                let mut set = PairSet::default();
                for share in PARTS {
                    let mut some = parts_of(share, count.div_ceil(PARTS.len()));
                    for (k, target) in (0..).zip(&mut some.target) {
                        crop(&mut stream(seed, Purpose::Augment, k), target, share);
                    }
                    set.extend(some);
                }
                set
            }
            Kind::View
            | Kind::RoughView
            | Kind::WrongView
            | Kind::SeenView
            | Kind::SeenRoughView
            | Kind::SeenWrongView => {
                let mut set = PairSet::default();
                views.draw(count, VIEW, seed, &mut set);
                set
            }
        };
        if self.is_wrong() {
            let shift = 1.min(set.target.len());
            set.target.rotate_left(shift);
            if let Some(raw) = &mut set.raw {
                raw.rotate_left(shift);
            }
        }
        if matches!(self, Kind::Rough | Kind::RoughPart | Kind::RoughView) {
            for (k, source) in (0..).zip(&mut set.source) {
                distort(source, &mut stream(seed, Purpose::Augment, k));
            }
        }
        set
    }
}

/// Bends a cloud smoothly and adds noise: sensors err in both ways, and so do models.
fn distort(points: &mut [Point], rng: &mut Rng) {
    const WAVES: usize = 4;
    let centre = points.iter().copied().map(Vec3::from).sum::<Vec3>() / points.len() as f32;
    // Size by the median distance, since flying pixels lie metres away.
    let mut distances: Vec<f32> = points.iter().map(|&p| centre.distance(p.into())).collect();
    distances.sort_by(f32::total_cmp);
    let size = 4.0 * distances[distances.len() / 2];
    let [least, most] = ROUGH_NOISE.map(f32::ln);
    let noise = size * rng.random_range(least..most).exp();
    let bend = size * rng.random_range(0.0..ROUGH_BEND) / (WAVES as f32).sqrt();
    let waves: [_; WAVES] = std::array::from_fn(|_| {
        let along = random_direction(rng) * rng.random_range(2.0..10.0f32);
        let phase = rng.random_range(0.0..std::f32::consts::TAU);
        (along, phase, random_direction(rng) * bend)
    });
    for point in points {
        let mut p = Vec3::from(*point);
        let place = (p - centre) / size.max(f32::MIN_POSITIVE);
        for (along, phase, by) in waves {
            p += by * (along.dot(place) + phase).sin();
        }
        let normal = [(); 3].map(|()| -> f32 { StandardNormal.sample(rng) });
        *point = (p + Vec3::from(normal) * noise).to_array();
    }
}
