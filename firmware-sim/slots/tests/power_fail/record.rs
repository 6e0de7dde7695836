//! The two copies of the record: lost, or being restored when the power is cut.

use super::{CAPACITY, Flash, RECORD, Shipped, assert_runs, erased, open, update};
use futures::executor::block_on;
use reagent_slots::{Boot, SlotError};

/// Fills memory with noise.
fn spoil(memory: &mut [u8], mut seed: u64) {
    for byte in memory {
        seed = seed
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        *byte = (seed >> 56) as u8;
    }
}

#[test]
fn a_copy_of_the_record_that_is_lost_is_made_anew_from_the_other() {
    let [older, old] = [1, 2].map(Shipped::new);
    let mut before = erased();
    let mut slots = open(Flash::new(&mut before)).expect("erased");
    update(&mut slots, &older).expect("power");
    update(&mut slots, &old).expect("power");
    let copies = [0..RECORD, CAPACITY - RECORD..CAPACITY];
    for seed in 0..20 {
        for (lost, other) in [(0, 1), (1, 0)] {
            let what = format!("seed {seed}, copy {lost}");
            let lose = |memory: &mut [u8], copy: usize| {
                let part = &mut memory[copies[copy].clone()];
                match seed {
                    0 => part.fill(0),
                    _ => spoil(part, seed),
                }
            };
            let mut memory = before.clone();
            lose(&mut memory, lost);
            let mut slots = open(Flash::new(&mut memory)).expect(&what);
            assert!(slots.needs_repair(), "{what}");
            assert_runs(&mut slots, &[&old], &what);
            assert!(!slots.needs_repair(), "{what}");
            // The copy is restored. Now the other one may be lost.
            lose(&mut memory, other);
            let mut slots = open(Flash::new(&mut memory)).expect(&what);
            assert_runs(&mut slots, &[&old], &what);
            let back = update(&mut slots, &older);
            assert!(matches!(back, Err(SlotError::Version { .. })), "{what}");

            // With both lost, nobody knows what counted.
            lose(&mut memory, lost);
            lose(&mut memory, other);
            let opened = open(Flash::new(&mut memory));
            assert!(matches!(opened.err(), Some(SlotError::Lost)), "{what}");
        }
    }
}

#[test]
fn a_cut_while_a_copy_is_made_anew_leaves_the_other() {
    let old = Shipped::new(2);
    let mut before = erased();
    update(&mut open(Flash::new(&mut before)).expect("erased"), &old).expect("power");
    for lost in [0..RECORD, CAPACITY - RECORD..CAPACITY] {
        for cut in 0..40 {
            let what = format!("{lost:?}, cut {cut}");
            let mut memory = before.clone();
            spoil(&mut memory[lost.clone()], 7);
            if let Ok(mut slots) = open(Flash::new(&mut memory).cut_after(cut, 3)) {
                let _ = block_on(slots.boot());
            }
            let mut slots = open(Flash::new(&mut memory)).expect(&what);
            assert_runs(&mut slots, &[&old], &what);
        }
    }
}

#[test]
fn a_record_of_noise_is_never_taken_for_one() {
    for seed in 0..50 {
        let mut memory = erased();
        spoil(&mut memory[..RECORD], seed);
        spoil(&mut memory[CAPACITY - RECORD..], seed + 100);
        // The slots are blank: there never was a policy.
        let mut slots = open(Flash::new(&mut memory)).expect("a new robot");
        assert_eq!(block_on(slots.boot()).ok(), Some(Boot::Empty));
        update(&mut slots, &Shipped::new(1)).expect("power");
        let mut slots = open(Flash::new(&mut memory)).expect("a record");
        assert_runs(&mut slots, &[&Shipped::new(1)], "after noise");
    }
}
