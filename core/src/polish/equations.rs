//! Normal equations of the matched points: for a step, and for the certainty of a pose.

use super::Refiner;
use super::stage::{FINE, NEAR, Stage};
use crate::covariance::Covariance;
use crate::kernels::{LANES, Sums, Weighing};
use crate::solve::{NormalEquations, Rigid, Spread, least, principal_axes};
use crate::surface::Surface;
use glam::{Mat3, Vec3};

/// Damping: the share of the equations' trace added to their diagonal.
pub(super) const RIDGE: f64 = 1e-7;

/// How much noise, relative to the radius of neighbourhoods, spoils the planes that are fitted to those; both squared.
/// Chosen on pairs drawn from training meshes with noise of 0 to .03 radii.
const ROUGH: f64 = 50.0;
/// Most that it raises a variance by.
const MOST_ROUGH: f64 = 100.0;
/// What holds turns, relative to what holds shifts, in a shape that is not round.
const A_TURN: f32 = 0.1;

/// The turn that planes hold least.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HeldTurn {
    /// Unit vector along the axis.
    pub(crate) axis: Vec3,
    /// How well they hold it, as a share of what holds turns about all axes.
    pub(crate) held: f32,
    /// From a turn to the shift that suits it best.
    shift_of: Mat3,
}

impl HeldTurn {
    /// The point nearest to the target's centre of a line in this direction, about which turns are held least.
    pub(crate) fn through(&self, axis: Vec3) -> Vec3 {
        axis.cross(self.shift_of * axis)
    }

    /// The point about which turns in all directions are held least: a ball's centre.
    pub(crate) fn centre(&self) -> Vec3 {
        // A turn ω about a point p shifts by p × ω.
        let Mat3 {
            x_axis: x,
            y_axis: y,
            z_axis: z,
        } = self.shift_of;
        Vec3::new(y.z - z.y, z.x - x.z, x.y - y.x) * 0.5
    }
}

impl Refiner<'_> {
    /// The axis through the target's centre about which the planes matched under a pose constrain rotation least, and how well
    /// ([`super::Refined::rotation_constraint`]).
    pub(crate) fn least_constraint(&mut self, at: Rigid) -> (Vec3, f32) {
        let (axis, constraint) = least(self.matched_equations(at, &NEAR).turning());
        (if axis == Vec3::ZERO { Vec3::Z } else { axis }, constraint)
    }

    /// The turn that the planes matched under a pose hold least.
    pub(crate) fn least_held_turn(&mut self, at: Rigid) -> HeldTurn {
        let equations = self.matched_equations(at, &NEAR);
        let trace = |[xx, yy, zz, ..]: Spread| xx + yy + zz;
        let (free, shift_of) = equations.free_turning();
        let (axis, share) = least(free);
        let axis = if axis == Vec3::ZERO { Vec3::Z } else { axis };
        // All turns of a ball are held by nothing but noise, so shifts tell what would be firm.
        let firm = trace(equations.turning()).max(A_TURN * trace(equations.shifting()));
        HeldTurn {
            axis,
            shift_of,
            held: share * trace(free) / firm.max(f32::MIN_POSITIVE),
        }
    }

    /// The direction along which the planes matched under a pose constrain translation least, and how well (same measure).
    pub(crate) fn least_held_shift(&mut self, at: Rigid) -> (Vec3, f32) {
        least(self.matched_equations(at, &NEAR).shifting())
    }

    /// Principal axes of the translation constraint of these planes, the last along the least constrained direction.
    pub(crate) fn shift_axes(&mut self, at: Rigid) -> Mat3 {
        principal_axes(self.matched_equations(at, &NEAR).shifting())
    }

    /// Normal equations of one step of a stage.
    pub(super) fn matched_equations(&mut self, at: Rigid, stage: &Stage) -> NormalEquations {
        let by = Weighing {
            gate: self.match_within_gate(at, stage),
            tangential: stage.tangential,
        };
        const AT_ONCE: usize = 4 * LANES;
        let (isa, pose) = (self.isa, at.pose());
        let surfaces = self.surfaces().map(Surface::bare);
        let (mut pairs, mut count, mut sums) = ([[0; 2]; AT_ONCE], 0, Sums::ZERO);
        // `for_each` is faster here than a loop.
        self.matched().for_each(|pair| {
            if let Some(place) = pairs.get_mut(count) {
                *place = pair;
                count += 1;
            }
            if count == AT_ONCE {
                isa.equations(&pairs, surfaces, &pose, by, &mut sums);
                count = 0;
            }
        });
        let rest = pairs.get(..count).unwrap_or(&[]);
        isa.equations(rest, surfaces, &pose, by, &mut sums);
        NormalEquations::of(&sums)
    }

    /// Normal equations of the planes under a refined pose, summed in f64, and the weighted mean of the squared residuals.
    fn information(&mut self, at: Rigid) -> (NormalEquations, f64) {
        let gate = self.match_within_gate(at, &FINE);
        let [source, target] = self.surfaces();
        let (pose, mut motion) = (at.pose(), NormalEquations::ZERO);
        let (mut squares, mut weights) = (0.0f64, 0.0f64);
        for [i, j] in self.matched() {
            let ((p, m), (q, n)) = (source.at(i.into()), target.at(j.into()));
            let (p, m) = (pose.apply(p), pose.rotation * m);
            let (apart, middle) = (p - q, (p + q) * 0.5);
            let share = (1.0 - apart.length_squared() / gate).max(0.0);
            let normal = (if m.dot(n) < 0.0 { n - m } else { n + m }).normalize_or_zero();
            let across = normal.dot(apart);
            if share > 0.0 {
                motion.add(middle, normal, share * share);
                squares += f64::from(share * share * across * across);
                weights += f64::from(share * share);
            }
        }
        (motion, squares / weights.max(f64::MIN_POSITIVE))
    }

    /// Covariance of a refined pose.
    pub(super) fn covariance(&mut self, at: Rigid) -> Covariance {
        let (equations, variance) = self.information(at);
        let [source, target] = self.surfaces().map(|surface| f64::from(surface.radius));
        let neighbourhood = source.min(target).max(f64::from(f32::MIN_POSITIVE));
        let rough = (ROUGH * variance / (neighbourhood * neighbourhood)).min(MOST_ROUGH);
        Covariance::of(
            &equations,
            [variance, 1.0 + rough],
            self.model.frame.centre,
            self.model.frame.scale,
        )
    }
}
