//! Cuts the power within every single word that an update writes and every block that it erases. Then the robot starts again. It must
//! run the old policy or the new one, and then take the new one.

#[path = "power_fail/record.rs"]
mod record;
#[path = "power_fail/refused.rs"]
mod refused;

use futures::executor::block_on;
use reagent_slots::ram::{RamError, RamFlash};
use reagent_slots::{Boot, Floor, Layout, Slot, SlotError, Slots};
use sha2::{Digest, Sha256};

const WORD: usize = 4;
const BLOCK: usize = 128;
const CHUNK: usize = 256;
type Flash<'m> = RamFlash<&'m mut [u8], WORD, BLOCK>;

/// A policy as it is shipped.
#[derive(Debug, PartialEq, Eq)]
struct Shipped {
    frame: Vec<u8>,
    file: Vec<u8>,
    version: Floor,
}

fn floor(version: u64) -> Floor {
    Floor { epoch: 1, version }
}

impl Shipped {
    fn new(version: u64) -> Self {
        let byte = |i: usize| {
            // The first chunk is the same in all versions.
            let seed = if i < CHUNK { 0 } else { version as usize };
            (i * 31 + seed * 101 + i / 7) as u8
        };
        Shipped {
            frame: format!("signed manifest of version {version}").into_bytes(),
            file: (0..2 * CHUNK + 77).map(byte).collect(),
            version: floor(version),
        }
    }

    fn table(&self) -> Vec<[u8; 32]> {
        let hash = |chunk: &[u8]| Sha256::digest(chunk).into();
        self.file.chunks(CHUNK).map(hash).collect()
    }
}

const RECORD: usize = 2 * BLOCK;
const CAPACITY: usize = 2 * RECORD + 2 * 3072;

fn erased() -> Vec<u8> {
    vec![0; CAPACITY]
}

