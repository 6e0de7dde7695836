//! Object pose refinement on data sets in BOP layout: the paper's LINEMOD experiment.
//!
//! The source is what the camera sees of an object, the target its model; registering the two refines the pose.
//! Training and validation samples are annotated objects, cut out roughly and moved by a random error. Test samples
//! start from another method's estimate. A generator writes scenes in the same layout.
//! samples start from another method's estimate. A generator writes scenes in the same layout.

pub mod evaluate;
pub mod normalise;
pub mod recall;
pub mod sample;
pub mod segment;
pub mod synth;
pub mod table;
