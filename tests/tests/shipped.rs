//! The policies in core/weights: their records and their results.

use host_train::dataset::procedural;
use host_train::measure::eval::{EvalSettings, evaluate};
use host_train::measure::method::{Contestant, Finish, Start};
use host_train::protocol::{self, Protocol};
use reagent_core::dims::STEPS;
use reagent_core::pipeline::Mode;
use reagent_core::{Decision, Policy, Shape};
use sha2::{Digest, Sha256};

const RECORDS: [&str; 2] = [
    include_str!("../../core/weights/evaluation-models.json"),
    include_str!("../../core/weights/evaluation-categories.json"),
];

fn shipped() -> [(&'static str, &'static [u8]); 3] {
    [
        ("reagent", Policy::pretrained_bytes()),
        ("reagent-int8", Policy::pretrained_int8_bytes()),
        ("reagent-compact-int8", Policy::pretrained_compact_bytes()),
    ]
}

#[test]
fn records_are_of_the_files_beside_them() {
    for record in RECORDS {
        let record: serde_json::Value = serde_json::from_str(record).expect("JSON");
        for (name, file) in shipped() {
            assert_eq!(record["weights"][name], *sha256(file), "{name}");
            let verified = &record["methods"][format!("{name}+verify")];
            assert!(verified["recall_r5_t005"].as_f64() > Some(0.97), "{name}");
        }
    }
}

fn sha256(file: &[u8]) -> String {
    let digest = Sha256::digest(file);
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn the_record_of_the_policies_for_views_is_of_the_files_beside_it() {
    let record = include_str!("../../core/weights/evaluation-views.json");
    let record: serde_json::Value = serde_json::from_str(record).expect("JSON");
    let files: [(&str, &[u8], f64); 3] = [
        (
            "views",
            include_bytes!("../../core/weights/views.rgw"),
            80.0,
        ),
        (
            "views-int8",
            include_bytes!("../../core/weights/views-int8.rgw"),
            80.0,
        ),
        (
            "views-compact-int8",
            include_bytes!("../../core/weights/views-compact-int8.rgw"),
            45.0,
        ),
    ];
    for (name, file, least) in files {
        assert_eq!(record["weights"][name], *sha256(file), "{name}");
        let alone = &record["methods"][name]["ad05_pct"];
        assert!(alone.as_f64() > Some(least), "{name}: {alone}");
    }
}

#[test]
fn each_is_of_its_shape_and_size() {
    let shapes = shipped().map(|(_, file)| Policy::parse(file).map(|policy| policy.shape));
    assert_eq!(
        shapes,
        [Ok(Shape::FULL), Ok(Shape::FULL), Ok(Shape::COMPACT)]
    );
    assert!(Policy::pretrained_compact_bytes().len() <= 256 * 1024);
}

#[test]
fn each_reaches_on_shapes_of_its_own_what_it_is_shipped_for() {
    let pairs = protocol::draw(&procedural::models(40, 40), Protocol::M40Models, 40, 4);
    let settings = EvalSettings {
        steps: STEPS,
        threads: 2,
        per_step: false,
    };
    for (name, file) in shipped() {
        let policy = Policy::parse(file).expect("a sound policy");
        assert_eq!(policy.decision, Decision::BothWays, "{name}");
        let contestants: Vec<Contestant<'_>> = [
            Start::Policy(policy).then(Finish::Nothing),
            Start::Policy(policy).then(Finish::Core(Mode::Verify)),
        ]
        .into_iter()
        .zip(["alone", "verified"])
        .map(|(method, name)| Contestant {
            name: name.into(),
            method,
        })
        .collect();
        let found = evaluate(&pairs, &contestants, &settings, &|| {}).expect("sound pairs");
        let [alone, verified] = [0, 1].map(|i| &found[i].row.summary);
        assert!(alone.r_iso_median_deg < 2.5, "{name}: {alone:?}");
        assert!(alone.recall_r5_t005 > 0.75, "{name}: {alone:?}");
        assert!(verified.r_iso_deg < 1.5, "{name}: {verified:?}");
        assert!(verified.recall_r5_t005 > 0.95, "{name}: {verified:?}");
    }
}
