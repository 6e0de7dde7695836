//! Compares every kernel that this machine runs with the portable one.

use super::*;
use crate::dims::{CODES, PANEL, padded};
use crate::layer::{Codes, QuantLayer, pack_panels, padded_codes};
use proptest::prelude::*;

#[derive(Debug)]
struct Case {
    inputs: usize,
    outputs: usize,
    panels: Vec<f32>,
    bias: Vec<f32>,
    x: Vec<f32>,
}

impl Case {
    fn layer(&self) -> Dense<'_> {
        Dense::new(self.inputs, self.outputs, &self.panels, &self.bias).expect("padded lengths")
    }
}

fn value() -> impl Strategy<Value = f32> {
    prop_oneof![
        8 => -2.0f32..2.0,
        1 => Just(0.0f32),
        1 => prop_oneof![Just(1e4f32), Just(-1e4f32), Just(1e-30f32), Just(-0.0f32)],
    ]
}

fn case() -> impl Strategy<Value = Case> {
    (1usize..70, 1usize..80, 0usize..60).prop_flat_map(|(inputs, outputs, points)| {
        let values = |n| prop::collection::vec(value(), n);
        (
            values(inputs * outputs),
            values(outputs),
            values(points * inputs),
        )
            .prop_map(move |(matrix, mut bias, x)| {
                let mut panels = vec![0.0; inputs * padded(outputs)];
                pack_panels(inputs, outputs, &matrix, &mut panels);
                bias.resize(padded(outputs), 0.0);
                Case {
                    inputs,
                    outputs,
                    panels,
                    bias,
                    x,
                }
            })
    })
}

fn others() -> Vec<Isa> {
    let found: Vec<Isa> = Isa::all().skip(1).collect();
    if found.len() < 5 {
        println!("this machine runs only {found:?} beside the portable kernels");
    }
    found
}

impl Case {
    /// The case with the magnitudes of all numbers: its outputs are the sums of the magnitudes of terms.
    fn magnitudes(&self) -> Case {
        let all = |values: &[f32]| values.iter().map(|v| v.abs()).collect();
        Case {
            panels: all(&self.panels),
            bias: all(&self.bias),
            x: all(&self.x),
            ..*self
        }
    }
}

/// Whether results of two orders of summation agree, to 1e-5 of the magnitude of their terms. Below the smallest normal number,
/// bits are lost.
fn close(a: f32, b: f32, magnitude: f32) -> bool {
    a == b || (a - b).abs() <= 1e-5 * magnitude + f32::MIN_POSITIVE
}

