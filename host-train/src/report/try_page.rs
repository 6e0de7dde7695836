//! The page that registers in a browser: style, scripts and program are in it, and nothing is fetched.

use super::page::{SCRIPT, STYLE, VIEWER};
use crate::register::SOURCES;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;

const TEMPLATE: &str = include_str!("page/try.html");
const TRY: &str = include_str!("page/try.js");
/// Even a mistake in the page could not load anything.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline' 'wasm-unsafe-eval'; img-src data:";

/// How a file of WebAssembly begins, and a call of the page's program.
const MAGIC: &[u8] = b"\0asm";
const CALL: &[u8] = b"answer_length";

/// Why no page was made of a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PageError {
    /// The file is something else.
    #[error("it is not the page's program; name what host-train/page was compiled to")]
    OtherFile,
    /// It would give other poses than this command line, or none.
    #[error(
        "it was compiled from other sources than this command line, whose poses it may not give; build it again: \
         `cargo build --release` in host-train/page, of the checkout that this command line was built from"
    )]
    OtherSources,
}

/// The document, around the program that host-train/page is compiled to.
///
/// # Errors
/// Another file, and a program of other sources than this one's.
pub fn try_page(program: &[u8]) -> Result<String, PageError> {
    let has = |text: &[u8]| program.windows(text.len()).any(|part| part == text);
    if !(program.starts_with(MAGIC) && has(CALL)) {
        return Err(PageError::OtherFile);
    }
    if !has(SOURCES.as_bytes()) {
        return Err(PageError::OtherSources);
    }
    let parts = [
        ("policy", POLICY),
        ("style", STYLE),
        ("version", env!("CARGO_PKG_VERSION")),
        ("viewer", VIEWER),
        ("scripts", &[SCRIPT, TRY].concat()),
        ("program", &STANDARD.encode(program)),
    ];
    let page = parts
        .iter()
        .fold(TEMPLATE.to_owned(), |page, (name, part)| {
            page.replace(&format!("{{{{{name}}}}}"), part)
        });
    Ok(page)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_is_whole_and_holds_the_program() {
        let program = [MAGIC, &[1, 0, 0, 0], CALL, SOURCES.as_bytes()].concat();
        let page = try_page(&program).expect("a program");
        assert!(!page.contains("{{") && page.contains(&STANDARD.encode(&program)));
        let at = |words: &str| page.find(words).expect("a part of the page");
        assert!(
            at("<noscript>") < at("<template"),
            "a template's parts are not shown"
        );
        for other in [&b"\0asm of something else"[..], CALL] {
            assert_eq!(try_page(other), Err(PageError::OtherFile));
        }
        // One that was built before the last change.
        let old = [MAGIC, CALL, b"reagent-sources-0123456789abcdef"].concat();
        assert_eq!(try_page(&old), Err(PageError::OtherSources));
    }
}
