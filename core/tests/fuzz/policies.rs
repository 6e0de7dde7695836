//! Policy files that were changed and given a valid checksum: what is accepted registers.

use super::cases;
use bytemuck::{cast_slice, cast_slice_mut};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;
use reagent_core::dims::{LAYERS, padded};
use reagent_core::kernels::{Isa, Tile};
use reagent_core::net::Scratch;
use reagent_core::weights::{
    DECISION_AT, FORMAT_F32, HEADER, MAGIC, TABLE_ROW, checksum, file_len, offsets,
};
use reagent_core::{Frame, Policy, Pose, Registrar, Registration, Shape};
use std::sync::LazyLock;

/// Bytes of the header and the layer table.
const HEAD: usize = HEADER + LAYERS * TABLE_ROW;

/// A small network in f32 and the compact one in integers, with each decision.
static SOUND: LazyLock<Vec<Vec<u8>>> = LazyLock::new(|| {
    let small = Shape {
        embed: [64, 64, 64],
        head: [64, 64],
    };
    let floats = file_of_floats(&small);
    let files = [&floats, Policy::pretrained_compact_bytes()];
    let ways = |file: &[u8]| {
        let of_way = |way: u8| {
            let mut file = file.to_vec();
            file[DECISION_AT] = way;
            seal(&mut file);
            file
        };
        (0..3).map(of_way).collect::<Vec<_>>()
    };
    files.into_iter().flat_map(ways).collect()
});

/// An f32 file of a shape, with pseudo-random weights.
fn file_of_floats(shape: &Shape) -> Vec<u8> {
    let length = file_len(shape, FORMAT_F32);
    let mut file = vec![0; length];
    let mut put = |at: usize, bytes: &[u8]| file[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &MAGIC);
    put(4, &1u16.to_le_bytes());
    put(8, &(length as u32).to_le_bytes());
    put(12, &(LAYERS as u32).to_le_bytes());
    put(16, cast_slice(&shape.header()));
    let layers = shape.layers();
    for (i, (&(inputs, outputs), &(weights, bias))) in
        layers.iter().zip(&offsets(shape, FORMAT_F32)).enumerate()
    {
        let row = [inputs, outputs, weights, bias].map(|x| x as u32);
        put(HEADER + TABLE_ROW * i, cast_slice(&row));
        for k in 0..inputs * padded(outputs) {
            let weight = (k as f32 * 0.618_034).fract() - 0.5;
            put(weights + 4 * k, &weight.to_le_bytes());
        }
    }
    seal(&mut file);
    file
}

/// Makes the checksum valid.
fn seal(file: &mut [u8]) {
    if let Some((body, sum)) = file.split_last_chunk_mut::<4>() {
        *sum = checksum(body).to_le_bytes();
    }
}

/// What happens to a file.
#[derive(Clone, Debug)]
enum Change {
    Flip(Index, u32),
    /// A byte of the header or the layer table.
    Head(Index, u8),
    Width(usize, u16),
    Table(usize, u32),
    /// A number in the payload.
    Number(Index, f32),
    Bytes(Index, usize, u8),
    Numbers(Index, usize, f32),
    Cut(Index),
    Longer(usize),
    /// The length that the header states.
    Length(Option<u32>),
}

fn change() -> impl Strategy<Value = Change> {
    let at = any::<Index>;
    let width = prop_oneof![
        any::<u16>(),
        prop::sample::select(&[0u16, 1, 32, 64, 96, 128, 1024, 2048, 0x8000, 0xffff, 512, 3][..]),
    ];
    prop_oneof![
        (at(), 0u32..8).prop_map(|(at, bit)| Change::Flip(at, bit)),
        (at(), any::<u8>()).prop_map(|(at, byte)| Change::Head(at, byte)),
        (0usize..8, width).prop_map(|(i, width)| Change::Width(i, width)),
        (0usize..36, any::<u32>()).prop_map(|(i, word)| Change::Table(i, word)),
        (at(), super::number()).prop_map(|(at, number)| Change::Number(at, number)),
        (at(), 1usize..400, any::<u8>()).prop_map(|(at, n, byte)| Change::Bytes(at, n, byte)),
        (
            at(),
            1usize..300,
            prop_oneof![Just(3e38f32), Just(-3e38), super::number()]
        )
            .prop_map(|(at, n, number)| Change::Numbers(at, n, number)),
        at().prop_map(Change::Cut),
        (1usize..64).prop_map(Change::Longer),
        prop::option::of(any::<u32>()).prop_map(Change::Length),
    ]
}

