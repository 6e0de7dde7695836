use super::*;
use serde_json::json;
use std::fs;

/// Files of every kind in a folder.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let at = folder.path();
    fs::create_dir(at.join("run")).expect("made");
    fs::write(
        at.join("run/config.json"),
        r#"{"stage": "il", "epochs": 2, "seed": 42}"#,
    )
    .expect("written");
    fs::write(at.join("run/metrics.jsonl"), metrics()).expect("written");
    let row = json!({"r_iso_deg": 6.9, "t_iso": 0.05, "recall_r5_t005": 0.775, "ms_median": 5.0});
    let errors = json!({"r_iso_deg": [1.0, 2.0, 40.0], "adi": [0.01, 0.2, null]});
    let eval = json!({
        "pairs": 3,
        "methods": {"reagent": row, "icp": row},
        "per_step": {"reagent": [{"step": 0, "r_iso_deg": 40.0}, {"step": 1, "r_iso_deg": null}]},
        "errors": {"reagent": errors, "icp": errors},
        "objects": {"ape": {"reagent": {"ad_010d_pct": 99.5}, "icp": {"ad_010d_pct": 50.25}}},
    });
    fs::write(at.join("eval.json"), eval.to_string()).expect("written");
    let sample = |value: f64| json!({"value": value, "summary": row, "errors": errors});
    let sweep = json!({"sweep": [{"vary": "noise", "unit": "units", "pairs": 3, "methods": {"icp": [sample(0.1), sample(0.0)]}}]});
    fs::write(at.join("sweep.json"), sweep.to_string()).expect("written");
    let line = |pairs: &str| {
        json!({
            "pairs": pairs,
            "built_in": {"count": 4, "right": 0.5, "auc": null, "brier": 0.125, "risk_coverage": 0.25},
            "outcomes": {"probability": [0.9, 0.8, 0.3, 0.1], "right": [1, 1, 0, 0]},
        })
    };
    let calibration = json!({"weights": [1.0], "quality": [line("Polish Noisy"), line("Verify Noisy"), line("Verify Wrong")]});
    fs::write(at.join("calibration.json"), calibration.to_string()).expect("written");
    folder
}

fn metrics() -> String {
    let update = |i: usize| {
        let loss = if i == 3 {
            json!(null)
        } else {
            json!(2.0 / (i + 1) as f64)
        };
        json!({
            "update": i, "epoch": 0, "lr": 1e-3, "loss": loss, "agreement": 0.1 * i as f64,
            "agreement_axes": [0.1, 0.2, 0.3, 0.4, 0.5, 0.06 * i as f64],
            "action_histogram": vec![i; 11],
        })
        .to_string()
    };
    let mut lines: Vec<String> = (0..5).map(update).collect();
    let validation = json!({"chamfer_mod": 0.01, "r_iso_deg": 6.125, "recall_r5_t005": 0.5});
    lines
        .push(json!({"epoch": 0, "updates": 5, "loss": 1.0, "validation": validation}).to_string());
    lines.join("\n") + "\n"
}

fn html(paths: &[PathBuf]) -> String {
    Report::read(paths)
        .expect("valid inputs")
        .html()
        .expect("drawn")
}

#[test]
fn every_kind_of_input_is_in_the_page() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let page = html(&[at("run"), at("eval.json"), at("sweep.json")]);
    for text in [
        "Evaluation: eval",
        "Sweep: sweep",
        "Training run",
        "<strong>", // equal values are both the best
        "6.125",
        "77.5",
        "99.5",
        "50.2",
        "ADI recall",
        "agreement with the expert by axis",
        "The same throughout, and not drawn: learning rate 0.001",
        "Varied: noise, units, 3 pairs a value",
    ] {
        assert!(page.contains(text), "no {text}");
    }
    assert!(!page.contains("NaN") && !page.contains("id=\"viewer\""));
    // Nothing that a browser would fetch.
    for reference in [
        "src=",
        "url(",
        "@import",
        "fetch(",
        "XMLHttpRequest",
        "href=\"http",
    ] {
        assert!(!page.contains(reference), "{reference}");
    }
}

#[test]
fn verdicts_are_drawn_by_mode_and_kind_of_pairs() {
    let folder = folder();
    let paths = [folder.path().join("calibration.json")];
    let page = html(&paths);
    for text in [
        "Calibration: calibration",
        "Verify, by kind of pairs",
        "Reliability: within 5 degrees and .05",
        "Wrong: area",
        "0.1250",
    ] {
        assert!(page.contains(text), "no {text}");
    }
    let report = Report::read(&paths).expect("valid");
    let plots = folder.path().join("plots");
    assert_eq!(report.write_plots(&plots).expect("written"), 4);
    assert!(plots.join("calibration-verify-risk-coverage.svg").exists());

    let cut =
        json!({"quality": [{"pairs": "Polish Noisy", "built_in": {}, "outcomes": {"right": []}}]});
    fs::write(&paths[0], cut.to_string()).expect("written");
    let refused = Report::read(&paths).expect_err("no probabilities");
    assert!(refused.to_string().contains("outcomes"), "{refused}");
}

