//! The report of a small real run, in a browser: it renders, the slider moves the cloud, and the browser reports no
//! errors and fetches nothing.

mod support;

use std::path::Path;
use std::process::Command;
use support::browser::{chromium, open};
use support::{fail, folder, succeed};

/// Drives the page as a user would, and writes its findings into the document.
const DRIVER: &str = include_str!("support/drive_report.js");

#[test]
fn a_registration_is_written_as_a_page() {
    let folder = folder();
    let at = folder.path();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/data");
    let [scan, part] = ["scan.ply", "part.ply"].map(|name| data.join(name));
    let command = format!(
        "register {} {} --html look.html --trace look.jsonl",
        scan.display(),
        part.display()
    );
    succeed(at, &command);
    // The report shows the trace in the same view.
    succeed(at, "report look.jsonl --out report.html");
    let view = |name: &str| {
        let page = std::fs::read_to_string(at.join(name)).expect("written");
        let (_, view) = page.split_once("scan.ply to part.ply").expect("its name");
        view.to_owned()
    };
    assert_eq!(view("look.html"), view("report.html"));
}

#[test]
fn a_report_works_in_a_browser_without_errors_or_requests() {
    let folder = folder();
    let at = folder.path();
    make_report(at);
    let Some(browser) = chromium() else {
        eprintln!("skipped in part: no chromium or google-chrome in PATH to open the report with");
        return;
    };
    let page = std::fs::read_to_string(at.join("report.html")).expect("written");
    let driven = page.replace("</body>", &format!("<script>{DRIVER}</script></body>"));
    std::fs::write(at.join("driven.html"), driven).expect("written");
    let found = open(&browser, at, "driven.html");

    let number = |key: &str| {
        found[key]
            .as_f64()
            .unwrap_or_else(|| panic!("{key}: {found}"))
    };
    assert!(number("charts") > 25.0, "{found}");
    assert!(number("tables") >= 3.0, "{found}");
    assert_eq!(number("emptyCharts"), 0.0, "{found}");
    // Two pairs of the evaluation and one registration of two files.
    assert_eq!(number("registrations"), 3.0, "{found}");
    assert_eq!(number("steps"), 10.0, "{found}");
    assert_eq!(number("requests"), 0.0, "{found}");
    assert_eq!(found["columns"], serde_json::json!([9, 9, 7]), "{found}");
    assert!(number("overflow") <= 0.0, "{found}");
    for check in [
        "drawn",
        "steady",
        "sliderMoves",
        "keyboardTurns",
        "dragTurns",
        "wheelZooms",
        "resets",
        "legendHides",
        "barsSum",
        "barsChange",
        "rowMarked",
        "rowSelects",
        "errorShown",
        "choiceChanges",
        "playRuns",
    ] {
        assert_eq!(found[check], true, "{check}: {found}");
    }
}

/// A tiny run, an evaluation with a trace, a registration of two files with a trace, and their report.
fn make_report(at: &Path) {
    succeed(
        at,
        "train --data procedural:8 --stage pretrain --points 64 --epochs 8 --out run",
    );
    succeed(
        at,
        "eval --data procedural --protocol m40-models --count 2 --methods policy,icp,init --per-step --json eval.json --trace pairs.jsonl --traced 4",
    );
    let cloud = |shift: f32| {
        let point = |i: u32| {
            let a = i as f32 * 0.7;
            format!("{} {} {}\n", 3.0 * a.sin() + shift, 2.0 * a.cos(), i % 7)
        };
        (0..200).map(point).collect::<String>()
    };
    std::fs::write(at.join("a.xyz"), cloud(0.5)).expect("written");
    std::fs::write(at.join("b.xyz"), cloud(0.0)).expect("written");
    succeed(at, "register a.xyz b.xyz --trace files.jsonl");
    let text = succeed(
        at,
        "report run eval.json pairs.jsonl files.jsonl --out report.html --plots plots",
    );
    assert!(
        text.contains("report.html") && text.contains("charts"),
        "{text}"
    );
    let plots = std::fs::read_dir(at.join("plots")).expect("made").count();
    assert!(plots > 50, "{plots}");
}

#[test]
fn inputs_that_are_none_are_refused_on_one_line() {
    let folder = folder();
    let at = folder.path();
    std::fs::create_dir(at.join("empty")).expect("made");
    std::fs::write(at.join("cut.json"), "{\"methods\": {").expect("written");
    fail(at, "report empty --out r.html", &["config.json", "RUN_DIR"]);
    fail(
        at,
        "report cut.json --out r.html",
        &["cut.json, line 1", "write it again"],
    );
    fail(
        at,
        "report none.json --out r.html",
        &["cannot read none.json"],
    );
    assert!(!at.join("r.html").exists());
}

/// As with `host-train … | head -0`: the reader is gone before anything is written.
#[test]
fn a_closed_pipe_ends_no_command() {
    let folder = folder();
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let both = writer.try_clone().expect("cloned");
    let status = Command::new(env!("CARGO_BIN_EXE_host-train"))
        .current_dir(folder.path())
        .args("pairs --data procedural --protocol m40-clean --count 1 --out p.h5".split(' '))
        .stdout(writer)
        .stderr(both)
        .status()
        .expect("host-train runs");
    assert_eq!(status.code(), Some(0));
    assert!(folder.path().join("p.h5").exists());
}
