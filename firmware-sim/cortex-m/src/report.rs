//! The board's state, and how long its work takes.

use crate::POINTS;
use crate::hardware::{self, HERTZ};
use crate::link::Link;
use reagent_core::register::Step;
use reagent_core::verdict::VERDICTS;
use reagent_core::wire::{Board, FlashCheck, Message, PolicyId, Reason, Status};
use reagent_core::{Error, Registrar, Registration, Verdict};

/// Points of one slice of work. A real control loop would take what its period leaves time for.
const SLICE: usize = 16;

/// The board's state.
#[derive(Default)]
pub(crate) struct Report {
    /// The policy that serves.
    pub(crate) policy: Option<PolicyId>,
    /// Result of the check of the policy in flash.
    pub(crate) flash: FlashCheck,
    pub(crate) target_ticks: u32,
    pub(crate) steps_ticks: u32,
    slice_ticks: u32,
    verdicts: [u32; VERDICTS],
}

impl Report {
    /// Does one slice of a registration and times it.
    ///
    /// # Errors
    /// As [`Registrar::advance`].
    pub(crate) fn slice(
        &mut self,
        registrar: &mut Registrar<'_, '_>,
        registration: &mut Registration<'_>,
    ) -> Result<Option<Step>, Error> {
        let before = hardware::ticks();
        let step = registrar.advance(registration, SLICE);
        let took = hardware::ticks().wrapping_sub(before);
        self.slice_ticks = self.slice_ticks.max(took);
        step
    }

    /// Counts a pose.
    pub(crate) fn count(&mut self, verdict: Verdict) {
        if let Some(count) = self.verdicts.get_mut(verdict as usize) {
            *count += 1;
        }
    }

    /// Why no policy serves.
    pub(crate) fn why_not(&self) -> Reason {
        match self.flash {
            FlashCheck::Empty => Reason::NoPolicy,
            FlashCheck::Damaged => Reason::PolicyDamaged,
            FlashCheck::FailedSelfTest => Reason::FailedSelfTest,
            FlashCheck::Passed => Reason::Internal,
        }
    }

    pub(crate) fn send_status(&self, link: &mut Link) {
        link.send(&Message::Status(Status {
            policy: self.policy,
            served: self.verdicts.iter().map(|&count| u64::from(count)).sum(),
            refused: link.refused,
            verdicts: self.verdicts,
            ..Status::default()
        }));
    }

    pub(crate) fn send(&self, link: &mut Link) {
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
            steps_ticks: self.steps_ticks,
            slice_ticks: self.slice_ticks,
            hertz: HERTZ,
            flash: self.flash,
        }));
    }
}
