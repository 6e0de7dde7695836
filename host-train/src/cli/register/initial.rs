//! Where a registration starts: `--init`.

use crate::pose64::Pose64;
use crate::register::Start;
use anyhow::{Context, bail};
use serde_json::Value;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Longest pose file that is read: a registration's JSON with its steps is far shorter.
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
    /// The start.
    ///
    /// # Errors
    /// A file that cannot be read, or holds no pose.
    pub fn load(self) -> anyhow::Result<Start> {
        match self {
            Initial::Start(start) => Ok(start),
            Initial::File(path) => {
                let pose = read_pose(&path);
                pose.map(Start::Pose)
                    .with_context(|| format!("initial pose {}", path.display()))
            }
        }
    }
}

fn read_pose(path: &Path) -> anyhow::Result<Pose64> {
    let mut text = String::new();
    if path == Path::new("-") {
        std::io::stdin()
            .take(POSE_BYTES)
            .read_to_string(&mut text)?;
    } else {
        File::open(path)?
            .take(POSE_BYTES)
            .read_to_string(&mut text)?;
    }
    let text = text.trim_start_matches('\u{feff}').trim();
    if !text.starts_with('{') {
        return parse_pose(text);
    }
    let document: Value = serde_json::from_str(text).context("it is not JSON")?;
    match document.get("target_from_source") {
        Some(pose) => parse_pose(&pose.to_string()),
        None => bail!("it has no \"target_from_source\""),
    }
}

/// Twelve numbers, the rows of `[R | t]`, or sixteen with the row 0 0 0 1; brackets, commas and white
/// space separate them, as JSON arrays and text files do.
fn parse_pose(text: &str) -> anyhow::Result<Pose64> {
    let numbers = text
        .split(|c: char| c.is_whitespace() || matches!(c, ',' | '[' | ']'))
        .filter(|word| !word.is_empty())
        .map(|word| {
            word.parse::<f64>()
                .with_context(|| format!("\"{word}\" is not a number"))
        })
        .collect::<anyhow::Result<Vec<f64>>>()?;
    let (rows, rest) = numbers.as_chunks::<4>();
    let pose = match (rows, rest) {
        ([a, b, c], []) | ([a, b, c, [0.0, 0.0, 0.0, 1.0]], []) => Pose64::from_rows([*a, *b, *c]),
        _ => bail!(
            "a pose is 12 numbers, the rows of [R | t]; there are {}",
            numbers.len()
        ),
    };
    Ok(pose.checked()?)
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
        std::fs::write(&path, "{\"pose\": []}").expect("written");
        let said = format!("{:#}", Initial::File(path).load().expect_err("no pose"));
        assert!(
            said.contains("r.json") && said.contains("no \"target_from_source\""),
            "{said}"
        );
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
