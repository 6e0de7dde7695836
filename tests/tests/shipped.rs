//! The policies in core/weights: what their records say, and what they do.

use reagent_core::{Policy, Shape};
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
            let sha256 = Sha256::digest(file);
            let hexadecimal: String = sha256.iter().map(|byte| format!("{byte:02x}")).collect();
            assert_eq!(record["weights"][name], *hexadecimal, "{name}");
            let verified = &record["methods"][format!("{name}+verify")];
            assert!(verified["recall_r5_t005"].as_f64() > Some(0.97), "{name}");
        }
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