fn open(flash: Flash<'_>) -> Result<Slots<Flash<'_>>, SlotError<RamError>> {
    let layout = Layout::over::<Flash<'_>>(CAPACITY as u32, CHUNK as u32);
    block_on(Slots::open(flash, layout))
}

/// Downloads, tries and confirms a policy. Returns how many chunks had to be fetched.
fn update(slots: &mut Slots<Flash<'_>>, new: &Shipped) -> Result<u32, SlotError<RamError>> {
    block_on(async {
        slots
            .begin(&new.frame, new.file.len() as u32, &new.table())
            .await?;
        let mut fetched = 0;
        let mut from = 0;
        while let Some(index) = slots.missing(from).await? {
            let mut buffer = [0; CHUNK];
            if !slots.reuse_chunk(index, &mut buffer).await? {
                let chunk = new.file.chunks(CHUNK).nth(index as usize).expect("a chunk");
                slots.write_chunk(index, chunk).await?;
                fetched += 1;
            }
            from = index + 1;
        }
        slots.try_out().await?;
        slots.confirm(new.version).await?;
        Ok(fetched)
    })
}

/// What a slot holds.
fn content(slots: &mut Slots<Flash<'_>>, slot: Slot) -> (Vec<u8>, Vec<u8>) {
    block_on(async {
        let header = slots
            .header(slot)
            .await
            .expect("power")
            .expect("a whole slot");
        let mut file = vec![0; header.length as usize];
        slots.read(slot, 0, &mut file).await.expect("power");
        let mut frame = [0; 1024];
        let frame = slots.frame(slot, &mut frame).await.expect("power");
        (frame.expect("a frame").to_vec(), file)
    })
}

fn assert_runs(slots: &mut Slots<Flash<'_>>, candidates: &[&Shipped], what: &str) {
    let boot = block_on(slots.boot()).expect(what);
    let slot = match boot {
        Boot::Confirmed(slot) | Boot::Reverted(Some(slot)) => slot,
        other => panic!("{what}: {other:?}"),
    };
    let (frame, file) = content(slots, slot);
    let running = candidates
        .iter()
        .find(|s| s.frame == frame && s.file == file);
    let running = running.unwrap_or_else(|| panic!("{what}: neither the old policy nor the new"));
    assert_eq!(slots.floor(), running.version, "{what}");
}

#[test]
fn a_cut_at_any_moment_leaves_the_old_policy_or_the_new() {
    let [first, old, new, later] = [1, 2, 3, 4].map(Shipped::new);
    let mut before = erased();
    let mut slots = open(Flash::new(&mut before)).expect("erased flash");
    assert_eq!(block_on(slots.boot()).expect("power"), Boot::Empty);
    assert_eq!(update(&mut slots, &first).expect("power"), 3);
    // Enough confirmations that the record has moved from block to block.
    assert_eq!(
        update(&mut slots, &old).expect("power"),
        2,
        "the first chunk did not change"
    );

    let mut memory = before.clone();
    let mut slots = open(Flash::new(&mut memory)).expect("a record");
    update(&mut slots, &new).expect("power");
    assert_runs(&mut slots, &[&new], "without a cut");
    let mut whole = before.clone();
    let counted = {
        let mut slots = open(Flash::new(&mut whole).cut_after(u32::MAX - 1, 0)).expect("a record");
        update(&mut slots, &new).expect("power");
        slots.destroy().operations()
    };
    assert!(counted > 100, "{counted}");

    let mut resumed = 0;
    for cut in 0..counted {
        for tear in 0..4 {
            let what = format!("cut {cut} of {counted}, tear {tear}");
            let mut memory = before.clone();
            {
                let flash = Flash::new(&mut memory).cut_after(cut, tear);
                let mut slots = open(flash).expect(&what);
                let error = update(&mut slots, &new).expect_err(&what);
                assert!(
                    matches!(error, SlotError::Flash(RamError::PowerCut)),
                    "{what}: {error:?}"
                );
            }
            let mut slots = open(Flash::new(&mut memory)).expect(&what);
            assert_runs(&mut slots, &[&old, &new], &what);
            if slots.floor() == old.version {
                let fetched = update(&mut slots, &new).unwrap_or_else(|e| panic!("{what}: {e:?}"));
                resumed += u32::from(fetched < 2);
            }
            assert_runs(&mut slots, &[&new], &what);
            update(&mut slots, &later).unwrap_or_else(|e| panic!("{what}: {e:?}"));
            assert_runs(&mut slots, &[&later], &what);
        }
    }
    assert!(
        resumed > 100,
        "chunks that came before the cut are kept: {resumed}"
    );
}

#[test]
fn a_second_cut_during_recovery_changes_nothing() {
    let [old, new] = [1, 2].map(Shipped::new);
    let mut before = erased();
    update(&mut open(Flash::new(&mut before)).expect("erased"), &old).expect("power");
    for first in (0..300).step_by(13) {
        for second in (0..300).step_by(17) {
            let what = format!("cuts {first} and {second}");
            let mut memory = before.clone();
            for (cut, tear) in [(first, 1), (second, 2)] {
                let flash = Flash::new(&mut memory).cut_after(cut, tear);
                let Ok(mut slots) = open(flash) else { continue };
                let _ = block_on(slots.boot());
                if slots.floor() < new.version {
                    let _ = update(&mut slots, &new);
                }
            }
            let mut slots = open(Flash::new(&mut memory)).expect(&what);
            assert_runs(&mut slots, &[&old, &new], &what);
        }
    }
}

#[test]
fn a_trial_that_a_restart_cuts_short_is_reverted() {
    let [old, new] = [1, 2].map(Shipped::new);
    let mut memory = erased();
    let mut slots = open(Flash::new(&mut memory)).expect("erased");
    update(&mut slots, &old).expect("power");
    let tried = block_on(async {
        slots
            .begin(&new.frame, new.file.len() as u32, &new.table())
            .await?;
        for (index, chunk) in (0..).zip(new.file.chunks(CHUNK)) {
            slots.write_chunk(index, chunk).await?;
        }
        slots.try_out().await
    });
    let tried = tried.expect("power");
    assert_eq!(content(&mut slots, tried).1, new.file);
    // The policy hung, and the watchdog restarted the robot.
    let mut slots = open(Flash::new(&mut memory)).expect("a record");
    assert_runs(&mut slots, &[&old], "after the watchdog");
    assert_eq!(
        block_on(slots.boot()).expect("power"),
        Boot::Confirmed(tried.other())
    );
}
