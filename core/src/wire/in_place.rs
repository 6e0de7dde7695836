//! Requests without a second buffer: decoded where their frames lie, or refused by their first bytes.

use super::cloud::{CODE_BYTES, POINT_BYTES};
use super::{
    Cancel, Cloud, CloudView, Message, Mode, Reason, RefineRequest, Refusal, VERSION, decode,
};
use crate::cloud;
use crate::error::Error;
use crate::grid::Grid;

/// A [`RefineRequest`] whose clouds lie aligned, in the format in which they came, in the buffer that held the frame. It has no
/// view point, background or outward directions: a device without memory for these does not look at free space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RequestInPlace<'b> {
    /// Client and id of the request.
    pub asked: Cancel,
    /// See [`RefineRequest::budget_ms`].
    pub budget_ms: u32,
    /// See [`RefineRequest::mode`].
    pub mode: Mode,
    /// See [`RefineRequest::max_steps`].
    pub max_steps: u8,
    /// See [`RefineRequest::initial`].
    pub initial: Option<[[f32; 4]; 3]>,
    /// See [`RefineRequest::source`].
    pub source: cloud::Cloud<'b>,
    /// See [`RefineRequest::target`].
    pub target: cloud::Cloud<'b>,
}

/// Decodes the request in the first `length` bytes of `space`, and moves its clouds to the front, where they are aligned:
/// points in f32 or codes, as they came. The frame is overwritten.
///
/// # Errors
/// As [`decode`]; [`Error::Frame`] for another message.
#[inline(never)] // off the stack before the registration begins
pub fn decode_in_place(space: &mut [u32], length: usize) -> Result<RequestInPlace<'_>, Error> {
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(space);
    let frame = bytes.get(..length).ok_or(Error::Frame)?;
    let Message::RefineRequest(request) = decode(frame)? else {
        return Err(Error::Frame);
    };
    let asked = Cancel::of(&request);
    let RefineRequest {
        budget_ms,
        mode,
        max_steps,
        initial,
        source,
        target,
        ..
    } = request;
    let place = |cloud: CloudView<'_>| Place {
        grid: cloud.grid(),
        start: cloud.range_in(frame).start,
        bytes: cloud.range_in(frame).len(),
    };
    let (mut source, mut target) = (place(source), place(target));
    // The fields before each cloud in the frame take more bytes than aligning it, so both clouds move to the front.
    source.shift(bytes, 0);
    target.shift(bytes, source.bytes.next_multiple_of(size_of::<f32>()));
    let bytes: &[u8] = bytes;
    Ok(RequestInPlace {
        asked,
        budget_ms,
        mode,
        max_steps,
        initial,
        source: source.cloud(bytes)?,
        target: target.cloud(bytes)?,
    })
}

/// Where a cloud lies in the buffer.
struct Place {
    grid: Option<Grid>,
    start: usize,
    bytes: usize,
}

impl Place {
    /// Moves the cloud towards the front, to `start`.
    fn shift(&mut self, buffer: &mut [u8], start: usize) {
        for at in 0..self.bytes {
            let byte = buffer.get(self.start + at).copied().unwrap_or(0);
            if let Some(place) = buffer.get_mut(start + at) {
                *place = byte;
            }
        }
        self.start = start;
    }

    /// The cloud, if it lies aligned.
    fn cloud<'b>(&self, buffer: &'b [u8]) -> Result<cloud::Cloud<'b>, Error> {
        let bytes = buffer.get(self.start..self.start + self.bytes);
        let bytes = bytes.ok_or(Error::Frame)?;
        let cloud = match self.grid {
            None => bytemuck::try_cast_slice(bytes).map(cloud::Cloud::F32),
            Some(grid) => {
                bytemuck::try_cast_slice(bytes).map(|codes| cloud::Cloud::Grid(grid, codes))
            }
        };
        cloud.map_err(|_| Error::Frame)
    }
}

/// First fields of a request: kind of message, id, client, budget, mode, steps, trace, initial pose, whether from anywhere,
/// view point, grid and byte count of the source.
type Beginning = (
    u8,
    u64,
    u64,
    u32,
    Mode,
    u8,
    bool,
    Option<[[f32; 4]; 3]>,
    bool,
    Option<[f32; 3]>,
    Option<Grid>,
    u32,
);

/// First fields of a cloud: its grid, and how many bytes follow.
type Bytes = (Option<Grid>, u32);

/// Number of points in this many bytes.
fn points_of(grid: Option<Grid>, bytes: usize) -> usize {
    match grid {
        None => bytes / POINT_BYTES,
        Some(_) => bytes / CODE_BYTES,
    }
}

/// The refusal of a frame of which only the beginning was kept: because of `busy`, or because a request of `length` bytes is
/// longer than one with `points` points in each cloud. What follows the target is counted as a background in the target's
/// format. If the beginning ends before the target, all that follows the source is counted in the source's format.
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
    let read = postcard::take_from_bytes::<Beginning>(body);
    let Ok(((2, id, _, _, _, _, _, _, _, _, grid, source), rest)) = read else {
        return unread;
    };
    let source = source as usize;
    let left = |rest: &[u8], bytes: usize| {
        let before = beginning.len() - rest.len();
        length.saturating_sub(before).saturating_sub(bytes)
    };
    let target = rest.get(source..).unwrap_or(&[]);
    let (cloud, found) = if points_of(grid, source) > points {
        (Cloud::Source, points_of(grid, source))
    } else if let Ok(((grid, target), rest)) = postcard::take_from_bytes::<Bytes>(target) {
        let target = target as usize;
        let background = points_of(grid, left(rest, target));
        if points_of(grid, target) > points || background == 0 {
            (Cloud::Target, points_of(grid, target))
        } else {
            (Cloud::Background, background)
        }
    } else {
        (Cloud::Target, points_of(grid, left(rest, source)))
    };
    let reason = if busy {
        Reason::Busy
    } else {
        Reason::TooManyPoints(cloud, u32::try_from(found).unwrap_or(u32::MAX))
    };
    Refusal { id, reason }
}

#[cfg(test)]
mod tests;
