//! The cut: leaves out source points too far from the model to belong to it.
//!
//! A feature is a maximum over points, so one point metres away dominates it, and the centroid about which the source rotates.
//! The segment of a depth image always has such points, where the mask reaches over the object's edge. A policy for views
//! ([`Sight::cut`](crate::sight::Sight::cut)) therefore leaves out, in every look, points farther from the model's centre than
//! its radius and the start's error can explain. Nothing is stored: points are judged as they are read.

use crate::cloud::Cloud;
use crate::dims::MIN_POINTS;
use crate::frame::Frame;
use crate::pose::{Pose, mean};
use crate::view::View;
use glam::Vec3;

/// Units of [`Cut`] in one radius of the model.
const PARTS: f32 = 16.0;

/// Distance from the model's centre up to which points are looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Cut(u8);

impl Cut {
    /// No limit: everything is looked at.
    pub const NONE: Cut = Cut(0);

    /// A limit in radii of the model, rounded to sixteenths, from 1/16 to 15.9; `None` for any other number.
    pub fn within(radii: f32) -> Option<Cut> {
        let parts = libm::roundf(radii * PARTS);
        (1.0..=255.0).contains(&parts).then_some(Cut(parts as u8))
    }

    /// The limit in radii of the model; infinite without a limit.
    pub fn radii(self) -> f32 {
        match self.0 {
            0 => f32::INFINITY,
            parts => f32::from(parts) / PARTS,
        }
    }

    /// The limit as stored in a policy file.
    pub const fn header(self) -> u8 {
        self.0
    }

    /// The limit that a policy file states.
    pub const fn from_header(parts: u8) -> Cut {
        Cut(parts)
    }

    /// The reach for a cloud under `view`. If it would keep fewer than [`MIN_POINTS`], the pose estimate tells nothing about
    /// which points belong to the model, and all are kept.
    pub fn of(self, cloud: Cloud<'_>, view: &View) -> Reach {
        let radii = self.radii();
        let reach = Reach {
            squared: radii * radii,
        };
        if self == Cut::NONE
            || cloud
                .points()
                .filter(|&p| reach.keeps(view, p))
                .nth(MIN_POINTS - 1)
                .is_some()
        {
            reach
        } else {
            Reach::ALL
        }
    }

    /// Mean of the points kept under a plain pose estimate: the point about which the source rotates.
    pub fn centroid(self, source: Cloud<'_>, frame: &Frame, initial: &Pose) -> Vec3 {
        let view = frame.view(initial);
        let reach = self.of(source, &view);
        mean(source.points().filter(|&p| reach.keeps(&view, p)))
    }
}

/// Distance from the origin of the normalised frame up to which points are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    squared: f32,
}

impl Reach {
    /// No limit.
    pub const ALL: Reach = Reach {
        squared: f32::INFINITY,
    };

    /// Whether a stored point is within reach under `view`.
    #[inline]
    pub fn keeps(&self, view: &View, point: [f32; 3]) -> bool {
        self.squared == f32::INFINITY
            || Vec3::from_array(view.see(point)).length_squared() <= self.squared
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FAR: [[f32; 3]; 5] = [
        [1.0, 0.0, 0.0],
        [0.0, 1.4, 0.0],
        [0.0, 0.0, -1.5],
        [0.0, 1.6, 0.0],
        [0.0, 0.0, 300.0],
    ];

    #[test]
    fn what_is_far_from_the_model_is_left_out() {
        let cut = Cut::within(1.5).expect("a number of radii");
        let source = Cloud::F32(&FAR);
        let reach = cut.of(source, &View::IDENTITY);
        assert_eq!(
            FAR.map(|p| reach.keeps(&View::IDENTITY, p)),
            [true, true, true, false, false]
        );
        let centroid = cut.centroid(source, &Frame::IDENTITY, &Pose::IDENTITY);
        assert!(centroid.abs_diff_eq(Vec3::new(1.0, 1.4, -1.5) / 3.0, 1e-6));
        // In the clouds' own units, under a pose estimate that brings the last two points to the model.
        let frame = Frame {
            centre: Vec3::Z * 7.0,
            scale: 200.0,
        };
        let initial = Pose {
            translation: Vec3::Z * -7.0,
            ..Pose::IDENTITY
        };
        let view = frame.view(&initial);
        assert_eq!(view.see(FAR[4]), [0.0, 0.0, 1.43]);
        assert!(cut.of(source, &view).keeps(&view, FAR[4]));
    }

    #[test]
    fn a_start_without_the_model_in_reach_cuts_nothing() {
        let source = Cloud::F32(&FAR[2..]);
        let cut = Cut::within(1.5).expect("a number of radii");
        assert_eq!(cut.of(source, &View::IDENTITY), Reach::ALL);
        assert_eq!(Cut::NONE.of(source, &View::IDENTITY), Reach::ALL);
        let centroid = cut.centroid(source, &Frame::IDENTITY, &Pose::IDENTITY);
        assert_eq!(centroid, mean(source.points()));
    }

    #[test]
    fn radii_are_sixteenths() {
        for radii in [0.0, -1.0, f32::NAN, f32::INFINITY, 16.0, 0.02] {
            assert_eq!(Cut::within(radii), None, "{radii}");
        }
        let cut = Cut::within(1.49).expect("a number of radii");
        assert_eq!(cut.radii(), 1.5);
        assert_eq!(Cut::from_header(cut.header()), cut);
        assert_eq!(Cut::NONE.radii(), f32::INFINITY);
    }

    /// Far points among those of the object change neither a logit nor a pose, in either number format, however the steps are
    /// sliced and whichever points they look at.
    #[cfg(all(feature = "pretrained", feature = "pretrained-int8"))]
    #[test]
    fn what_is_cut_off_takes_no_part() {
        use crate::golden::{POINTS, clouds};
        use crate::kernels::Isa;
        use crate::net::Scratch;
        use crate::sight::Sight;
        use crate::{Policy, Registrar, Registration};
        const FAR: usize = POINTS / 4;
        let [source, target] = clouds();
        let frame = Frame::of(&target).expect("a cloud");
        let mut mixed = [[9.0, -70.0, 30.0]; POINTS + FAR];
        for (i, &point) in source.iter().enumerate() {
            mixed[i + i / 4] = point;
        }
        let cut = Cut::within(2.5).expect("a number of radii");
        let policies = [Policy::pretrained(), Policy::pretrained_int8()];
        for policy in policies.map(|policy| policy.expect("a sound policy")) {
            for (isa, rescan) in Isa::all().flat_map(|isa| [(isa, 1), (isa, 3)]) {
                let policy = Policy {
                    sight: Sight { cut, focus: 0 },
                    rescan,
                    ..policy
                };
                let mut scratch = Scratch::new();
                let mut registrar = Registrar::with_isa(isa, policy, &mut scratch);
                let mut expected = registrar
                    .start(&source, &target, frame, Pose::IDENTITY)
                    .expect("two clouds");
                let steps = [(); 4].map(|()| registrar.step(&mut expected).expect("a step"));
                let mut found = Registration::new();
                registrar
                    .begin(
                        &mut found,
                        Cloud::F32(&mixed),
                        Cloud::F32(&target),
                        frame,
                        Pose::IDENTITY,
                    )
                    .expect("two clouds");
                for step in steps {
                    let found = loop {
                        if let Some(step) = registrar.advance(&mut found, 37).expect("a slice") {
                            break step;
                        }
                    };
                    assert_eq!(found, step, "{} {rescan}", isa.name());
                }
                assert_eq!(found.target_from_source(), expected.target_from_source());
            }
        }
    }
}
