//! Whether a refined pose is explained by how the clouds are sampled, and better ones where it is not.
//!
//! | stage | hypotheses | what |
//! |---|---|---|
//! | polish | the pose given | [`Refiner::polish`]; done where its residual is explained |
//! | screen | copies of it turned about axes through the centroid, alignments of principal axes, turns about the axis that planes fix least | few steps on few points |
//! | sift | the best of those | more steps on more points |
//! | polish | the best of those that differ | the least residual wins |

use crate::error::Error;
use crate::polish::{Candidate, RESIDUAL_SCALE, Refined, Refiner, Residual, Stage};
use crate::pose::Pose;
use crate::solve::{Rigid, principal_axes};
use crate::surface::Surface;
use crate::turn::Turn;
use glam::{Mat3, Vec3};

/// Residual that two samples of one surface explain.
const EXPLAINED: f32 = 0.18;
/// First steps of every hypothesis.
const SCREEN: Stage = Stage {
    iterations: 3,
    points: 96,
    gate: 4.0,
    tangential: 0.1,
    stop: 0.01,
};
/// Further steps of the best.
const SIFT: Stage = Stage {
    iterations: 6,
    points: 256,
    gate: 4.0,
    tangential: 0.1,
    stop: 2e-3,
};
/// Hypotheses that are sifted, of those that are screened.
const SIFTED: usize = 8;
/// Spins that are sifted.
const SPINS_SIFTED: usize = 3;
/// Spins about the axis about which planes fix a rotation least: every 4.5 degrees, from two poses.
const SPINS: usize = 80;
/// Scale of the residual by which spins are compared, in radii of a neighbourhood: it sees the points that both
/// clouds share.
const SPIN_SCALE: f32 = 0.15;
/// Points by which spins are compared.
const SPIN_POINTS: usize = 256;
/// Share of a residual by which another pose must be better to take the initial one's place.
const BETTER: f32 = 0.95;
/// A sifted hypothesis is polished unless its residual exceeds the best one's by this factor.
const CLOSE: f32 = 1.1;
/// Hypotheses that are polished.
const POLISHED: usize = 3;
/// Cosine of half the angle below which two rotations are one hypothesis: 8 degrees.
const SAME: f32 = 0.997_564;

/// A pose that was compared with others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verified {
    /// The best pose.
    pub best: Refined,
    /// The initial pose, polished.
    pub polished: Refined,
    /// Hypotheses that were tried besides.
    pub hypotheses: usize,
    /// Residual of the best pose that differs from [`Self::best`] by more than 8 degrees, if one was polished.
    pub runner_up: Option<Residual>,
}

/// The best hypotheses so far, the best first.
struct Best<const N: usize>([Option<(f32, Rigid)>; N]);

impl<const N: usize> Best<N> {
    /// Takes a hypothesis unless it is worse than all, or than one of nearly the same rotation.
    fn offer(&mut self, score: f32, at: Rigid) {
        let same = |held: &Option<(f32, Rigid)>| {
            held.is_some_and(|(_, other)| at.turn.likeness(other.turn) > SAME)
        };
        let mut carried = Some((score, at));
        if let Some(twin) = self.0.iter_mut().find(|held| same(held)) {
            if twin.is_some_and(|(held, _)| held <= score) {
                return;
            }
            *twin = None;
        }
        for held in &mut self.0 {
            let before = match (&carried, &*held) {
                (Some((a, _)), Some((b, _))) => a < b,
                (Some(_), None) => true,
                (None, _) => return,
            };
            if before {
                core::mem::swap(held, &mut carried);
            }
        }
    }
}

