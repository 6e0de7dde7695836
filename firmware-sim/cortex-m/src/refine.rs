//! A request, from its frame to its answer.

use crate::hardware::{self, HERTZ, feed_watchdog};
use crate::link::Link;
use crate::report::Report;
use reagent_core::wire::{
    Cloud, Message, Mode, Reason, RefineReply, Refusal, StepTaken, decode_in_place,
};
use reagent_core::{Error, Frame, Pose, Registrar, Registration};

/// Ticks since its start. It must be read more often than the counter wraps.
struct Clock {
    last: u32,
    ticks: u64,
}

impl Clock {
    fn start() -> Clock {
        Clock {
            last: hardware::ticks(),
            ticks: 0,
        }
    }

    fn ticks(&mut self) -> u64 {
        let now = hardware::ticks();
        self.ticks += u64::from(now.wrapping_sub(self.last));
        self.last = now;
        self.ticks
    }

    fn micros(&mut self) -> u64 {
        self.ticks() / u64::from(HERTZ / 1_000_000)
    }
}

/// Registers the clouds of a request, slice by slice. Between two slices a real controller would run its control loop; here the
/// line is served.
#[inline(never)]
pub(crate) fn refine(
    registrar: Option<&mut Registrar<'_, '_>>,
    space: &mut [u32],
    length: usize,
    link: &mut Link,
    report: &mut Report,
) -> Result<RefineReply, Refusal> {
    let mut clock = Clock::start();
    let request = decode_in_place(space, length).map_err(refusal)?;
    let id = request.asked.id;
    let refused = |reason| Refusal { id, reason };
    let (source, target) = (request.source, request.target);
    let because = |cloud| move |error| refused(Reason::of(error, cloud));
    source.check().map_err(because(Cloud::Source))?;
    target.check().map_err(because(Cloud::Target))?;
    if !matches!(request.mode, Mode::Fast | Mode::Best) {
        return Err(refused(Reason::NoSuchMode(request.mode)));
    }
    let (Some(registrar), Some(policy)) = (registrar, report.policy) else {
        return Err(refused(report.why_not()));
    };
    let initial = request.initial.map_or(Pose::IDENTITY, Pose::from_rows);
    let frame = Frame::of_cloud(target).map_err(because(Cloud::Target))?;
    let mut registration = Registration::new();
    registrar
        .begin(&mut registration, source, target, frame, initial)
        .map_err(because(Cloud::Target))?;
    let mut begun = 0;
    let mut steps = 0;
    // After a stop on every axis, every further step would see the same and stop again.
    while steps < request.max_steps && !registration.is_settled() {
        if clock.micros() / 1000 > u64::from(request.budget_ms) {
            return Err(refused(Reason::Deadline));
        }
        let at_target = registration.is_at_target();
        let step = report.slice(registrar, &mut registration);
        let step = step.map_err(because(Cloud::Source))?;
        let took = (clock.ticks() - begun) as u32;
        if at_target && !registration.is_at_target() {
            report.target_ticks = took;
            report.steps_ticks = 0;
            begun = clock.ticks();
        }
        if let Some(step) = step {
            report.steps_ticks += took;
            steps += 1;
            link.send(&Message::StepTaken(StepTaken {
                id,
                action: step.action,
                target_from_source: registration.target_from_source().to_rows(),
            }));
            begun = clock.ticks();
        }
        feed_watchdog();
        if link.glance() == Some(request.asked) {
            return Err(refused(Reason::TakenBack));
        }
    }
    report.count(registration.verdict());
    Ok(RefineReply {
        id,
        target_from_source: registration.target_from_source().to_rows(),
        steps,
        mode: Mode::Fast,
        verdict: registration.verdict(),
        probability: None,
        fit: None,
        waited_micros: 0,
        micros: clock.micros().min(u64::from(u32::MAX)) as u32,
        policy_version: policy.version,
    })
}

/// The refusal of a frame without an id.
pub(crate) fn refusal(error: Error) -> Refusal {
    Refusal {
        id: 0,
        reason: Reason::of(error, Cloud::Source),
    }
}
