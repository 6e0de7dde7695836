//! Pose estimates in the BOP challenge's results format, one CSV row each: `scene_id,im_id,obj_id,score,R,t,time`. `R` is
//! nine numbers row by row and `t` three (mm), separated by spaces; `time` is in seconds (-1 if it was not measured).

use super::{BopError, json};
use reagent_core::Pose;
use std::path::Path;

const FORMAT: &str = "rows scene_id,im_id,obj_id,score,R,t,time, with R nine numbers of a rotation and t three numbers (mm), separated by spaces";
const HEADER: [&str; 7] = ["scene_id", "im_id", "obj_id", "score", "R", "t", "time"];

/// One estimated pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Scene.
    pub scene: u32,
    /// Image of the scene.
    pub image: u32,
    /// Object.
    pub object: u32,
    /// Confidence, any range.
    pub score: f32,
    /// The pose, translation in millimetres.
    pub camera_from_model: Pose,
    /// Seconds for all estimates in the image, -1 where unknown.
    pub time_s: f32,
}

/// Reads a results file, with or without a first row of column names.
///
/// # Errors
/// A missing or empty file, a row with another number of fields, a field that is not the number it should be, a
/// pose that is not rigid.
pub fn read_results(path: &Path) -> Result<Vec<Estimate>, BopError> {
    let malformed = |reason: String| BopError::Malformed {
        path: path.into(),
        reason,
        expected: FORMAT,
    };
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .from_path(path)
        .map_err(|error| match error.into_kind() {
            csv::ErrorKind::Io(source) if source.kind() == std::io::ErrorKind::NotFound => {
                BopError::Missing {
                    path: path.into(),
                    expected: FORMAT,
                }
            }
            csv::ErrorKind::Io(source) => BopError::Io {
                path: path.into(),
                source,
            },
            other => malformed(format!("{other:?}")),
        })?;
    let mut estimates = Vec::new();
    for (row, record) in reader.records().enumerate() {
        let record = record.map_err(|e| malformed(e.to_string()))?;
        if row == 0 && record.get(0) == Some(HEADER[0]) {
            continue;
        }
        let at = |what: String| malformed(format!("row {}: {what}", row + 1));
        let fields: Vec<&str> = record.iter().collect();
        let Ok(fields) = <[&str; 7]>::try_from(fields) else {
            return Err(at(format!("{} fields", record.len())));
        };
        estimates.push(estimate(fields).map_err(at)?);
    }
    if estimates.is_empty() {
        return Err(BopError::Empty {
            path: path.into(),
            what: "no estimates",
        });
    }
    Ok(estimates)
}

fn estimate(fields: [&str; 7]) -> Result<Estimate, String> {
    let whole = |i: usize| {
        fields[i]
            .parse::<u32>()
            .map_err(|_| format!("{} is {:.40?}, not a whole number", HEADER[i], fields[i]))
    };
    let number = |i: usize| match fields[i].parse::<f32>() {
        Ok(x) if x.is_finite() => Ok(x),
        _ => Err(format!("{} is {:.40?}, not a number", HEADER[i], fields[i])),
    };
    let camera_from_model = json::pose(&numbers(&fields, 4)?, &numbers(&fields, 5)?)
        .ok_or("R and t are not a finite rigid transform")?;
    Ok(Estimate {
        scene: whole(0)?,
        image: whole(1)?,
        object: whole(2)?,
        score: number(3)?,
        camera_from_model,
        time_s: number(6)?,
    })
}

fn numbers<const N: usize>(fields: &[&str; 7], i: usize) -> Result<[f64; N], String> {
    let mut values = [0.0; N];
    let mut words = fields[i].split_ascii_whitespace();
    for value in &mut values {
        let word = words
            .next()
            .ok_or_else(|| format!("{} has fewer than {N} numbers", HEADER[i]))?;
        *value = word
            .parse()
            .map_err(|_| format!("{} holds {word:.40?}, not a number", HEADER[i]))?;
    }
    match words.next() {
        None => Ok(values),
        Some(_) => Err(format!("{} has more than {N} numbers", HEADER[i])),
    }
}

