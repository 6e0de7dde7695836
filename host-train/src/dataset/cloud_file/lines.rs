//! Text as programs of all systems write it, line by line.

use super::{Note, Position};
use std::borrow::Cow;

/// The text of a file: UTF-8 with or without a byte order mark, UTF-16 with one. What is neither, as names in
/// older encodings, becomes replacement characters; numbers are ASCII in all of them.
pub(super) fn decode<'a>(bytes: &'a [u8], notes: &mut Vec<Note>) -> Result<Cow<'a, str>, String> {
    let wide = |bytes: &[u8], order: fn([u8; 2]) -> u16| {
        let (pairs, odd) = bytes.as_chunks::<2>();
        let text: Result<String, _> =
            char::decode_utf16(pairs.iter().copied().map(order)).collect();
        match text {
            Ok(text) if odd.is_empty() => Ok(text.into()),
            _ => Err("it begins like UTF-16 text and is none; write it as UTF-8".to_owned()),
        }
    };
    match bytes {
        [0xef, 0xbb, 0xbf, rest @ ..] => Ok(String::from_utf8_lossy(rest)),
        [0xff, 0xfe, rest @ ..] => {
            notes.push(Note::Utf16);
            wide(rest, u16::from_le_bytes)
        }
        [0xfe, 0xff, rest @ ..] => {
            notes.push(Note::Utf16);
            wide(rest, u16::from_be_bytes)
        }
        _ if bytes.iter().take(1024).any(|&b| b == 0) => {
            Err("it is not text; UTF-16 needs a byte order mark".into())
        }
        _ => Ok(String::from_utf8_lossy(bytes)),
    }
}

/// Lines that hold something, with their numbers from 1, without what follows a `#`.
pub(super) fn numbered(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let numbered = text
        .lines()
        .enumerate()
        .map(|(i, line)| (i + 1, line.split('#').next().unwrap_or("").trim()));
    numbered.filter(|(_, line)| !line.is_empty())
}

/// The numbers of a line, separated by white space; `None` where a word is no number.
pub(super) fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split_whitespace()
        .map(|word| word.parse().ok())
        .collect()
}

/// The first three of a line's numbers.
pub(super) fn position(
    numbers: Option<&[f64]>,
    text: &str,
    line: usize,
) -> Result<Position, String> {
    match numbers {
        Some(&[x, y, z, ..]) => Ok([x, y, z]),
        _ => Err(format!(
            "line {line}: expected three coordinates, found \"{}\"",
            excerpt(text)
        )),
    }
}

/// The beginning of a line, fit to be shown.
pub(super) fn excerpt(text: &str) -> String {
    let shown = text.chars().take(40);
    shown
        .map(|c| if c.is_control() { '?' } else { c })
        .collect()
}
