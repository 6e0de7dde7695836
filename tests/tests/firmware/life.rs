//! The simulator ends with the process that started it, however that ends; a board that hangs is restarted.

use super::c::output;
use super::images;
use firmware_sim::board::{Board, QEMU, Simulation, check_simulator};
use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Write};
#[cfg(unix)]
use std::os::unix::net::UnixListener;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

/// Set in the process that will be killed.
const VICTIM: &str = "REAGENT_TEST_VICTIM";

/// The process that will be killed starts a board and waits. Does nothing in other processes.
#[test]
fn victim() {
    if std::env::var_os(VICTIM).is_none() {
        return;
    }
    let (kind, image) = images().into_iter().next().expect("an image");
    let mut board = Board::start(kind, &image, Simulation::default()).expect("QEMU starts");
    board.status_and_report().expect("it runs");
    println!("board {}", board.process_id());
    board.receive().expect_err("it says nothing more");
}

#[test]
#[cfg(target_os = "linux")]
fn a_killed_process_leaves_no_simulator_behind() {
    if let Err(error) = check_simulator() {
        return eprintln!("skipped: {error}");
    }
    if images().is_empty() {
        return;
    }
    let program = std::env::current_exe().expect("this program");
    let mut victim = Command::new(program)
        .args(["--exact", "life::victim", "--nocapture"])
        .env(VICTIM, "1")
        .stdout(Stdio::piped())
        .spawn()
        .expect("it runs");
    let printed = BufReader::new(victim.stdout.take().expect("piped"));
    let board = printed
        .lines()
        .find_map(|line| line.ok()?.split_once("board ").map(|(_, id)| id.to_owned()))
        .expect("it tells the board's process");
    let process = Path::new("/proc").join(&board);
    assert!(process.exists());
    victim.kill().expect("it can be killed");
    victim.wait().expect("it was killed");
    let arguments = ["60", "tail", "--pid", &board, "-f", "/dev/null"].map(OsStr::new);
    output("timeout", &arguments);
    assert!(!process.exists());
}

/// Nobody reads what the board sends, so that it cannot go on. A nanosecond of its time is a thousandth of an
/// instruction, so its seconds pass fast.
#[test]
#[cfg(unix)]
fn the_watchdog_resets_a_board_that_hangs() {
    if let Err(error) = check_simulator() {
        return eprintln!("skipped: {error}");
    }
    let directory = tempfile::tempdir().expect("a temporary directory");
    for (kind, image) in images() {
        let control = directory.path().join(kind.name());
        let listener = UnixListener::bind(&control).expect("a socket");
        let mut qemu = Command::new(QEMU)
            .args(["-machine", kind.machine(), "-display", "none"])
            .args(["-serial", "stdio", "-icount", "shift=10"])
            .arg("-chardev")
            .arg(format!("socket,id=control,path={}", control.display()))
            .args(["-mon", "chardev=control,mode=control", "-kernel"])
            .arg(image)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("QEMU starts");
        let (mut control, _) = listener.accept().expect("it connects");
        control
            .write_all(b"{\"execute\": \"qmp_capabilities\"}")
            .expect("it listens");
        let mut line = qemu.stdin.take().expect("piped");
        // Each frame is refused with an answer. The thread ends when the simulator does.
        let flood = std::thread::spawn(move || while line.write_all(&[1, 1, 0]).is_ok() {});
        let limit = Some(Duration::from_secs(100));
        control.set_read_timeout(limit).expect("a time");
        let mut events = BufReader::new(control).lines().map_while(Result::ok);
        let reset = events.any(|event| event.contains("\"WATCHDOG\""));
        qemu.kill().expect("it can be killed");
        qemu.wait().expect("it was killed");
        flood.join().expect("it has ended");
        assert!(reset, "{kind:?}");
    }
}
