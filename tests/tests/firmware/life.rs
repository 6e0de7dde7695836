//! The simulator ends with the process that has started it, however that ends.

use super::c::output;
use super::images;
use firmware_sim::board::{Board, Simulation, check_simulator};
use std::ffi::OsStr;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

/// Set for the process that is going to be killed.
const VICTIM: &str = "REAGENT_TEST_VICTIM";

/// In the process that is going to be killed: a board, and waiting. Nothing in others.
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
