//! The serial line to a board: messages out, frames in, and the requests over it.

use super::emulator::Emulator;
use super::{BoardError, Kind, Simulation};
use reagent_core::wire::{
    self, Cancel, Chunk, Manifest, Message, Reason, RefineReply, Refusal, SMALL_FRAME_BYTES,
    Status, StepTaken, serial,
};
use std::ops::ControlFlow;
use std::path::Path;

/// Bytes of a policy that are sent to a board at once. They fit into the space of a request's clouds on a grid.
const CHUNK_BYTES: u32 = 8 * 1024;

/// A running board.
#[derive(Debug)]
pub struct Board {
    kind: Kind,
    emulator: Emulator,
    /// Reports that are expected.
    reports: u32,
}

impl Board {
    /// Switches a board on. It first sends a status and a report.
    ///
    /// # Errors
    /// `NoQemu`, `Process`.
    pub fn start(
        kind: Kind,
        image: &Path,
        simulation: Simulation<'_>,
    ) -> Result<Board, BoardError> {
        Ok(Board {
            kind,
            emulator: Emulator::start(kind, image, simulation)?,
            reports: 1,
        })
    }

    /// Its kind.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// The number of the simulator's process.
    pub fn process_id(&self) -> u32 {
        self.emulator.process_id()
    }

    /// Sends bytes unchanged.
    ///
    /// # Errors
    /// `Stopped`.
    pub fn send_bytes(&mut self, bytes: &[u8]) -> Result<(), BoardError> {
        self.emulator.send(bytes)
    }

    /// Sends a frame.
    ///
    /// # Errors
    /// `Stopped`.
    pub fn send_frame(&mut self, frame: &[u8]) -> Result<(), BoardError> {
        let mut bytes = Vec::with_capacity(serial::line_bytes(frame.len()));
        serial::write(frame, |byte| bytes.push(byte));
        self.send_bytes(&bytes)
    }

    /// Sends a message that is not a request.
    ///
    /// # Errors
    /// `Stopped`.
    pub fn send(&mut self, message: &Message<'_>) -> Result<(), BoardError> {
        let mut buffer = vec![0; SMALL_FRAME_BYTES + CHUNK_BYTES as usize];
        let frame = wire::encode(message, &mut buffer).expect("small messages and chunks fit");
        self.send_frame(frame)
    }

    /// The next frame that the board sends.
    ///
    /// # Errors
    /// `Silent`, `Stopped`.
    pub fn receive(&mut self) -> Result<Vec<u8>, BoardError> {
        self.emulator.receive()
    }

    /// Waits for a frame for which `pick` returns something. Others are skipped.
    ///
    /// # Errors
    /// `Restarted`; as [`Board::receive`].
    pub fn wait_for<T>(
        &mut self,
        mut pick: impl FnMut(Message<'_>) -> Option<T>,
    ) -> Result<T, BoardError> {
        loop {
            let frame = self.receive()?;
            let Ok(message) = wire::decode(&frame) else {
                continue;
            };
            if matches!(message, Message::Board(_)) {
                // The board also sends a report when it starts.
                self.reports = self.reports.checked_sub(1).ok_or(BoardError::Restarted)?;
            }
            if let Some(found) = pick(message) {
                return Ok(found);
            }
        }
    }

    /// Asks for the board's status and report.
    ///
    /// # Errors
    /// As [`Board::receive`].
    pub fn ask(&mut self) -> Result<(Status, wire::Board), BoardError> {
        self.send(&Message::Ask)?;
        self.reports += 1;
        self.status_and_report()
    }

    /// Waits for the status and the report, which come at the start and after a question.
    ///
    /// # Errors
    /// As [`Board::receive`].
    pub fn status_and_report(&mut self) -> Result<(Status, wire::Board), BoardError> {
        let mut status = Status::default();
        self.wait_for(|message| match message {
            Message::Status(found) => {
                status = found;
                None
            }
            Message::Board(report) => Some(report),
            _ => None,
        })
        .map(|report| (status, report))
    }

    /// Sends the frame of a request and waits for the answer. Meanwhile `step` gets every step. If `step` breaks off, the request is
    /// taken back, and the answer is most likely a refusal that says so.
    ///
    /// # Errors
    /// `Restarted`; as [`Board::receive`].
    pub fn refine(
        &mut self,
        request: &[u8],
        mut step: impl FnMut(StepTaken) -> ControlFlow<()>,
    ) -> Result<Result<RefineReply, Refusal>, BoardError> {
        self.send_frame(request)?;
        loop {
            let heard = self.wait_for(|message| match message {
                Message::StepTaken(taken) => Some(Err(taken)),
                Message::RefineReply(reply) => Some(Ok(Ok(reply))),
                Message::Refusal(refusal) => Some(Ok(Err(refusal))),
                _ => None,
            })?;
            match heard {
                Ok(answer) => return Ok(answer),
                Err(taken) => {
                    if step(taken).is_break()
                        && let Ok(Message::RefineRequest(request)) = wire::decode(request)
                    {
                        self.send(&Message::Cancel(Cancel::of(&request)))?;
                    }
                }
            }
        }
    }

    /// Writes a policy into the board's flash, chunk by chunk.
    ///
    /// # Errors
    /// `PolicyRefused`, `PolicyUnfit`, `Restarted`; as [`Board::receive`].
    pub fn load(&mut self, manifest: &Manifest, file: &[u8]) -> Result<(), BoardError> {
        let answer = |message: Message<'_>| match message {
            Message::Status(status) => Some(Ok(status)),
            Message::Refusal(Refusal { reason, .. }) => Some(Err(match reason {
                Reason::PolicyDamaged | Reason::FailedSelfTest => {
                    BoardError::PolicyUnfit { reason }
                }
                _ => BoardError::PolicyRefused { bytes: file.len() },
            })),
            _ => None,
        };
        // Pending reports would be taken for answers to what follows.
        while self.reports > 0 {
            self.status_and_report()?;
        }
        self.send(&Message::Manifest(Manifest {
            chunk_length: CHUNK_BYTES,
            ..manifest.clone()
        }))?;
        let mut status = self.wait_for(answer)??;
        for (index, bytes) in file.chunks(CHUNK_BYTES as usize).enumerate() {
            let index = index as u32;
            self.send(&Message::Chunk(Chunk { index, bytes }))?;
            status = self.wait_for(answer)??;
        }
        match status.policy {
            Some(id) if id.sha256 == manifest.sha256 => Ok(()),
            _ => Err(BoardError::PolicyRefused { bytes: file.len() }),
        }
    }
}
