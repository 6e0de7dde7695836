//! ReAgent from C. The header is `include/reagent.h`; [`reagent_init`] comes first.
//!
//! All its `unsafe` is for pointers: those from C are checked for null and alignment, and trusted to point to as much memory as
//! stated. Every function takes bounded time and allocates nothing. It asks the system at most what the processor can do.
#![doc = "\n"]
#![doc = include_str!("../README.md")]
#![cfg_attr(target_os = "none", no_std)]
#![allow(unsafe_code, reason = "a C interface is made of pointers")]

mod answer;
mod cloud;
mod depth;
mod far;
mod memory;
mod model;
mod pointer;
mod pretrained;
mod refine;
mod register;
mod status;
mod task;
mod version;
mod workspace;

pub use answer::{REAGENT_OTHERS, ReagentAnswer, ReagentVerdict};
pub use cloud::{ReagentGrid, reagent_encode, reagent_grid_of, reagent_put_in_order};
pub use depth::{ReagentCamera, reagent_points_of_depth};
pub use far::{reagent_far_pose, reagent_near_pose, reagent_take_origin_off};
pub use memory::{REAGENT_MEMORY_WORDS, ReagentMemory, reagent_init};
pub use model::{REAGENT_MODEL_WORDS, ReagentModel, reagent_prepare};
#[cfg(feature = "pretrained")]
pub use pretrained::reagent_pretrained;
#[cfg(feature = "pretrained-compact")]
pub use pretrained::reagent_pretrained_compact;
#[cfg(feature = "pretrained-int8")]
pub use pretrained::reagent_pretrained_int8;
#[cfg(feature = "pretrained-views-compact")]
pub use pretrained::reagent_pretrained_views_compact;
#[cfg(feature = "pretrained-views")]
pub use pretrained::reagent_pretrained_views_int8;
pub use refine::{reagent_refine, reagent_register};
pub use register::{
    ReagentPose, ReagentResult, ReagentStep, reagent_advance, reagent_begin, reagent_begin_on_grid,
    reagent_result, reagent_set_source, reagent_set_source_on_grid, reagent_set_target,
    reagent_set_target_on_grid, reagent_step,
};
pub use status::{ReagentStatus, reagent_status_text};
pub use task::{ReagentMode, ReagentTask, reagent_task};
pub use version::{
    REAGENT_VERSION, REAGENT_VERSION_MAJOR, REAGENT_VERSION_MINOR, REAGENT_VERSION_PATCH,
    reagent_version,
};
pub use workspace::{REAGENT_WORKSPACE_WORDS, ReagentWorkspace};

#[cfg(target_os = "none")]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {}
}

#[cfg(test)]
mod tests;
