//! What is said of files that cannot be written.

use std::io;

/// The system's message, without the name of a temporary file.
pub fn plain(error: io::Error) -> io::Error {
    let text = error.to_string();
    match text.split_once(" at path ") {
        Some((said, _)) => io::Error::new(error.kind(), said),
        None => error,
    }
}
