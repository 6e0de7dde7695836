use super::*;
use crate::decision::Decision;
use crate::golden::clouds;
use crate::kernels::Tile;
use crate::net::Scratch;
use proptest::prelude::*;

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

/// What is seen of the source at first, and the pose after two steps.
fn seen(
    isa: Isa,
    policy: Policy<'_>,
    [source, target]: [&[[f32; 3]]; 2],
) -> ([f32; FEATURES], [i32; FEATURES], Pose) {
    let mut scratch = Scratch::new();
    let mut registrar = Registrar::with_isa(isa, policy, &mut scratch);
    let mut registration = registrar
        .start(source, target, Frame::IDENTITY, Pose::IDENTITY)
        .expect("two clouds");
    registrar.observe(&mut registration);
    let (floats, codes) = feature(registrar.scratch);
    registrar.step(&mut registration);
    registrar.step(&mut registration);
    (floats, codes, registration.target_from_source())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 8, max_shrink_iters: 4, ..ProptestConfig::default() })]

    // Portable code looks at every point as it comes; other kernels find an order, and leave points out.
    #[test]
    fn what_kernels_leave_out_changes_nothing(
        cloud in proptest::collection::vec(prop::array::uniform3(-1.0f32..1.0), 6..700),
        flat: bool,
    ) {
        let mut cloud = cloud;
        if flat {
            cloud.iter_mut().for_each(|point| point[1] = 0.25);
        }
        let (source, target) = cloud.split_at(cloud.len() / 2);
        let clouds = [source, target];
        let integers = Policy::pretrained_int8().expect("a sound policy");
        let expected = seen(Isa::PORTABLE, integers, clouds);
        for isa in Isa::all() {
            prop_assert!(seen(isa, integers, clouds) == expected, "{}", isa.name());
        }
        let floats = Policy::pretrained().expect("a sound policy");
        let mut memory = std::vec![Tile::ZERO; floats.packed_tiles().unwrap_or(0)];
        floats.pack(&mut memory);
        let (expected, ..) = seen(Isa::PORTABLE, floats, clouds);
        for isa in Isa::all() {
            for policy in [floats, floats.with_packed(&memory)] {
                let (found, ..) = seen(isa, policy, clouds);
                for (a, b) in found.iter().zip(&expected) {
                    prop_assert!((a - b).abs() <= 5e-5 * b.abs().max(1.0), "{} {a} {b}", isa.name());
                }
            }
        }
    }
}
