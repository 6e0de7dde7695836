use super::*;
use crate::decision::Decision;
use crate::dims::FEATURES;
use crate::golden::clouds;
use crate::kernels::Tile;
use crate::net::Scratch;
use crate::numbers::Numbers;
use crate::quant::Feature;
use proptest::prelude::*;

/// The feature of the source observed last: in f32, and in codes.
fn feature(registrar: &mut Registrar<'_, '_>) -> ([f32; FEATURES], Feature) {
    let scratch = &mut registrar.scratch;
    match &registrar.policy.network {
        Numbers::F32(_) => (scratch.floats().feature, Feature::ZERO),
        Numbers::Int8(_) => ([0.0; FEATURES], scratch.integers().feature.clone()),
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
            registrar.observe(&mut registration).expect("started");
            let whole = feature(&mut registrar);
            registration.steps = 1;
            let points = registration.points_ahead(&policy);
            assert!((3..source.len()).contains(&points), "{points}");
            registrar.observe(&mut registration).expect("started");
            let critical = feature(&mut registrar);
            assert_eq!(critical.1, whole.1, "{}", isa.name());
            for (a, b) in critical.0.iter().zip(&whole.0) {
                assert!((a - b).abs() <= 1e-5 * b.abs().max(1.0), "{a} {b}");
            }
            registration.steps = 3;
            assert_eq!(registration.points_ahead(&policy), source.len());
        }
    }
}

/// The feature of the source at the start, and the pose after two steps.
fn seen(
    isa: Isa,
    policy: Policy<'_>,
    [source, target]: [&[[f32; 3]]; 2],
) -> ([f32; FEATURES], Feature, Pose) {
    let mut scratch = Scratch::new();
    let mut registrar = Registrar::with_isa(isa, policy, &mut scratch);
    let mut registration = registrar
        .start(source, target, Frame::IDENTITY, Pose::IDENTITY)
        .expect("two clouds");
    registrar.observe(&mut registration).expect("started");
    let (floats, codes) = feature(&mut registrar);
    registrar.step(&mut registration).expect("started");
    registrar.step(&mut registration).expect("started");
    (floats, codes, registration.target_from_source())
}

#[test]
fn a_registration_goes_on_only_with_the_policy_that_it_was_started_with() {
    let [source, target] = clouds();
    let policies = [
        Policy::pretrained(),
        Policy::pretrained_int8(),
        Policy::pretrained_compact(),
    ];
    let policies = policies.map(|policy| policy.expect("a sound policy"));
    for (i, policy) in policies.into_iter().enumerate() {
        let mut scratch = Scratch::new();
        let mut registration = Registrar::new(policy, &mut scratch)
            .start(&source, &target, Frame::IDENTITY, Pose::IDENTITY)
            .expect("two clouds");
        let before = registration.outcome();
        for (j, other) in policies.into_iter().enumerate() {
            let mut registrar = Registrar::new(other, &mut scratch);
            let step = registrar.step(&mut registration);
            if i == j {
                assert_eq!(step.map(|_| registration.steps()), Ok(1));
                registration = registrar
                    .start(&source, &target, Frame::IDENTITY, Pose::IDENTITY)
                    .expect("two clouds");
            } else {
                assert_eq!(step, Err(Error::NotStarted), "{i} {j}");
                let mut scratch = [Scratch::new()];
                let mut alone = [registration.clone()];
                let steps = Team::with_isa(Isa::best(), other, &mut scratch).step(&mut alone);
                assert_eq!(steps, [Err(Error::NotStarted)], "{i} {j}");
            }
            assert_eq!(registration.outcome(), before);
        }
    }
}

#[test]
fn a_registration_that_was_never_started_takes_no_step() {
    let policy = Policy::pretrained_int8().expect("a sound policy");
    let mut scratch = Scratch::new();
    let mut registrar = Registrar::new(policy, &mut scratch);
    let mut registration = Registration::new();
    assert_eq!(registrar.step(&mut registration), Err(Error::NotStarted));
    let advanced = registrar.advance(&mut registration, 9);
    assert_eq!(advanced, Err(Error::NotStarted));
    assert_eq!(registration.steps(), 0);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 8, max_shrink_iters: 4, ..ProptestConfig::default() })]

    // The portable kernel looks at every point in order; other kernels reorder points and skip some.
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
