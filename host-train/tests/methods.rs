//! Baselines and sweeps of the trainer's command line.

mod support;

use reagent_tests::shared;
use serde_json::Value;
use support::{fail, folder, read_json, run, succeed, without_times, write_weights};

const METHODS: &str = "init,icp,icp-plane,icp-trimmed,fgr,fgr-gnc,fgr+icp-plane,policy,policy+icp,policy+polish,policy+verify,init+polish,init+verify";
const NAMES: [&str; 13] = [
    "init",
    "icp",
    "icp-plane",
    "icp-trimmed",
    "fgr",
    "fgr-gnc",
    "fgr+icp-plane",
    "w",
    "w+icp",
    "w+polish",
    "w+verify",
    "init+polish",
    "init+verify",
];

#[test]
fn every_method_runs_and_none_depends_on_the_threads() {
    let folder = folder();
    let at = folder.path();
    write_weights(&at.join("w.rgw"));
    let run = format!(
        "eval --weights w.rgw --methods {METHODS} --data procedural --protocol m40-models --count 4 --steps 3"
    );
    let text = succeed(at, &format!("{run} --threads 1 --json one.json"));
    succeed(at, &format!("{run} --threads 2 --json two.json"));
    let (one, two) = (
        read_json(&at.join("one.json")),
        read_json(&at.join("two.json")),
    );
    for name in NAMES {
        assert!(text.contains(&format!("\n{name} ")), "{name} in\n{text}");
        let row = |document: &Value| without_times(document["methods"][name].clone());
        assert!(row(&one)["r_iso_deg"].is_f64(), "{name}");
        assert_eq!(row(&one), row(&two), "{name}");
        assert_eq!(one["errors"][name], two["errors"][name], "{name}");
        assert_eq!(one["errors"][name]["adi"].as_array().map(Vec::len), Some(4));
    }
    let error = |name: &str| {
        one["methods"][name]["chamfer_mod"]
            .as_f64()
            .expect("a number")
    };
    for name in [
        "icp",
        "icp-plane",
        "icp-trimmed",
        "fgr",
        "fgr-gnc",
        "fgr+icp-plane",
        "init+polish",
        "init+verify",
    ] {
        assert!(error(name) < 0.5 * error("init"), "{name} does something");
    }
    assert_ne!(error("w"), error("w+icp"));
    for name in NAMES {
        let given = one["probability"][name].as_array();
        let has_verdict = name.ends_with("+polish") || name.ends_with("+verify");
        assert_eq!(given.map(Vec::len), has_verdict.then_some(4), "{name}");
    }
    assert_eq!(
        one["methods"].as_object().map(|m| m.len()),
        Some(NAMES.len())
    );
}

