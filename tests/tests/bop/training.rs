//! Training samples, and the images held back from training.

use super::*;
use host_train::bop::sample::{BopSampling, BopTraining};
use host_train::bop::synth::ESTIMATES_FILE;
use host_train::dataset::bop::{TARGETS_FILE, read_results, write_results};
use host_train::dataset::pairs::PairSet;
use host_train::random::{Purpose, stream};

#[test]
fn training_samples_are_the_papers() {
    let sampling = BopSampling::default();
    let set = BopTraining::open(EXACT.path(), 1, sampling).expect("opened");
    let draw = |i: usize, k: u64| {
        set.sample(i, &mut stream(1, Purpose::Augment, k))
            .expect("a sample")
    };
    assert_eq!(draw(0, 0), draw(0, 0));
    assert_ne!(draw(0, 0).source, draw(0, 1).source);
    for i in 0..set.instances().len() {
        let sample = draw(i, i as u64);
        assert_eq!((sample.source.len(), sample.target.len()), (1024, 1024));
        let target: Vec<Vec3> = sample.target.iter().copied().map(Vec3::from).collect();
        let mean = target.iter().sum::<Vec3>() / 1024.0;
        let farthest = target.iter().map(|p| p.length()).fold(0.0, f32::max);
        assert!(mean.length() < 1e-4 && (farthest - 1.0).abs() < 1e-4);
        // At least half of the source lies on the object, so the true pose brings it onto the target.
        let on_model = sample
            .source
            .iter()
            .filter(|p| {
                let p = sample.target_from_source.apply(Vec3::from_array(**p));
                target.iter().any(|q| q.distance(p) < 0.12)
            })
            .count();
        assert!(on_model >= 500, "{on_model} of sample {i}");
    }
}

#[test]
fn validation_images_are_held_back() {
    let open = || BopTraining::open(EXACT.path(), 1, BopSampling::default()).expect("opened");
    let all = open().instances().len();
    let (training, validation) = open().split(5, 0.5);
    let image = |set: &BopTraining| set.instances().iter().map(|i| i.image).collect::<Vec<_>>();
    assert_eq!(image(&training).len() + image(&validation).len(), all);
    assert!(
        image(&training)
            .iter()
            .all(|i| !image(&validation).contains(i))
    );
    let draw = || {
        let mut set = PairSet::default();
        validation.draw(3, 5, &mut set).expect("pairs");
        set
    };
    assert_eq!((draw().source.len(), draw().label.len()), (3, 3));
    assert_eq!(draw(), draw());
}

#[test]
fn on_listed_targets_the_others_are_trained_on() {
    let dir = generated(0.0, 7);
    let root = dir.path();
    let all = BopTraining::open(root, 1, BopSampling::default()).expect("opened");
    assert_eq!(
        all.instances().len(),
        4 * 2,
        "one scene of the folder train"
    );
    // Image 1 of scene 0 is left for training.
    let line = |scene: u32, image: u32, object: u32| {
        format!("{{\"scene_id\":{scene},\"im_id\":{image},\"obj_id\":{object},\"inst_count\":1}}")
    };
    let mut lines = Vec::new();
    for (scene, image) in [(0, 0), (1, 0), (1, 1)] {
        lines.extend((1..=8).map(|object| line(scene, image, object)));
    }
    std::fs::write(root.join(TARGETS_FILE), format!("[{}]", lines.join(","))).expect("written");
    let left = BopTraining::open(root, 1, BopSampling::default()).expect("opened");
    assert!(
        left.instances()
            .iter()
            .all(|i| (i.scene, i.image) == (0, 1))
    );

    // A listed object without an estimate counts as a failure; objects in images that are not listed do not count.
    let estimates = root.join(ESTIMATES_FILE);
    let mut kept = read_results(&estimates).expect("estimates");
    kept.retain(|e| (e.scene, e.image) == (0, 0));
    write_results(&estimates, &kept).expect("written");
    let found = Refinements::open(root, &estimates, None, 3).expect("opened");
    let rows = rows(&found, &vec![Pose::IDENTITY; found.set.source.len()]);
    assert_eq!(rows.iter().map(|r| r.pairs).sum::<usize>(), 12);
    assert_eq!(found.unrefined().1, 12 - kept.len());
}
