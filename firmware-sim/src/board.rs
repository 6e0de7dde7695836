//! A microcontroller in QEMU that runs the image of `firmware-sim/cortex-m`, and the serial line to it.

use reagent_core::wire::serial::{self, CHECK_BYTES, Decoder, Line};
use reagent_core::wire::{
    self, Cancel, Chunk, FLASH_HEADER_BYTES, Manifest, Message, Reason, RefineReply, Refusal,
    SMALL_FRAME_BYTES, Status, StepTaken,
};
use std::io::{self, Read, Write};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;
use thiserror::Error;

/// The program that simulates boards.
pub const QEMU: &str = "qemu-system-arm";
/// A program of Linux that asks the kernel to end another with its parent, and becomes that other.
const SETPRIV: &str = "setpriv";
/// A board that says nothing for longer is not working. A step takes seconds on a busy machine.
pub const SILENCE: Duration = Duration::from_secs(120);
/// Bytes of a policy that go to a board at once: what fits where a request's clouds on a grid do.
const CHUNK_BYTES: u32 = 8 * 1024;

/// The boards there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Kind {
    /// Cortex-M7, MPS2 with AN500
    CortexM7,
    /// Cortex-M55 with Helium, MPS3 with AN547
    CortexM55,
}

impl Kind {
    /// Every board.
    pub const ALL: [Kind; 2] = [Kind::CortexM7, Kind::CortexM55];

    /// The compiler's name of its instruction set.
    pub fn target(self) -> &'static str {
        match self {
            Kind::CortexM7 => "thumbv7em-none-eabihf",
            Kind::CortexM55 => "thumbv8m.main-none-eabihf",
        }
    }

    /// Its processor's name.
    pub fn name(self) -> &'static str {
        match self {
            Kind::CortexM7 => "Cortex-M7",
            Kind::CortexM55 => "Cortex-M55",
        }
    }

    /// What QEMU calls its machine.
    pub fn machine(self) -> &'static str {
        match self {
            Kind::CortexM7 => "mps2-an500",
            Kind::CortexM55 => "mps3-an547",
        }
    }

    /// Where the policy's flash begins.
    fn policy_address(self) -> &'static str {
        match self {
            Kind::CortexM7 => "0x00100000",
            Kind::CortexM55 => "0x60000000",
        }
    }
}

/// Why a board cannot be used.
#[derive(Debug, Error)]
pub enum BoardError {
    /// The simulator is not installed.
    #[error(
        "{QEMU} is not installed, and boards are simulated by it: apt-get install qemu-system-arm \
         (Debian, Ubuntu), brew install qemu (macOS)"
    )]
    NoQemu,
    /// The compiler cannot build for the board.
    #[error("the compiler has no core library for {target}: rustup target add {target}")]
    NoTarget {
        /// As the compiler calls it.
        target: &'static str,
    },
    /// The image cannot be built.
    #[error("the image for {target} does not build (cargo build in {directory}): {reason}")]
    Build {
        /// As the compiler calls it.
        target: &'static str,
        /// Where its sources are.
        directory: String,
        /// What cargo says.
        reason: String,
    },
    /// The process cannot be started or spoken to.
    #[error("{QEMU}: {0}")]
    Process(#[from] io::Error),
    /// The board has stopped.
    #[error("the board has stopped: {0}")]
    Stopped(String),
    /// The board says nothing.
    #[error("the board says nothing for {} s", SILENCE.as_secs())]
    Silent,
    /// The board has started anew, and what it was asked is forgotten.
    #[error("the board has started anew, probably by its watchdog")]
    Restarted,
    /// The policy that the board has taken does not pass its checks.
    #[error("the board does not use its policy: {reason}")]
    PolicyUnfit {
        /// Why.
        reason: Reason,
    },
    /// The board does not take a policy.
    #[error(
        "the board does not take the policy of {bytes} bytes; it has room for one in int8 \
         (host-train export --format int8)"
    )]
    PolicyRefused {
        /// Its length.
        bytes: usize,
    },
}

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

/// The simulator, such that it ends when this process does, however that ends; where the system has no means
/// for it, a killed process leaves it running.
fn simulator() -> Result<Command, BoardError> {
    let setpriv = Command::new(SETPRIV).arg("--version").output();
    if !setpriv.is_ok_and(|output| output.status.success()) {
        return Ok(Command::new(QEMU));
    }
    // It would only say that it cannot start what is not there.
    check_simulator()?;
    let mut qemu = Command::new(SETPRIV);
    qemu.args(["--pdeathsig", "KILL", "--", QEMU]);
    Ok(qemu)
}

fn no_thread() -> BoardError {
    BoardError::Process(io::Error::other("no thread to start it from"))
}

/// What the image has memory for: clouds of 1024 points each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Clouds {
    /// As floats, or on a grid
    #[default]
    Floats,
    /// On a grid of 16-bit codes, in half of the memory; half as many points as floats
    Grid,
}

