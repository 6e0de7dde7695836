//! Policies that are linked in.

use super::*;

#[test]
fn linked_policies_are_ready_for_use() {
    let mut memory = memory();
    let memory: *mut ReagentMemory = &raw mut *memory;
    let files: &[unsafe extern "C" fn(*mut usize) -> *const u8] = &[
        #[cfg(feature = "pretrained")]
        reagent_pretrained,
        #[cfg(feature = "pretrained-int8")]
        reagent_pretrained_int8,
        #[cfg(feature = "pretrained-compact")]
        reagent_pretrained_compact,
        #[cfg(feature = "pretrained-views")]
        reagent_pretrained_views_int8,
        #[cfg(feature = "pretrained-views-compact")]
        reagent_pretrained_views_compact,
    ];
    for linked in files {
        let mut length = 0;
        // SAFETY: pointers to live values, and a file as long as stated.
        unsafe {
            let file = linked(&raw mut length);
            assert_eq!(linked(null_mut()), file);
            assert_eq!(reagent_init(memory, file, length), ReagentStatus::Ok);
        }
    }
}
