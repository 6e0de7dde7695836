//! What is said of a refined pose, in sentences: the command line prints them, and the page in a browser shows them.

use crate::register::request::Done;
use glam::Vec3;
use reagent_core::evidence::SEEN_THROUGH;
use reagent_core::pipeline::Refinement;
use reagent_core::polish::Refined;
use reagent_core::verdict::{Percent, Verdict};
use reagent_core::verify::{Axis, OTHERS, Slide};
use reagent_core::wire::Fit;

/// How the source and the target are called.
pub type Names<'a> = [&'a str; 2];

/// What a probability leaves out if other poses fit as well.
pub const UP_TO: &str = ", up to what is undetermined";

/// What is to be known of a pose before it is used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Remark {
    /// The turn about an axis is open.
    OpenAxis(Axis),
    /// All turns are open.
    AnyRotation,
    /// A rotational symmetry leaves the turn open: its axis, and in how many ways.
    Fold(Vec3, u8),
    /// The place along a direction is open.
    OpenSlide(Slide),
    /// So many other poses fit as well; from [`OTHERS`] on, there may be more than are named.
    OtherPoses(usize),
    /// Shares of the source's and of the target's points that were not looked at.
    LeftOut([f32; 2]),
    /// The size of the source over that of the target.
    SizesDiffer(f32),
    /// The source is so many times as large as the target, and fits far better once it is scaled.
    OtherSize(f32),
    /// The mirror image fits better.
    Mirrored,
    /// This share of the source's points lies off the target, though the pose is called right.
    OffTarget(f32),
    /// Something was seen behind this share of the target.
    SeenThrough(f32),
}

impl Remark {
    /// All that there are of a registration.
    pub fn all(done: &Done) -> Vec<Remark> {
        let answer = &done.found.answer;
        let Some(found) = &answer.refinement else {
            return Vec::new();
        };
        let mut remarks = Remark::on_fit(answer.verdict, &Fit::of(found));
        let on_clouds = [
            done.other_size.map(Remark::OtherSize),
            done.off_target().map(Remark::OffTarget),
        ];
        remarks.extend(on_clouds.into_iter().flatten());
        remarks
    }

    /// Those that the fit tells: a robot's answer holds no more.
    pub fn on_fit(verdict: Verdict, fit: &Fit) -> Vec<Remark> {
        let others = usize::from(fit.others);
        let axis = fit.axis.map(|(point, direction, range_rad)| {
            let (point, direction) = (point.into(), direction.into());
            match fit.any_rotation {
                true => Remark::AnyRotation,
                false => Remark::OpenAxis(Axis {
                    point,
                    direction,
                    range_rad,
                }),
            }
        });
        let fold = fit
            .fold
            .map(|(_, direction, order)| Remark::Fold(direction.into(), order));
        let slide = fit.slide.map(|(direction, range)| Slide {
            direction: direction.into(),
            range,
        });
        let remarks = [
            axis,
            fold,
            slide.map(Remark::OpenSlide),
            (others > 0).then_some(Remark::OtherPoses(others)),
            (fit.left_out != [0.0; 2]).then_some(Remark::LeftOut(fit.left_out)),
            (verdict == Verdict::SizesDiffer).then_some(Remark::SizesDiffer(fit.extents_ratio)),
            (verdict == Verdict::Mirrored).then_some(Remark::Mirrored),
            (fit.seen_through > SEEN_THROUGH).then_some(Remark::SeenThrough(fit.seen_through)),
        ];
        // Where sizes differ, what seems open says nothing of the shape.
        let remarks = remarks.into_iter().flatten();
        remarks
            .filter(|remark| verdict != Verdict::SizesDiffer || !remark.is_open())
            .collect()
    }

    /// Whether the pose is one of several that fit as well.
    pub fn is_open(&self) -> bool {
        matches!(
            self,
            Remark::OpenAxis(_)
                | Remark::AnyRotation
                | Remark::Fold(..)
                | Remark::OpenSlide(_)
                | Remark::OtherPoses(_)
        )
    }

    /// In words.
    pub fn sentence(&self, [source, target]: Names<'_>) -> String {
        match *self {
            Remark::OpenAxis(axis) => {
                let [x, y, z] = axis.direction.to_array();
                let turn = match axis.range_rad.map(f32::to_degrees) {
                    [-180.0, 180.0] => "by any angle".into(),
                    [least, most] => format!("from {least:.0} to {most:.0} degrees"),
                };
                format!(
                    "undetermined: the turn about the {target}'s axis ({x:.3}, {y:.3}, {z:.3}), {turn}"
                )
            }
            Remark::AnyRotation => {
                format!("undetermined: the {target} is a ball, and any rotation fits as well")
            }
            Remark::Fold(direction, order) => {
                let ([x, y, z], degrees) = (direction.to_array(), 360.0 / f32::from(order));
                let degrees = (100.0 * degrees).round() / 100.0;
                format!(
                    "undetermined: turned about the {target}'s axis ({x:.3}, {y:.3}, {z:.3}) by any multiple of {degrees} degrees it fits as well, in {order} ways"
                )
            }
            Remark::OpenSlide(slide) => {
                let [x, y, z] = slide.direction.to_array();
                let [least, most] = slide.range;
                format!(
                    "undetermined: the place along the {target}'s direction ({x:.3}, {y:.3}, {z:.3}), from {least:.3} to {most:.3} in its unit"
                )
            }
            Remark::OtherPoses(1) => "undetermined: 1 other pose fits as well".into(),
            // Not many more are looked for.
            Remark::OtherPoses(others @ OTHERS..) => {
                format!("undetermined: at least {others} other poses fit as well")
            }
            Remark::OtherPoses(others) => {
                format!("undetermined: {others} other poses fit as well")
            }
            Remark::LeftOut(shares) => {
                let clouds = [source, target].into_iter().zip(shares);
                let some = clouds.filter(|&(_, share)| share > 0.0);
                let of = |(of, share)| format!("{:.1} % of the {of}'s points", 100.0 * share);
                let parts: Vec<String> = some.map(of).collect();
                format!("left out: {}, far from all others", parts.join(" and "))
            }
            Remark::SizesDiffer(ratio) => {
                let factor = ratio.max(1.0 / ratio.max(f32::MIN_POSITIVE));
                let which = if ratio > 1.0 { source } else { target };
                format!(
                    "sizes differ: the {which} is about {factor:.1} times as large as the other cloud; inch (25.4), cm (10) or m (1000) against mm?"
                )
            }
            Remark::OtherSize(times) => format!(
                "the {source} is {times:.2} times as large as the {target}: check its unit or calibration"
            ),
            Remark::Mirrored => format!(
                "the mirror image of the {source} fits better: a left-hand part for a right-hand one, an axis the other way around, or a wrong pose of a symmetric shape"
            ),
            Remark::OffTarget(share) => format!(
                "{:.0} % of the {source} lies off the {target}: where they overlap in part that is to be expected, else something more is in view, or it is another part",
                100.0 * share
            ),
            Remark::SeenThrough(share) => format!(
                "{:.0} % of the {target} would stand where something was seen behind it: the pose is wrong, or what is in view is smaller, has less to it, or is another part",
                100.0 * share
            ),
        }
    }
}