/// A method and its results: ISO R mean and median, ISO t mean, ADI AUC, recall.
type Reached = (&'static str, [f64; 5]);

/// Results of Open3D 0.20 on the same pairs. FGR depends on its seed, and ICP after it even more: over eight seeds,
/// Open3D's mean ISO R after it lies between 4.2 and 8.8 degrees on the first file, so its means are not compared.
#[test]
fn baselines_agree_with_open3d() {
    let keys = [
        "r_iso_deg",
        "r_iso_median_deg",
        "t_iso",
        "adi_auc_pct",
        "recall_r5_t005",
    ];
    let table: [(&str, [Reached; 5]); 2] = [
        (
            "pairs_models.h5",
            [
                ("init", [45.6, 47.1, 0.472, 5.4, 0.0]),
                ("icp", [9.39, 0.47, 0.057, 89.5, 0.67]),
                ("icp-plane", [11.07, 0.43, 0.068, 93.5, 0.82]),
                ("fgr", [14.09, 5.18, 0.096, 79.4, 0.42]),
                ("fgr+icp-plane", [8.84, 0.41, 0.045, 96.3, 0.89]),
            ],
        ),
        (
            "pairs_categories.h5",
            [
                ("init", [43.0, 42.2, 0.483, 3.1, 0.0]),
                ("icp", [11.30, 0.72, 0.074, 87.9, 0.63]),
                ("icp-plane", [9.79, 0.42, 0.066, 91.5, 0.83]),
                ("fgr", [11.12, 4.78, 0.082, 82.9, 0.47]),
                ("fgr+icp-plane", [4.28, 0.39, 0.030, 97.3, 0.94]),
            ],
        ),
    ];
    for (file, rows) in table {
        let Some(pairs) = shared(&format!("data/{file}")) else {
            return;
        };
        let folder = folder();
        let pairs = pairs.canonicalize().expect("an existing file");
        let arguments = format!(
            "eval --methods init,icp,icp-plane,fgr,fgr+icp-plane --threads 2 --pairs {} --json e.json",
            pairs.display()
        );
        succeed(folder.path(), &arguments);
        let document = read_json(&folder.path().join("e.json"));
        for (name, theirs) in rows {
            for (key, theirs) in keys.into_iter().zip(theirs) {
                let mean = key == "r_iso_deg" || key == "t_iso";
                let share = match name {
                    "fgr+icp-plane" if mean => continue,
                    "fgr" | "fgr+icp-plane" => 0.2,
                    _ => 0.1,
                };
                let ours = document["methods"][name][key].as_f64().expect("a number");
                assert!(
                    (ours - theirs).abs() <= share * theirs,
                    "{file} {name} {key}: {ours}, Open3D {theirs}"
                );
            }
        }
    }
}

#[test]
fn a_sweep_measures_every_method_at_every_value() {
    let folder = folder();
    let at = folder.path();
    let sweep =
        "sweep --data procedural --protocol m40-models --methods init,icp --count 3 --seed 4";
    let text = succeed(at, &format!("{sweep} --vary noise,overlap --json all.json"));
    assert!(
        text.contains("noise") && text.contains("overlap") && text.contains("icp"),
        "{text}"
    );
    let all = read_json(&at.join("all.json"));
    let varied = all["sweep"].as_array().expect("a list");
    assert_eq!(varied.len(), 2);
    assert_eq!(
        (&varied[0]["vary"], &varied[1]["vary"]),
        (&"noise".into(), &"overlap".into())
    );
    assert_eq!(varied[1]["unit"], "share");
    for one in varied {
        assert_eq!(one["pairs"], 3);
        for name in ["init", "icp"] {
            let at = one["methods"][name].as_array().expect("a list");
            assert!(at.len() >= 5);
            for at in at {
                assert!(at["value"].is_f64() && at["summary"]["quartiles"]["t_iso"][2].is_f64());
                assert_eq!(at["errors"]["add"].as_array().map(Vec::len), Some(3));
            }
        }
    }
    // A single value gives the same result as it did among others.
    succeed(
        at,
        &format!("{sweep} --vary noise --values 0.02 --threads 2 --json one.json"),
    );
    let one = read_json(&at.join("one.json"));
    assert_eq!(
        one["sweep"][0]["methods"]["icp"][0]["errors"],
        varied[0]["methods"]["icp"][2]["errors"]
    );
}

#[test]
fn sweeps_that_make_no_sense_are_bad_usage() {
    let folder = folder();
    let sweep = "sweep --data procedural --count 2 --methods init";
    for (arguments, word) in [
        (
            "--protocol m40-models --vary noise,points --values 1",
            "single",
        ),
        (
            "--protocol m40-models --vary overlap --values 0.5,1.5",
            "1.5",
        ),
        ("--protocol m40-models --vary points --values 10.5", "10.5"),
        ("--protocol m40-clean --vary noise", "m40-models"),
        ("--protocol m40-models --vary colour", "colour"),
    ] {
        let output = run(folder.path(), &format!("{sweep} {arguments}"));
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments}: {stderr}");
        assert!(stderr.contains(word), "{arguments}: {stderr}");
    }
    fail(
        folder.path(),
        "sweep --data absent --protocol scan --vary points --methods init",
        &["absent"],
    );
}
