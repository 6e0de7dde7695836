//! Compares every kernel with the portable one on the network's own layers, with clouds of up to 2048 points and extreme
//! values: few cases with much work each, besides the many small ones of the other tests.

use super::float::{sieve, split};
use super::*;
use crate::dims::{PANEL, padded};
use crate::layer::{Codes, QuantLayer};
use crate::shape::Shape;
use proptest::prelude::*;

/// Layer `i` of a network: `(inputs, outputs)`.
fn layer(compact: bool, i: usize) -> (usize, usize) {
    let shape = if compact { Shape::COMPACT } else { Shape::FULL };
    shape.layers()[i]
}

/// Which values are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Values {
    /// Eighths whose sums are exact in f32, in any order and with or without fused products.
    Exact,
    /// A mixture with very large, very small and subnormal values and both zeros.
    Mixed,
    /// The largest value everywhere.
    Largest,
    /// The lowest value everywhere, but the largest for activations.
    Lowest,
}

fn values() -> impl Strategy<Value = Values> {
    use Values::*;
    prop::sample::select(vec![Exact, Mixed, Largest, Lowest])
}

/// Pseudo-random numbers.
struct Draw(u64, Values);

impl Draw {
    fn bits(&mut self) -> u32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005);
        self.0 = self.0.wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as u32
    }

    fn floats(&mut self, n: usize) -> Vec<f32> {
        let float = |bits: u32, values| match (values, bits % 64) {
            (Values::Exact, _) => (bits >> 8) as i8 as f32 / 8.0,
            (Values::Largest, _) => 1e4,
            (Values::Lowest, _) => -1e4,
            (Values::Mixed, 0) => 1e4,
            (Values::Mixed, 1) => -1e4,
            (Values::Mixed, 2) => 1e-40,
            (Values::Mixed, 3) => -0.0,
            (Values::Mixed, 4) => f32::MIN_POSITIVE,
            (Values::Mixed, 5) => 0.0,
            (Values::Mixed, _) => (bits >> 8) as f32 / (1 << 22) as f32 - 1.0,
        };
        (0..n).map(|_| float(self.bits(), self.1)).collect()
    }

    fn weights(&mut self, n: usize) -> Vec<i8> {
        let weight = |bits: u32, values| match values {
            Values::Largest => 127,
            Values::Lowest => -127,
            _ => ((bits >> 8) as i8).max(-127),
        };
        (0..n).map(|_| weight(self.bits(), self.1)).collect()
    }

    fn codes(&mut self, n: usize, most: u8) -> Vec<u8> {
        let code = |bits: u32, values| match values {
            Values::Largest | Values::Lowest => most,
            _ => (bits >> 8) as u8 & most,
        };
        (0..n).map(|_| code(self.bits(), self.1)).collect()
    }
}

/// Magnitudes of values. Errors of a result may be a share of the summed magnitudes of each output's terms, or for a maximum,
/// of the largest such sum.
fn magnitudes(values: &[f32]) -> Vec<f32> {
    values.iter().map(|v| v.abs()).collect()
}

/// Whether two f32 results agree: to the bit if sums are exact, else to 1e-5 of the magnitude of their terms.
fn agree(a: &[f32], b: &[f32], magnitude: &[f32], values: Values) -> bool {
    let share = if values == Values::Exact { 0.0 } else { 1e-5 };
    // Below the smallest normal number, bits are lost.
    let close = |a: f32, b: f32, m: f32| a == b || (a - b).abs() <= share * m + f32::MIN_POSITIVE;
    let mut all = a.iter().zip(b).zip(magnitude);
    a.len() == b.len() && a.len() == magnitude.len() && all.all(|((&a, &b), &m)| close(a, b, m))
}

fn others() -> impl Iterator<Item = Isa> {
    Isa::all().filter(|&isa| isa != Isa::PORTABLE)
}

