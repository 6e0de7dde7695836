//! Coarse steps and losses, for searches that look at many poses: few of the source's points, and points of the target that are
//! about nearest to them.

use super::Refiner;
use super::equations::{RIDGE, columns, set};
use crate::kernels::{PAIRS, Pairs, Sums, Weighing};
use crate::loss;
use crate::model::Model;
use crate::nearest::Lookup;
use crate::search::{
    Best, EARLY, EARLY_POINTS, EARLY_SLACK, SCREEN, SCREEN_POINTS, SCREEN_SCALE, SIFT, SIFT_POINTS,
    SIFT_SCALE,
};
use crate::solve::{Motion, Rigid};
use crate::surface::Surface;
use glam::Vec3;

impl Refiner<'_> {
    /// Steps on few of the source's points and about nearest points, one for each of the gates: distances from which a
    /// match has no weight, in normalised units.
    pub(crate) fn coarse(&self, initial: Rigid, points: usize, gates: &[f32]) -> Rigid {
        const TANGENTIAL: f32 = 0.1;
        let Model {
            lookup,
            surface: target,
            ..
        } = self.model;
        let (mut at, mut pairs) = (initial, Pairs::ZERO);
        for &gate in gates {
            let by = Weighing {
                gate: gate * gate,
                tangential: TANGENTIAL,
            };
            let (pose, mut sums) = (at.pose(), Sums::ZERO);
            for (lanes, count) in self.work.sample.first(points) {
                [pairs.p, pairs.m] = *lanes;
                self.isa.see(&mut pairs, &pose);
                look_up(&mut pairs, lookup, target);
                self.isa.equations(&pairs, by, count, &mut sums);
            }
            let (turn, shift) = Motion::of(&sums).solve(RIDGE);
            at = at.moved(turn, shift);
        }
        at
    }

    /// Mean loss of few of the source's points and about nearest points.
    pub(crate) fn coarse_loss(&self, at: Rigid, points: usize, scale: f32) -> f32 {
        let Model {
            lookup,
            surface: target,
            ..
        } = self.model;
        let pose = at.pose();
        let (mut sum, mut all) = (0.0f32, 0usize);
        let mut pairs = Pairs::ZERO;
        for (lanes, count) in self.work.sample.first(points) {
            [pairs.p, pairs.m] = *lanes;
            self.isa.see(&mut pairs, &pose);
            look_up(&mut pairs, lookup, target);
            let Pairs { p, q, n, .. } = &pairs;
            let lanes = vectors(p).zip(vectors(q)).zip(vectors(n));
            for ((p, q), n) in lanes.take(count) {
                sum += loss::of_surface(p - q, n, target.radius, scale);
            }
            all += count;
        }
        sum / all.max(1) as f32
    }

    /// Offers a hypothesis after a few steps, unless it is far behind those held after the first of them.
    pub(crate) fn screen<const N: usize>(&self, at: Rigid, screened: &mut Best<N>) {
        let [points, compared] = SCREEN_POINTS;
        let (early, late) = SCREEN.split_at(EARLY);
        let at = self.coarse(at, EARLY_POINTS, early);
        let loss = self.coarse_loss(at, EARLY_POINTS, SCREEN_SCALE);
        if screened.takes(loss - EARLY_SLACK) {
            let at = self.coarse(at, points, late);
            screened.offer(self.coarse_loss(at, compared, SCREEN_SCALE), at);
        }
    }

    /// A hypothesis after further steps, and its loss.
    pub(crate) fn sifted(&self, at: Rigid) -> (f32, Rigid) {
        let [points, compared] = SIFT_POINTS;
        let at = self.coarse(at, points, &SIFT);
        (self.coarse_loss(at, compared, SIFT_SCALE), at)
    }
}

/// Sets the second of the pairs to points of the target that are about nearest to the first.
fn look_up(pairs: &mut Pairs, lookup: &Lookup, target: &Surface) {
    let places = lookup.near(&pairs.p);
    let lanes = columns(&mut pairs.q).zip(columns(&mut pairs.n));
    for ((q, n), place) in lanes.zip(places) {
        set(q, n, target.at(place.into()));
    }
}

/// The vectors in the lanes of three rows.
fn vectors([x, y, z]: &[[f32; PAIRS]; 3]) -> impl Iterator<Item = Vec3> {
    let lanes = x.iter().zip(y).zip(z);
    lanes.map(|((&x, &y), &z)| Vec3::new(x, y, z))
}
