//! Each layer of the network on the fastest kernels of this machine: `cargo bench -p reagent-core`. Layers over rows run on one
//! tile, whose activations are in the cache, as in a registration.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use reagent_core::dims::{EMBED, FEATURES, HEAD, LOGITS, QUANT_TILE, STATE, TILE, padded};
use reagent_core::kernels::{Isa, PackedDense, Tile};
use reagent_core::layer::{Codes, Dense, QuantLayer};
use std::hint::black_box;

/// Layers of the heads that one step runs: the source's half of the first, then the others.
const HEADS: [(usize, usize, usize); 3] = [
    (STATE, FEATURES, HEAD[0]),
    (HEAD[0], HEAD[0], HEAD[1]),
    (HEAD[1], HEAD[1], LOGITS),
];

fn floats(n: usize) -> Vec<f32> {
    (0..n).map(|i| (i % 97) as f32 / 97.0 - 0.5).collect()
}

fn weights(n: usize) -> Vec<i8> {
    (0..n).map(|i| (i % 251) as i8).collect()
}

fn in_f32(c: &mut Criterion) {
    let isa = Isa::best();
    let mut group = c.benchmark_group(format!("f32, {}", isa.name()));
    for (inputs, outputs) in [(3, EMBED[0]), (EMBED[0], EMBED[1]), (EMBED[1], EMBED[2])] {
        let (panels, bias) = (floats(inputs * outputs), floats(outputs));
        let layer = Dense::new(inputs, outputs, &panels, &bias).expect("whole panels");
        let x = floats(TILE * inputs);
        group.throughput(Throughput::Elements((TILE * inputs * outputs) as u64));
        if outputs == FEATURES {
            let mut max = vec![f32::NEG_INFINITY; outputs];
            group.bench_function(format!("dense_max {inputs} to {outputs}"), |b| {
                b.iter(|| isa.dense_max(black_box(&layer), &x, &mut max));
            });
            // The best case: for identical rows, bounds are exact.
            let near = x[..inputs].repeat(TILE);
            group.bench_function(
                format!("dense_max_near {inputs} to {outputs}, rows alike"),
                |b| {
                    b.iter(|| isa.dense_max_near(black_box(&layer), &near, &mut max));
                },
            );
            if let Some(len) = PackedDense::tiles(isa, &layer) {
                let mut memory = vec![Tile::ZERO; len];
                PackedDense::pack(isa, &layer, &mut memory);
                let packed = PackedDense::new(isa, &layer, &memory).expect("as long as it says");
                group.bench_function(
                    format!("dense_max_packed {inputs} to {outputs}, rows alike"),
                    |b| {
                        b.iter(|| isa.dense_max_packed(black_box(&packed), &near, &mut max));
                    },
                );
            }
        } else {
            let mut y = vec![0.0; TILE * outputs];
            group.bench_function(format!("dense_relu {inputs} to {outputs}"), |b| {
                b.iter(|| isa.dense_relu(black_box(&layer), &x, &mut y));
            });
        }
    }
    for (inputs, used, outputs) in HEADS {
        let width = padded(outputs);
        let (panels, bias) = (floats(inputs * width), floats(width));
        let layer = Dense::new(inputs, outputs, &panels, &bias).expect("whole panels");
        let (x, mut y) = (floats(used), floats(width));
        group.throughput(Throughput::Elements((used * outputs) as u64));
        group.bench_function(format!("gemv {used} to {outputs}"), |b| {
            b.iter(|| isa.gemv(black_box(&layer), &bias, 0, &x, &mut y));
        });
    }
}

fn in_integers(c: &mut Criterion) {
    let isa = Isa::best();
    let mut group = c.benchmark_group(format!("int8, {}", isa.name()));
    let points: Vec<[f32; 3]> = floats(3 * QUANT_TILE).as_chunks().0.to_vec();
    let (panels, bias) = (floats(3 * EMBED[0]), floats(EMBED[0]));
    let layer = Dense::new(3, EMBED[0], &panels, &bias).expect("whole panels");
    let mut hidden = vec![0; QUANT_TILE * EMBED[0]];
    group.throughput(Throughput::Elements((QUANT_TILE * 3 * EMBED[0]) as u64));
    group.bench_function("point_codes 3 to 64", |b| {
        b.iter(|| isa.point_codes(black_box(&layer), &points, &mut hidden));
    });

    let panels = weights(EMBED[0] * EMBED[1]);
    let bias = vec![1000; EMBED[1]];
    let requantise = vec![100 | 14 << 16; EMBED[1]];
    let codes = Codes::new(EMBED[0], EMBED[1], &panels).expect("whole panels");
    let layer = QuantLayer::new(codes, &bias, &requantise).expect("as long as the outputs");
    let mut wide = vec![0; QUANT_TILE * EMBED[1]];
    let macs = QUANT_TILE * EMBED[0] * EMBED[1];
    group.throughput(Throughput::Elements(macs as u64));
    group.bench_function("dense_codes 64 to 128", |b| {
        b.iter(|| isa.dense_codes(black_box(&layer), &hidden, &mut wide));
    });

    let panels = weights(EMBED[1] * EMBED[2]);
    let layer = Codes::new(EMBED[1], EMBED[2], &panels).expect("whole panels");
    let mut max = vec![i32::MIN; EMBED[2]];
    let macs = QUANT_TILE * EMBED[1] * EMBED[2];
    group.throughput(Throughput::Elements(macs as u64));
    group.bench_function("dense_codes_max 128 to 1024", |b| {
        b.iter(|| isa.dense_codes_max(black_box(&layer), &wide, &mut max));
    });

    for (inputs, used, outputs) in HEADS {
        let panels = weights(inputs * padded(outputs));
        let layer = Codes::new(inputs, padded(outputs), &panels).expect("whole panels");
        let (high, low, mut y) = (vec![93; used], vec![41; used], vec![0; padded(outputs)]);
        group.throughput(Throughput::Elements((used * outputs) as u64));
        group.bench_function(format!("gemv_codes {used} to {outputs}"), |b| {
            b.iter(|| {
                y.fill(0);
                isa.gemv_codes(black_box(&layer), 0, [&high, &low], &mut y);
            });
        });
    }
}

criterion_group!(layers, in_f32, in_integers);
criterion_main!(layers);
