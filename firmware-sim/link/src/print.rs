//! `print!`, `println!` and `eprintln!` for the commands. Those of the standard library panic if the reader has closed its end of
//! the pipe (`host-train eval … | head -1`). Here such output is dropped, and the command goes on to write its files. A command
//! that only prints asks whether anyone reads.

use std::fmt::Arguments;
use std::io::{ErrorKind, Write};
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether the reader of standard output has closed its end.
static READER_GONE: AtomicBool = AtomicBool::new(false);

/// Prints to standard output.
#[macro_export]
macro_rules! print {
    ($($arg:tt)*) => { $crate::print::stdout(format_args!($($arg)*)) };
}

/// Prints a line to standard output.
#[macro_export]
macro_rules! println {
    ($($arg:tt)*) => { $crate::print::stdout(format_args!("{}\n", format_args!($($arg)*))) };
}

/// Prints a line to standard error.
#[macro_export]
macro_rules! eprintln {
    ($($arg:tt)*) => { $crate::print::stderr(format_args!("{}\n", format_args!($($arg)*))) };
}

/// Writes to standard output. A full disk ends the process with status 1, since the output is the result.
pub fn stdout(text: Arguments<'_>) {
    let mut out = std::io::stdout().lock();
    match out.write_fmt(text).and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => {
            READER_GONE.store(true, Ordering::Relaxed);
        }
        Err(error) => {
            stderr(format_args!(
                "error: cannot write to standard output: {error}\n"
            ));
            std::process::exit(1);
        }
        Ok(()) => {}
    }
}

/// Whether output was dropped because nobody reads it any more.
pub fn reader_gone() -> bool {
    READER_GONE.load(Ordering::Relaxed)
}

/// Writes to standard error, if anyone reads it. A long job does not end because there is no terminal.
pub fn stderr(text: Arguments<'_>) {
    let _ = std::io::stderr().lock().write_fmt(text);
}
