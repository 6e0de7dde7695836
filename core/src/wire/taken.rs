//! Requests without a second buffer: taken out of their frames, or refused by their beginnings.

use super::cloud::POINT_BYTES;
use super::{Cloud, Message, Reason, RefineRequest, Refusal, VERSION, decode};
use crate::error::Error;

/// A [`RefineRequest`] whose clouds lie aligned in the buffer that held the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TakenRequest<'b> {
    /// See [`RefineRequest::id`].
    pub id: u64,
    /// See [`RefineRequest::max_steps`].
    pub max_steps: u8,
    /// See [`RefineRequest::initial`].
    pub initial: Option<[[f32; 4]; 3]>,
    /// See [`RefineRequest::source`].
    pub source: &'b [[f32; 3]],
    /// See [`RefineRequest::target`].
    pub target: &'b [[f32; 3]],
}

/// Reads the request that is the first `length` bytes of `space`, and moves its clouds to the front of
/// it, where they are aligned. The frame is gone afterwards.
///
/// # Errors
/// As [`decode`]; [`Error::Frame`] where it is another message.
pub fn take_request(space: &mut [u32], length: usize) -> Result<TakenRequest<'_>, Error> {
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(space);
    let frame = bytes.get(..length).ok_or(Error::Frame)?;
    let Message::RefineRequest(request) = decode(frame)? else {
        return Err(Error::Frame);
    };
    let RefineRequest {
        id,
        max_steps,
        initial,
        source,
        target,
    } = request;
    let [source, target] = [source.range_in(frame), target.range_in(frame)];
    let (sources, targets) = (source.len(), target.len());
    // Both move towards the front, the first one first: nothing is overwritten before it is read.
    for (to, from) in source.chain(target).enumerate() {
        if let (Some(byte), true) = (bytes.get(from).copied(), to <= from)
            && let Some(place) = bytes.get_mut(to)
        {
            *place = byte;
        }
    }
    let bytes: &[u8] = bytes;
    let cloud = |at: usize, length: usize| {
        let cloud = bytes.get(at..at + length).ok_or(Error::Frame)?;
        bytemuck::try_cast_slice::<u8, [f32; 3]>(cloud).map_err(|_| Error::Frame)
    };
    Ok(TakenRequest {
        id,
        max_steps,
        initial,
        source: cloud(0, sources)?,
        target: cloud(sources, targets)?,
    })
}

/// What a request begins with: kind of message, id, steps, initial pose, bytes of the source.
type Beginning = (u8, u64, u8, Option<[[f32; 4]; 3]>, u32);

/// The refusal of a frame of which only the beginning was kept: because of `busy`, or since a request of
/// `length` bytes is longer than one of `points` points in each cloud.
pub fn refuse_beginning(beginning: &[u8], length: usize, points: usize, busy: bool) -> Refusal {
    let unread = Refusal {
        id: 0,
        reason: if busy {
            Reason::Busy
        } else {
            Reason::Malformed
        },
    };
    let [VERSION, body @ ..] = beginning else {
        return unread;
    };
    let Ok(((2, id, _, _, source), rest)) = postcard::take_from_bytes::<Beginning>(body) else {
        return unread;
    };
    let source = source as usize;
    let before = beginning.len() - rest.len();
    let target = length.saturating_sub(before + source) / POINT_BYTES;
    let (cloud, found) = if source / POINT_BYTES > points {
        (Cloud::Source, source / POINT_BYTES)
    } else {
        (Cloud::Target, target)
    };
    let reason = if busy {
        Reason::Busy
    } else {
        Reason::TooManyPoints(cloud, u32::try_from(found).unwrap_or(u32::MAX))
    };
    Refusal { id, reason }
}
