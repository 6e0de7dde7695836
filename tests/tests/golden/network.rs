//! The network: one step, and whole registrations.

use super::{actions, close, largest_difference, poses};
use glam::Vec3;
use host_train::dataset::h5::H5File;
use host_train::dataset::pairs::PairSet;
use host_train::learn::agent::{Features, Seen, embed};
use host_train::learn::heads::Activations;
use host_train::learn::nn::{PackedEmbedding, Search};
use host_train::policy::WeightFile;
use reagent_core::kernels::Isa;
use reagent_core::net::Scratch;
use reagent_core::view::View;
use reagent_core::{Action, Frame, Pose, Registrar};
use reagent_tests::{Golden, reference_parameters, shared};

#[test]
fn forward_pass_of_the_trainer_and_of_the_robot() {
    let Some(golden) = Golden::full() else { return };
    let parameters = reference_parameters(&golden);
    let (sources, targets) = (
        golden.clouds("forward.source"),
        golden.clouds("forward.target"),
    );
    let batch = sources.len();

    // The trainer's batched pass: features, logits, values.
    let packed = PackedEmbedding::with_search(&parameters, Search::F32);
    let in_bytes = PackedEmbedding::with_search(&parameters, Search::Int8);
    let [source, target] = [&sources, &targets].map(|clouds| {
        let seen: Vec<Seen<'_>> = clouds
            .iter()
            .map(|points| Seen {
                points: points.as_slice().into(),
                view: View::IDENTITY,
            })
            .collect();
        let mut features = Features::default();
        embed(&in_bytes, 1024, &seen, &mut features);
        let searched = features.clone();
        embed(&packed, 1024, &seen, &mut features);
        assert_eq!(searched.values.len(), features.values.len());
        // With the search in 8 bits a feature is exact, or that of a point that comes close.
        let other = features.critical.iter().zip(&searched.critical);
        let other = other.filter(|(a, b)| a != b).count();
        assert!(other * 8 < features.critical.len(), "{other} other points");
        assert!(largest_difference(&searched.values, &features.values) < 5e-3);
        for (searched, exact) in searched.values.iter().zip(&features.values) {
            assert!(*searched < exact + 1e-6, "no point beats the maximum");
        }
        features
    });
    assert!(largest_difference(&source.values, &golden.f32("forward.feat_source").1) < 1e-5);
    assert!(largest_difference(&target.values, &golden.f32("forward.feat_target").1) < 1e-5);
    let rows: Vec<usize> = (0..batch).collect();
    let mut activations = Activations::default();
    activations.forward(&parameters, (&source, &rows), (&target, &rows));
    activations.estimate(&parameters);
    let values = &activations.values;
    assert!(largest_difference(values, &golden.f32("forward.value").1) < 1e-5);
    for (head, name) in ["forward.logits_t", "forward.logits_r"]
        .into_iter()
        .enumerate()
    {
        let (_, expected) = golden.f32(name);
        for b in 0..batch {
            for i in 0..33 {
                let logit = activations.heads[head].logits[i * batch + b];
                assert!((logit - expected[b * 33 + i]).abs() < 1e-5);
            }
        }
    }

    // The robot's pass, on every kernel set of this machine.
    let file = WeightFile::from_parameters(&parameters).expect("deployable");
    let argmax = actions(&golden, "forward.argmax");
    let (_, logits_t) = golden.f32("forward.logits_t");
    for isa in Isa::all() {
        let mut scratch = Box::new(Scratch::new());
        let mut registrar = Registrar::with_isa(isa, file.policy(), &mut scratch);
        for b in 0..batch {
            let mut registration = registrar
                .start(&sources[b], &targets[b], Frame::IDENTITY, Pose::IDENTITY)
                .expect("sound clouds");
            let step = registrar.step(&mut registration).expect("started");
            assert_eq!(step.action, argmax[b], "{}", isa.name());
            assert!(largest_difference(&step.logits_t, &logits_t[b * 33..][..33]) < 1e-5);
        }
    }
}

