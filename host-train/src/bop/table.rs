//! The paper's tables on LINEMOD: the share of poses whose average distance (AD) is below a part of the diameter; and
//! BOP's average recall ([`super::recall`]).
//!
//! AD is ADD, the mean distance of corresponding model points under the true and the estimated pose; for objects with a
//! symmetry it is ADI, the mean distance to the closest point (Hinterstoisser et al., 2012).

use super::recall::{AverageRecall, PoseErrors};
use crate::dataset::bop::{BopModel, Models};
use crate::neighbours::{Neighbours, wide};
use rayon::prelude::*;
use reagent_core::{Error, Pose};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Thresholds of the three tables, in diameters.
pub const THRESHOLDS: [f64; 3] = [0.10, 0.05, 0.02];

/// One row: an object, and the share of its poses that are good.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ObjectRow {
    /// Id of the object.
    pub object: u32,
    /// Its name.
    pub name: String,
    /// Number of poses, including those that were not estimated.
    pub pairs: usize,
    /// Whether ADI was used.
    pub symmetric: bool,
    /// Percent with AD below a tenth of the diameter.
    pub ad_10: f64,
    /// Percent below a twentieth.
    pub ad_05: f64,
    /// Percent below a fiftieth.
    pub ad_02: f64,
    /// BOP's average recalls.
    #[serde(flatten)]
    pub recall: AverageRecall,
}

/// A pose to be measured, millimetres.
#[derive(Clone, Copy, Debug)]
pub struct Estimated {
    /// Object concerned.
    pub object: u32,
    /// Its true pose.
    pub truth: Pose,
    /// The estimated pose; `None` counts as a failure.
    pub estimate: Option<Pose>,
    /// Its errors for BOP's average recall.
    pub errors: PoseErrors,
}

/// AD of an estimate, in diameters of the model. `tree` holds [`BopModel::metric_points`].
pub fn average_distance(model: &BopModel, tree: &Neighbours, truth: &Pose, estimate: &Pose) -> f64 {
    // A rigid motion keeps distances, so everything is measured in the model's frame.
    // Like the BOP toolkit, ADI measures from each true point to the estimated ones.
    let residual = if model.is_symmetric() {
        estimate.inverse().after(*truth)
    } else {
        truth.inverse().after(*estimate)
    };
    let rows = residual.to_rows().map(|row| row.map(f64::from));
    let moved = |p: &[f32; 3]| {
        let [x, y, z] = p.map(f64::from);
        nalgebra::Vector3::from(rows.map(|r| r[0] * x + r[1] * y + r[2] * z + r[3]))
    };
    let points = &model.metric_points;
    let sum: f64 = if model.is_symmetric() {
        let distance = |p| tree.nearest(moved(p)).1.sqrt();
        points.iter().map(distance).sum()
    } else {
        let distance = |p: &[f32; 3]| (moved(p) - wide(*p)).norm();
        points.iter().map(distance).sum()
    };
    sum / points.len() as f64 / model.diameter_mm
}

/// One row for each object that has poses, by id.
///
/// # Errors
/// A model without points. Poses of objects without a model are left out.
pub fn objects(models: &Models, poses: &[Estimated]) -> Result<Vec<ObjectRow>, Error> {
    let mut by_object: BTreeMap<u32, Vec<&Estimated>> = BTreeMap::new();
    for pose in poses {
        by_object.entry(pose.object).or_default().push(pose);
    }
    let mut rows = Vec::new();
    for (object, poses) in by_object {
        let Some(model) = models.get(object) else {
            continue;
        };
        let tree = Neighbours::new(&model.metric_points)?;
        let distances: Vec<f64> = poses
            .par_iter()
            .map(|pose| {
                pose.estimate.map_or(f64::INFINITY, |estimate| {
                    average_distance(model, &tree, &pose.truth, &estimate)
                })
            })
            .collect();
        let percent = |threshold: f64| {
            let good = distances.iter().filter(|&&d| d < threshold).count();
            100.0 * good as f64 / distances.len() as f64
        };
        rows.push(ObjectRow {
            object,
            name: model.name.clone(),
            pairs: distances.len(),
            symmetric: model.is_symmetric(),
            ad_10: percent(THRESHOLDS[0]),
            ad_05: percent(THRESHOLDS[1]),
            ad_02: percent(THRESHOLDS[2]),
            recall: AverageRecall::of(poses.iter().map(|pose| pose.errors)),
        });
    }
    Ok(rows)
}

