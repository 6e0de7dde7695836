//! A robot's controller: refine requests over a serial line, the policy in flash, no heap.
//!
//! `main` checks the policy and then serves frames:
//!
//! | frame | answer |
//! |---|---|
//! | a request | the steps taken, and the pose |
//! | a question | status and resources |
//! | a manifest, then chunks | status; the chunks go into flash as the new policy |
//!
//! [`Registrar::advance`] slices the work. Between two slices the control loop has its turn, the line is served, and the watchdog
//! is fed.
#![no_std]
#![no_main]

mod hardware;
mod link;
mod policy;
mod refine;
mod report;

use cortex_m_rt::entry;
use hardware::{Flash, Uart};
use link::Link;
use policy::{Progress, Update};
use reagent_core::net::Scratch;
use reagent_core::wire::serial::CHECK_BYTES;
use reagent_core::wire::{self, FlashCheck, Manifest, Message, REQUEST_OVERHEAD_BYTES, Refusal};
use reagent_core::{Error, Registrar};
use refine::{refine, refusal};
use report::Report;

/// Most points of each cloud.
const POINTS: usize = 1024;
/// Bytes of a point: codes on a grid, or coordinates. Of the other kind, half or twice as many points fit.
const POINT_BYTES: usize = if cfg!(feature = "grid") { 6 } else { 12 };
/// The largest request.
const REQUEST_WORDS: usize =
    (REQUEST_OVERHEAD_BYTES + CHECK_BYTES + 2 * POINT_BYTES * POINTS).div_ceil(4);

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
    hardware::start_watchdog();
    let mut manifest = serve(&flash, REQUEST, SCRATCH, &mut link, &mut report, None);
    loop {
        let updated = update(manifest, &mut flash, REQUEST, &mut link, &mut report);
        let after = Some(updated);
        manifest = serve(&flash, REQUEST, SCRATCH, &mut link, &mut report, after);
    }
}

/// Checks the policy and reports the result, also that of an update before it. Then answers requests until a new policy is
/// announced.
fn serve(
    flash: &Flash,
    space: &mut [u32],
    scratch: &mut Scratch,
    link: &mut Link,
    report: &mut Report,
    updated: Option<Result<(), Refusal>>,
) -> Manifest {
    let mut registrar = check(flash, space, scratch, report);
    match updated {
        None => report.send(link),
        Some(Err(refusal)) => link.refuse(refusal),
        Some(Ok(())) if registrar.is_some() => report.send_status(link),
        Some(Ok(())) => link.refuse(Refusal {
            id: 0,
            reason: report.why_not(),
        }),
    }
    loop {
        let length = link.receive(bytemuck::cast_slice_mut(space));
        let frame: &[u8] = bytemuck::cast_slice(space);
        match wire::decode(frame.get(..length).unwrap_or(&[])) {
            Ok(Message::RefineRequest(_)) => {
                match refine(registrar.as_mut(), space, length, link, report) {
                    Ok(reply) => link.send(&Message::RefineReply(reply)),
                    Err(refusal) => link.refuse(refusal),
                }
            }
            Ok(Message::Manifest(manifest)) => return manifest,
            Ok(Message::Ask) => report.send(link),
            // The request has been answered already.
            Ok(Message::Cancel(_)) => {}
            Ok(_) => link.refuse(refusal(Error::Frame)),
            Err(error) => link.refuse(refusal(error)),
        }
    }
}

/// A registrar with the policy in flash, if that policy is undamaged and does what its manifest says.
fn check<'f, 's>(
    flash: &'f Flash,
    space: &mut [u32],
    scratch: &'s mut Scratch,
    report: &mut Report,
) -> Option<Registrar<'f, 's>> {
    let loaded = policy::load(flash);
    report.policy = None;
    let loaded = match loaded {
        Ok(loaded) => loaded,
        Err(check) => {
            report.flash = check;
            return None;
        }
    };
    let mut registrar = Registrar::new(loaded.policy, scratch);
    report.flash = loaded.test(&mut registrar, space, report);
    if report.flash != FlashCheck::Passed {
        return None;
    }
    report.policy = Some(loaded.id);
    Some(registrar)
}

/// Writes the chunks of a policy into flash. Any other frame ends the update.
#[inline(never)]
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