/// Writes a results file with its header.
///
/// # Errors
/// The system's.
pub fn write_results(path: &Path, estimates: &[Estimate]) -> Result<(), BopError> {
    let io = |source| BopError::Io {
        path: path.into(),
        source,
    };
    let failed = |e: csv::Error| io(std::io::Error::other(e));
    let mut writer = csv::Writer::from_path(path).map_err(failed)?;
    writer.write_record(HEADER).map_err(failed)?;
    let words = |values: &[f64]| {
        let words: Vec<String> = values.iter().map(|x| format!("{x:.9}")).collect();
        words.join(" ")
    };
    for e in estimates {
        let (rotation, translation) = json::rows(&e.camera_from_model);
        writer
            .write_record([
                e.scene.to_string(),
                e.image.to_string(),
                e.object.to_string(),
                e.score.to_string(),
                words(&rotation),
                words(&translation),
                e.time_s.to_string(),
            ])
            .map_err(failed)?;
    }
    writer.flush().map_err(io)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use reagent_core::pose::rotation_from_euler;

    fn refused(text: &str) -> String {
        let dir = tempfile::tempdir().expect("temporary directory");
        let path = dir.path().join("results.csv");
        std::fs::write(&path, text).expect("written");
        read_results(&path).expect_err("refused").to_string()
    }

    #[test]
    fn results_survive_a_round_trip_and_need_no_header() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let path = dir.path().join("results.csv");
        let estimate = |i: u32| Estimate {
            scene: 2,
            image: i,
            object: 15,
            score: 0.25,
            camera_from_model: Pose {
                rotation: rotation_from_euler(Vec3::new(0.1, 0.2 * i as f32, -3.0)),
                translation: Vec3::new(-12.5, 40.0, 1234.5),
            },
            time_s: -1.0,
        };
        let all: Vec<Estimate> = (0..5).map(estimate).collect();
        write_results(&path, &all).expect("written");
        let check = || {
            let back = read_results(&path).expect("read");
            assert_eq!(back.len(), 5);
            for (a, b) in back.iter().zip(&all) {
                let (p, q) = (a.camera_from_model, b.camera_from_model);
                assert!(p.rotation.abs_diff_eq(q.rotation, 1e-6));
                assert_eq!((a.image, p.translation), (b.image, q.translation));
            }
        };
        check();
        let text = std::fs::read_to_string(&path).expect("text");
        let (_, rows) = text.split_once('\n').expect("a header");
        std::fs::write(&path, rows).expect("written");
        check();
    }

    #[test]
    fn a_bad_row_is_named() {
        let good = "1,2,3,1.0,1 0 0 0 1 0 0 0 1,0 0 900,-1\n";
        for (bad, words) in [
            ("1,2,3,1.0,1 0 0 0 1 0 0 0 1,0 0 900\n", "6 fields"),
            (
                "1,2,3,1.0,1 0 0 0 1 0 0 0,0 0 900,-1\n",
                "R has fewer than 9",
            ),
            (
                "1,2,3,1.0,1 0 0 0 1 0 0 0 1,0 0 9 9,-1\n",
                "t has more than 3",
            ),
            (
                "1,2,-3,1.0,1 0 0 0 1 0 0 0 1,0 0 900,-1\n",
                "obj_id is \"-3\"",
            ),
            (
                "1,2,3,NaN,1 0 0 0 1 0 0 0 1,0 0 900,-1\n",
                "score is \"NaN\"",
            ),
            (
                "1,2,3,1.0,1 0 0 0 2 0 0 0 1,0 0 900,-1\n",
                "not a finite rigid",
            ),
            ("1,2,3,1.0,1 0 0 0 1 0 0 0 1,0 x 900,-1\n", "t holds \"x\""),
        ] {
            let said = refused(&format!("{good}{bad}"));
            assert!(
                said.contains("row 2") && said.contains(words) && said.contains("results.csv"),
                "{said}"
            );
        }
        assert!(refused("scene_id,im_id,obj_id,score,R,t,time\n").contains("no estimates"));
    }
}
