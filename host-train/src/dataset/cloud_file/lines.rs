//! Text files of any operating system, line by line.

use super::{Note, Position};
use std::borrow::Cow;

/// Decodes a file's text: UTF-8 with or without a byte order mark, or UTF-16 with one. Invalid bytes, such as names
/// in older encodings, become replacement characters; numbers are ASCII in all of these.
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
    let text = match bytes {
        [0xef, 0xbb, 0xbf, rest @ ..] => String::from_utf8_lossy(rest),
        [0xff, 0xfe, rest @ ..] => {
            notes.push(Note::Utf16);
            wide(rest, u16::from_le_bytes)?
        }
        [0xfe, 0xff, rest @ ..] => {
            notes.push(Note::Utf16);
            wide(rest, u16::from_be_bytes)?
        }
        _ if bytes.iter().take(1024).any(|&b| b == 0) => {
            return Err("it is not text; UTF-16 needs a byte order mark".into());
        }
        _ => String::from_utf8_lossy(bytes),
    };
    // Line ends of classic Mac OS, which some programs still write.
    Ok(match text.contains('\r') && !text.contains('\n') {
        true => text.replace('\r', "\n").into(),
        false => text,
    })
}

/// Splits a line into content and comment, which begins at the first `#` outside of a number ([`number`]).
pub(super) fn without_comment(line: &str) -> (&str, &str) {
    let is_number = |at: usize| {
        let after = line[at + 1..].chars().next();
        line[..at].ends_with('.') && after.is_some_and(|c| c.is_ascii_alphabetic())
    };
    let mut marks = line.match_indices('#').map(|(at, _)| at);
    line.split_at(marks.find(|&at| !is_number(at)).unwrap_or(line.len()))
}

/// Parses a number. The spellings of NaN on Windows, `-nan(ind)` or `1.#QNAN`, are NaN.
pub(super) fn number(word: &str) -> Option<f64> {
    word.parse().ok().or_else(|| {
        let word = word.trim_start_matches(['-', '+']);
        let begins = |start: &str| {
            let of_word = word.get(..start.len());
            of_word.is_some_and(|word| word.eq_ignore_ascii_case(start))
        };
        (begins("nan(") || begins("1.#")).then_some(f64::NAN)
    })
}

/// Lines with content, numbered from 1, without comments.
pub(super) fn numbered(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let numbered = text
        .lines()
        .enumerate()
        .map(|(i, line)| (i + 1, without_comment(line).0.trim()));
    numbered.filter(|(_, line)| !line.is_empty())
}

/// The numbers of a line, separated by white space; `None` if a word is not a number.
pub(super) fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split_whitespace().map(number).collect()
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

/// The start of a line, made printable.
pub(super) fn excerpt(text: &str) -> String {
    let shown = text.chars().take(40);
    shown
        .map(|c| if c.is_control() { '?' } else { c })
        .collect()
}
