use super::*;
use core::ptr::{null, null_mut};

fn memory() -> Box<ReagentMemory> {
    Box::new(ReagentMemory {
        words: [u64::MAX; REAGENT_MEMORY_WORDS],
    })
}

#[test]
fn calls_out_of_order_and_bad_pointers_are_refused() {
    let mut memory = memory();
    let memory: *mut ReagentMemory = &raw mut *memory;
    let mut result = ReagentResult::default();
    let cloud = [[0.0f32, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];
    let xyz = cloud.as_flattened().as_ptr();
    // SAFETY: pointers to live values, or such as must be refused.
    unsafe {
        assert_eq!(
            reagent_step(memory, null_mut()),
            ReagentStatus::NotInitialised
        );
        assert_eq!(
            reagent_set_target(memory, xyz, 3),
            ReagentStatus::NotInitialised
        );
        assert_eq!(
            reagent_result(null_mut(), &mut result),
            ReagentStatus::Pointer
        );
        assert_eq!(reagent_init(memory, null(), 0), ReagentStatus::Pointer);
        let short = [0u32; 4];
        let bytes = short.as_ptr().cast::<u8>();
        assert_eq!(reagent_init(memory, bytes, 16), ReagentStatus::WeightsMagic);
        assert_eq!(reagent_init(memory, bytes, 0), ReagentStatus::WeightsLength);
        assert_eq!(
            reagent_step(memory, null_mut()),
            ReagentStatus::NotInitialised
        );
    }
}

#[test]
fn every_error_has_a_status() {
    assert_eq!(ReagentStatus::from(Error::BadPose), ReagentStatus::BadPose);
    let range = Error::WeightsRange { layer: 2 };
    assert_eq!(ReagentStatus::from(range), ReagentStatus::WeightsDamaged);
}

#[cfg(all(feature = "pretrained-int8", feature = "pretrained-compact"))]
#[test]
fn linked_policies_are_ready_for_use() {
    let mut memory = memory();
    let memory: *mut ReagentMemory = &raw mut *memory;
    for linked in [reagent_pretrained_int8, reagent_pretrained_compact] {
        let mut length = 0;
        // SAFETY: pointers to live values, and a file as long as it is said to be.
        unsafe {
            let file = linked(&raw mut length);
            assert_eq!(linked(null_mut()), file);
            assert_eq!(reagent_init(memory, file, length), ReagentStatus::Ok);
        }
    }
}