#[test]
fn columns_beyond_the_layer_are_refused() {
    let (panels, bias) = ([1.0; 16 * 16], [0.0; 16]);
    let dense = Dense::new(16, 16, &panels, &bias).expect("whole panels");
    let codes = [1; 64 * 16];
    let codes = Codes::new(64, 16, &codes).expect("whole panels");
    for isa in Isa::all() {
        for (from, n) in [(usize::MAX - 15, 16), (1, 16), (0, 17), (usize::MAX, 0)] {
            let mut y = [7.0; 16];
            isa.gemv(&dense, &bias, from, &[1.0; 17][..n], &mut y);
            assert_eq!(y, [7.0; 16], "{} {from} {n}", isa.name());
        }
        for (from, n) in [(usize::MAX - 63, 64), (4, 64), (0, 68), (usize::MAX - 3, 4)] {
            let mut y = [7; 16];
            let plane = &[1; 68][..n];
            isa.gemv_codes(&codes, from, [plane; 2], &mut y);
            assert_eq!(y, [7; 16], "{} {from} {n}", isa.name());
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn dense_relu_equals_portable(case in case()) {
        let layer = case.layer();
        let n = case.x.len() / case.inputs * padded(case.outputs);
        let mut expected = vec![0.0; n];
        Isa::PORTABLE.dense_relu(&layer, &case.x, &mut expected);
        let (magnitudes, mut magnitude) = (case.magnitudes(), vec![0.0; n]);
        Isa::PORTABLE.dense_relu(&magnitudes.layer(), &magnitudes.x, &mut magnitude);
        for isa in others() {
            let mut y = vec![7.0; n];
            isa.dense_relu(&layer, &case.x, &mut y);
            for ((&a, &b), &m) in y.iter().zip(&expected).zip(&magnitude) {
                prop_assert!(close(a, b, m), "{}: {a} {b}", isa.name());
            }
        }
    }

    #[test]
    fn dense_max_equals_portable(case in case()) {
        let layer = case.layer();
        let n = padded(case.outputs);
        let points = case.x.len() / case.inputs;
        let mut expected = vec![f32::NEG_INFINITY; n];
        Isa::PORTABLE.dense_max(&layer, &case.x, &mut expected);
        let (magnitudes, mut magnitude) = (case.magnitudes(), vec![0.0; n]);
        Isa::PORTABLE.dense_max(&magnitudes.layer(), &magnitudes.x, &mut magnitude);
        for isa in others() {
            let mut max = vec![f32::NEG_INFINITY; n];
            isa.dense_max(&layer, &case.x, &mut max);
            let (mut kept, mut arg) = (vec![f32::NEG_INFINITY; n], vec![u32::MAX; n]);
            isa.dense_argmax(&layer, &case.x, 100, &mut kept, &mut arg);
            prop_assert_eq!(&kept, &max, "{}", isa.name());
            for o in 0..n {
                let close = close(max[o], expected[o], magnitude[o]);
                prop_assert!(close, "{}: {} {}", isa.name(), max[o], expected[o]);
                if points > 0 {
                    let row = (arg[o] - 100) as usize;
                    let x = &case.x[row * case.inputs..(row + 1) * case.inputs];
                    let mut alone = vec![f32::NEG_INFINITY; n];
                    isa.dense_max(&layer, x, &mut alone);
                    prop_assert_eq!(alone[o], max[o], "the kept row reaches the maximum");
                }
            }
        }
    }

    #[test]
    fn search_equals_portable(
        (inputs, outputs) in (1usize..200, 1usize..8).prop_map(|(i, o)| (padded_codes(i), o * PANEL)),
        points in 0usize..500,
        extreme in 0u8..4,
        seed: u64,
    ) {
        let mut state = seed;
        let mut byte = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 56) as u8
        };
        let panels: Vec<i8> = (0..inputs * outputs)
            .map(|_| match (extreme, byte()) { (1, _) => 127, (2, _) => -127, (_, b) => b as i8 })
            .collect();
        let codes: Vec<u8> = (0..points * inputs)
            .map(|_| match (extreme, byte()) { (1 | 2, _) => 255, (3, b) => b / 128, (_, b) => b })
            .collect();
        let scales: Vec<f32> = (0..points).map(|_| f32::from(byte() / 32)).collect();
        let layer = Codes::new(inputs, outputs, &panels).expect("padded lengths");
        let mut expected = (vec![0.0; GROUPS * outputs], vec![0; GROUPS * outputs]);
        Isa::PORTABLE.search(&layer, &codes, &scales, &mut expected.0, &mut expected.1);
        for isa in others() {
            let mut found = (vec![0.0; GROUPS * outputs], vec![0; GROUPS * outputs]);
            isa.search(&layer, &codes, &scales, &mut found.0, &mut found.1);
            prop_assert_eq!(&found, &expected, "{}", isa.name());
        }
    }

    #[test]
    fn codes_and_winners_equal_portable(case in case()) {
        let (width, stride) = (case.inputs, padded_codes(case.inputs));
        let points = case.x.len() / width;
        let x: Vec<f32> = case.x.iter().map(|v| v.max(0.0)).collect();
        let mut expected = (vec![9; points * stride], vec![9.0; points]);
        Isa::PORTABLE.quantise_rows(width, &x, &mut expected.0, &mut expected.1);
        for ((x, codes), scale) in x.chunks(width).zip(expected.0.chunks(stride)).zip(&expected.1) {
            for (x, &code) in x.iter().zip(codes) {
                prop_assert!((x - f32::from(code) * scale).abs() <= 0.501 * scale);
            }
        }
        let rows = &case.panels[..case.outputs * width];
        let bias = &case.bias[..case.outputs];
        let winner: Vec<u32> = (0..GROUPS * case.outputs).map(|i| (i * 7 % (points + 1)) as u32).collect();
        let mut won = (winner.clone(), vec![0.0; case.outputs]);
        Isa::PORTABLE.winners(width, rows, bias, &x, &mut won.0, &mut won.1);
        for isa in others() {
            let mut found = (vec![7; points * stride], vec![7.0; points]);
            isa.quantise_rows(width, &x, &mut found.0, &mut found.1);
            prop_assert_eq!(&found, &expected, "{}", isa.name());
            let mut found = (winner.clone(), vec![0.0; case.outputs]);
            isa.winners(width, rows, bias, &x, &mut found.0, &mut found.1);
            prop_assert_eq!(&found, &won, "{}", isa.name());
        }
    }

    #[test]
    fn gemv_equals_portable(case in case(), from in 0usize..70) {
        let layer = case.layer();
        prop_assume!(from < case.inputs && case.x.len() >= case.inputs);
        let x = &case.x[..case.inputs - from];
        let mut expected = vec![0.0; padded(case.outputs)];
        Isa::PORTABLE.gemv(&layer, &case.bias, from, x, &mut expected);
        let (magnitudes, mut magnitude) = (case.magnitudes(), vec![0.0; expected.len()]);
        let x_m = &magnitudes.x[..x.len()];
        Isa::PORTABLE.gemv(&magnitudes.layer(), &magnitudes.bias, from, x_m, &mut magnitude);
        for isa in others() {
            let mut y = vec![7.0; expected.len()];
            isa.gemv(&layer, &case.bias, from, x, &mut y);
            for ((&a, &b), &m) in y.iter().zip(&expected).zip(&magnitude) {
                prop_assert!(close(a, b, m), "{}: {a} {b}", isa.name());
            }
        }
    }
}