impl Refiner<'_> {
    /// Refines a pose, and where its residual is not explained by two samples of one surface, compares it with
    /// others: the least residual wins. Bounded: at most 214 hypotheses.
    ///
    /// # Errors
    /// [`Error::BadPose`] for an initial pose that is not rigid.
    pub fn verify(&mut self, initial: Pose) -> Result<Verified, Error> {
        self.verify_while(initial, || Ok(()))
    }

    /// As [`Self::verify`], asking before every hypothesis whether to go on.
    ///
    /// # Errors
    /// As [`Self::verify`], and whatever `go_on` returns.
    pub fn verify_while<E: From<Error>>(
        &mut self,
        initial: Pose,
        mut go_on: impl FnMut() -> Result<(), E>,
    ) -> Result<Verified, E> {
        let initial_inside = self.inside(initial.checked()?);
        let polished = self.polish_inside(initial_inside);
        let mut verified = Verified {
            best: self.refined(&polished, initial),
            polished: self.refined(&polished, initial),
            hypotheses: 0,
            runner_up: None,
        };
        if polished.residual.mean() <= EXPLAINED {
            return Ok(verified);
        }
        let mut screened = Best::<SIFTED>([None; SIFTED]);
        let [source_axes, target_axes] = self.surfaces().map(axes);
        let Rigid { turn, shift } = polished.at;
        let turned = turns(target_axes).map(|by| by.after(turn));
        let aligned = alignments().map(|signed| target_axes * signed * source_axes.transpose());
        for turn in turned.chain(aligned.map(|rotation| Turn::of(&rotation))) {
            go_on()?;
            verified.hypotheses += 1;
            let (at, _) = self.run(Rigid { turn, shift }, &SCREEN);
            screened.offer(self.score(at, SCREEN.points, RESIDUAL_SCALE), at);
        }
        let mut spun = Best::<SPINS_SIFTED>([None; SPINS_SIFTED]);
        for at in self.spins(polished.at) {
            go_on()?;
            verified.hypotheses += 1;
            spun.offer(self.score(at, SPIN_POINTS, SPIN_SCALE), at);
        }
        let mut sifted = Best::<POLISHED>([None; POLISHED]);
        for (_, at) in screened.0.into_iter().chain(spun.0).flatten() {
            go_on()?;
            let (at, _) = self.run(at, &SIFT);
            sifted.offer(self.score(at, SIFT.points, RESIDUAL_SCALE), at);
        }
        let mut best = polished;
        let mut others: [Option<Candidate>; POLISHED] = [None; POLISHED];
        let close = CLOSE
            * sifted
                .0
                .first()
                .copied()
                .flatten()
                .map_or(0.0, |held| held.0);
        let sifted = sifted
            .0
            .into_iter()
            .flatten()
            .filter(|held| held.0 <= close);
        for (other, (_, at)) in others.iter_mut().zip(sifted) {
            go_on()?;
            let found = self.polish_inside(at);
            *other = Some(found);
            let to_beat = best.residual.mean() * if best.at == polished.at { BETTER } else { 1.0 };
            if found.residual.mean() < to_beat {
                best = found;
            }
        }
        let differs = |c: &Candidate| c.at.turn.likeness(best.at.turn) <= SAME;
        let all = others.into_iter().flatten().chain([polished]);
        verified.runner_up = all
            .filter(differs)
            .map(|c| c.residual)
            .min_by(|a, b| a.mean().total_cmp(&b.mean()));
        verified.best = self.refined(&best, initial);
        Ok(verified)
    }

    fn score(&mut self, at: Rigid, points: usize, scale: f32) -> f32 {
        self.match_both(at, points);
        self.matched_residual(scale).mean()
    }

    /// Copies of a pose turned about its slippery axis in small steps, and of the same upside down.
    fn spins(&mut self, at: Rigid) -> impl Iterator<Item = Rigid> + use<> {
        let axis = self.slippery_axis(at);
        let upside_down = Turn::new(axis.any_orthonormal_vector(), 0.0);
        let (sine, cosine) = libm::sincosf(core::f32::consts::PI / SPINS as f32);
        let step = Turn::new(axis * sine, cosine);
        [at.turn, upside_down.after(at.turn)]
            .into_iter()
            .flat_map(move |from| {
                let turns = core::iter::successors(Some(from), move |&turn| Some(step.after(turn)));
                turns.take(SPINS).map(move |turn| Rigid { turn, ..at })
            })
    }
}

