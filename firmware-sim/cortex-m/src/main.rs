//! A robot's controller: refine requests over a serial line, the policy in flash, no heap.
//!
//! `main` waits for a frame, and answers each: a request with the steps taken and the pose, a question
//! with status and resources, a manifest and chunks with the new policy. The work is sliced by
//! [`Registrar::step`]; between two steps the control loop has its turn, and here the line is served.
#![no_std]
#![no_main]

mod hardware;
mod link;
mod policy;

use cortex_m_rt::entry;
use hardware::{Flash, HERTZ, Uart};
use link::Link;
use policy::{Progress, Update};
use reagent_core::net::Scratch;
use reagent_core::register::check_cloud;
use reagent_core::wire::serial::CHECK_BYTES;
use reagent_core::wire::{
    self, Board, Cloud, Manifest, Message, Mode, PolicyId, REQUEST_OVERHEAD_BYTES, Reason,
    RefineReply, Refusal, Status, StepTaken, take_request,
};
use reagent_core::{Error, Frame, Policy, Pose, Registrar, Registration, Verdict};

/// Most points of each cloud.
const POINTS: usize = 1024;
/// The largest request.
const REQUEST_WORDS: usize = (REQUEST_OVERHEAD_BYTES + CHECK_BYTES + 2 * 12 * POINTS).div_ceil(4);

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {}
}

#[entry]
fn main() -> ! {
    static mut REQUEST: [u32; REQUEST_WORDS] = [0; REQUEST_WORDS];
    static mut SCRATCH: Scratch = Scratch::new();

    // SAFETY: the only call.
    let mut flash = unsafe { Flash::take() };
    let mut link = Link::new(Uart::open());
    let mut report = Report::default();
    let loaded = policy::load(&flash);
    report.policy = loaded.map(|(id, _)| id);
    report.send(&mut link);
    let mut manifest = serve(loaded, REQUEST, SCRATCH, &mut link, &mut report);
    loop {
        let updated = update(manifest, &mut flash, REQUEST, &mut link, &mut report);
        let loaded = policy::load(&flash);
        report.policy = loaded.map(|(id, _)| id);
        match updated {
            Ok(()) => report.send_status(&mut link),
            Err(refusal) => link.refuse(refusal),
        }
        manifest = serve(loaded, REQUEST, SCRATCH, &mut link, &mut report);
    }
}

