//! The focus: chooses the points of the target that lie near the source, as seen under the current pose.
//!
//! A view shows one side of an object. The target's other sides make its feature unlike the source's even under the right pose.
//! A policy for views ([`Sight::focus`](crate::sight::Sight::focus)) therefore chooses, every few steps, the points of the
//! target that have some of the source near them. It needs no view point and stores no points: as [`crate::cut`] does with the
//! source, it judges points as they are read.

use crate::cloud::Cloud;
use crate::cut::Reach;
use crate::view::View;

/// Cells along an edge of the cube around the target.
const SIDE: usize = 16;
/// Fewer points than this tell nothing about a shape.
const FEWEST: usize = 32;
/// Half an edge of the cube, in target radii; the whole target lies inside.
const HALF: f32 = 1.28;

/// Cells around the target that hold a point of the source, or touch a cell that does.
#[derive(Clone, Debug, PartialEq)]
pub struct Focus {
    /// A bit for each cell along x, for each y and z; `None` to look at everything.
    rows: Option<[[u16; SIDE]; SIDE]>,
}

impl Focus {
    /// Looks at everything.
    pub const ALL: Focus = Focus { rows: None };

    /// The cells near a source under its view. If they would leave fewer than 32 of the target's points, the pose tells nothing
    /// about what was seen of the target, and everything is looked at.
    #[inline(never)]
    pub fn on(
        (source, source_view, reach): (Cloud<'_>, &View, Reach),
        (target, target_view): (Cloud<'_>, &View),
    ) -> Focus {
        let mut filled = [[0u16; SIDE]; SIDE];
        for point in source.points().filter(|&p| reach.keeps(source_view, p)) {
            if let Some([x, y, z]) = cell(source_view.see(point))
                && let Some(row) = filled.get_mut(z).and_then(|plane| plane.get_mut(y))
            {
                *row |= 1 << x;
            }
        }
        let focus = Focus {
            rows: Some(grown(&filled)),
        };
        let near = target.points().filter(|&p| focus.keeps(target_view, p));
        match near.take(FEWEST).count() {
            FEWEST => focus,
            _ => Focus::ALL,
        }
    }

    /// Whether a stored point of the target is looked at under `view`.
    #[inline]
    pub fn keeps(&self, view: &View, point: [f32; 3]) -> bool {
        let Some(rows) = &self.rows else {
            return true;
        };
        let Some([x, y, z]) = cell(view.see(point)) else {
            return false;
        };
        let row = rows.get(z).and_then(|plane| plane.get(y));
        row.is_some_and(|row| row >> x & 1 == 1)
    }
}

/// The cell of a normalised point; `None` outside the cube.
#[inline(never)]
fn cell(point: [f32; 3]) -> Option<[usize; 3]> {
    let place = point.map(|x| libm::floorf((x + HALF) * (SIDE as f32 / (2.0 * HALF))));
    let inside = |x: f32| (0.0..SIDE as f32).contains(&x);
    place
        .into_iter()
        .all(inside)
        .then_some(place.map(|x| x as usize))
}

/// Adds all cells that touch a filled one, by spreading along one axis after the other.
fn grown(filled: &[[u16; SIDE]; SIDE]) -> [[u16; SIDE]; SIDE] {
    let mut grown = *filled;
    for along in [1, SIDE] {
        let before = grown;
        let rows = before.as_flattened();
        for (i, row) in grown.as_flattened_mut().iter_mut().enumerate() {
            // Rows at the border of a plane have one neighbour in it.
            let is_beside = |k: usize| along == SIDE || k / SIDE == i / SIDE;
            let beside = [i.wrapping_sub(along), i + along];
            for &near in beside
                .iter()
                .filter(|&&k| is_beside(k))
                .filter_map(|&k| rows.get(k))
            {
                *row |= near;
            }
        }
    }
    for row in grown.as_flattened_mut() {
        *row |= *row << 1 | *row >> 1;
    }
    grown
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::Pose;
    use glam::Vec3;

    /// Points all over the unit sphere.
    fn sphere() -> [[f32; 3]; 500] {
        core::array::from_fn(|i| {
            let z = (2 * i + 1) as f32 / 500.0 - 1.0;
            let (sin, cos) = libm::sincosf(2.399_963 * i as f32);
            let r = libm::sqrtf(1.0 - z * z);
            [r * cos, r * sin, z]
        })
    }

    #[test]
    fn what_has_some_of_the_source_near_it_is_looked_at() {
        let target = sphere();
        let (seen, rest) = target.split_at(250); // the half below z = 0
        let view = View::IDENTITY;
        let on = |source| Focus::on((source, &view, Reach::ALL), (Cloud::F32(&target), &view));
        let focus = on(Cloud::F32(seen));
        assert!(seen.iter().all(|&p| focus.keeps(&view, p)));
        let kept = |&&p: &&[f32; 3]| focus.keeps(&view, p);
        assert!(rest.iter().filter(kept).all(|p| p[2] < 0.33));
        assert_eq!(on(Cloud::F32(&target)).rows.map(|_| ()), Some(()));
    }

    #[test]
    fn a_source_out_of_place_leaves_everything() {
        let target = sphere();
        let view = View::IDENTITY;
        let away = View {
            origin: Vec3::ZERO,
            map: Pose {
                translation: Vec3::X * 2.6,
                ..Pose::IDENTITY
            },
        };
        let target_seen = (Cloud::F32(&target), &view);
        let source = Cloud::F32(&target);
        assert_eq!(
            Focus::on((source, &away, Reach::ALL), target_seen),
            Focus::ALL
        );
        assert!(Focus::ALL.keeps(&view, [9.0; 3]));
        // Points cut off from the source do not count.
        let none = crate::cut::Cut::within(0.0625).expect("a number of radii");
        let reach = none.of(Cloud::F32(&[[0.0; 3]; 3]), &view);
        assert_eq!(Focus::on((source, &view, reach), target_seen), Focus::ALL);
    }

    #[test]
    fn cells_touch_across_faces_edges_and_corners() {
        let mut filled = [[0u16; SIDE]; SIDE];
        filled[0][15] = 1 << 15;
        filled[7][7] = 1 << 7;
        let grown = grown(&filled);
        let count: u32 = grown.iter().flatten().map(|row| row.count_ones()).sum();
        assert_eq!(count, 8 + 27);
        assert_eq!(grown[1][14], 0b11 << 14);
        assert_eq!(grown[8][6], 0b111 << 6);
    }

    /// In either number format, the steps are the same however they are sliced, and the focus is chosen anew.
    #[cfg(all(feature = "pretrained", feature = "pretrained-int8"))]
    #[test]
    fn slices_take_the_same_steps() {
        use crate::golden::{POINTS, clouds};
        use crate::kernels::Isa;
        use crate::net::Scratch;
        use crate::sight::Sight;
        use crate::{Frame, Policy, Registrar, Registration};
        let [source, target] = clouds();
        let part = &source[..POINTS / 2];
        let frame = Frame::of(&target).expect("a cloud");
        let policies = [Policy::pretrained(), Policy::pretrained_int8()];
        for policy in policies.map(|policy| policy.expect("a sound policy")) {
            let focused = Policy {
                sight: Sight {
                    focus: 2,
                    ..Sight::ALL
                },
                ..policy
            };
            for isa in Isa::all() {
                let mut scratch = Scratch::new();
                let mut registrar = Registrar::with_isa(isa, focused, &mut scratch);
                let mut whole = registrar
                    .start(part, &target, frame, Pose::IDENTITY)
                    .expect("two clouds");
                let expected = [(); 5].map(|()| registrar.step(&mut whole).expect("a step"));
                let mut sliced = Registration::new();
                registrar
                    .begin(
                        &mut sliced,
                        Cloud::F32(part),
                        Cloud::F32(&target),
                        frame,
                        Pose::IDENTITY,
                    )
                    .expect("two clouds");
                for step in expected {
                    let found = loop {
                        if let Some(step) = registrar.advance(&mut sliced, 37).expect("a slice") {
                            break step;
                        }
                    };
                    assert_eq!(found, step, "{}", isa.name());
                }
                assert_eq!(sliced.target_from_source(), whole.target_from_source());
                // A policy that looks at all of the target acts differently.
                let mut registrar = Registrar::with_isa(isa, policy, &mut scratch);
                let mut all = registrar
                    .start(part, &target, frame, Pose::IDENTITY)
                    .expect("two clouds");
                let step = registrar.step(&mut all).expect("a step");
                assert_ne!(step.logits_t, expected[0].logits_t, "{}", isa.name());
            }
        }
    }
}
