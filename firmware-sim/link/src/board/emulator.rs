//! A QEMU process that simulates a board: its start, its end, and its bytes in and out.

use super::{BoardError, Kind, QEMU, SILENCE};
use reagent_core::wire::SMALL_FRAME_BYTES;
use reagent_core::wire::serial::{CHECK_BYTES, Decoder, Line};
use std::io::{self, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};

/// A Linux program that runs another one and has the kernel end that when its parent ends.
const SETPRIV: &str = "setpriv";

/// Whether boards can be simulated here.
///
/// # Errors
/// `NoQemu`.
pub fn check_simulator() -> Result<(), BoardError> {
    let version = Command::new(QEMU).arg("--version").output();
    version.map(drop).map_err(not_started)
}

fn not_started(error: io::Error) -> BoardError {
    match error.kind() {
        io::ErrorKind::NotFound => BoardError::NoQemu,
        _ => BoardError::Process(error),
    }
}

/// The command for the simulator. The simulator ends when this process does, however that ends. If the system cannot do this, it
/// stays running when this process is killed.
fn simulator() -> Result<Command, BoardError> {
    let setpriv = Command::new(SETPRIV).arg("--version").output();
    if !setpriv.is_ok_and(|output| output.status.success()) {
        return Ok(Command::new(QEMU));
    }
    // If QEMU is missing, `setpriv` would only say that it cannot start it.
    check_simulator()?;
    let mut qemu = Command::new(SETPRIV);
    qemu.args(["--pdeathsig", "KILL", "--", QEMU]);
    Ok(qemu)
}

fn no_thread() -> BoardError {
    BoardError::Process(io::Error::other("no thread to start it from"))
}

/// How the simulator runs.
#[derive(Clone, Copy, Debug, Default)]
pub struct Simulation<'a> {
    /// A file with the initial content of the policy's flash ([`super::flash_content`]).
    pub flash: Option<&'a Path>,
    /// Whether an instruction takes exactly one nanosecond of the board's time, independent of the host's time.
    pub count_instructions: bool,
}

/// A running emulator.
#[derive(Debug)]
pub(super) struct Emulator {
    process: Child,
    input: ChildStdin,
    frames: Receiver<Vec<u8>>,
}

impl Emulator {
    /// Switches a board on.
    pub(super) fn start(
        kind: Kind,
        image: &Path,
        simulation: Simulation<'_>,
    ) -> Result<Emulator, BoardError> {
        let mut qemu = simulator()?;
        qemu.args(["-machine", kind.machine()])
            .args(["-display", "none", "-monitor", "none"])
            .args(["-chardev", "stdio,id=line,signal=off"])
            .args(["-serial", "chardev:line"])
            .arg("-kernel")
            .arg(image);
        if let Some(flash) = simulation.flash {
            let (file, address) = (flash.display(), kind.policy_address());
            let loader = format!("loader,file={file},addr={address},force-raw=on");
            qemu.args(["-device", &loader]);
        }
        if simulation.count_instructions {
            qemu.args(["-icount", "shift=0,sleep=off"]);
        }
        qemu.stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        // The thread that starts the simulator must live as long as the simulator: the kernel takes the end of that thread for the
        // end of this process.
        let (started, process) = channel();
        let (sender, frames) = channel();
        std::thread::spawn(move || {
            let mut process = qemu.spawn();
            let output = process.as_mut().ok().and_then(|p| p.stdout.take());
            started.send(process).ok();
            if let Some(output) = output {
                read_frames(output, &sender);
            }
        });
        let mut process = process
            .recv()
            .map_err(|_| no_thread())?
            .map_err(not_started)?;
        let input = process.stdin.take().expect("piped");
        Ok(Emulator {
            process,
            input,
            frames,
        })
    }

    /// The number of its process.
    pub(super) fn process_id(&self) -> u32 {
        self.process.id()
    }

    /// Sends bytes unchanged.
    pub(super) fn send(&mut self, bytes: &[u8]) -> Result<(), BoardError> {
        let sent = self
            .input
            .write_all(bytes)
            .and_then(|()| self.input.flush());
        sent.map_err(|_| self.why_stopped())
    }

    /// The next frame that the board sends.
    pub(super) fn receive(&mut self) -> Result<Vec<u8>, BoardError> {
        match self.frames.recv_timeout(SILENCE) {
            Ok(frame) => Ok(frame),
            Err(RecvTimeoutError::Timeout) => Err(BoardError::Silent),
            Err(RecvTimeoutError::Disconnected) => Err(self.why_stopped()),
        }
    }

    /// The error that the simulator has printed.
    fn why_stopped(&mut self) -> BoardError {
        self.process.kill().ok();
        self.process.wait().ok();
        let mut text = String::new();
        if let Some(mut error) = self.process.stderr.take() {
            error.read_to_string(&mut text).ok();
        }
        let line = text.lines().next().unwrap_or("the line was closed");
        BoardError::Stopped(line.to_owned())
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        self.process.kill().ok();
        self.process.wait().ok();
    }
}

/// Passes on every frame until the line is closed.
fn read_frames(mut output: impl Read, frames: &Sender<Vec<u8>>) {
    let mut decoder = Decoder::new();
    let mut space = [0; SMALL_FRAME_BYTES + CHECK_BYTES];
    let mut bytes = [0; 4096];
    while let Ok(count @ 1..) = output.read(&mut bytes) {
        for &byte in &bytes[..count] {
            if let Some(Line::Frame(length)) = decoder.push(byte, &mut space)
                && frames.send(space[..length].to_vec()).is_err()
            {
                return;
            }
        }
    }
}