/// Answers requests until a new policy is announced.
fn serve(
    loaded: Option<(PolicyId, Policy<'_>)>,
    space: &mut [u32],
    scratch: &mut Scratch,
    link: &mut Link,
    report: &mut Report,
) -> Manifest {
    let mut registrar = loaded.map(|(_, policy)| Registrar::new(policy, scratch));
    loop {
        let length = link.receive(bytemuck::cast_slice_mut(space));
        let frame: &[u8] = bytemuck::cast_slice(space);
        match wire::decode(frame.get(..length).unwrap_or(&[])) {
            Ok(Message::RefineRequest(_)) => {
                match refine(registrar.as_mut(), space, length, link, report) {
                    Ok(reply) => {
                        report.served += 1;
                        link.send(&Message::RefineReply(reply));
                    }
                    Err(refusal) => link.refuse(refusal),
                }
            }
            Ok(Message::Manifest(manifest)) => return manifest,
            Ok(Message::Ask) => report.send(link),
            Ok(_) => link.refuse(refusal(Error::Frame)),
            Err(error) => link.refuse(refusal(error)),
        }
    }
}

/// Registers the clouds of a request, step by step.
fn refine(
    registrar: Option<&mut Registrar<'_, '_>>,
    space: &mut [u32],
    length: usize,
    link: &mut Link,
    report: &mut Report,
) -> Result<RefineReply, Refusal> {
    let started = hardware::ticks();
    let request = take_request(space, length).map_err(refusal)?;
    let id = request.id;
    let refused = |reason| Refusal { id, reason };
    let checked =
        |cloud, points| check_cloud(points).map_err(|error| refused(Reason::of(error, cloud)));
    checked(Cloud::Source, request.source)?;
    checked(Cloud::Target, request.target)?;
    if !matches!(request.mode, Mode::Fast | Mode::Best) {
        return Err(refused(Reason::NoSuchMode(request.mode)));
    }
    let (Some(registrar), Some(policy)) = (registrar, report.policy) else {
        return Err(refused(Reason::NoPolicy));
    };
    let initial = request.initial.map_or(Pose::IDENTITY, Pose::from_rows);
    let failed = |error| refused(Reason::of(error, Cloud::Target));
    let frame = Frame::of(request.target).map_err(failed)?;
    let mut registration = Registration::new();
    registrar
        .start_in(
            &mut registration,
            request.source,
            request.target,
            frame,
            initial,
        )
        .map_err(failed)?;
    report.target_ticks = hardware::ticks().wrapping_sub(started);
    let mut steps = 0;
    // After a stop on every axis each further step would see the same and stop again.
    while steps < request.max_steps && registration.verdict() != Verdict::Converged {
        let before = hardware::ticks();
        if before.wrapping_sub(started) / (HERTZ / 1000) > request.budget_ms {
            return Err(refused(Reason::Deadline));
        }
        let action = registrar.step(&mut registration).action;
        report.step_ticks = hardware::ticks().wrapping_sub(before);
        steps += 1;
        link.send(&Message::StepTaken(StepTaken {
            id,
            action,
            target_from_source: registration.target_from_source().to_rows(),
        }));
        link.glance();
    }
    let ticks = hardware::ticks().wrapping_sub(started);
    Ok(RefineReply {
        id,
        target_from_source: registration.target_from_source().to_rows(),
        steps,
        mode: Mode::Fast,
        verdict: registration.verdict(),
        probability: None,
        waited_micros: 0,
        micros: ticks / (HERTZ / 1_000_000),
        policy_version: policy.version,
    })
}

/// Takes the chunks of a policy into flash. Whatever else comes ends it.
fn update(
    manifest: Manifest,
    flash: &mut Flash,
    space: &mut [u32],
    link: &mut Link,
    report: &mut Report,
) -> Result<(), Refusal> {
    report.policy = None;
    let mut update = Update::begin(flash, manifest).ok_or(refusal(Error::Frame))?;
    loop {
        report.send_status(link);
        let length = link.receive(bytemuck::cast_slice_mut(space));
        let frame: &[u8] = bytemuck::cast_slice(space);
        let Ok(Message::Chunk(chunk)) = wire::decode(frame.get(..length).unwrap_or(&[])) else {
            return Err(refusal(Error::Frame));
        };
        match update.write(flash, chunk) {
            Progress::More => {}
            Progress::Done => return Ok(()),
            Progress::Failed => return Err(refusal(Error::Frame)),
        }
    }
}

/// The refusal of what has no id.
fn refusal(error: Error) -> Refusal {
    Refusal {
        id: 0,
        reason: Reason::of(error, Cloud::Source),
    }
}

/// How the board is doing.
#[derive(Default)]
struct Report {
    policy: Option<PolicyId>,
    served: u64,
    target_ticks: u32,
    step_ticks: u32,
}

impl Report {
    fn send_status(&self, link: &mut Link) {
        link.send(&Message::Status(Status {
            policy: self.policy,
            served: self.served,
            refused: link.refused,
            ..Status::default()
        }));
    }

    fn send(&self, link: &mut Link) {
        self.send_status(link);
        let (program_bytes, static_bytes) = hardware::program_and_static_bytes();
        let (stack_bytes, stack_capacity) = hardware::stack_bytes();
        link.send(&Message::Board(Board {
            program_bytes,
            static_bytes,
            stack_bytes,
            stack_capacity,
            points: POINTS as u32,
            target_ticks: self.target_ticks,
            step_ticks: self.step_ticks,
            hertz: HERTZ,
        }));
    }
}
