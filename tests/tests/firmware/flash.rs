//! The contents of its flash decide whether a board serves after its start.

use super::{
    COMPACT, POLICY, cloud, manifest_of, on_boards, on_boards_with, request, still_answers,
};
use firmware_sim::board::{BoardError, Clouds, flash_content};
use host_train::policy::WeightFile;
use host_train::random::{Purpose, Rng, stream};
use reagent_core::wire::{FLASH_HEADER_BYTES, FlashCheck, Manifest, Reason, Refusal};
use std::ops::ControlFlow;

/// The manifest of a policy, with another first action.
fn other_actions(file: &WeightFile, version: u64) -> Manifest {
    let mut manifest = manifest_of(file, version);
    let first = manifest.golden.first_mut().expect("clear actions");
    first.rotation[1] = (first.rotation[1] + 1) % 11;
    manifest
}

#[test]
fn a_policy_that_fails_its_checks_is_reported_and_does_not_serve() {
    let sound = flash_content(&manifest_of(&POLICY, 5), POLICY.bytes());
    let mut damaged = sound.clone();
    damaged[FLASH_HEADER_BYTES + 2_000_000] ^= 8;
    let mut half_erased = sound;
    half_erased[FLASH_HEADER_BYTES + 1_000_000..].fill(0xff);
    let other = flash_content(&other_actions(&POLICY, 5), POLICY.bytes());
    for (content, check, reason) in [
        (damaged, FlashCheck::Damaged, Reason::PolicyDamaged),
        (half_erased, FlashCheck::Damaged, Reason::PolicyDamaged),
        (other, FlashCheck::FailedSelfTest, Reason::FailedSelfTest),
        (vec![0xff; 4096], FlashCheck::Empty, Reason::NoPolicy),
    ] {
        on_boards_with(Clouds::Floats, Some(&content), |_, mut board| {
            let (status, report) = board.status_and_report().expect("it runs");
            assert_eq!((status.policy, report.flash), (None, check));
            let mut rng: Rng = stream(1, Purpose::Shape, 0);
            let frame = request(9, 2, &cloud(&mut rng, 10), &cloud(&mut rng, 10));
            let answer = board
                .refine(&frame, |_| ControlFlow::Continue(()))
                .expect("it answers");
            assert_eq!(answer, Err(Refusal { id: 9, reason }));
        });
    }
}

#[test]
fn after_a_policy_that_fails_its_self_test_a_sound_one_is_taken() {
    on_boards(true, |_, mut board| {
        let (_, report) = board.status_and_report().expect("it runs");
        assert_eq!(report.flash, FlashCheck::Passed);
        let unfit = board.load(&other_actions(&COMPACT, 6), COMPACT.bytes());
        assert!(
            matches!(
                unfit,
                Err(BoardError::PolicyUnfit {
                    reason: Reason::FailedSelfTest
                })
            ),
            "{unfit:?}"
        );
        board
            .load(&manifest_of(&COMPACT, 7), COMPACT.bytes())
            .expect("it is sound");
        let (status, report) = board.ask().expect("it runs");
        assert_eq!(status.policy.map(|policy| policy.version), Some(7));
        assert_eq!(report.flash, FlashCheck::Passed);
        still_answers(&COMPACT, &mut board, 60);
    });
}