/// Such a pair once held up the report for ever.
#[test]
fn a_pair_without_a_probability_is_left_out_of_verdicts() {
    let folder = folder();
    let paths = [folder.path().join("calibration.json")];
    let document = |probability: [Option<f64>; 5]| {
        let outcomes = json!({"probability": probability, "right": [1, 0, 1, 0, 1]});
        let line = json!({"pairs": "Verify Noisy", "built_in": {}, "outcomes": outcomes});
        fs::write(&paths[0], json!({"quality": [line]}).to_string()).expect("written");
        html(&paths)
    };
    let page = document([Some(0.9), Some(0.8), Some(0.3), Some(0.1), None]);
    // Wrong among the one to four most probable: 0, 1, 1 and 2.
    assert!(page.contains("Noisy: area 33.33 %"));
    assert!(!document([None; 5]).contains("Noisy: area"));
}

#[test]
fn an_evaluation_with_probabilities_shows_whether_they_hold() {
    let folder = folder();
    let path = folder.path().join("verified.json");
    let row = json!({"r_iso_deg": 1.0});
    let errors = json!({"r_iso_deg": [1.0, 2.0, 40.0], "t_iso": [0.01, 0.02, 0.5]});
    let eval = json!({
        "methods": {"reagent+verify": row}, "errors": {"reagent+verify": errors},
        "probability": {"reagent+verify": [0.99, 0.9, 0.2]},
    });
    fs::write(&path, eval.to_string()).expect("written");
    let page = html(&[path]);
    assert!(
        page.contains("How far verdicts can be trusted") && page.contains("reagent+verify: area")
    );
}

#[test]
fn runs_are_overlaid_and_told_apart() {
    let folder = folder();
    let other = folder.path().join("other");
    fs::create_dir(&other).expect("made");
    for file in ["config.json", "metrics.jsonl"] {
        fs::copy(folder.path().join("run").join(file), other.join(file)).expect("copied");
    }
    let page = html(&[folder.path().join("run"), other.clone()]);
    assert!(page.contains("Training runs"));
    let legends = page.matches(">\nother\n</text>").count();
    assert!(legends >= 2, "{legends}");
    let of_one = html(&[other]);
    assert!(!of_one.contains(">\nother\n</text>"));
}

#[test]
fn plots_are_svg_and_png() {
    let folder = folder();
    let report = Report::read(&[folder.path().join("eval.json")]).expect("valid");
    let plots = folder.path().join("plots");
    let charts = report.write_plots(&plots).expect("written");
    assert_eq!(fs::read_dir(&plots).expect("made").count(), 2 * charts);
    let bytes = fs::read(plots.join("eval-box-r-iso-deg.png")).expect("written");
    assert!(bytes.starts_with(b"\x89PNG"));
    assert!(plots.join("eval-recall-adi.svg").exists());
}

/// A run that is being written ends within a line; anything else that is cut is an error.
#[test]
fn an_incomplete_last_line_is_left_out_and_said_so() {
    let folder = folder();
    let path = folder.path().join("run/metrics.jsonl");
    fs::write(&path, metrics().trim_end().trim_end_matches('}')).expect("written");
    let report = Report::read(&[folder.path().join("run")]).expect("valid");
    assert!(
        report.notes()[0].contains("last line"),
        "{:?}",
        report.notes()
    );
    assert!(report.html().expect("drawn").contains("class=\"note\""));
}

