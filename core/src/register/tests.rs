use super::*;
use crate::decision::Decision;
use crate::golden::clouds;
use crate::net::Scratch;

/// The feature of the source that was observed last: codes, or f32.
fn feature(scratch: &Scratch) -> ([f32; FEATURES], [i32; FEATURES]) {
    match &scratch.memory {
        Memory::F32(scratch) => (scratch.feature, [0; FEATURES]),
        Memory::Int8(scratch) => ([0.0; FEATURES], scratch.feature.codes()),
    }
}

#[test]
fn critical_points_have_the_feature_of_the_whole_cloud() {
    let [source, target] = clouds();
    for policy in [Policy::pretrained(), Policy::pretrained_int8()] {
        let policy = Policy {
            rescan: 3,
            decision: Decision::BothWays,
            ..policy.expect("a sound policy")
        };
        for isa in Isa::all() {
            let mut scratch = Scratch::new();
            let mut registrar = Registrar::with_isa(isa, policy, &mut scratch);
            let mut registration = registrar
                .start(&source, &target, Frame::IDENTITY, Pose::IDENTITY)
                .expect("two clouds");
            assert_eq!(registration.points_ahead(&policy), source.len());
            registrar.observe(&mut registration);
            let whole = feature(registrar.scratch);
            registration.steps = 1;
            let points = registration.points_ahead(&policy);
            assert!((3..source.len()).contains(&points), "{points}");
            registrar.observe(&mut registration);
            let critical = feature(registrar.scratch);
            assert_eq!(critical.1, whole.1, "{}", isa.name());
            for (a, b) in critical.0.iter().zip(&whole.0) {
                assert!((a - b).abs() <= 1e-5 * b.abs().max(1.0), "{a} {b}");
            }
            registration.steps = 3;
            assert_eq!(registration.points_ahead(&policy), source.len());
        }
    }
}
