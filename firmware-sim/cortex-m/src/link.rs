//! Frames over the serial line. While a registration runs, its clouds fill the large buffer. Frames that arrive then go into a
//! small one, just to be answered.

use crate::POINTS;
use crate::hardware::{Uart, clear_tick, feed_watchdog};
use reagent_core::wire::serial::{self, CHECK_BYTES, Decoder, Line};
use reagent_core::wire::{self, Cancel, Message, Refusal, SMALL_FRAME_BYTES, refuse_beginning};

/// The serial line.
pub(crate) struct Link {
    uart: Uart,
    decoder: Decoder,
    small: [u8; SMALL_FRAME_BYTES + CHECK_BYTES],
    /// Whether the current frame goes into the small buffer.
    skim: bool,
    waits: u8,
    /// Requests refused.
    pub(crate) refused: u64,
}

impl Link {
    pub(crate) fn new(uart: Uart) -> Link {
        Link {
            uart,
            decoder: Decoder::new(),
            small: [0; SMALL_FRAME_BYTES + CHECK_BYTES],
            skim: false,
            waits: 0,
            refused: 0,
        }
    }

    /// Waits for a frame in `space` and returns its length. Anything that is no frame is refused.
    pub(crate) fn receive(&mut self, space: &mut [u8]) -> usize {
        loop {
            let Some(byte) = self.uart.receive() else {
                self.uart.wait();
                self.waits = self.waits.wrapping_add(1);
                // Seconds apart if nothing comes. If much comes, not too often, since registers are slow.
                if self.waits.is_multiple_of(16) {
                    feed_watchdog();
                    clear_tick();
                }
                continue;
            };
            if self.decoder.is_idle() {
                self.skim = false;
            }
            if self.skim {
                self.skim(byte);
                continue;
            }
            match self.decoder.push(byte, space) {
                None => {}
                Some(Line::Frame(length)) => return length,
                Some(Line::Overlong(length)) => {
                    self.refuse(refuse_beginning(space, length, POINTS, false));
                }
                Some(Line::Broken) => self.refuse(refuse_beginning(&[], 0, POINTS, false)),
            }
        }
    }

    /// Answers frames that have come meanwhile: the board is busy. Returns the request that was taken back, if any.
    pub(crate) fn glance(&mut self) -> Option<Cancel> {
        let mut cancel = None;
        while let Some(byte) = self.uart.receive() {
            if self.decoder.is_idle() {
                self.skim = true;
            }
            cancel = self.skim(byte).or(cancel);
        }
        cancel
    }

    fn skim(&mut self, byte: u8) -> Option<Cancel> {
        let refusal = match self.decoder.push(byte, &mut self.small)? {
            Line::Frame(length) | Line::Overlong(length) => {
                let frame = self.small.get(..length).unwrap_or(&[]);
                if let Ok(Message::Cancel(cancel)) = wire::decode(frame) {
                    return Some(cancel);
                }
                refuse_beginning(&self.small, length, POINTS, true)
            }
            Line::Broken => refuse_beginning(&[], 0, POINTS, false),
        };
        self.refuse(refusal);
        None
    }

    /// Sends a refusal and counts it.
    pub(crate) fn refuse(&mut self, refusal: Refusal) {
        self.refused += 1;
        self.send(&Message::Refusal(refusal));
    }

    /// Sends any message except a request.
    pub(crate) fn send(&mut self, message: &Message<'_>) {
        let mut buffer = [0; SMALL_FRAME_BYTES];
        if let Ok(frame) = wire::encode(message, &mut buffer) {
            serial::write(frame, |byte| self.uart.send(byte));
        }
    }
}
