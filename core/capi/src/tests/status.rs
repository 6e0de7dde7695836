//! Statuses and the version.

use super::*;
use reagent_core::Error;

#[test]
fn every_status_has_a_sentence_of_its_own() {
    let text = |status: i32| {
        // SAFETY: a string that lives as long as the program.
        let text = unsafe { core::ffi::CStr::from_ptr(reagent_status_text(status)) };
        text.to_str().expect("English").to_owned()
    };
    let last = ReagentStatus::BadCamera as i32;
    let all: std::collections::BTreeSet<_> = (-1..=last).map(text).collect();
    assert_eq!(all.len(), last as usize + 2);
    assert_eq!(text(last + 1), text(-1));
    assert!(text(ReagentStatus::BadPose as i32).contains("pose"));
    assert!(text(ReagentStatus::TooFewPoints as i32).contains("source"));
    assert!(text(last).contains("camera"));
    assert!(text(ReagentStatus::NotPrepared as i32).contains("prepare"));
    assert!(text(ReagentStatus::TargetNotFinite as i32).contains("target"));
}

#[test]
fn the_version_is_that_of_the_package() {
    let parts = [
        REAGENT_VERSION_MAJOR,
        REAGENT_VERSION_MINOR,
        REAGENT_VERSION_PATCH,
    ];
    let text = parts.map(|part| part.to_string()).join(".");
    assert_eq!(text, env!("CARGO_PKG_VERSION"));
    assert_eq!(reagent_version(), REAGENT_VERSION);
}

#[test]
fn every_error_has_a_status() {
    assert_eq!(ReagentStatus::from(Error::BadPose), ReagentStatus::BadPose);
    let range = Error::WeightsRange { layer: 2 };
    assert_eq!(ReagentStatus::from(range), ReagentStatus::WeightsDamaged);
}
