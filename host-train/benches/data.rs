//! Loading and augmentation: `cargo bench -p host-train --bench data`. Loading is measured only if the data set lies
//! beside the checkout.

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use host_train::augment::{clean_sample, noisy_sample};
use host_train::dataset::pairs::Sample;
use host_train::dataset::{Model, Point, Split, modelnet, procedural};
use host_train::random::{Purpose, Rng, stream};
use reagent_tests::shared;

const BATCH: u64 = 32;
const POINTS: usize = 1024;

/// A training batch on one core, from clouds of 2048 points.
fn batches(c: &mut Criterion) {
    let models: Vec<Model> = procedural::models(1, BATCH as usize);
    let samples = [
        (
            "clean",
            clean_sample as fn(&mut Rng, &[Point], usize) -> Sample,
        ),
        ("noisy", noisy_sample),
    ];
    for (name, sample) in samples {
        c.bench_function(&format!("{name} batch of 32"), |b| {
            let mut position = 0;
            b.iter_batched(
                || {
                    position += BATCH;
                    position
                },
                |first| {
                    let draw = |i: u64| {
                        let rng = &mut stream(1, Purpose::Augment, first + i);
                        sample(rng, &models[i as usize].points, POINTS)
                    };
                    (0..BATCH).map(draw).collect::<Vec<_>>()
                },
                BatchSize::LargeInput,
            );
        });
    }
}

/// The whole training split, from disk.
fn load(c: &mut Criterion) {
    let Some(dir) = shared("data") else { return };
    let mut group = c.benchmark_group("load");
    group.sample_size(10);
    group.bench_function("training split", |b| {
        b.iter(|| modelnet::load(&dir, Split::Train).expect("a data set"));
    });
    group.finish();
}

criterion_group!(benches, batches, load);
criterion_main!(benches);