/// Builds the image with cargo and gives its path; a moment where nothing has changed.
///
/// # Errors
/// `NoTarget`, `Build`.
pub fn build_image(kind: Kind, clouds: Clouds) -> Result<PathBuf, BoardError> {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmware-sim/cortex-m");
    let target = kind.target();
    let failed = |reason: String| BoardError::Build {
        target,
        directory: directory.display().to_string(),
        reason,
    };
    // Each in a folder of its own, so that nobody's is replaced while it runs.
    let (folder, features) = match clouds {
        Clouds::Floats => ("../../target/cortex-m", ""),
        Clouds::Grid => ("../../target/cortex-m-grid", "grid"),
    };
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut build = Command::new(cargo);
    build
        .args(["build", "--release", "--locked", "--target", target])
        .args(["--target-dir", folder, "--features", features])
        .current_dir(&directory);
    // The image has flags of its own.
    for variable in ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS"] {
        build.env_remove(variable);
    }
    let output = build.output().map_err(|error| failed(error.to_string()))?;
    if !output.status.success() {
        let text = String::from_utf8_lossy(&output.stderr);
        if text.contains("can't find crate for `core`") {
            return Err(BoardError::NoTarget { target });
        }
        let error = text.lines().find(|line| line.starts_with("error"));
        return Err(failed(error.unwrap_or("no reason given").to_owned()));
    }
    Ok(directory
        .join(folder)
        .join(target)
        .join("release/reagent-cortex-m"))
}

/// What lies in a board's flash for a policy file: its manifest and itself.
pub fn flash_content(manifest: &Manifest, file: &[u8]) -> Vec<u8> {
    let mut content = vec![0; FLASH_HEADER_BYTES];
    let (length, frame) = content.split_at_mut(4);
    let used = wire::encode(&Message::Manifest(manifest.clone()), frame)
        .expect("every manifest fits")
        .len();
    length.copy_from_slice(&(used as u32).to_le_bytes());
    content.extend_from_slice(file);
    content
}

/// How the simulator runs.
#[derive(Clone, Copy, Debug, Default)]
pub struct Simulation<'a> {
    /// File with the content of the policy's flash at the start ([`flash_content`]).
    pub flash: Option<&'a Path>,
    /// One nanosecond of the board's time is one instruction, whatever the host's time is.
    pub count_instructions: bool,
}

/// A running board.
#[derive(Debug)]
pub struct Board {
    kind: Kind,
    process: Child,
    line: ChildStdin,
    frames: Receiver<Vec<u8>>,
    /// Reports that are due.
    reports: u32,
}

impl Board {
    /// Switches a board on. It speaks first: a status and a report.
    ///
    /// # Errors
    /// `NoQemu`, `Process`.
    pub fn start(
        kind: Kind,
        image: &Path,
        simulation: Simulation<'_>,
    ) -> Result<Board, BoardError> {
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
        // The thread that starts the simulator lives as long as it: the kernel takes the end of that thread
        // for the end of this process.
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
        let line = process.stdin.take().expect("piped");
        Ok(Board {
            kind,
            process,
            line,
            frames,
            reports: 1,
        })
    }

    /// What it is.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// Number of the simulator's process.
    pub fn process_id(&self) -> u32 {
        self.process.id()
    }

    /// Puts bytes onto the line as they are.
    ///
    /// # Errors
    /// `Stopped`.
    pub fn send_bytes(&mut self, bytes: &[u8]) -> Result<(), BoardError> {
        let sent = self.line.write_all(bytes).and_then(|()| self.line.flush());
        sent.map_err(|_| self.why_stopped())
    }

    /// Puts a frame onto the line.
    ///
    /// # Errors
    /// `Stopped`.
    pub fn send_frame(&mut self, frame: &[u8]) -> Result<(), BoardError> {
        let mut bytes = Vec::with_capacity(serial::line_bytes(frame.len()));
        serial::write(frame, |byte| bytes.push(byte));
        self.send_bytes(&bytes)
    }

    /// Puts a message that is no request onto the line.
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
        match self.frames.recv_timeout(SILENCE) {
            Ok(frame) => Ok(frame),
            Err(RecvTimeoutError::Timeout) => Err(BoardError::Silent),
            Err(RecvTimeoutError::Disconnected) => Err(self.why_stopped()),
        }
    }

    /// The next frame of which `pick` gives something; others are passed over.
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
                // The board gives a report at its start, too.
                self.reports = self.reports.checked_sub(1).ok_or(BoardError::Restarted)?;
            }
            if let Some(found) = pick(message) {
                return Ok(found);
            }
        }
    }

    /// Asks how the board is.
    ///
    /// # Errors
    /// As [`Board::receive`].
    pub fn ask(&mut self) -> Result<(Status, wire::Board), BoardError> {
        self.send(&Message::Ask)?;
        self.reports += 1;
        self.status_and_report()
    }

    /// The status and the report that come at the start and after a question.
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

    /// Sends the frame of a request, and waits for its answer; `step` gets every step meanwhile. Where it
    /// breaks off the request is taken back, and the answer is most likely a refusal for that.
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
        // Answers that belong to nothing sent from here would be taken for others.
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

    /// What the simulator has left behind.
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

impl Drop for Board {
    fn drop(&mut self) {
        self.process.kill().ok();
        self.process.wait().ok();
    }
}

/// Sends on every frame that comes, until the line is closed.
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
