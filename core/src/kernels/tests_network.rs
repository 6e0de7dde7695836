//! Every kernel against the portable one on the network's own layers, with clouds of up to 2048 points
//! and extreme values: few cases with much work each, beside the many small ones of the other tests.

use super::*;
use crate::dims::padded;
use crate::quant::QuantLayer;
use crate::shape::Shape;
use proptest::prelude::*;

/// Layer `i` of a network: `(inputs, outputs)`.
fn layer(compact: bool, i: usize) -> (usize, usize) {
    let shape = if compact { Shape::COMPACT } else { Shape::FULL };
    shape.layers()[i]
}

/// What values are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Values {
    /// Eighths whose sums are exact in f32, in any order and with or without fused products.
    Exact,
    /// A mixture with very large, very small and subnormal values and both zeros.
    Mixed,
    /// The same largest value everywhere.
    Largest,
    /// The same lowest value everywhere, activations still the largest.
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

/// Whether two results of f32 agree: to the bit where sums are exact, else to 1e-6 a product.
fn agree(a: &[f32], b: &[f32], inputs: usize, values: Values) -> bool {
    let largest = if values == Values::Exact { 0.0 } else { 1e8 };
    let close = |a: f32, b: f32| a == b || (a - b).abs() <= 1e-6 * inputs as f32 * largest;
    a.len() == b.len() && a.iter().zip(b).all(|(&a, &b)| close(a, b))
}

fn others() -> impl Iterator<Item = Isa> {
    Isa::all().filter(|&isa| isa != Isa::PORTABLE)
}

fn points() -> impl Strategy<Value = usize> {
    prop_oneof![Just(0usize), Just(2048usize), 1024usize..2048]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 10, max_shrink_iters: 4, ..ProptestConfig::default() })]

    #[test]
    fn layers_of_the_embedding(points in points(), compact: bool, i in 0usize..3, values in values(), seed: u64) {
        let (inputs, outputs) = layer(compact, i);
        let mut draw = Draw(seed, values);
        let (panels, bias) = (draw.floats(inputs * outputs), draw.floats(outputs));
        let layer = Dense::new(inputs, outputs, &panels, &bias).expect("whole panels");
        let x = draw.floats(points * inputs);
        let run = |isa: Isa| {
            let mut y = vec![7.0; points * outputs];
            isa.dense_relu(&layer, &x, &mut y);
            let mut max = vec![f32::NEG_INFINITY; outputs];
            isa.dense_max(&layer, &x, &mut max);
            (y, max)
        };
        let expected = run(Isa::PORTABLE);
        for isa in others() {
            let found = run(isa);
            prop_assert!(agree(&found.0, &expected.0, inputs, values), "{} relu", isa.name());
            prop_assert!(agree(&found.1, &expected.1, inputs, values), "{} max", isa.name());
            if let Some(len) = packed_tiles(&layer).filter(|_| isa.has_fast_splits()) {
                let mut packed = vec![Tile::ZERO; len];
                pack_split(&layer, &mut packed);
                let split = SplitDense::new(&layer, &packed).expect("as long as it says");
                let mut max = vec![f32::NEG_INFINITY; outputs];
                isa.dense_max_split(&split, &x, &mut max);
                // Sums of pairs round at other places than sums of one.
                prop_assert!(agree(&max, &expected.1, 2 * inputs, values), "{} split", isa.name());
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
        let run = |isa: Isa| {
            let mut y = vec![7.0; width];
            isa.gemv(&layer, &bias, from, &x, &mut y);
            y
        };
        let expected = run(Isa::PORTABLE);
        for isa in others() {
            prop_assert!(agree(&run(isa), &expected, inputs, values), "{}", isa.name());
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
        let layer = QuantLayer { codes, bias: &bias, requantise: &requantise };
        let x = draw.codes(points * inputs, 255);
        let run = |isa: Isa| {
            let mut y = vec![9; points * outputs];
            isa.dense_codes(&layer, &x, &mut y);
            let mut max = vec![i32::MIN; outputs];
            isa.dense_codes_max(&codes, &x, &mut max);
            (y, max)
        };
        let expected = run(Isa::PORTABLE);
        for isa in others() {
            prop_assert!(run(isa) == expected, "{}", isa.name());
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