/// Principal axes of a surface's points.
fn axes(surface: &Surface) -> Mat3 {
    let mut sums = [0.0f32; 6];
    for &[x, y, z] in surface.points() {
        for (sum, product) in sums
            .iter_mut()
            .zip([x * x, y * y, z * z, x * y, x * z, y * z])
        {
            *sum += product;
        }
    }
    principal_axes(sums)
}

/// Turns by 45, 90 and 180 degrees about the axes given and about x, y, z.
fn turns(axes: Mat3) -> impl Iterator<Item = Turn> {
    // Sine and cosine of half the angle.
    const HALVES: [(f32, f32); 5] = [
        (1.0, 0.0),
        (
            core::f32::consts::FRAC_1_SQRT_2,
            core::f32::consts::FRAC_1_SQRT_2,
        ),
        (
            -core::f32::consts::FRAC_1_SQRT_2,
            core::f32::consts::FRAC_1_SQRT_2,
        ),
        (0.382_683_43, 0.923_879_5),
        (-0.382_683_43, 0.923_879_5),
    ];
    let about = [
        axes.x_axis,
        axes.y_axis,
        axes.z_axis,
        Vec3::X,
        Vec3::Y,
        Vec3::Z,
    ];
    HALVES
        .into_iter()
        .flat_map(move |(sine, cosine)| about.map(|axis| Turn::new(axis * sine, cosine)))
}

