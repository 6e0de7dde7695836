//! What a registration did, step by step, with all that is needed to repeat it.

use super::cloud::Bytes;
use super::{PolicyId, RefineReply};
use crate::dims::AXES;
use crate::steps::Action;
use serde::de::{self, Deserialize, Deserializer};
use serde::{Serialize, Serializer};

/// Name of the kernels that did the work, for example `avx2+fma`.
pub type KernelName = heapless::String<24>;

/// Bytes of a step inside a trace: six step ids, translation first, and a pose as twelve little-endian f32.
pub const STEP_BYTES: usize = 2 * AXES + 48;

/// A step taken by a registration.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct StepTaken {
    /// Id of the request.
    pub id: u64,
    /// The action.
    pub action: Action,
    /// The pose after it, as rows of `[R | t]`, in the clouds' units.
    pub target_from_source: [[f32; 4]; 3],
}

/// A whole registration. Repeating it gives the same bits: with a policy in 8-bit integers on every machine, with one in f32 on
/// the same kernels.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Trace<'a> {
    /// The policy in use.
    pub policy: PolicyId,
    /// The kernels in use.
    pub kernels: KernelName,
    /// The frame of the request, as received.
    pub request: &'a [u8],
    /// The steps taken.
    #[serde(borrow)]
    pub steps: StepsView<'a>,
    /// The answer.
    pub reply: RefineReply,
}

/// Steps borrowed from a frame or a buffer, in the order taken; [`STEP_BYTES`] bytes each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepsView<'a> {
    bytes: &'a [u8],
}

impl<'a> StepsView<'a> {
    /// A view of steps, as [`step_bytes`] encodes them, to put into a frame.
    pub fn of(steps: &'a [[u8; STEP_BYTES]]) -> Self {
        StepsView {
            bytes: steps.as_flattened(),
        }
    }

    /// The actions, and the pose after each as rows of `[R | t]`.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (Action, [[f32; 4]; 3])> + use<'a> {
        let (steps, _) = self.bytes.as_chunks::<STEP_BYTES>();
        steps.iter().map(|step| {
            let (ids, pose) = step.split_at(2 * AXES);
            let (&translation, rotation) = ids.split_first_chunk().unwrap_or((&[0; AXES], &[]));
            let rotation = rotation.first_chunk().copied().unwrap_or([0; AXES]);
            let mut rows = [[0.0; 4]; 3];
            let numbers = rows.as_flattened_mut().iter_mut();
            for (number, bytes) in numbers.zip(pose.as_chunks::<4>().0) {
                *number = f32::from_le_bytes(*bytes);
            }
            let action = Action {
                translation,
                rotation,
            };
            (action, rows)
        })
    }
}

/// Encodes a step for a trace.
pub fn step_bytes(action: Action, target_from_source: [[f32; 4]; 3]) -> [u8; STEP_BYTES] {
    let mut bytes = [0; STEP_BYTES];
    let ids = action.translation.into_iter().chain(action.rotation);
    let numbers = target_from_source.as_flattened().iter();
    let content = ids.chain(numbers.flat_map(|number| number.to_le_bytes()));
    for (place, byte) in bytes.iter_mut().zip(content) {
        *place = byte;
    }
    bytes
}

impl Serialize for StepsView<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Bytes(self.bytes).serialize(serializer)
    }
}

impl<'de: 'a, 'a> Deserialize<'de> for StepsView<'a> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let bytes = <&'de [u8]>::deserialize(deserializer)?;
        if bytes.len().is_multiple_of(STEP_BYTES) {
            Ok(StepsView { bytes })
        } else {
            Err(de::Error::invalid_length(
                bytes.len(),
                &"a whole number of steps",
            ))
        }
    }
}
