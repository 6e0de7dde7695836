//! Results of the trainer's command line: registrations, baselines, the authors' poses.

mod support;

use host_train::dataset::pairs::load_poses;
use host_train::learn::nn::{Parameters, Shape};
use host_train::policy::WeightFile;
use reagent_core::Decision;
use reagent_tests::shared;
use serde_json::Value;
use std::path::PathBuf;
use support::{fail, folder, read_json, run, succeed, without_times, write_weights};

#[test]
fn register_writes_pose_trace_and_the_moved_cloud() {
    let folder = folder();
    let at = folder.path();
    write_weights(&at.join("w.rgw"));
    let cloud = |shift: f32| {
        let point = |i: i32| {
            let a = i as f32 * 0.7;
            format!(
                "{} {} {}\n",
                3.0 * a.sin() + shift,
                2.0 * a.cos(),
                (i % 7) as f32
            )
        };
        (0..200).map(point).collect::<String>()
    };
    std::fs::write(at.join("a.xyz"), cloud(0.5)).expect("written");
    std::fs::write(at.join("b.xyz"), cloud(0.0)).expect("written");
    let text = succeed(
        at,
        "register --weights w.rgw a.xyz b.xyz --mode fast --steps 3 --init 1,0,0,-.5,0,1,0,0,0,0,1,0 --out moved.ply --trace t.jsonl --json r.json",
    );
    assert!(
        text.contains("target_from_source") && text.contains("pose not judged, "),
        "{text}"
    );

    let result = read_json(&at.join("r.json"));
    let trace = std::fs::read_to_string(at.join("t.jsonl")).expect("written");
    let lines: Vec<Value> = trace
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect();
    assert_eq!(lines.len(), 4);
    assert_eq!(lines[0]["registration"]["name"], "a.xyz to b.xyz");
    // The trace has the policy's float32 poses.
    for row in 0..3 {
        for column in 0..4 {
            let number = |value: &Value| value["target_from_source"][row][column].as_f64();
            let (traced, found) = (number(&lines[3]), number(&result));
            let apart = traced.expect("a number") - found.expect("a number");
            assert!(apart.abs() < 1e-6, "{apart}");
        }
    }
    assert_eq!(result["source_points"], 200);

    // The moved cloud lies where the final pose puts it.
    let moved = host_train::dataset::cloud_file::read_cloud(&at.join("moved.ply"), 0)
        .expect("readable")
        .points;
    let row: Vec<f64> = (0..4)
        .map(|i| {
            result["target_from_source"][0][i]
                .as_f64()
                .expect("a number")
        })
        .collect();
    let first = [0.5, 2.0, 0.0];
    let x = row[0] * first[0] + row[1] * first[1] + row[2] * first[2] + row[3];
    assert!((moved[0][0] - x).abs() < 1e-9, "{x} {:?}", moved[0]);
}

/// Beyond the capacity a part of the points is used, the same for every seed, and a note says so.
#[test]
fn clouds_beyond_the_capacity_are_sampled() {
    let folder = folder();
    let at = folder.path();
    write_weights(&at.join("w.rgw"));
    let cloud: String = (0..5000u32)
        .map(|i| format!("{} {} {}\n", i % 17, i % 29, i % 31))
        .collect();
    std::fs::write(at.join("big.xyz"), cloud).expect("written");
    let register = |seed: u32, json: &str| {
        let arguments = format!(
            "register --weights w.rgw big.xyz big.xyz --mode polish --steps 2 --seed {seed} --json {json}"
        );
        let output = run(at, &arguments);
        assert_eq!(output.status.code(), Some(0));
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            stderr.contains("5000") && stderr.contains("2048"),
            "{stderr}"
        );
        without_times(read_json(&at.join(json)))
    };
    let first = register(1, "1.json");
    assert_eq!(first["source_points"], 2048);
    assert_eq!(first, register(2, "again.json"));
}

#[test]
fn agreement_is_with_the_first_policy_along_its_way() {
    let folder = folder();
    let at = folder.path();
    write_weights(&at.join("a.rgw"));
    write_weights(&at.join("same.rgw"));
    let other = WeightFile::from_parameters(&Parameters::random(Shape::PAPER, 6));
    let other = other.expect("deployable").deciding(Decision::default());
    other.save(&at.join("other.rgw")).expect("written");
    let run = "eval --data procedural --protocol m40-models --count 4 --steps 6 --methods policy,init --agreement";
    let text = succeed(
        at,
        &format!("{run} --weights a.rgw same.rgw other.rgw --json all.json"),
    );
    assert!(text.contains("same acts as a on"), "{text}");
    let found = &read_json(&at.join("all.json"))["agreement"];
    assert_eq!(found["same"]["along"], "a");
    assert_eq!(found["same"]["equal"], serde_json::json!(vec![1.0; 6]));
    let shares = found["other"]["equal"].as_array().expect("shares");
    let shares: Vec<f64> = shares.iter().filter_map(Value::as_f64).collect();
    assert_eq!(shares.len(), 6);
    assert!(
        shares.iter().all(|share| (0.0..1.0).contains(share)),
        "{shares:?}"
    );
    // Shares are whole axes of whole pairs.
    assert!(
        shares
            .iter()
            .all(|share| (share * 24.0).fract().abs() < 1e-9),
        "{shares:?}"
    );
}