/// The table as text: a row for each object, then the mean over objects, then BOP's average recalls over all poses.
/// Objects with ADI have a star.
pub fn text(method: &str, rows: &[ObjectRow], recall: &AverageRecall) -> String {
    let names = rows.iter().map(|r| r.name.chars().count());
    let width = names.max().unwrap_or(0).max("object".len()) + 1;
    let mut text = format!(
        "{method}, percent of poses with AD below a part of the diameter (*: ADI), and BOP's average recalls\n\
         {:width$}  poses   <0.10d  <0.05d  <0.02d  VSD     MSSD    MSPD    AR\n",
        "object"
    );
    let mut line = |name: &str, pairs: usize, ad: Option<[f64; 3]>, recall: &AverageRecall| {
        let ad = ad.map(|ad| ad.map(|x| format!("{x:.1}")));
        let [a, b, c] = ad.unwrap_or_default();
        let AverageRecall {
            ar_vsd,
            ar_mssd,
            ar_mspd,
            ar,
        } = recall;
        writeln!(
            text,
            "{name:width$}  {pairs:<6}  {a:<6}  {b:<6}  {c:<6}  {ar_vsd:<6.1}  {ar_mssd:<6.1}  {ar_mspd:<6.1}  {ar:.1}"
        )
        .expect("writing to a string cannot fail");
    };
    for row in rows {
        let star = if row.symmetric { "*" } else { "" };
        let ad = Some([row.ad_10, row.ad_05, row.ad_02]);
        line(&format!("{}{star}", row.name), row.pairs, ad, &row.recall);
    }
    let mean = |f: fn(&ObjectRow) -> f64| rows.iter().map(f).sum::<f64>() / rows.len() as f64;
    let means = [mean(|r| r.ad_10), mean(|r| r.ad_05), mean(|r| r.ad_02)];
    let recalls = AverageRecall {
        ar_vsd: mean(|r| r.recall.ar_vsd),
        ar_mssd: mean(|r| r.recall.ar_mssd),
        ar_mspd: mean(|r| r.recall.ar_mspd),
        ar: mean(|r| r.recall.ar),
    };
    let pairs = rows.iter().map(|r| r.pairs).sum();
    line("mean", pairs, Some(means), &recalls);
    line("all", pairs, None, recall);
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::mesh::Mesh;
    use glam::{Mat3, Vec3};

    fn square(symmetric: bool) -> BopModel {
        let metric_points = vec![
            [-10.0, -10.0, 0.0],
            [10.0, -10.0, 0.0],
            [10.0, 10.0, 0.0],
            [-10.0, 10.0, 0.0],
        ];
        BopModel {
            object: 7,
            name: "square".into(),
            diameter_mm: 10.0 * 8f64.sqrt(),
            symmetries: vec![Pose::IDENTITY; 1 + usize::from(symmetric)],
            mesh: Mesh::default(),
            surface: metric_points.clone(),
            metric_points,
        }
    }

    fn distance(symmetric: bool, estimate: impl Fn(Pose) -> Pose) -> f64 {
        let truth = Pose {
            rotation: Mat3::from_rotation_x(0.8),
            translation: Vec3::new(5.0, -3.0, 700.0),
        };
        let model = square(symmetric);
        let tree = Neighbours::new(&model.metric_points).expect("points");
        average_distance(&model, &tree, &truth, &estimate(truth))
    }

    #[test]
    fn distances_are_those_one_can_see() {
        let turn = |angle: f32| {
            move |truth: Pose| {
                truth.after(Pose {
                    rotation: Mat3::from_rotation_z(angle),
                    translation: Vec3::ZERO,
                })
            }
        };
        let quarter = std::f32::consts::FRAC_PI_2;
        // A quarter turn takes every corner to the next, 20 mm away, but the square looks the same.
        assert!((distance(false, turn(quarter)) - 20.0 / 800f64.sqrt()).abs() < 1e-5);
        assert!(distance(true, turn(quarter)) < 1e-5);
        // A shift of 3 mm towards the camera moves every point by 3 mm, whatever the metric.
        let nearer = |mut pose: Pose| {
            pose.translation.z -= 3.0;
            pose
        };
        assert!((distance(false, nearer) - 3.0 / 800f64.sqrt()).abs() < 1e-4);
        assert!((distance(true, nearer) - 3.0 / 800f64.sqrt()).abs() < 1e-4);
    }

    #[test]
    fn text_has_a_row_an_object_and_the_mean_over_objects() {
        let recall = |ar| AverageRecall {
            ar_vsd: 30.0,
            ar_mssd: 20.0,
            ar_mspd: 10.0,
            ar,
        };
        let row = |object, pairs, ad_10, symmetric| ObjectRow {
            object,
            name: format!("thing{object}"),
            pairs,
            symmetric,
            ad_10,
            ad_05: 10.0,
            ad_02: 0.0,
            recall: recall(ad_10),
        };
        let rows = [row(1, 3, 100.0, false), row(2, 9, 50.0, true)];
        let table = text("icp", &rows, &recall(62.5));
        let words = |line: &str| line.split_whitespace().collect::<Vec<_>>().join(" ");
        let lines: Vec<String> = table.lines().map(words).collect();
        assert_eq!(
            lines[3], "thing2* 9 50.0 10.0 0.0 30.0 20.0 10.0 50.0",
            "{table}"
        );
        assert_eq!(
            lines[4], "mean 12 75.0 10.0 0.0 30.0 20.0 10.0 75.0",
            "{table}"
        );
        assert_eq!(lines[5], "all 12 30.0 20.0 10.0 62.5", "{table}");
    }
}
