//! Object poses on the command line: scenes are generated, poses refined, tables and results written.

mod support;

use serde_json::Value;
use support::{fail, folder, read_json, run, succeed};

const SYNTH: &str =
    "bop-synth --models procedural --scenes 2 --train-scenes 1 --images 1 --size 160x120 --seed 3";

#[test]
fn poses_are_refined_from_estimates_to_results() {
    let folder = folder();
    let at = folder.path();
    let said = succeed(at, &format!("{SYNTH} --out set"));
    assert!(said.contains("3 images of 8 objects in set"), "{said}");

    let eval = "eval --data set --protocol bop --methods icp,init --json";
    let said = succeed(
        at,
        &format!("{eval} one.json --estimates set/estimates.csv --results refined.csv"),
    );
    assert!(said.contains("<0.10d") && said.contains("mean"), "{said}");
    let tables = read_json(&at.join("one.json"));
    let pairs = tables["pairs"].as_u64().expect("a number");
    for method in ["icp", "init"] {
        assert!(tables["methods"][method]["r_iso_deg"].is_number());
        let rows = tables["objects"][method].as_array().expect("rows");
        let sum: u64 = rows.iter().filter_map(|row| row["pairs"].as_u64()).sum();
        assert_eq!(sum, pairs);
        assert!(tables["average_recall"][method]["ar"].as_f64() > Some(5.0));
        for row in rows {
            let percent = |name: &str| row[name].as_f64().expect("a number");
            assert!(percent("ad_02") <= percent("ad_05") && percent("ad_05") <= percent("ad_10"));
            assert!(percent("ad_10") <= 100.0);
            let parts = ["ar_vsd", "ar_mssd", "ar_mspd"].map(percent);
            assert!(parts.iter().all(|ar| (0.0..=100.0).contains(ar)));
            assert!((percent("ar") - parts.iter().sum::<f64>() / 3.0).abs() < 1e-9);
            let symmetric = [4, 8].contains(&row["object"].as_u64().expect("an id"));
            assert_eq!(row["symmetric"], Value::Bool(symmetric), "{row}");
            assert!(row["name"].is_string());
        }
    }

    // Refining the refined poses by nothing leaves the tables as they were.
    succeed(
        at,
        &format!("{eval} two.json --estimates refined-icp.csv --threads 2"),
    );
    let again = read_json(&at.join("two.json"));
    assert_eq!(again["objects"]["init"], tables["objects"]["icp"]);

    let half = format!("{eval} half.json --estimates set/estimates.csv --count 3");
    succeed(at, &half);
    assert_eq!(read_json(&at.join("half.json"))["pairs"], 3);
}

#[test]
fn meshes_of_a_folder_become_objects() {
    let folder = folder();
    let at = folder.path();
    std::fs::create_dir(at.join("meshes")).expect("created");
    let wedge = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n";
    std::fs::write(at.join("meshes/wedge.obj"), wedge).expect("written");
    std::fs::write(at.join("meshes/notes.txt"), "not a mesh").expect("written");
    let synth = "bop-synth --models meshes --scenes 1 --images 1 --size 80x60 --mm-per-unit 150";
    let said = succeed(at, &format!("{synth} --out set"));
    assert!(said.contains("1 objects"), "{said}");
    let info = read_json(&at.join("set/models_eval/models_info.json"));
    let diameter = info["1"]["diameter"].as_f64().expect("a number");
    assert!((diameter - 150.0 * 2f64.sqrt()).abs() < 1e-3, "{diameter}");
    assert_eq!(info["1"]["name"], "wedge");

    fail(at, &format!("{synth} --out set"), &["set", "not empty"]);
    std::fs::write(at.join("meshes/flat.obj"), "v 0 0 0\nv 1 0 0\n").expect("written");
    fail(at, &format!("{synth} --out other"), &["flat.obj"]);
    fail(
        at,
        "bop-synth --models none --out other --scenes 1",
        &["none"],
    );
}

#[test]
fn usage_and_missing_data_are_explained() {
    let folder = folder();
    let at = folder.path();
    for usage in [
        "eval --data set --protocol bop",
        "eval --data procedural --protocol bop --estimates e.csv",
        "eval --data procedural --protocol scan --estimates e.csv",
        "eval --data set --protocol bop --results r.csv",
        "bop-synth --models procedural --out set",
        "bop-synth --models procedural --out set --scenes 1 --size 320",
        "bop-synth --models procedural --out set --scenes 1 --noise -1",
    ] {
        assert_eq!(run(at, usage).status.code(), Some(2), "{usage}");
    }
    fail(
        at,
        "eval --data none --protocol bop --estimates e.csv",
        &["none", "models_eval", "bop-synth"],
    );
}