/// How a registration ended. Without a probability nothing judged the pose, and the verdict is on the policy's steps.
pub fn outcome(verdict: Verdict, probability: Option<f32>) -> String {
    match (verdict, probability) {
        (_, Some(_)) => verdict.to_string(),
        (Verdict::Converged, None) => "steps settled, pose not judged".into(),
        (_, None) => format!("{verdict}, pose not judged"),
    }
}

/// How probably a pose is right.
pub fn probability(found: &Refinement, [_, target]: Names<'_>) -> String {
    let up_to = match found.undetermined.is_nothing() || found.evidence.sizes_differ() {
        true => "",
        false => UP_TO,
    };
    let percent = Percent(found.evidence.probability());
    format!(
        "right within 5 degrees and .05 radii of the {target}, or not to be told from the true pose{up_to}: {percent}"
    )
}

/// How the clouds fit.
pub fn fit(refined: &Refined, [source, target]: Names<'_>) -> String {
    let (percent, off) = (100.0 * refined.overlap, refined.inlier_rmse);
    format!(
        "{percent:.0} % of the {source} lies on the {target}, {off:.3e} off it (root mean square)"
    )
}

/// How far a right pose is off.
pub fn uncertainty(refined: &Refined, [_, target]: Names<'_>) -> String {
    let matrix = &refined.covariance.matrix;
    let deviation = |i: usize| f64::from(matrix[i][i]).sqrt();
    let [a, b, c] = [0, 1, 2].map(|i| deviation(i).to_degrees());
    let [x, y, z] = [3, 4, 5].map(deviation);
    format!(
        "standard deviations, if the pose is right: {a:.2}, {b:.2}, {c:.2} degrees about the {target}'s axes and {x:.1e}, {y:.1e}, {z:.1e} along them"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A slide is open, and nothing else.
    #[test]
    fn a_robots_answer_tells_of_an_open_slide() {
        let fit = Fit {
            overlap: 1.0,
            inlier_rmse: 0.0,
            extents_ratio: 1.0,
            distinct_points: 900,
            left_out: [0.0; 2],
            seen_through: 0.0,
            axis: None,
            slide: Some(([1.0, 0.0, 0.0], [-0.5, 2.0])),
            any_rotation: false,
            fold: None,
            others: 0,
            covariance: ([0.0; 3], [0.0; 21]),
        };
        let remarks = Remark::on_fit(Verdict::Converged, &fit);
        assert!(remarks.len() == 1 && remarks[0].is_open(), "{remarks:?}");
        let words = "from -0.500 to 2.000 in its unit";
        assert!(remarks[0].sentence(["scan", "part"]).ends_with(words));
    }

    #[test]
    fn clouds_are_called_as_the_reader_calls_them() {
        let names = ["scan", "part"];
        for (remark, words) in [
            (
                Remark::SizesDiffer(25.4),
                "the scan is about 25.4 times as large",
            ),
            (
                Remark::SizesDiffer(0.001),
                "the part is about 1000.0 times as large",
            ),
            (
                Remark::LeftOut([0.1, 0.0]),
                "left out: 10.0 % of the scan's points, far",
            ),
            (
                Remark::LeftOut([0.1, 0.02]),
                "10.0 % of the scan's points and 2.0 % of the part's points, far",
            ),
            (
                Remark::OtherSize(1.1),
                "the scan is 1.10 times as large as the part: check its",
            ),
            (Remark::Mirrored, "mirror image of the scan"),
            (
                Remark::OffTarget(0.5),
                "50 % of the scan lies off the part:",
            ),
            (Remark::OtherPoses(1), "1 other pose fits as well"),
            (
                Remark::Fold(Vec3::Z, 6),
                "about the part's axis (0.000, 0.000, 1.000) by any multiple of 60 degrees it fits as well, in 6 ways",
            ),
            (Remark::OtherPoses(2), "undetermined: 2 other poses fit"),
            (
                Remark::OtherPoses(OTHERS),
                "undetermined: at least 5 other poses fit as well",
            ),
        ] {
            let sentence = remark.sentence(names);
            assert!(sentence.contains(words), "{sentence}");
        }
    }
}
