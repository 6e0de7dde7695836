//! Compares a policy with ICP on pairs of your own, whose true poses are known:
//! `cargo run --release -p host-train --example evaluate_pairs`, or with a policy and pairs: `-- policy.rgw pairs.h5`.
//!
//! `host-train pairs` writes such files of pairs; for any other source of clouds, fill a `PairSet` as below.

use host_train::baselines::IcpSettings;
use host_train::dataset::pairs::{PairSet, Sample};
use host_train::dataset::procedural;
use host_train::measure::eval::{EvalSettings, evaluate};
use host_train::measure::method::{Contestant, Finish, Start};
use host_train::policy::WeightFile;
use reagent_core::Pose;
use reagent_core::pipeline::Mode;
use reagent_core::pose::rotation_from_euler;
use std::path::Path;

/// Twenty shapes. The source has every second point, turned by 20 degrees about z and moved along x. Clouds are
/// normalised: the target's mean at the origin, its farthest point at 1.
fn own_pairs() -> PairSet {
    let mut pairs = PairSet::default();
    for model in procedural::models(7, 20) {
        let source_from_target = Pose {
            rotation: rotation_from_euler([0.0, 0.0, 20f32.to_radians()].into()),
            translation: [0.3, 0.0, 0.0].into(),
        };
        let seen = |points: &[[f32; 3]]| -> Vec<[f32; 3]> {
            let points = points.iter().step_by(2);
            points
                .map(|&point| source_from_target.apply(point.into()).to_array())
                .collect()
        };
        let sample = Sample {
            source: seen(&model.points),
            target: model.points[1..].iter().step_by(2).copied().collect(),
            target_from_source: source_from_target.inverse(),
        };
        pairs.push(sample, model.points, model.label);
    }
    pairs
}

fn main() -> anyhow::Result<()> {
    let files: Vec<String> = std::env::args().skip(1).collect();
    let (weights, pairs) = match &files[..] {
        [policy, pairs] => (
            WeightFile::load(Path::new(policy))?,
            PairSet::load(Path::new(pairs))?,
        ),
        _ => (WeightFile::pretrained(), own_pairs()),
    };
    let policy = weights.policy();
    let contestants = [
        ("start", Start::Identity.then(Finish::Nothing)),
        ("policy", Start::Policy(policy).then(Finish::Nothing)),
        (
            "policy, verified",
            Start::Policy(policy).then(Finish::Core(Mode::Verify)),
        ),
        (
            "ICP to planes",
            Start::Identity.then(Finish::Icp(IcpSettings::PLANE)),
        ),
    ];
    let contestants = contestants.map(|(name, method)| Contestant {
        name: name.into(),
        method,
    });
    let settings = EvalSettings {
        steps: 10,
        threads: 1,
        per_step: false,
    };
    println!("method             rotation, degrees   translation   recall   ms");
    for found in evaluate(&pairs, &contestants, &settings, &|| ())? {
        let errors = &found.row.summary;
        println!(
            "{:<18} {:>17.2} {:>13.4} {:>6.0} % {:>4.1}",
            found.name,
            errors.r_iso_deg,
            errors.t_iso,
            100.0 * errors.recall_r5_t005,
            found.row.ms_median,
        );
    }
    Ok(())
}