#[test]
fn bad_inputs_say_what_where_and_what_to_do() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let case = |path: &str, bytes: &[u8], words: &[&str]| {
        fs::write(at(path), bytes).expect("written");
        let input = if path.contains("run/") { "run" } else { path };
        let error = Report::read(&[at(input)]).expect_err("bad").to_string();
        for word in words {
            assert!(error.contains(word), "{path}: no \"{word}\" in: {error}");
        }
    };
    let eval = fs::read(at("eval.json")).expect("written");
    case(
        "e.json",
        &eval[..eval.len() / 2],
        &["e.json, line 1", "cut short"],
    );
    case("e.json", b"", &["e.json", "empty", "again"]);
    case("e.json", b"{\"pairs\": 3}", &["e.json", "neither"]);
    case(
        "e.json",
        b"{\"methods\": []}",
        &["\"methods\" is not an object"],
    );
    case(
        "e.json",
        b"{\"methods\": {}, \"errors\": {\"icp\": {\"adi\": [1, \"x\"]}}}",
        &["\"errors.icp.adi\"", "numbers"],
    );
    case("s.json", b"{\"sweep\": []}", &["\"sweep\""]);
    case(
        "s.json",
        b"{\"sweep\": [{\"vary\": \"noise\"}]}",
        &["\"sweep.0.methods\""],
    );
    case(
        "s.json",
        b"{\"sweep\": [{\"vary\": \"noise\", \"methods\": {\"icp\": [{}]}}]}",
        &["\"sweep.0.methods.icp.0.value\""],
    );
    case("x.png", b"\x89PNG\r\n\x1a\n", &["x.png", "neither"]);
    case("x.txt", b"hello", &["x.txt", "neither"]);
    case(
        "run/metrics.jsonl",
        b"",
        &["metrics.jsonl", "empty", "wait"],
    );
    case(
        "run/metrics.jsonl",
        b"{\"update\": 0",
        &["metrics.jsonl, line 1"],
    );
    case(
        "run/metrics.jsonl",
        b"{\"update\": 0}\n{\"upd\n{}\n",
        &["line 2", "not JSON"],
    );
    case("run/config.json", b"{", &["config.json, line 1"]);
    fs::remove_file(at("run/config.json")).expect("there");
    let error = |path: &str| Report::read(&[at(path)]).expect_err("bad").to_string();
    assert!(error("run").contains("no config.json"), "{}", error("run"));
    assert!(error("none.json").contains("cannot read"));
}

#[test]
fn a_refusal_names_the_key_and_what_belongs_there() {
    let folder = folder();
    let path = folder.path().join("k.json");
    for (document, key, expected) in [
        (json!({"methods": {"icp": 3}}), "methods.icp", "an object"),
        (
            json!({"methods": {}, "per_step": {"a": {}}}),
            "per_step.a",
            "a list",
        ),
        (
            json!({"methods": {}, "per_step": {"a": [{}, null]}}),
            "per_step.a.1",
            "an object",
        ),
        (
            json!({"methods": {}, "probability": {"a": [true]}}),
            "probability.a",
            "a list of numbers",
        ),
        (json!({"sweep": {}}), "sweep", "a list"),
        (json!({"sweep": [{"methods": {}}]}), "sweep.0.vary", "there"),
        (
            json!({"sweep": [{"methods": {}, "vary": "noise", "unit": 3}]}),
            "sweep.0.unit",
            "a text",
        ),
        (
            json!({"sweep": [{"methods": {"a": [{"value": 1}, {"value": 1e100}]}}]}),
            "sweep.0.methods.a.1.value",
            "a number",
        ),
        (
            json!({"sweep": [{"methods": {"a": [{"value": 1, "errors": {"adi": [""]}}]}}]}),
            "sweep.0.methods.a.0.errors.adi",
            "a list of numbers",
        ),
        (json!({"quality": [3]}), "quality.0.outcomes", "there"),
        (
            json!({"quality": [{"outcomes": {"probability": [], "right": []}}]}),
            "quality.0.built_in",
            "there",
        ),
    ] {
        fs::write(&path, document.to_string()).expect("written");
        let error = Report::read(std::slice::from_ref(&path)).expect_err(key);
        let said = format!("k.json: \"{key}\" is not {expected}; write");
        assert!(error.to_string().contains(&said), "{error}");
    }
}

#[test]
fn names_are_stems_unless_they_repeat() {
    let paths = [
        "a/eval.json",
        "b/eval.json",
        "c/other.json",
        "c/other.jsonl",
    ]
    .map(PathBuf::from);
    assert_eq!(
        names(&paths),
        ["a/eval.json", "b/eval.json", "other", "other"]
    );
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(48))]

    /// Whatever bytes are overwritten or cut: a report or a typed error, never a panic.
    #[test]
    fn corrupted_inputs_never_panic(
        which in 0usize..4,
        places in proptest::collection::vec((0usize..4000, proptest::num::u8::ANY), 1..4),
        cut in 0usize..40,
    ) {
        let folder = folder();
        let file = ["eval.json", "sweep.json", "calibration.json", "run/metrics.jsonl"][which];
        let input = if which == 3 { "run" } else { file };
        let path = folder.path().join(file);
        let mut bytes = fs::read(&path).expect("written");
        let length = bytes.len();
        for (place, byte) in places {
            // Digits now and then, so that some documents stay valid with absurd numbers.
            bytes[place % length] = if byte < 128 { b'0' + byte % 10 } else { byte };
        }
        bytes.truncate(length - cut);
        fs::write(&path, bytes).expect("written");
        if let Ok(report) = Report::read(&[folder.path().join(input)]) {
            report.html().expect("drawn");
        }
    }
}
