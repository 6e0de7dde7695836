//! The page that registers in a browser: style, scripts and program are in it, and nothing is fetched.

use super::page::{SCRIPT, STYLE, VIEWER};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;

const TEMPLATE: &str = include_str!("page/try.html");
const TRY: &str = include_str!("page/try.js");
/// Even a mistake in the page could not load anything.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline' 'wasm-unsafe-eval'; img-src data:";

/// How a file of WebAssembly begins, and a call of the page's program.
const MAGIC: &[u8] = b"\0asm";
const CALL: &[u8] = b"answer_length";

/// The document, around the program that host-train/page is compiled to; `None` where it is not that.
pub fn try_page(program: &[u8]) -> Option<String> {
    let is_program =
        program.starts_with(MAGIC) && program.windows(CALL.len()).any(|name| name == CALL);
    if !is_program {
        return None;
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
    Some(page)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_is_whole_and_holds_the_program() {
        let program = [MAGIC, &[1, 0, 0, 0], CALL].concat();
        let page = try_page(&program).expect("a program");
        assert!(!page.contains("{{") && page.contains(&STANDARD.encode(&program)));
        let at = |words: &str| page.find(words).expect("a part of the page");
        assert!(
            at("<noscript>") < at("<template"),
            "a template's parts are not shown"
        );
        assert_eq!(try_page(b"\0asm of something else"), None);
        assert_eq!(try_page(b"answer_length"), None);
    }
}