fn points() -> impl Strategy<Value = usize> {
    prop_oneof![1 => Just(0usize), 1 => Just(2048usize), 6 => 0usize..=2048]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 16, max_shrink_iters: 4, ..ProptestConfig::default() })]

    #[test]
    fn layers_of_the_embedding(points in points(), compact: bool, i in 0usize..3, values in values(), seed: u64) {
        let (inputs, outputs) = layer(compact, i);
        let mut draw = Draw(seed, values);
        let (panels, bias) = (draw.floats(inputs * outputs), draw.floats(outputs));
        let layer = Dense::new(inputs, outputs, &panels, &bias).expect("whole panels");
        let x = draw.floats(points * inputs);
        let run = |isa: Isa, layer: &Dense<'_>, x: &[f32]| {
            let mut y = vec![7.0; points * outputs];
            isa.dense_relu(layer, x, &mut y);
            let mut max = vec![f32::NEG_INFINITY; outputs];
            isa.dense_max(layer, x, &mut max);
            let mut near = vec![f32::NEG_INFINITY; outputs];
            isa.dense_max_near(layer, x, &mut near);
            assert_eq!(near, max, "{} near", isa.name());
            (y, max)
        };
        let expected = run(Isa::PORTABLE, &layer, &x);
        let [panels_m, bias_m, x_m] = [&panels, &bias, &x].map(|values| magnitudes(values));
        let layer_m = Dense::new(inputs, outputs, &panels_m, &bias_m).expect("whole panels");
        let magnitude = run(Isa::PORTABLE, &layer_m, &x_m);
        for isa in others() {
            let found = run(isa, &layer, &x);
            prop_assert!(agree(&found.0, &expected.0, &magnitude.0, values), "{} relu", isa.name());
            prop_assert!(agree(&found.1, &expected.1, &magnitude.1, values), "{} max", isa.name());
            if let Some(len) = PackedDense::tiles(isa, &layer) {
                let mut memory = vec![Tile::ZERO; len];
                PackedDense::pack(isa, &layer, &mut memory);
                let packed = PackedDense::new(isa, &layer, &memory).expect("as long as it says");
                // Activations are not negative. Sums round elsewhere, but still within 1e-5.
                let expected = run(isa, &layer, &x_m);
                let mut max = vec![f32::NEG_INFINITY; outputs];
                isa.dense_max_packed(&packed, &x_m, &mut max);
                prop_assert!(agree(&max, &expected.1, &magnitude.1, values), "{} packed", isa.name());
            }
        }
    }

    // On every kernel, whatever machine a layer was packed for.
    #[test]
    fn packed_layers_are_right_on_all_kernels(compact: bool, points in 1usize..=64, seed: u64) {
        let (inputs, outputs) = layer(compact, 2);
        let mut draw = Draw(seed, Values::Mixed);
        let (panels, bias) = (draw.floats(inputs * outputs), draw.floats(outputs));
        let layer = Dense::new(inputs, outputs, &panels, &bias).expect("whole panels");
        let x = magnitudes(&draw.floats(points * inputs));
        let [mut split, mut sieve] = [split::packed_tiles(&layer), sieve::packed_tiles(&layer)]
            .map(|tiles| vec![Tile::ZERO; tiles.unwrap_or(0)]);
        split::pack(&layer, &mut split);
        sieve::pack(&layer, &mut sieve);
        let packed = [
            SplitDense::new(&layer, &split).map(PackedDense::Split),
            SieveDense::new(&layer, &sieve).map(PackedDense::Sieve),
        ];
        prop_assert!(compact || packed.iter().all(Option::is_some));
        let [panels_m, bias_m] = [&panels, &bias].map(|values| magnitudes(values));
        let layer_m = Dense::new(inputs, outputs, &panels_m, &bias_m).expect("whole panels");
        let [mut expected, mut magnitude] = [0; 2].map(|_| vec![f32::NEG_INFINITY; outputs]);
        Isa::PORTABLE.dense_max(&layer, &x, &mut expected);
        Isa::PORTABLE.dense_max(&layer_m, &x, &mut magnitude);
        for isa in Isa::all() {
            for packed in packed.iter().flatten() {
                let mut max = vec![f32::NEG_INFINITY; outputs];
                isa.dense_max_packed(packed, &x, &mut max);
                prop_assert!(agree(&max, &expected, &magnitude, Values::Mixed), "{}", isa.name());
            }
        }
    }

    // All terms have one sign and use all their bits: each product of parts that is left out, or goes to another output, is at
    // least a hundred-thousandth of the sum.
    #[test]
    fn every_part_of_a_packed_layer_counts(compact: bool, points in 1usize..=64, negative: bool, seed: u64) {
        let (inputs, outputs) = layer(compact, 2);
        let mut draw = Draw(seed, Values::Mixed);
        let sign = if negative { -1.0 } else { 1.0 };
        // From 1 to 2, with the last bit set.
        let mut full = |n: usize, sign: f32| -> Vec<f32> {
            let float = |bits: u32| sign * f32::from_bits(1f32.to_bits() | (bits >> 8) | 1);
            (0..n).map(|_| float(draw.bits())).collect()
        };
        let (panels, bias) = (full(inputs * outputs, sign), vec![0.0; outputs]);
        let layer = Dense::new(inputs, outputs, &panels, &bias).expect("whole panels");
        let x = full(points * inputs, 1.0);
        let exact = |o: usize| {
            let panel = &panels[o / PANEL * PANEL * inputs..][..PANEL * inputs];
            let sum = |row: &[f32]| -> f64 {
                let terms = row.iter().zip(panel[o % PANEL..].iter().step_by(PANEL));
                terms.map(|(&x, &w)| f64::from(x) * f64::from(w)).sum()
            };
            x.chunks(inputs).map(sum).fold(f64::NEG_INFINITY, f64::max)
        };
        let exact: Vec<f64> = (0..outputs).map(exact).collect();
        let close = |max: &[f32]| {
            let mut all = max.iter().zip(&exact);
            all.all(|(&found, &exact)| (f64::from(found) - exact).abs() <= 3e-6 * exact.abs())
        };
        for isa in others() {
            let mut max = vec![f32::NEG_INFINITY; outputs];
            isa.dense_max(&layer, &x, &mut max);
            prop_assert!(close(&max), "{}", isa.name());
            if let Some(len) = PackedDense::tiles(isa, &layer) {
                let mut memory = vec![Tile::ZERO; len];
                PackedDense::pack(isa, &layer, &mut memory);
                let packed = PackedDense::new(isa, &layer, &memory).expect("as long as it says");
                max.fill(f32::NEG_INFINITY);
                isa.dense_max_packed(&packed, &x, &mut max);
                prop_assert!(close(&max), "{} packed", isa.name());
            }
        }
    }

    #[test]
    fn layers_of_the_heads(compact: bool, i in 3usize..6, half: bool, values in values(), seed: u64) {
        let (inputs, outputs) = layer(compact, i);
        let mut draw = Draw(seed, values);
        let width = padded(outputs);
        let (panels, bias) = (draw.floats(inputs * width), draw.floats(width));
        let layer = Dense::new(inputs, outputs, &panels, &bias).expect("whole panels");
        let from = if half { inputs / 2 } else { 0 };
        let x = draw.floats(inputs - from);
        let run = |isa: Isa, layer: &Dense<'_>, bias: &[f32], x: &[f32]| {
            let mut y = vec![7.0; width];
            isa.gemv(layer, bias, from, x, &mut y);
            y
        };
        let expected = run(Isa::PORTABLE, &layer, &bias, &x);
        let [panels_m, bias_m, x_m] = [&panels, &bias, &x].map(|values| magnitudes(values));
        let layer_m = Dense::new(inputs, outputs, &panels_m, &bias_m).expect("whole panels");
        let magnitude = run(Isa::PORTABLE, &layer_m, &bias_m, &x_m);
        for isa in others() {
            let found = run(isa, &layer, &bias, &x);
            prop_assert!(agree(&found, &expected, &magnitude, values), "{}", isa.name());
        }
    }

    #[test]
    fn integer_layers_of_the_embedding(points in points(), compact: bool, i in 1usize..3, values in values(), seed: u64) {
        let (inputs, outputs) = layer(compact, i);
        let mut draw = Draw(seed, values);
        let panels = draw.weights(inputs * outputs);
        let codes = Codes::new(inputs, outputs, &panels).expect("whole panels");
        let bias: Vec<i32> = (0..outputs).map(|_| draw.bits() as i32 % 100_000).collect();
        let requantise: Vec<u32> = (0..outputs)
            .map(|_| (1 + draw.bits() % 500) | (8 + draw.bits() % 12) << 16)
            .collect();
        let layer = QuantLayer::new(codes, &bias, &requantise).expect("as long as the outputs");
        let x = draw.codes(points * inputs, 255);
        let run = |isa: Isa| {
            let mut y = vec![9; points * outputs];
            isa.dense_codes(&layer, &x, &mut y);
            let mut max = vec![i32::MIN; outputs];
            isa.dense_codes_max(&codes, &x, &mut max);
            let mut near = vec![i32::MIN; outputs];
            isa.dense_codes_max_near(&codes, &x, &mut near);
            assert_eq!(near, max, "{} near", isa.name());
            let (mut again, mut winners) = (vec![i32::MIN; outputs], vec![0; outputs]);
            isa.dense_codes_argmax(&codes, &x, &mut again, |o, row| winners[o] = row);
            assert_eq!(again, max);
            (y, max, winners)
        };
        let expected = run(Isa::PORTABLE);
        let rows: Vec<Vec<i32>> = x.chunks(inputs).map(|row| {
            let mut sums = vec![i32::MIN; outputs];
            Isa::PORTABLE.dense_codes_max(&codes, row, &mut sums);
            sums
        }).collect();
        for (o, &winner) in expected.2.iter().enumerate() {
            let first = rows.iter().position(|sums| sums[o] == expected.1[o]);
            prop_assert_eq!(winner, first.unwrap_or(0));
        }
        for isa in others() {
            prop_assert!(run(isa) == expected, "{}", isa.name());
        }
    }

    // Rows that differ in few places, like those of points close together: most are skipped.
    #[test]
    fn what_is_left_out_raises_no_maximum(points in 0usize..600, compact: bool, start in -4000i32..4000, seed: u64) {
        let (inputs, outputs) = layer(compact, 2);
        let mut draw = Draw(seed, Values::Mixed);
        let panels = draw.weights(inputs * outputs);
        let codes = Codes::new(inputs, outputs, &panels).expect("whole panels");
        let mut row = draw.codes(inputs, 255);
        let mut x = Vec::new();
        for _ in 0..points {
            for _ in 0..4 {
                row[draw.bits() as usize % inputs] = draw.bits() as u8;
            }
            x.extend_from_slice(&row);
        }
        let weights: Vec<f32> = panels.iter().map(|&w| f32::from(w) / 100.0).collect();
        let bias = Draw(seed, Values::Exact).floats(outputs);
        let mut floats = vec![0.0; weights.len()];
        crate::layer::pack_panels(inputs, outputs, &weights, &mut floats);
        let layer = Dense::new(inputs, outputs, &floats, &bias).expect("whole panels");
        let activations: Vec<f32> = x.iter().map(|&x| f32::from(x) / 70.0).collect();
        for isa in Isa::all() {
            let (mut near, mut all) = (vec![start; outputs], vec![start; outputs]);
            isa.dense_codes_max_near(&codes, &x, &mut near);
            isa.dense_codes_max(&codes, &x, &mut all);
            prop_assert_eq!(near, all, "{}", isa.name());
            let start = start as f32 / 1000.0;
            let (mut near, mut all) = (vec![start; outputs], vec![start; outputs]);
            isa.dense_max_near(&layer, &activations, &mut near);
            isa.dense_max(&layer, &activations, &mut all);
            prop_assert_eq!(&near, &all, "{}", isa.name());
            let Some(len) = PackedDense::tiles(isa, &layer) else { continue };
            let mut memory = vec![Tile::ZERO; len];
            PackedDense::pack(isa, &layer, &mut memory);
            let packed = PackedDense::new(isa, &layer, &memory).expect("as long as it says");
            let (mut whole, mut sliced) = (vec![start; outputs], vec![start; outputs]);
            isa.dense_max_packed(&packed, &activations, &mut whole);
            for part in activations.chunks(inputs * (1 + seed as usize % 40)) {
                isa.dense_max_packed(&packed, part, &mut sliced);
            }
            prop_assert_eq!(&whole, &sliced, "{}", isa.name());
            let largest = 16.0 + 255.0 / 70.0 * 1.27 * inputs as f32;
            prop_assert!(agree(&whole, &all, &vec![largest; outputs], Values::Mixed), "{} packed", isa.name());
        }
    }

    #[test]
    fn integer_layers_of_the_heads(compact: bool, i in 3usize..6, half: bool, values in values(), seed: u64) {
        let (inputs, outputs) = layer(compact, i);
        let width = padded(outputs);
        let mut draw = Draw(seed, values);
        let panels = draw.weights(inputs * width);
        let codes = Codes::new(inputs, width, &panels).expect("whole panels");
        let from = if half { inputs / 2 } else { 0 };
        let (high, low) = (draw.codes(inputs - from, 127), draw.codes(inputs - from, 63));
        let run = |isa: Isa| {
            let mut y = vec![0; width];
            isa.gemv_codes(&codes, from, [&high, &low], &mut y);
            y
        };
        let expected = run(Isa::PORTABLE);
        for isa in others() {
            prop_assert_eq!(run(isa), expected.clone(), "{}", isa.name());
        }
    }

    #[test]
    fn points_become_the_same_codes(points in points(), values in values(), seed: u64) {
        let (inputs, outputs) = layer(false, 0);
        let mut draw = Draw(seed, values);
        let (panels, bias) = (draw.floats(inputs * outputs), draw.floats(outputs));
        let layer = Dense::new(inputs, outputs, &panels, &bias).expect("whole panels");
        let x = draw.floats(3 * points);
        let run = |isa: Isa| {
            let mut y = vec![9; points * outputs];
            isa.point_codes(&layer, x.as_chunks().0, &mut y);
            y
        };
        let expected = run(Isa::PORTABLE);
        for isa in others() {
            prop_assert!(run(isa) == expected, "{}", isa.name());
        }
    }
}
