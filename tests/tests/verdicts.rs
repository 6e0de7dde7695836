//! Verdicts on clouds that have no right pose, or too little to tell it: each file stands for one kind of fault.

use host_train::dataset::cloud_file::read_cloud;
use host_train::policy::WeightFile;
use host_train::register::{register, within_capacity};
use reagent_core::pipeline::{Answer, Task};
use reagent_core::start::Start;
use reagent_core::{Error, Pose, Verdict};
use std::path::PathBuf;

fn points(name: &str) -> Vec<[f32; 3]> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("fixtures/cases");
    let cloud = read_cloud(&folder.join(name), 1).expect("a cloud");
    within_capacity(&cloud.relative_to(cloud.origin()))
}

fn registered(source: &str, target: &str) -> Result<Answer, Error> {
    let task = Task::new(Start::at(Pose::IDENTITY));
    let weights = WeightFile::pretrained();
    let found = register(weights.policy(), &points(source), &points(target), &task)?;
    Ok(found.answer)
}

fn verdict(source: &str) -> Verdict {
    let name = format!("verdict/{source}.xyz");
    registered(&name, "verdict/target.xyz")
        .expect("a pose")
        .verdict
}

#[test]
fn nothing_is_right_that_is_not() {
    assert_eq!(verdict("target"), Verdict::Converged);
    assert_eq!(verdict("other"), Verdict::PoorFit);
    assert_eq!(verdict("other-790-zeros"), Verdict::TooFewPoints);
    for same_part_or_not in ["target-x1000", "other-x0.001"] {
        assert_eq!(verdict(same_part_or_not), Verdict::SizesDiffer);
    }
}

#[test]
fn what_was_not_measured_is_refused() {
    let refused = |source: &str| registered(&format!("verdict/{source}.xyz"), "verdict/target.xyz");
    for one_place in ["one-point", "zeros"] {
        assert_eq!(refused(one_place).err(), Some(Error::NoExtent));
    }
    // A reader may leave the mark out and say so; then it is another object, as before.
    match refused("other-one-fltmax") {
        Err(error) => assert_eq!(error, Error::OutOfRange { index: 5 }),
        Ok(answer) => assert_ne!(answer.verdict, Verdict::Converged),
    }
}

#[test]
fn another_unit_is_named_with_its_factor() {
    for (name, factor) in [
        ("bracket_x100_large", 100.0),
        ("bracket_inch_vs_mm", 25.4),
        ("bracket_x1000_small", 1e-3),
        ("bracket_x100_small", 1e-2),
    ] {
        let [source, target] = ["s", "t"].map(|side| format!("unit_mismatch/{name}_{side}.ply"));
        let answer = registered(&source, &target).expect("a pose");
        assert_eq!(answer.verdict, Verdict::SizesDiffer, "{name}");
        let found = answer.refinement.expect("verified").refined.extents_ratio;
        assert!((found / factor - 1.0).abs() < 0.1, "{name} {found}");
    }
}

#[test]
fn few_points_are_no_evidence() {
    for count in [4, 10, 32] {
        let [source, target] =
            ["s", "t"].map(|side| format!("few_points/few_diff_{count}_{side}.ply"));
        let answer = registered(&source, &target).expect("a pose");
        let probability = answer.probability.expect("verified");
        assert!(probability < 0.5, "{count} {probability}");
        assert_ne!(answer.verdict, Verdict::Converged, "{count}");
    }
}

/// A cube with a pin of 6 mm: other turns of the cube fit nearly as well, and the true one is found or named.
#[test]
fn where_other_poses_fit_as_well_the_true_one_is_among_those_named() {
    let true_rows = [
        [-0.082_122_2, -0.796_395_4, 0.599_174_7, 12.0],
        [0.363_430_9, -0.583_736_6, -0.726_064_44, -7.0],
        [0.927_994_6, 0.158_132_57, 0.337_372_33, 5.0],
    ];
    let truth = Pose::from_rows(true_rows);
    let folder = "near_symmetric/cube_pin6";
    let answer = registered(&format!("{folder}_s.ply"), &format!("{folder}_t.ply"));
    let answer = answer.expect("a pose");
    assert_eq!(answer.verdict, Verdict::Converged);
    let open = answer.refinement.expect("it is verified").undetermined;
    let named = open.poses.into_iter().flatten();
    let is_true = |pose: Pose| {
        let error = pose.after(truth.inverse());
        let diagonal = error.rotation.to_cols_array_2d();
        let cosine = 0.5 * (diagonal[0][0] + diagonal[1][1] + diagonal[2][2] - 1.0);
        cosine > 2.0_f32.to_radians().cos()
    };
    let mut all = std::iter::once(answer.target_from_source).chain(named);
    assert!(all.any(is_true), "{answer:?}");
}
