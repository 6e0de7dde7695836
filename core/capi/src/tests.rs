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
