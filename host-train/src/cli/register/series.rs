//! The steps as a series of `.ply` files, for programs that show clouds.

use crate::dataset::Point;
use crate::dataset::cloud_file::{CloudFile, write_cloud};
use crate::pose64::Pose64;
use crate::register::trace::Traced;
use anyhow::{Context, ensure};
use reagent_core::Pose;
use std::fs;
use std::path::Path;

/// Makes the folder. Refuses one that is not empty, because it could hold the rest of a longer series.
pub(super) fn make_folder(folder: &Path) -> anyhow::Result<()> {
    let named = || folder.display().to_string();
    fs::create_dir_all(folder).with_context(named)?;
    let is_empty = fs::read_dir(folder).with_context(named)?.next().is_none();
    ensure!(is_empty, "{}: it is not empty: name a new folder", named());
    Ok(())
}

/// Writes `target.ply`, and as `source_000.ply` and so on the source in its initial, intermediate and final poses.
pub(super) fn write(folder: &Path, traced: &Traced) -> anyhow::Result<()> {
    let Traced {
        header,
        steps,
        answer,
    } = traced;
    let [_, origin] = header.origins.unwrap_or_default();
    let placed = Pose64 {
        translation: origin.into(),
        ..Pose64::IDENTITY
    };
    let write = |name: &str, points: &[Point]| {
        write_cloud(&folder.join(name), &CloudFile::of(points).moved(&placed))
    };
    write("target.ply", &header.target)?;
    let initial = [header.initial].into_iter();
    let after = steps.iter().map(|step| step.target_from_source);
    let given = answer.iter().map(|given| given.target_from_source);
    for (number, rows) in initial.chain(after).chain(given).enumerate() {
        let pose = Pose::from_rows(rows);
        let moved = |&point: &Point| pose.apply(point.into()).to_array();
        let source: Vec<Point> = header.source.iter().map(moved).collect();
        write(&format!("source_{number:03}.ply"), &source)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::cloud_file::read_file;
    use crate::register::trace::{FinalAnswer, Header};
    use glam::Vec3;

    #[test]
    fn a_series_shows_the_source_in_every_pose_and_takes_no_folder_that_holds_something() {
        let along_x = |x: f32| {
            let translation = Vec3::new(x, 0.0, 0.0);
            let rotation = Pose::IDENTITY.rotation;
            Pose {
                rotation,
                translation,
            }
            .to_rows()
        };
        let traced = Traced {
            header: Header {
                name: String::new(),
                policy: String::new(),
                source: vec![[0.0; 3], [0.0, 1.0, 0.0]],
                target: vec![[5.0; 3]],
                truth: None,
                initial: along_x(1.0),
                origins: Some([[0.0; 3], [5e6, 0.0, 100.0]]),
            },
            steps: Vec::new(),
            answer: Some(FinalAnswer {
                mode: String::new(),
                verdict: String::new(),
                probability: None,
                target_from_source: along_x(2.0),
            }),
        };
        let parent = tempfile::tempdir().expect("a temporary directory");
        let folder = parent.path().join("of/steps");
        make_folder(&folder).expect("a new folder");
        write(&folder, &traced).expect("written");
        let points = |name: &str| {
            let cloud = read_file(&folder.join(name)).expect("a cloud");
            cloud.points
        };
        assert_eq!(points("target.ply"), [[5e6 + 5.0, 5.0, 105.0]]);
        let at = |x| [[5e6 + x, 0.0, 100.0], [5e6 + x, 1.0, 100.0]];
        assert_eq!(points("source_000.ply"), at(1.0));
        assert_eq!(points("source_001.ply"), at(2.0));
        let said = make_folder(&folder)
            .expect_err("it holds files")
            .to_string();
        assert!(
            said.ends_with("it is not empty: name a new folder"),
            "{said}"
        );
    }
}
