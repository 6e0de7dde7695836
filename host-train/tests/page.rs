//! The page that registers in a browser gives the poses of the command line, to the bit, and says in sentences what is
//! wrong with a file.

mod support;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::fmt::Write;
use std::path::Path;
use support::browser::{chromium, open};
use support::{fail, folder, succeed};

/// Drives the page as a user does and says what it found.
const DRIVER: &str = include_str!("support/drive_page.js");

#[test]
fn the_page_registers_as_the_command_line_does() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let wasm = root.join("target/page/wasm32-unknown-unknown/release/reagent_page.wasm");
    let Some(browser) = chromium() else {
        eprintln!("skipped: no chromium or google-chrome in PATH to open the page with");
        return;
    };
    if !wasm.exists() {
        eprintln!("skipped: {} is not built", wasm.display());
        return;
    }
    let folder = folder();
    let at = folder.path();
    succeed(
        at,
        &format!("page --wasm {} --out try.html", wasm.display()),
    );

    let mut files = String::from("const FILES = {");
    let data = root.join("host-train/examples/data");
    for name in ["scan", "part"] {
        let file = format!("{name}.ply");
        std::fs::copy(data.join(&file), at.join(&file)).expect("copied");
        let bytes = std::fs::read(at.join(&file)).expect("a sample");
        write!(files, "{name}: '{}',", STANDARD.encode(bytes)).expect("a string");
    }
    let page = std::fs::read_to_string(at.join("try.html")).expect("written");
    let driven = page.replace(
        "</body>",
        &format!("<script>{files}}};{DRIVER}</script></body>"),
    );
    std::fs::write(at.join("driven.html"), driven).expect("written");
    let found = open(&browser, at, "driven.html");

    // The same number may be written in several ways: bits are compared.
    let bits = |text: &str| -> Vec<u64> {
        let numbers = text
            .split_whitespace()
            .map(|x| x.parse::<f64>().expect("a number"));
        numbers.map(f64::to_bits).collect()
    };
    for (key, start) in [("pose", "identity"), ("anywhere", "none")] {
        let command = "register scan.ply part.ply --weights compact --matrix pose.txt";
        succeed(at, &format!("{command} --init {start}"));
        let expected = std::fs::read_to_string(at.join("pose.txt")).expect("written");
        let given = found[key].as_str().expect("text");
        assert_eq!(bits(given), bits(&expected), "{key}: {found}");
    }
    assert_eq!(found["steps"], 11, "{found}");
    let state = found["state"].as_str().expect("text");
    assert!(
        state.starts_with("Verdict: converged. Right with a probability of"),
        "{found}"
    );
    assert_eq!(found["bars"], 66, "{found}");
    assert_eq!(found["waits"], true, "{found}");
    assert_eq!(found["views"], 1, "{found}");
    assert_eq!(found["requests"], 0, "{found}");
    assert!(
        found["where"]
            .as_str()
            .expect("text")
            .starts_with("after step 2"),
        "{found}"
    );

    let errors = found["errors"].as_array().expect("a list");
    for (error, words) in errors.iter().zip([
        "empty.xyz: ",
        "cut.ply: ",
        "photo.png: unknown kind of file; give .ply",
        "one.xyz: all points coincide",
    ]) {
        let error = error.as_str().expect("text");
        assert!(error.starts_with(words) && error.ends_with('.'), "{error}");
    }
}

#[test]
fn kernels_of_a_browser_give_the_bits_of_the_portable_ones() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let wasm = root.join("target/page/wasm32-unknown-unknown/release/examples/kernels.wasm");
    let (Some(browser), Ok(program)) = (chromium(), std::fs::read(&wasm)) else {
        eprintln!(
            "skipped: no chromium in PATH, or {} is not built",
            wasm.display()
        );
        return;
    };
    let folder = folder();
    let page = format!(
        "<body><script>
        const bytes = Uint8Array.from(atob('{}'), (c) => c.charCodeAt(0));
        WebAssembly.instantiate(bytes).then(({{ instance }}) => {{
          console.log('findings ' + instance.exports.compared());
        }});
        </script></body>",
        STANDARD.encode(program)
    );
    std::fs::write(folder.path().join("kernels.html"), page).expect("written");
    assert_eq!(open(&browser, folder.path(), "kernels.html"), 60);
}

#[test]
fn what_is_not_the_program_is_refused() {
    let folder = folder();
    let at = folder.path();
    fail(
        at,
        "page --wasm none.wasm --out p.html",
        &["cannot read none.wasm", "cargo build --release"],
    );
    std::fs::write(at.join("other.wasm"), b"\0asm").expect("written");
    fail(
        at,
        "page --wasm other.wasm --out p.html",
        &["other.wasm is not the page's program"],
    );
    assert!(!at.join("p.html").exists());
}
