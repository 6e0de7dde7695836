//! Where a registration starts: `--init`.

use crate::dataset::cloud_file::{STANDARD, npy};
use crate::pose64::Pose64;
use crate::register::Start;
use anyhow::{Context, bail};
use serde_json::{Deserializer, Value};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Longest pose file that is read; a registration's JSON with its steps is far shorter.
const POSE_BYTES: u64 = 1 << 20;

/// A start on the command line, or the file that holds it.
#[derive(Clone, Debug, PartialEq)]
pub enum Initial {
    /// On the command line.
    Start(Start),
    /// In this file; `-` is standard input.
    File(PathBuf),
}

impl FromStr for Initial {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> anyhow::Result<Initial> {
        Ok(match text {
            "none" => Initial::Start(Start::None),
            "identity" => Initial::Start(Start::Identity),
            _ if text.contains(',') => Initial::Start(Start::Pose(parse_pose(text)?)),
            _ => Initial::File(text.into()),
        })
    }
}

impl Initial {
    /// The only start.
    ///
    /// # Errors
    /// As [`Initial::load_all`], and a file with several poses.
    pub fn load(self) -> anyhow::Result<Start> {
        let name = match &self {
            Initial::File(path) => path.display().to_string(),
            Initial::Start(_) => String::new(),
        };
        match *self.load_all()?.as_slice() {
            [start] => Ok(start),
            ref starts => bail!(
                "initial pose {name}: expected one pose, found {}",
                starts.len()
            ),
        }
    }

    /// The start, or all poses of a file.
    ///
    /// # Errors
    /// A file that cannot be read, or holds no pose.
    pub fn load_all(self) -> anyhow::Result<Vec<Start>> {
        match self {
            Initial::Start(start) => Ok(vec![start]),
            Initial::File(path) => {
                let poses = read_poses(&path).with_context(|| match path.exists() || path == Path::new(STANDARD) {
                    true => format!("initial pose {}", path.display()),
                    false => format!(
                        "initial pose \"{}\": give none, identity, 12 numbers separated by commas, or a file with them",
                        path.display()
                    ),
                })?;
                Ok(poses.into_iter().map(Start::Pose).collect())
            }
        }
    }
}