#[test]
fn results_depend_neither_on_threads_nor_on_the_way_of_the_pairs() {
    let folder = folder();
    let at = folder.path();
    write_weights(&at.join("w.rgw"));
    let draw = "--data procedural --protocol m40-models --count 6 --seed 9";
    succeed(at, &format!("pairs {draw} --out p.h5"));
    let run = "--weights w.rgw --methods policy,icp,init --steps 2 --per-step";
    succeed(
        at,
        &format!("eval {run} --pairs p.h5 --threads 1 --json one.json --poses one.h5"),
    );
    succeed(
        at,
        &format!("eval {run} --pairs p.h5 --threads 3 --json three.json --poses three.h5"),
    );
    succeed(at, &format!("eval {run} {draw} --json drawn.json"));

    let one = read_json(&at.join("one.json"));
    assert_eq!(one["pairs"], 6);
    for other in ["three.json", "drawn.json"] {
        let other = read_json(&at.join(other));
        for name in ["w", "icp", "init"] {
            let row = |document: &Value| without_times(document["methods"][name].clone());
            assert!(row(&one)["r_iso_deg"].is_f64(), "{name}");
            assert_eq!(row(&one), row(&other), "{name}");
        }
    }
    for name in ["w", "icp", "init"] {
        let poses = |file: &str| load_poses(&at.join(file), name).expect("written");
        assert_eq!(poses("one.h5"), poses("three.h5"), "{name}");
    }

    for name in ["w", "icp", "init"] {
        let errors = &one["errors"][name];
        assert_eq!(
            errors,
            &read_json(&at.join("three.json"))["errors"][name],
            "{name}"
        );
        for (list, mean) in [
            ("r_iso_deg", Some("r_iso_deg")),
            ("t_iso", Some("t_iso")),
            ("chamfer_mod", Some("chamfer_mod")),
            ("adi", None),
            ("add", None),
        ] {
            let list: Vec<f64> = serde_json::from_value(errors[list].clone()).expect("numbers");
            assert_eq!(list.len(), 6, "{name}: one error a pair");
            if let Some(mean) = mean {
                let expected = one["methods"][name][mean].as_f64().expect("a number");
                let sum: f64 = list.iter().sum();
                assert!((sum / 6.0 - expected).abs() < 1e-12, "{name} {mean}");
            }
        }
        let quartiles = &one["methods"][name]["quartiles"]["r_iso_deg"];
        assert_eq!(quartiles[1], one["methods"][name]["r_iso_median_deg"]);
    }

    let steps = one["per_step"]["w"].as_array().expect("a row a step");
    assert_eq!(steps.len(), 3);
    assert_eq!(steps[0]["ms_median"], 0.0);
    assert_eq!(steps[0]["r_iso_deg"], one["methods"]["init"]["r_iso_deg"]);
    assert_eq!(steps[2]["adi_auc_pct"], one["methods"]["w"]["adi_auc_pct"]);
    assert_eq!(one["per_step"].as_object().map(|m| m.len()), Some(1));
}

#[test]
fn two_policies_of_one_name_are_refused() {
    let folder = folder();
    let at = folder.path();
    std::fs::create_dir(at.join("other")).expect("made");
    write_weights(&at.join("w.rgw"));
    write_weights(&at.join("other/w.rgw"));
    succeed(
        at,
        "pairs --data procedural --protocol m40-clean --count 1 --out p.h5",
    );
    fail(
        at,
        "eval --weights w.rgw other/w.rgw --pairs p.h5",
        &["\"w\"", "rename"],
    );
}

/// The authors' evaluation loop on the same checkpoint and pairs.
#[test]
fn an_imported_checkpoint_reproduces_the_authors_poses() {
    let paths = [
        shared("fixtures/reference_checkpoint.zip"),
        shared("fixtures/reference_poses.h5"),
        shared("data/pairs_models.h5"),
    ];
    let [Some(checkpoint), Some(poses), Some(pairs)] = paths else {
        return;
    };
    let absolute = |path: PathBuf| {
        path.canonicalize()
            .expect("an existing file")
            .display()
            .to_string()
    };
    let folder = folder();
    let at = folder.path();
    succeed(
        at,
        &format!("import --pytorch {} --out ref.rgw", absolute(checkpoint)),
    );
    succeed(
        at,
        &format!(
            "eval --weights ref.rgw --pairs {} --poses p.h5",
            absolute(pairs)
        ),
    );
    let ours = load_poses(&at.join("p.h5"), "ref").expect("written");
    let theirs = load_poses(&poses, "pred").expect("readable");
    assert_eq!(ours.len(), theirs.len());
    // All rows: float64 takes the same actions as the reference in each, whatever its margin.
    for (row, (a, b)) in ours.iter().zip(&theirs).enumerate() {
        let (a, b) = (a.to_rows(), b.to_rows());
        let worst = a
            .as_flattened()
            .iter()
            .zip(b.as_flattened())
            .map(|(x, y)| (x - y).abs());
        assert!(
            worst.fold(0.0, f32::max) < 1e-4,
            "row {row}: {a:?}, reference {b:?}"
        );
    }
}

/// The hidden part of a view's target is far from the source in any pose.
#[test]
fn of_views_no_chamfer_distance_is_printed() {
    let folder = folder();
    for (data, is_told) in [
        ("views:procedural:2", false),
        ("procedural:2 --protocol m40-clean", true),
    ] {
        let eval = format!("eval --data {data} --methods init");
        let printed = succeed(folder.path(), &eval);
        let row = printed.lines().find(|line| line.starts_with("init "));
        let column = row.and_then(|row| row.split_whitespace().nth(6));
        let distance = column.expect("a row").parse::<f64>();
        assert_eq!(distance.is_ok(), is_told, "{printed}");
        assert!(is_told || column == Some("-"), "{printed}");
    }
}