/// The 24 rotations that map axes to axes.
fn alignments() -> impl Iterator<Item = Mat3> {
    let axes = [
        Vec3::X,
        Vec3::Y,
        Vec3::Z,
        Vec3::NEG_X,
        Vec3::NEG_Y,
        Vec3::NEG_Z,
    ];
    axes.into_iter().flat_map(move |first| {
        axes.into_iter()
            .filter(move |second| first.dot(*second) == 0.0)
            .map(move |second| Mat3::from_cols(first, second, first.cross(second)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polish::Workspace;
    use crate::polish::tests::{Numbers, error, moved, part, pose};
    use crate::verdict::{Evidence, Verdict};

    fn verify(source: &[[f32; 3]], target: &[[f32; 3]], initial: Pose) -> Verified {
        let mut workspace = Box::new(Workspace::new());
        let mut refiner = Refiner::new(source, target, &mut workspace).expect("valid clouds");
        refiner.verify(initial).expect("a rigid pose")
    }

    #[test]
    fn flips_are_found_and_taken_back() {
        use core::f32::consts::PI;
        let truth = pose([0.4, -0.2, 0.3], [0.2, -0.1, 0.3]);
        let source = moved(&part(800, 1), truth.inverse());
        let target = part(900, 2);
        for flip in [
            [PI, 0.0, 0.0],
            [0.0, PI, 0.0],
            [0.0, 0.0, PI],
            [0.0, PI / 2.0, 0.0],
        ] {
            let found = verify(&source, &target, pose(flip, [0.1, 0.0, 0.0]).after(truth));
            let (angle, distance) = error(found.best.target_from_source, truth);
            assert!(
                angle < 1.0 && distance < 0.02,
                "{flip:?} {angle} {distance}"
            );
            assert!(
                found.hypotheses > 0 && found.best.residual.mean() < found.polished.residual.mean()
            );
            assert!(
                found
                    .runner_up
                    .is_none_or(|other| other.mean() > found.best.residual.mean())
            );
            assert!(Evidence::verified(&found).probability() > 0.5, "{found:?}");
        }
        let kept = verify(&source, &target, truth);
        assert_eq!(kept.best, kept.polished);
    }

    #[test]
    fn it_ends_when_told_to() {
        #[derive(Debug, PartialEq)]
        enum Ended {
            Told,
            Failed(Error),
        }
        impl From<Error> for Ended {
            fn from(error: Error) -> Self {
                Ended::Failed(error)
            }
        }
        let target = part(900, 2);
        let mut workspace = Box::new(Workspace::new());
        let mut refiner = Refiner::new(&part(800, 1), &target, &mut workspace).expect("valid");
        let far = pose([core::f32::consts::PI, 0.0, 0.0], [0.1, 0.0, 0.0]);
        let mut asked = 0;
        let whole = refiner.verify_while(far, || {
            asked += 1;
            Ok::<(), Ended>(())
        });
        let whole = whole.expect("nobody ends it");
        // Before each hypothesis, and before each that is sifted or polished.
        assert!(asked > whole.hypotheses, "{asked}");
        for last in [1, whole.hypotheses, asked] {
            let mut left = last;
            let ended = refiner.verify_while(far, || {
                left -= 1;
                if left == 0 { Err(Ended::Told) } else { Ok(()) }
            });
            assert_eq!((ended, left), (Err(Ended::Told), 0));
        }
        let bad = Pose {
            rotation: glam::Mat3::ZERO,
            ..far
        };
        let failed = refiner.verify_while(bad, || Err(Ended::Told));
        assert!(matches!(failed, Err(Ended::Failed(Error::BadPose))));
    }

    #[test]
    fn another_object_is_refused() {
        let mut numbers = Numbers(3);
        let other: Vec<[f32; 3]> = (0..900)
            .map(|_| {
                let v = Vec3::new(numbers.next(), numbers.next(), numbers.next()).normalize();
                (v * Vec3::new(1.0, 0.3, 0.9)).to_array()
            })
            .collect();
        let found = verify(&part(800, 4), &other, Pose::IDENTITY);
        let probability = Evidence::verified(&found).probability();
        assert!(probability < 0.2, "{probability} {found:?}");
        assert_eq!(Verdict::of_probability(probability), Verdict::PoorFit);
    }

    /// A vase: its surface says nothing of the angle, the points that both clouds share do.
    #[test]
    fn shared_points_tell_the_angle_of_a_surface_of_revolution() {
        let mut numbers = Numbers(5);
        let vase: Vec<[f32; 3]> = (0..1600)
            .map(|_| {
                let (angle, z) = (core::f32::consts::PI * numbers.next(), numbers.next());
                let radius = 0.3 + 0.2 * z * z + 0.1 * z;
                [radius * angle.cos(), radius * angle.sin(), 0.8 * z]
            })
            .collect();
        let truth = pose([0.2, 0.1, 0.4], [0.1, 0.0, 0.0]);
        let source = moved(&vase[..1000], truth.inverse());
        let initial = pose([0.0, 0.0, 2.0], [0.0; 3]).after(truth);
        let found = verify(&source, &vase[500..1500], initial);
        let (angle, _) = error(found.best.target_from_source, truth);
        assert!(angle < 1.0, "{angle} {found:?}");
        assert!(found.polished.grip < 0.02, "{found:?}");
    }

    #[test]
    fn there_are_24_alignments_and_30_turns() {
        let alignments: Vec<Mat3> = alignments().collect();
        assert_eq!(alignments.len(), 24);
        assert!(alignments.iter().all(|m| m.determinant() == 1.0));
        let turns: Vec<Turn> = turns(Mat3::IDENTITY).collect();
        assert_eq!(turns.len(), 30);
        assert!(turns.iter().all(|q| (q.likeness(*q) - 1.0).abs() < 1e-6));
    }

    #[test]
    fn the_best_are_kept_in_order_and_one_of_a_kind() {
        let mut best = Best::<2>([None; 2]);
        let at = |x: f32| Rigid {
            turn: Turn::new(Vec3::X * (0.5 * x).sin(), (0.5 * x).cos()),
            shift: Vec3::ZERO,
        };
        for (score, angle) in [
            (0.5, 0.0),
            (0.4, 1.0),
            (0.3, 0.05),
            (0.6, 2.0),
            (0.45, 1.02),
        ] {
            best.offer(score, at(angle));
        }
        let scores: Vec<f32> = best.0.iter().flatten().map(|held| held.0).collect();
        assert_eq!(scores, [0.3, 0.4]);
    }
}
