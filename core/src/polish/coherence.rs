//! Whether what is off a surface is noise, which is each point's own, or another surface, off which neighbours are together.

use super::Refiner;
use crate::loss;
use crate::pose::Pose;
use crate::solve::Rigid;
use crate::surface::Surface;
use crate::surface::matching::Matching;
use glam::Vec3;

/// How far neighbours are off the other cloud's surface together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coherence {
    /// Root of the mean product of the offsets of neighbours among the source's points, target radii: noise leaves 0, whatever
    /// it is.
    pub together: f32,
    /// Mean product of the offsets of neighbours among the target's points over the mean square: 0 for noise, up to 1.
    pub alike: f32,
}

impl Refiner<'_> {
    /// Of the points matched last.
    pub(super) fn matched_coherence(&self, at: Rigid) -> Coherence {
        let [source, target] = self.surfaces();
        let pose = at.pose();
        let is_within = |apart: Vec3, _, radius: f32| apart.length_squared() < radius * radius;
        let of_source = products([source, target], &self.work.of_source, pose, is_within);
        let of_target = products(
            [target, source],
            &self.work.of_target,
            pose.inverse(),
            loss::is_near_surface,
        );
        let share = |sum: f64, of: f64| (sum / of.max(f64::MIN_POSITIVE)) as f32;
        Coherence {
            together: libm::sqrtf(share(of_source.product, of_source.pairs).max(0.0)),
            alike: share(of_target.product, of_target.square),
        }
    }
}

/// Sums over pairs of neighbours.
struct Products {
    product: f64,
    square: f64,
    pairs: f64,
}

/// Over neighbours in the spatial order of a surface, both of which `counts`: by their offsets from the planes of the points
/// that are nearest to them.
fn products(
    [surface, other]: [&Surface; 2],
    matching: &Matching,
    pose: Pose,
    counts: impl Fn(Vec3, Vec3, f32) -> bool,
) -> Products {
    let offsets = matching.matches().map(|found| {
        let ((p, _), (q, n)) = (surface.at(found.of), other.at(found.to));
        let apart = pose.apply(p) - q;
        counts(apart, n, other.radius).then(|| n * n.dot(apart))
    });
    let mut sums = Products {
        product: 0.0,
        square: 0.0,
        pairs: 0.0,
    };
    let mut before = None;
    for offset in offsets {
        if let (Some(a), Some(b)) = (before, offset) {
            sums.product += f64::from(Vec3::dot(a, b));
            sums.square += 0.5 * f64::from(a.length_squared() + b.length_squared());
            sums.pairs += 1.0;
        }
        before = offset;
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polish::Workspace;
    use crate::polish::tests::Numbers;

    /// Of a plane against another that is bent by so much, with noise of so much.
    fn coherence(bent: f32, noise: f32) -> Coherence {
        let mut numbers = Numbers(3);
        let mut plane = |bent: f32| -> Vec<[f32; 3]> {
            let point = |_| {
                let [x, y, z] = [(); 3].map(|()| numbers.next());
                [x, y, bent * libm::sinf(4.0 * x) + noise * z]
            };
            (0..1024).map(point).collect()
        };
        let (source, target) = (plane(bent), plane(0.0));
        let mut workspace = Box::new(Workspace::new());
        let mut refiner = Refiner::new(&source, &target, &mut workspace).expect("valid clouds");
        refiner.residual(Pose::IDENTITY).expect("rigid");
        let at = refiner.inside(Pose::IDENTITY);
        refiner.matched_coherence(at)
    }

    #[test]
    fn neighbours_are_off_together_where_the_surface_is_another() {
        let (noisy, bent) = (coherence(0.0, 0.05), coherence(0.05, 0.0));
        assert!(noisy.together < 0.3 * bent.together, "{noisy:?} {bent:?}");
        assert!(noisy.alike < 0.3 && bent.alike > 0.7, "{noisy:?} {bent:?}");
    }
}
