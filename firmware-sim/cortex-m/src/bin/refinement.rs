//! Refinement and nothing else: requests with a start over the serial line, in the modes `refine` and `verify`. No policy. The
//! image exists to measure what refinement needs of a microcontroller.
#![no_std]
#![no_main]

// This image needs no watchdog and no flash, and does not serve the line while it works.
#[allow(dead_code)]
#[path = "../hardware.rs"]
mod hardware;
#[allow(dead_code)]
#[path = "../link.rs"]
mod link;

use cortex_m_rt::entry;
use hardware::{HERTZ, Uart};
use link::Link;
use reagent_core::pipeline::{self, Answer, Task};
use reagent_core::polish::Workspace;
use reagent_core::start::Start;
use reagent_core::wire::serial::CHECK_BYTES;
use reagent_core::wire::{
    self, Board, Fit, FlashCheck, Message, Mode, REQUEST_OVERHEAD_BYTES, Reason, RefineReply,
    Refusal, Status, decode_in_place,
};
use reagent_core::{Cloud, Error, Pose};

/// Most points of each cloud.
const POINTS: usize = 1024;
/// The largest request.
const REQUEST_WORDS: usize =
    (REQUEST_OVERHEAD_BYTES + CHECK_BYTES + 2 * size_of::<[f32; 3]>() * POINTS).div_ceil(4);

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {}
}

#[entry]
fn main() -> ! {
    static mut REQUEST: [u32; REQUEST_WORDS] = [0; REQUEST_WORDS];
    static mut WORKSPACE: Workspace = Workspace::new();

    let mut link = Link::new(Uart::open());
    let mut ticks = 0;
    report(&mut link, ticks);
    loop {
        let length = link.receive(bytemuck::cast_slice_mut(REQUEST));
        let frame: &[u8] = bytemuck::cast_slice(REQUEST);
        match wire::decode(frame.get(..length).unwrap_or(&[])) {
            Ok(Message::RefineRequest(_)) => match refine(REQUEST, length, WORKSPACE, &mut ticks) {
                Ok(reply) => link.send(&Message::RefineReply(reply)),
                Err(refusal) => link.refuse(refusal),
            },
            Ok(Message::Ask) => report(&mut link, ticks),
            Ok(_) => link.refuse(refusal(0, Error::Frame)),
            Err(error) => link.refuse(refusal(0, error)),
        }
    }
}

/// Refines the start of a request. Writes the time that it took into `ticks`.
#[inline(never)]
fn refine(
    space: &mut [u32],
    length: usize,
    workspace: &mut Workspace,
    ticks: &mut u32,
) -> Result<RefineReply, Refusal> {
    let request = decode_in_place(space, length).map_err(|error| refusal(0, error))?;
    let (id, mode) = (request.asked.id, request.mode);
    let refused = |error| refusal(id, error);
    let no_such_mode = Refusal {
        id,
        reason: Reason::NoSuchMode(mode),
    };
    let (Mode::Refine | Mode::Verify) = mode else {
        return Err(no_such_mode);
    };
    let (Cloud::F32(source), Cloud::F32(target)) = (request.source, request.target) else {
        return Err(refused(Error::Frame));
    };
    let start = request.initial.map_or(Pose::IDENTITY, Pose::from_rows);
    let task = Task {
        mode,
        ..Task::new(Start::at(start))
    };
    let before = hardware::ticks();
    let found = pipeline::refine(workspace, [source, target], start, &task, || Ok(()));
    *ticks = hardware::ticks().wrapping_sub(before);
    let found = found.map_err(refused)?.ok_or(no_such_mode)?;
    let answer = Answer::refined(found, None).map_err(refused)?;
    Ok(RefineReply {
        id,
        target_from_source: answer.target_from_source.to_rows(),
        steps: 0,
        mode,
        verdict: answer.verdict,
        probability: answer.probability,
        fit: Some(Fit::of(&found)),
        waited_micros: 0,
        micros: *ticks / (HERTZ / 1_000_000),
        policy_version: 0,
    })
}

fn refusal(id: u64, error: Error) -> Refusal {
    let reason = Reason::of(error, wire::Cloud::Source);
    Refusal { id, reason }
}

/// Reports what the board has and uses, and how long the last request took.
fn report(link: &mut Link, steps_ticks: u32) {
    link.send(&Message::Status(Status::default()));
    let (program_bytes, static_bytes) = hardware::program_and_static_bytes();
    let (stack_bytes, stack_capacity) = hardware::stack_bytes();
    link.send(&Message::Board(Board {
        program_bytes,
        static_bytes,
        stack_bytes,
        stack_capacity,
        points: POINTS as u32,
        target_ticks: 0,
        steps_ticks,
        slice_ticks: 0,
        hertz: HERTZ,
        flash: FlashCheck::Empty,
    }));
}