fn apply(change: &Change, file: &mut Vec<u8>) {
    let length = file.len();
    let mut put = |at: usize, bytes: &[u8]| {
        if let Some(place) = file.get_mut(at..at + bytes.len()) {
            place.copy_from_slice(bytes);
        }
    };
    match *change {
        _ if length < HEAD + 8 => {}
        Change::Flip(at, bit) => file[at.index(length)] ^= 1 << bit,
        Change::Head(at, byte) => file[at.index(HEAD)] = byte,
        Change::Width(i, width) => put(16 + 2 * i, &width.to_le_bytes()),
        Change::Table(i, word) => put(HEADER + 4 * i, &word.to_le_bytes()),
        Change::Number(at, number) => put(4 * at.index(length / 4), &number.to_le_bytes()),
        Change::Bytes(at, n, byte) => {
            let at = at.index(length);
            file[at..(at + n).min(length)].fill(byte);
        }
        Change::Numbers(at, n, number) => {
            let at = 4 * at.index(length / 4);
            (0..n).for_each(|i| put(at + 4 * i, &number.to_le_bytes()));
        }
        Change::Cut(at) => file.truncate(at.index(length)),
        Change::Longer(n) => file.resize(length + n, 0),
        Change::Length(announced) => {
            put(8, &announced.unwrap_or(length as u32).to_le_bytes());
        }
    }
}

proptest! {
    #![proptest_config(cases(300))]

    #[test]
    fn changed_files_are_refused_or_register(
        which in any::<Index>(),
        changes in vec(change(), 1..6),
        is_sealed in prop::bool::weighted(0.95),
        offset in prop_oneof![9 => Just(0usize), 1 => 1usize..4],
        isa in any::<Index>(),
        packed in any::<bool>(),
        points in prop::sample::select(&[3usize, 4, 5, 17, 48, 49, 64, 193][..]),
        coordinates in vec([-0.5f32..0.5, -0.5f32..0.5, -0.5f32..0.5], 386),
    ) {
        let mut file = SOUND[which.index(SOUND.len())].clone();
        changes.iter().for_each(|change| apply(change, &mut file));
        if is_sealed {
            seal(&mut file);
        }
        // At any alignment; off a four-byte boundary, it is refused.
        let mut memory = vec![0u64; file.len().div_ceil(8) + 1];
        let bytes: &mut [u8] = cast_slice_mut(&mut memory);
        let bytes = &mut bytes[offset..offset + file.len()];
        bytes.copy_from_slice(&file);
        let Ok(policy) = Policy::parse(bytes) else {
            return Ok(());
        };
        prop_assert_eq!(offset, 0);
        let mut tiles = vec![Tile::ZERO; policy.packed_tiles().unwrap_or(0)];
        policy.pack(&mut tiles);
        let policy = if packed { policy.with_packed(&tiles) } else { policy };
        let all: Vec<Isa> = Isa::all().collect();
        let isa = all[isa.index(all.len())];
        let (source, target) = coordinates.split_at(193);
        let (source, target) = (&source[..points], &target[..points]);
        let frame = Frame::of(target).expect("extent");
        let mut scratch = Box::new(Scratch::new());
        let mut registrar = Registrar::with_isa(isa, policy, &mut scratch);
        let steps = if points < 20 { 10 } else { 3 };
        let found = registrar.register(source, target, frame, Pose::IDENTITY, steps);
        let pose = found.expect("good clouds").target_from_source;
        prop_assert!(pose.checked().is_ok(), "{} {:?}", isa.name(), pose);
        let mut sliced = Registration::new();
        let clouds = [source, target].map(reagent_core::Cloud::F32);
        let begun = registrar.begin(&mut sliced, clouds[0], clouds[1], frame, Pose::IDENTITY);
        begun.expect("good clouds");
        while sliced.steps() < steps {
            registrar.advance(&mut sliced, 7).expect("it was begun");
        }
        prop_assert_eq!(sliced.target_from_source(), pose);
        let _ = registrar.golden_actions();
    }
}