#[test]
fn whole_registrations_take_the_reference_s_steps() {
    let Some(golden) = Golden::full() else { return };
    for group in ["registration", "registration_centred"] {
        let mut parameters = reference_parameters(&golden);
        let clouds = if group == "registration" {
            "forward"
        } else {
            for (layer, name) in [(5, "policy_t"), (8, "policy_r")] {
                let (_, bias) = golden.f32(&format!("{group}.{name}.bias"));
                parameters.layer_mut(layer).1.copy_from_slice(&bias);
            }
            group
        };
        let file = WeightFile::from_parameters(&parameters).expect("deployable");
        let sources = golden.clouds(&format!("{clouds}.source"));
        let targets = golden.clouds(&format!("{clouds}.target"));
        let expected = actions(&golden, &format!("{group}.actions"));
        let global = poses(&golden, &format!("{group}.pose_global"));
        let (_, logits_r) = golden.f32(&format!("{group}.logits_r"));
        let finals = golden.clouds(&format!("{group}.final_cloud"));
        let batch = sources.len();
        for isa in Isa::all() {
            let mut scratch = Box::new(Scratch::new());
            let mut registrar = Registrar::with_isa(isa, file.policy(), &mut scratch);
            for b in 0..batch {
                let mut registration = registrar
                    .start(&sources[b], &targets[b], Frame::IDENTITY, Pose::IDENTITY)
                    .expect("sound clouds");
                for s in 0..10 {
                    let row = s * batch + b;
                    let step = registrar.step(&mut registration).expect("started");
                    assert_eq!(
                        step.action,
                        expected[row],
                        "{group} {} step {s} pair {b}",
                        isa.name()
                    );
                    let pose = registration.target_from_source();
                    assert!(
                        close(&pose, &global[row], 1e-5),
                        "{group} step {s} pair {b}"
                    );
                    assert!(largest_difference(&step.logits_r, &logits_r[row * 33..][..33]) < 2e-5);
                }
                let pose = registration.target_from_source();
                for (&p, &q) in sources[b].iter().zip(&finals[b]) {
                    assert!(
                        pose.apply(Vec3::from_array(p))
                            .abs_diff_eq(Vec3::from_array(q), 1e-5)
                    );
                }
            }
        }
    }
}

#[test]
fn the_imported_checkpoint_takes_every_recorded_action() {
    let (Some(checkpoint), Some(recorded), Some(pairs)) = (
        shared("fixtures/reference_checkpoint.zip"),
        shared("fixtures/reference_poses.h5"),
        shared("data/pairs_models.h5"),
    ) else {
        return;
    };
    let parameters = host_train::policy::import::pytorch(&checkpoint).expect("a checkpoint");
    let file = WeightFile::from_parameters(&parameters).expect("deployable");
    let pairs = PairSet::load(&pairs).expect("pairs");
    let (_, ids) = H5File::open(&recorded)
        .and_then(|file| file.read_i64("actions", "[M,10,2,3] i64"))
        .expect("recorded actions");
    let (expected, _) = ids.as_chunks::<6>();
    assert_eq!(expected.len(), 10 * pairs.source.len());
    let mut scratch = Box::new(Scratch::new());
    let mut registrar = Registrar::new(file.policy(), &mut scratch);
    for (i, (source, target)) in pairs.source.iter().zip(&pairs.target).enumerate() {
        let mut registration = registrar
            .start(source, target, Frame::IDENTITY, Pose::IDENTITY)
            .expect("sound clouds");
        for s in 0..10 {
            let Action {
                translation,
                rotation,
            } = registrar.step(&mut registration).expect("started").action;
            let taken: Vec<i64> = translation
                .iter()
                .chain(&rotation)
                .map(|&id| id.into())
                .collect();
            assert_eq!(taken, expected[10 * i + s], "pair {i} step {s}");
        }
    }
}