fn read_poses(path: &Path) -> anyhow::Result<Vec<Pose64>> {
    let input: Box<dyn Read> = match path == Path::new(STANDARD) {
        true => Box::new(std::io::stdin()),
        false => Box::new(File::open(path)?),
    };
    let mut bytes = Vec::new();
    input.take(POSE_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > POSE_BYTES {
        bail!("it has more than the {POSE_BYTES} bytes that are read of poses");
    }
    if npy::is(&bytes) {
        return of_rows(npy::matrix(&bytes).map_err(anyhow::Error::msg)?);
    }
    let Ok(text) = String::from_utf8(bytes) else {
        bail!("it is neither text nor a NumPy array");
    };
    let text = text.trim_start_matches('\u{feff}').trim();
    match text.contains('{') {
        true => Ok(vec![of_registration(text)?]),
        false => parse_poses(text),
    }
}

/// The pose of the only registration in the output of `--json`: an object, a line, or a list of one.
fn of_registration(text: &str) -> anyhow::Result<Pose64> {
    let mut registrations = Vec::new();
    for document in Deserializer::from_str(text).into_iter::<Value>() {
        match document.context("it is not JSON")? {
            Value::Array(list) => registrations.extend(list),
            document => registrations.push(document),
        }
    }
    let [registration] = registrations.as_slice() else {
        bail!(
            "it holds {} registrations: keep the one to start from, or of each its \"target_from_source\" alone, to try them all",
            registrations.len()
        );
    };
    match registration.get("target_from_source") {
        Some(pose) => parse_pose(&pose.to_string()),
        None => bail!("it has no \"target_from_source\""),
    }
}

/// One pose, as [`parse_poses`] reads it.
fn parse_pose(text: &str) -> anyhow::Result<Pose64> {
    match *parse_poses(text)?.as_slice() {
        [pose] => Ok(pose),
        ref poses => bail!("expected one pose, found {}", poses.len()),
    }
}

/// Parses poses of twelve numbers, the rows of `[R | t]`, or of sixteen with the row 0 0 0 1. Brackets, commas and
/// white space separate them, as in JSON arrays and text files. What follows a `#` is a comment.
fn parse_poses(text: &str) -> anyhow::Result<Vec<Pose64>> {
    let content = |line: &'_ str| line.find('#').unwrap_or(line.len());
    let lines = text.lines().map(|line| &line[..content(line)]);
    let is_between = |c: char| c.is_whitespace() || matches!(c, ',' | '[' | ']');
    let numbers = lines
        .flat_map(|line| line.split(is_between))
        .filter(|word| !word.is_empty())
        .map(|word| {
            word.parse::<f64>()
                .with_context(|| format!("\"{word}\" is not a number"))
        })
        .collect::<anyhow::Result<Vec<f64>>>()?;
    of_rows(numbers)
}

/// Poses as rows of four numbers.
fn of_rows(numbers: Vec<f64>) -> anyhow::Result<Vec<Pose64>> {
    let (rows, rest) = numbers.as_chunks::<4>();
    let is_square = rows
        .chunks(4)
        .all(|rows| rows.get(3) == Some(&[0.0, 0.0, 0.0, 1.0]));
    let each = if is_square { 4 } else { 3 };
    if rows.is_empty() || !rest.is_empty() || !rows.len().is_multiple_of(each) {
        let last = match rows {
            [.., [a, b, c, d]] if numbers.len() == 16 => {
                format!(" with the last row {a} {b} {c} {d}; are they by columns?")
            }
            _ => String::new(),
        };
        bail!(
            "a pose is 12 numbers, the rows of [R | t], or 16 with the row 0 0 0 1; there are {}{last}",
            numbers.len()
        );
    }
    let pose = |rows: &[[f64; 4]]| Ok(Pose64::from_rows([rows[0], rows[1], rows[2]]).checked()?);
    rows.chunks(each).map(pose).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    #[test]
    fn poses_are_read_from_numbers_and_json() {
        let turned = "0,-1,0,.5, 1,0,0,-2, 0,0,1,5456871.1234";
        let pose = parse_pose(turned).expect("twelve numbers");
        assert_eq!(pose.translation, Vector3::new(0.5, -2.0, 5_456_871.123_4));
        let json = "[[0,-1,0,0.5],[1,0,0,-2],[0,0,1,5456871.1234]]\n";
        assert_eq!(parse_pose(json).expect("twelve numbers"), pose);
        let text = "0 -1 0 .5\n1 0 0 -2\n0 0 1 5456871.1234\n0 0 0 1\n";
        assert_eq!(parse_pose(text).expect("sixteen numbers"), pose);
        assert_eq!(
            "none".parse::<Initial>().expect("a word"),
            Initial::Start(Start::None)
        );
    }

    #[test]
    fn a_pose_is_read_from_an_array_of_numpy() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("pose.npy");
        let rows = [
            [0.0, -1.0, 0.0, 0.5],
            [1.0, 0.0, 0.0, -2.0],
            [0.0, 0.0, 1.0, 3.0],
            [0.0, 0.0, 0.0, 1.0f64],
        ];
        let loaded = |bytes: &[u8]| {
            std::fs::write(&path, bytes).expect("written");
            let start = Initial::File(path.clone()).load();
            start.map_err(|e| format!("{e:#}"))
        };
        for rows in [&rows[..], &rows[..3]] {
            let numbers = rows.as_flattened().iter();
            let numbers: Vec<u8> = numbers.flat_map(|x| x.to_le_bytes()).collect();
            let array = [npy::header("<f8", &[rows.len(), 4]), numbers].concat();
            let Ok(Start::Pose(pose)) = loaded(&array) else {
                panic!("another start");
            };
            assert_eq!(pose.translation, Vector3::new(0.5, -2.0, 3.0));
            let said = loaded(&array[..array.len() - 8]).expect_err("cut off");
            assert!(
                said.contains("pose.npy") && said.contains("cut off"),
                "{said}"
            );
        }
        let said = loaded(&[0xff, 0xfe, 0x00]).expect_err("no text");
        assert!(
            said.contains("it is neither text nor a NumPy array"),
            "{said}"
        );
    }

    #[test]
    fn the_document_of_a_registration_is_a_start() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("r.json");
        let document = r#"{"target_from_source": [[0,-1,0,0.5],[1,0,0,-2],[0,0,1,3]], "verdict": "converged",
            "policy": {"target_from_source": [[1,0,0,0],[0,1,0,0],[0,0,1,0]]}}"#;
        std::fs::write(&path, document).expect("written");
        let Start::Pose(pose) = Initial::File(path.clone()).load().expect("a pose") else {
            panic!("another start");
        };
        assert_eq!(pose.translation, Vector3::new(0.5, -2.0, 3.0));
        let said = format!(
            "{:#}",
            "abc"
                .parse::<Initial>()
                .expect("a name")
                .load()
                .expect_err("no file")
        );
        assert!(said.contains("\"abc\": give none, identity,"), "{said}");
        std::fs::write(&path, "{\"pose\": []}").expect("written");
        let said = format!("{:#}", Initial::File(path).load().expect_err("no pose"));
        assert!(
            said.contains("r.json") && said.contains("no \"target_from_source\""),
            "{said}"
        );
    }

    /// A line about one of many pairs, and such lines as a list.
    #[test]
    fn the_only_registration_of_a_list_is_a_start() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("r.jsonl");
        let loaded = |text: &str| {
            std::fs::write(&path, text).expect("written");
            let start = Initial::File(path.clone()).load();
            start.map_err(|e| format!("{e:#}"))
        };
        let line = r#"{"source": "a.ply", "target_from_source": [[1,0,0,2],[0,1,0,3],[0,0,1,4]]}"#;
        let alone = loaded(line);
        assert!(matches!(alone, Ok(Start::Pose(_))), "{alone:?}");
        for text in [
            format!("[{line}]"),
            format!(" [\n{line}\n]\n"),
            format!("{line}\n"),
        ] {
            assert_eq!(loaded(&text), alone, "{text}");
        }
        for text in [format!("{line}\n{line}\n"), format!("[{line}, {line}]")] {
            let said = loaded(&text).expect_err("two");
            let words = "r.jsonl: it holds 2 registrations: keep the one";
            assert!(said.contains(words), "{said}");
        }
        for (text, words) in [
            (
                r#"[{"source": "a.ply", "error": "no points"}]"#,
                "no \"target_from_source\"",
            ),
            (&format!("[{line}"), "it is not JSON"),
            (&format!("{line} 1,2"), "it is not JSON"),
        ] {
            let said = loaded(text).expect_err(words);
            assert!(said.contains(words), "{said}");
        }
    }

    #[test]
    fn a_file_holds_several_poses() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("starts.json");
        let loaded = |text: &str| {
            std::fs::write(&path, text).expect("written");
            let starts = Initial::File(path.clone()).load_all();
            starts
                .map(|starts| starts.len())
                .map_err(|e| format!("{e:#}"))
        };
        let square = "[[1,0,0,2],[0,1,0,3],[0,0,1,4],[0,0,0,1]]";
        let rows = "[[1,0,0,2],[0,1,0,3],[0,0,1,4]]";
        for (pose, several) in [square, rows]
            .into_iter()
            .flat_map(|p| [(p, 1), (p, 3), (p, 4)])
        {
            let list = vec![pose; several].join(",");
            assert_eq!(loaded(&format!("[{list}]")), Ok(several));
            assert_eq!(loaded(&list.replace([',', '[', ']'], " ")), Ok(several));
        }
        let said = Initial::File(path.clone())
            .load()
            .expect_err("several")
            .to_string();
        assert!(
            said.contains("starts.json: expected one pose, found 4"),
            "{said}"
        );
        let said = loaded(&format!("[{square}, {rows}]")).expect_err("28 numbers");
        assert!(
            said.contains("starts.json") && said.contains("there are 28"),
            "{said}"
        );
        assert!(loaded("[]").expect_err("nothing").contains("there are 0"));
        let long = loaded(&" ".repeat(1 << 21)).expect_err("too long");
        assert!(long.contains("more than"), "{long}");
    }

    #[test]
    fn what_is_no_pose_is_refused_with_the_reason() {
        let reason = |text: &str| format!("{:#}", parse_pose(text).expect_err("not a pose"));
        assert!(reason("1,2,3").contains("there are 3"));
        assert!(reason("1,0,0,0,0,one,0,0,0,0,1,0").contains("\"one\" is not a number"));
        assert!(reason("2,0,0,0,0,1,0,0,0,0,1,0").contains("rigid"));
        assert!(reason("1,0,0,nan,0,1,0,0,0,0,1,0").contains("pose"));
    }

    proptest! {
        #[test]
        fn no_text_is_more_than_refused(text in r"[-+.,0-9eEnaif\[\] \n]{0,80}", numbers in prop::collection::vec(any::<f64>(), 0..18)) {
            let listed: Vec<String> = numbers.iter().map(f64::to_string).collect();
            for text in [text, listed.join(",")] {
                if let Ok(pose) = parse_pose(&text) {
                    prop_assert!(pose.to_rows().iter().flatten().all(|x| x.is_finite()));
                }
            }
        }
    }
}