#[test]
fn kernels_are_found_by_name() {
    for isa in Isa::all() {
        assert_eq!(Isa::named(isa.name()), Some(isa));
    }
    assert_eq!(Isa::named("abacus"), None);
}

#[test]
fn the_first_of_equal_rows_is_kept() {
    let mut panels = vec![0.0; PANEL];
    pack_panels(1, 1, &[1.0], &mut panels);
    let bias = vec![0.0; PANEL];
    let layer = Dense::new(1, 1, &panels, &bias).expect("padded lengths");
    for isa in others().into_iter().chain([Isa::PORTABLE]) {
        let (mut max, mut arg) = (vec![f32::NEG_INFINITY; PANEL], vec![0; PANEL]);
        isa.dense_argmax(&layer, &[1.0, 3.0, 3.0, 2.0], 0, &mut max, &mut arg);
        assert_eq!((max[0], arg[0]), (3.0, 1), "{}", isa.name());
    }
}

/// Pseudo-random bytes for integer layers, extreme ones on request.
struct Bytes(u64, u8);

impl Bytes {
    fn next(&mut self) -> u8 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (self.0 >> 56) as u8
    }

    fn weights(&mut self, n: usize) -> Vec<i8> {
        let extreme = self.1;
        let weight = |byte: u8| match extreme {
            1 => 127,
            2 => -127,
            _ => (byte as i8).max(-127),
        };
        (0..n).map(|_| weight(self.next())).collect()
    }

    fn codes(&mut self, n: usize, most: u8) -> Vec<u8> {
        let extreme = self.1;
        let code = |byte: u8| if extreme > 0 { most } else { byte & most };
        (0..n).map(|_| code(self.next())).collect()
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn integer_layers_equal_portable(
        inputs in (1usize..5).prop_map(|n| n * CODES),
        outputs in (1usize..12).prop_map(|n| n * PANEL),
        points in 0usize..300,
        extreme in 0u8..4,
        seed: u64,
    ) {
        let mut bytes = Bytes(seed, extreme);
        let panels = bytes.weights(inputs * outputs);
        let codes = Codes::new(inputs, outputs, &panels).expect("padded lengths");
        let x = bytes.codes(points * inputs, 255);
        let bias: Vec<i32> = (0..outputs).map(|_| i32::from(bytes.next()) * 3000 - 300_000).collect();
        let requantise: Vec<u32> =
            (0..outputs).map(|_| 1 + u32::from(bytes.next()) % 20 + ((12 + u32::from(bytes.next()) % 5) << 16)).collect();
        let layer = QuantLayer::new(codes, &bias, &requantise).expect("as long as the outputs");
        let wide = [bytes.codes(inputs - 4, 127), bytes.codes(inputs - 4, 63)];
        let planes = [&wide[0][..], &wide[1][..]];

        let run = |isa: Isa| {
            let mut y = vec![9u8; points * outputs];
            isa.dense_codes(&layer, &x, &mut y);
            let mut max = vec![i32::MIN; outputs];
            isa.dense_codes_max(&codes, &x, &mut max);
            let mut sums = bias.clone();
            isa.gemv_codes(&codes, 4, planes, &mut sums);
            (y, max, sums)
        };
        let expected = run(Isa::PORTABLE);
        for (o, &sum) in expected.2.iter().enumerate() {
            let weights = (4..inputs).map(|k| panels[o / PANEL * PANEL * inputs + k / 4 * 4 * PANEL + o % PANEL * 4 + k % 4]);
            let exact: i64 = weights.zip(wide[0].iter().zip(&wide[1]))
                .map(|(w, (&h, &l))| i64::from(w) * (64 * i64::from(h) + i64::from(l))).sum();
            prop_assert_eq!(i64::from(sum), exact + i64::from(bias[o]));
        }
        for isa in others() {
            prop_assert_eq!(run(isa), expected.clone(), "{}", isa.name());
        }
    }

    #[test]
    fn point_codes_equal_portable(case in case()) {
        let points = case.x.as_chunks::<3>().0;
        let outputs = padded(case.outputs);
        let panels: Vec<f32> = case.panels.iter().chain(&case.bias).cycle().take(3 * outputs).map(|w| w * 60.0).collect();
        let layer = Dense::new(3, outputs, &panels, &case.bias).expect("padded lengths");
        let mut expected = vec![0; points.len() * outputs];
        Isa::PORTABLE.point_codes(&layer, points, &mut expected);
        for isa in others() {
            let mut codes = vec![1; expected.len()];
            isa.point_codes(&layer, points, &mut codes);
            prop_assert_eq!(&codes, &expected, "{}", isa.name());
        }
    }
}
