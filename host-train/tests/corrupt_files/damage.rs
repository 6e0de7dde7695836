//! Kinds of damage to a file, and a check that a reader survives them.

use peak_alloc::PeakAlloc;
use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::{RngSeed, TestRunner};
use std::path::Path;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Damage to a file.
#[derive(Clone, Debug)]
enum Damage {
    Cut(Index),
    Byte(Index, u8),
    Word32(Index, u32),
    Word64(Index, u64),
    Insert(Index, Vec<u8>),
    Remove(Index, u8),
    /// The number written in digits at this place becomes another one.
    Digits(Index, &'static str),
}

fn damage() -> impl Strategy<Value = Vec<Damage>> {
    let at = any::<Index>;
    let bits32 = prop_oneof![
        Just(u32::MAX),
        Just(1 << 30),
        Just(0),
        Just(f32::NAN.to_bits()),
        Just(f32::INFINITY.to_bits()),
        any::<u32>()
    ];
    let bits64 = prop_oneof![
        Just(u64::MAX),
        Just(1 << 40),
        Just(1 << 63),
        Just(0),
        0..4096u64,
        any::<u64>()
    ];
    let digits = prop::sample::select(
        &[
            "1099511627776",
            "18446744073709551615",
            "-1",
            "0",
            "4294967296",
            "nan",
            "1e39",
            "7",
        ][..],
    );
    let one = prop_oneof![
        1 => at().prop_map(Damage::Cut),
        4 => (at(), any::<u8>()).prop_map(|(i, b)| Damage::Byte(i, b)),
        2 => (at(), bits32).prop_map(|(i, w)| Damage::Word32(i, w)),
        2 => (at(), bits64).prop_map(|(i, w)| Damage::Word64(i, w)),
        1 => (at(), prop::collection::vec(any::<u8>(), 1..9)).prop_map(|(i, b)| Damage::Insert(i, b)),
        1 => (at(), 1..9u8).prop_map(|(i, n)| Damage::Remove(i, n)),
        3 => (at(), digits).prop_map(|(i, d)| Damage::Digits(i, d)),
    ];
    prop::collection::vec(one, 1..4)
}

/// The bytes after the damage, all of which lies within the first `within` bytes.
fn apply(bytes: &[u8], damage: &[Damage], within: usize) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let overwrite = |bytes: &mut Vec<u8>, at: usize, word: &[u8]| {
        let end = bytes.len().min(at + word.len());
        bytes[at..end].copy_from_slice(&word[..end - at]);
    };
    for one in damage {
        if bytes.is_empty() {
            break;
        }
        let limit = within.min(bytes.len());
        match one {
            Damage::Cut(at) => bytes.truncate(at.index(limit)),
            Damage::Byte(at, value) => bytes[at.index(limit)] = *value,
            Damage::Word32(at, word) => overwrite(&mut bytes, at.index(limit), &word.to_le_bytes()),
            Damage::Word64(at, word) => overwrite(&mut bytes, at.index(limit), &word.to_le_bytes()),
            Damage::Insert(at, new) => {
                drop(bytes.splice(at.index(limit)..at.index(limit), new.iter().copied()))
            }
            Damage::Remove(at, count) => {
                let end = bytes.len().min(at.index(limit) + usize::from(*count));
                drop(bytes.drain(at.index(limit)..end));
            }
            Damage::Digits(at, digits) => {
                let starts: Vec<usize> = (0..limit)
                    .filter(|&i| {
                        bytes[i].is_ascii_digit() && (i == 0 || !bytes[i - 1].is_ascii_digit())
                    })
                    .collect();
                if !starts.is_empty() {
                    let start = starts[at.index(starts.len())];
                    let length = bytes[start..]
                        .iter()
                        .take_while(|b| b.is_ascii_digit())
                        .count();
                    drop(bytes.splice(start..start + length, digits.bytes()));
                }
            }
        }
    }
    bytes
}

/// Runs `read` on damaged copies of `whole`, stored at `path`. Memory in use must stay below `factor` times the file's
/// length plus a mebibyte.
pub(crate) fn damage_and_read(
    path: &Path,
    whole: &[u8],
    factor: usize,
    cases: u32,
    read: impl Fn(&Path) -> Result<(), String>,
) {
    std::fs::write(path, whole).expect("written");
    assert_eq!(read(path), Ok(()), "{}: undamaged", path.display());
    let config = ProptestConfig {
        cases: std::env::var("PROPTEST_CASES")
            .ok()
            .and_then(|n| n.parse().ok())
            .unwrap_or(cases),
        rng_seed: RngSeed::Fixed(7),
        failure_persistence: None,
        ..ProptestConfig::default()
    };
    // Tables at the beginning of a file are damaged as often as the rest.
    let strategy = (
        damage(),
        prop::sample::select(vec![whole.len(), whole.len().min(1024)]),
    );
    let outcome = TestRunner::new(config).run(&strategy, |(damage, within)| {
        let bytes = apply(whole, &damage, within);
        std::fs::write(path, &bytes).expect("written");
        let before = ALLOCATOR.current_usage();
        ALLOCATOR.reset_peak_usage();
        let refused = read(path).err();
        let used = ALLOCATOR.peak_usage() - before;
        prop_assert!(
            used <= factor * bytes.len() + (1 << 20),
            "{used} bytes for a file of {}",
            bytes.len()
        );
        if let Some(said) = refused {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            prop_assert!(said.contains(&*name) && !said.contains('\n'), "{said}");
        }
        Ok(())
    });
    if let Err(failure) = outcome {
        panic!("{}: {failure}", path.display());
    }
}
