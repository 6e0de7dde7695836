//! Requests without a second buffer: taken out of their frames, or refused by their beginnings.

use super::cloud::POINT_BYTES;
use super::{
    Cancel, Cloud, CloudView, Message, Mode, Reason, RefineRequest, Refusal, VERSION, decode,
};
use crate::error::Error;
use crate::grid::Grid;

/// A [`RefineRequest`] whose clouds lie aligned in the buffer that held the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TakenRequest<'b> {
    /// Its client and id.
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
    pub source: &'b [[f32; 3]],
    /// See [`RefineRequest::target`].
    pub target: &'b [[f32; 3]],
}

/// Reads the request that is the first `length` bytes of `space`, and puts its clouds to the front of
/// it as f32, where they are aligned. The frame is gone afterwards.
///
/// # Errors
/// As [`decode`]; [`Error::Frame`] where it is another message; [`Error::TooManyPoints`] where the space does
/// not hold both clouds as f32.
pub fn take_request(space: &mut [u32], length: usize) -> Result<TakenRequest<'_>, Error> {
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
    let capacity = bytes.len() / POINT_BYTES;
    if source.len() + target.len() > capacity {
        return Err(Error::TooManyPoints {
            points: source.len().max(target.len()),
            capacity: capacity / 2,
        });
    }
    let place = |cloud: CloudView<'_>| Place {
        grid: cloud.grid(),
        start: cloud.range_in(frame).start,
        bytes: cloud.range_in(frame).len(),
        points: cloud.len(),
    };
    let (mut source, mut target) = (place(source), place(target));
    // First to the end, the last first; then, point by point, to the front. Where both clouds fit, nothing is
    // overwritten before it is read.
    target.start = shift_back(bytes, target, bytes.len());
    source.start = shift_back(bytes, source, target.start);
    spread(bytes, source, 0);
    spread(bytes, target, source.points * POINT_BYTES);
    let bytes: &[u8] = bytes;
    let cloud = |first: usize, points: usize| {
        let (first, length) = (first * POINT_BYTES, points * POINT_BYTES);
        let cloud = bytes.get(first..first + length).ok_or(Error::Frame)?;
        bytemuck::try_cast_slice::<u8, [f32; 3]>(cloud).map_err(|_| Error::Frame)
    };
    Ok(TakenRequest {
        asked,
        budget_ms,
        mode,
        max_steps,
        initial,
        source: cloud(0, source.points)?,
        target: cloud(source.points, target.points)?,
    })
}

/// A cloud in the buffer.
#[derive(Clone, Copy)]
struct Place {
    grid: Option<Grid>,
    start: usize,
    bytes: usize,
    points: usize,
}

/// Moves a cloud's bytes back, so that they end at `end`, and returns where they start.
fn shift_back(buffer: &mut [u8], cloud: Place, end: usize) -> usize {
    let start = end.saturating_sub(cloud.bytes);
    for at in (0..cloud.bytes).rev() {
        let byte = buffer.get(cloud.start + at).copied().unwrap_or(0);
        if let Some(place) = buffer.get_mut(start + at) {
            *place = byte;
        }
    }
    start
}

/// Writes a cloud's points from `to` on as f32.
fn spread(buffer: &mut [u8], cloud: Place, to: usize) {
    let size = cloud.bytes.checked_div(cloud.points).unwrap_or(0);
    for index in 0..cloud.points {
        let mut read = [0; POINT_BYTES];
        let from = cloud.start + index * size;
        let bytes = buffer.get(from..from + size).unwrap_or(&[]);
        for (place, &byte) in read.iter_mut().zip(bytes) {
            *place = byte;
        }
        let written = match cloud.grid {
            None => read,
            Some(grid) => {
                let [a, b, c, d, e, f, ..] = read;
                let codes = [[a, b], [c, d], [e, f]].map(i16::from_le_bytes);
                bytemuck::cast(grid.decode(codes))
            }
        };
        let to = to + index * POINT_BYTES;
        let places = buffer.get_mut(to..to + POINT_BYTES).unwrap_or(&mut []);
        for (place, byte) in places.iter_mut().zip(written) {
            *place = byte;
        }
    }
}

/// What a request begins with: kind of message, id, client, budget, mode, steps, trace, initial pose, grid and
/// bytes of the source.
type Beginning = (
    u8,
    u64,
    u64,
    u32,
    Mode,
    u8,
    bool,
    Option<[[f32; 4]; 3]>,
    Option<Grid>,
    u32,
);

/// The refusal of a frame of which only the beginning was kept: because of `busy`, or since a request of
/// `length` bytes is longer than one of `points` points in each cloud. The target's points are counted as if
/// they were in the source's format.
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
    let Ok(((2, id, _, _, _, _, _, _, grid, source), rest)) = read else {
        return unread;
    };
    let point = if grid.is_some() {
        POINT_BYTES / 2
    } else {
        POINT_BYTES
    };
    let source = source as usize;
    let before = beginning.len() - rest.len();
    let target = length.saturating_sub(before + source) / point;
    let (cloud, found) = if source / point > points {
        (Cloud::Source, source / point)
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

#[cfg(test)]
mod tests;
