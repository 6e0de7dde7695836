use super::*;
use crate::learn::nn::{Parameters, Shape};
use crate::policy::WeightFile;
use crate::random::{Purpose, stream};
use proptest::prelude::*;
use rand::RngExt;
use reagent_core::pipeline::{Mode, Task};
use reagent_core::start::Start;
use std::sync::LazyLock;

fn traced(name: &str) -> Traced {
    let file =
        WeightFile::from_parameters(&Parameters::random(Shape::PAPER, 4)).expect("deployable");
    let rng = &mut stream(1, Purpose::Pairs, 0);
    let mut cloud = || -> Vec<Point> {
        (0..8)
            .map(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0)))
            .collect()
    };
    let (source, target) = (cloud(), cloud());
    let task = Task {
        mode: Mode::Fast,
        steps: 3,
        ..Task::new(Start::at(Pose::IDENTITY))
    };
    let found = crate::register::register(file.policy(), &source, &target, &task).expect("valid");
    Traced {
        header: Header {
            name: name.into(),
            policy: "p".into(),
            source,
            target,
            truth: None,
            initial: Pose::IDENTITY.to_rows(),
            origins: None,
        },
        steps: found.trace,
        answer: None,
    }
}

fn write(text: &[u8]) -> tempfile::NamedTempFile {
    let file = tempfile::NamedTempFile::new().expect("a temporary file");
    std::fs::write(file.path(), text).expect("written");
    file
}

#[test]
fn what_is_written_is_read() {
    let mut two = [traced("a"), traced("b")];
    two[0].answer = Some(FinalAnswer {
        mode: "verify".into(),
        verdict: "converged".into(),
        probability: Some(0.75),
        target_from_source: Pose::IDENTITY.to_rows(),
    });
    let file = write(to_text(&two).expect("encoded").as_bytes());
    assert_eq!(read(file.path(), 9).expect("valid"), (two.to_vec(), 2));
    let (first, count) = read(file.path(), 1).expect("valid");
    assert_eq!((first.as_slice(), count), (&two[..1], 2));
}

#[test]
fn probabilities_are_a_softmax_of_each_axis() {
    let mut logits = [0.0; LOGITS];
    logits[11] = (10.0f32).ln();
    let p = probabilities(&logits);
    assert!((p[0][3] - 1.0 / 11.0).abs() < 1e-6);
    assert!((p[1][0] - 0.5).abs() < 1e-6 && (p[1][1] - 0.05).abs() < 1e-6);
    let huge = probabilities(&[1e30; LOGITS]);
    assert!(huge.iter().flatten().all(|p| p.is_finite()));
}

#[test]
fn what_is_wrong_is_said_with_the_line() {
    let good = to_text(&[traced("a")]).expect("encoded");
    let lines: Vec<&str> = good.lines().collect();
    let reason = |text: String| {
        let file = write(text.as_bytes());
        read(file.path(), 1).expect_err("bad").to_string()
    };
    let case = |text: String, words: &[&str]| {
        let reason = reason(text);
        for word in words {
            assert!(reason.contains(word), "no \"{word}\" in: {reason}");
        }
    };
    case(String::new(), &["no registration"]);
    case(lines[1].into(), &["line 1", "before"]);
    case([lines[0], lines[2]].join("\n"), &["line 2", "step 2"]);
    case(good[..good.len() - 9].into(), &["line 4", "not JSON"]);
    case(
        good.replacen("\"rotation_rad\"", "\"rotations\"", 1),
        &["line 2", "rotation_rad"],
    );
    case(
        good.replacen(
            "\"translation_id\":[",
            "\"translation_id\":[99,0,0],\"x\":[",
            1,
        ),
        &["line 2", "99"],
    );
    case(
        good.replacen("\"source\":[[", "\"source\":[[1e39,0,0],[", 1),
        &["line 1", "source"],
    );
    case("{\"step\": 1}".into(), &["line 1", "not a step"]);
}

proptest! {
    /// Whatever is cut or flipped, the answer is a value or a typed error.
    #[test]
    fn corrupted_traces_never_panic(cut in 0usize..4000, place in 0usize..4000, byte: u8) {
        static TEXT: LazyLock<String> =
            LazyLock::new(|| to_text(&[traced("a")]).expect("encoded"));
        let mut bytes = TEXT.clone().into_bytes();
        let place = place % bytes.len();
        bytes[place] = byte;
        bytes.truncate(bytes.len() - cut.min(bytes.len()));
        let file = write(&bytes);
        let _ = read(file.path(), 2);
    }
}
