//! What the node publishes for each cloud.

use super::messages::{
    DiagnosticArray, DiagnosticStatus, ERROR, KeyValue, OK, PoseStamped, PoseWithCovarianceStamped,
    TransformStamped, Transforms, Triggered, WARN,
};
use super::node::{Member, Publisher};
use super::{Registration, keys, pose};
use host_train::dataset::ros::cdr::from_cdr;
use host_train::dataset::ros::point_cloud2::{Header, PointCloud2};
use host_train::register::request::Done;
use host_train::register::sentences::outcome;
use keys::Qos;
use reagent_core::track::TrackState;
use reagent_core::verdict::Verdict;
use reagent_link::log::one_line;
use serde_json::json;

/// The longest name of a topic or service of the node's own.
pub(super) const LONGEST: &str = "pose_with_covariance";

/// The publishers.
pub(crate) struct Outputs {
    pose: Publisher,
    pose_with_covariance: Publisher,
    diagnostics: Publisher,
    transforms: Option<Transforming>,
    node: String,
    model: String,
}

/// The publisher of transforms.
struct Transforming {
    publisher: Publisher,
    /// The model's frame.
    frame: String,
    /// Why there is no transform from the newest cloud's frame.
    refused: Option<String>,
}

impl Transforming {
    /// Checks a cloud's frame and reports what is wrong with it: `tf2` refuses transforms without a frame, or to the same frame.
    fn look_at(&mut self, cloud: &Header) {
        let wrong = match cloud.frame_id.trim_start_matches('/') {
            "" => Some("the clouds have no frame (frame_id)".into()),
            same if same == self.frame => Some(format!(
                "the frame of the clouds is {same:?}, as that of --tf, which is the model's: give it another name"
            )),
            _ => None,
        };
        let refused = wrong.map(|wrong| format!("no transform is published: {wrong}"));
        if let Some(reason) = &refused
            && self.refused != refused
        {
            eprintln!("{reason}");
        }
        self.refused = refused;
    }
}

impl Outputs {
    /// Declares the publishers of a node that looks for a model.
    pub(crate) async fn declare(
        member: &mut Member,
        model: String,
        frame: Option<String>,
    ) -> zenoh::Result<Outputs> {
        let [pose, with_covariance] = ["pose", LONGEST].map(|topic| member.node.own_topic(topic));
        let node = member.node.full_name().trim_matches('/').to_owned();
        let mut publisher = async |topic, of, qos| member.publisher(topic, of, qos).await;
        Ok(Outputs {
            pose: publisher(&pose, keys::POSE, Qos::Reliable).await?,
            pose_with_covariance: publisher(
                &with_covariance,
                keys::POSE_WITH_COVARIANCE,
                Qos::Reliable,
            )
            .await?,
            diagnostics: publisher("/diagnostics", keys::DIAGNOSTICS, Qos::Reliable).await?,
            transforms: match frame {
                None => None,
                Some(frame) => {
                    let publisher = publisher("/tf", keys::TRANSFORMS, Qos::Transforms);
                    Some(Transforming {
                        publisher: publisher.await?,
                        frame,
                        refused: None,
                    })
                }
            },
            node,
            model,
        })
    }

    /// Registers a message's cloud. Publishes a pose if it is probably right, and always a diagnostic. Also returns the result.
    pub(crate) fn answer(
        &mut self,
        registration: &mut Registration,
        bytes: &[u8],
    ) -> zenoh::Result<Triggered> {
        let cloud = match from_cdr::<PointCloud2>(bytes) {
            Ok(cloud) => cloud,
            Err(error) => return self.refuse(Header::default(), error.to_string()),
        };
        let header = cloud.header.clone();
        if let Some(transforms) = &mut self.transforms {
            transforms.look_at(&header);
        }
        let (done, state) = match registration.register(&cloud) {
            Ok(registered) => registered,
            Err(error) => return self.refuse(header, one_line(error.as_ref())),
        };
        let reagent_core::pipeline::Answer {
            verdict,
            probability,
            ..
        } = done.found.answer;
        // Without a probability nothing judged the pose: the verdict is on the policy's steps.
        let level = match (verdict, probability) {
            (Verdict::Converged, Some(_)) => OK,
            _ => WARN,
        };
        let outcome = outcome(verdict, probability);
        if level == OK {
            self.publish_pose(&header, registration, &done)?;
        }
        let said = match level {
            OK => document(&header, &done),
            _ => format!("no pose is probably right: {outcome}"),
        };
        let mut values = values(&done, state);
        let refused = self.transforms.as_ref().and_then(|tf| tf.refused.clone());
        values.extend(refused.map(|reason| KeyValue {
            key: "tf".into(),
            value: reason,
        }));
        self.tell(header, (level, outcome), values)?;
        Ok(Triggered {
            success: level == OK,
            message: said,
        })
    }

    /// Publishes what is wrong with a cloud.
    fn refuse(&mut self, header: Header, reason: String) -> zenoh::Result<Triggered> {
        self.tell(header, (ERROR, reason.clone()), vec![])?;
        Ok(Triggered {
            success: false,
            message: reason,
        })
    }

    fn publish_pose(
        &mut self,
        header: &Header,
        registration: &Registration,
        done: &Done,
    ) -> zenoh::Result<()> {
        let pose = pose::of(&done.pose);
        if let Some(covariance) = pose::covariance(done, &registration.model) {
            self.pose_with_covariance
                .publish(&PoseWithCovarianceStamped {
                    header: header.clone(),
                    pose,
                    covariance,
                })?;
        }
        if let Some(transforms) = &mut self.transforms
            && transforms.refused.is_none()
        {
            let transform = TransformStamped {
                header: header.clone(),
                child_frame_id: transforms.frame.clone(),
                transform: pose,
            };
            transforms.publisher.publish(&Transforms {
                transforms: vec![transform],
            })?;
        }
        self.pose.publish(&PoseStamped {
            header: header.clone(),
            pose,
        })
    }

    fn tell(
        &mut self,
        header: Header,
        (level, message): (u8, String),
        values: Vec<KeyValue>,
    ) -> zenoh::Result<()> {
        let status = vec![DiagnosticStatus {
            level,
            name: format!("{}: registration", self.node),
            message,
            hardware_id: self.model.clone(),
            values,
        }];
        self.diagnostics
            .publish(&DiagnosticArray { header, status })
    }
}

/// A pose that is probably right, as JSON.
fn document(header: &Header, done: &Done) -> String {
    let pose = pose::of(&done.pose);
    json!({
        "header": header,
        "pose": { "position": pose.position, "orientation": pose.orientation },
        "probability": probability(done),
    })
    .to_string()
}

/// The probability of a refined pose, in ten-thousandths.
fn probability(done: &Done) -> Option<f64> {
    let probability = f64::from(done.found.answer.probability?);
    Some((1e4 * probability).round() / 1e4)
}

/// The values of a diagnostic about a registration.
fn values(done: &Done, state: Option<TrackState>) -> Vec<KeyValue> {
    let mut values = vec![("ms", format!("{:.1}", done.ms))];
    values.extend(state.map(|state| ("state", state.to_string())));
    values.extend(probability(done).map(|p| ("probability", format!("{p:.4}"))));
    if let Some(found) = &done.found.answer.refinement {
        values.extend([
            ("overlap", format!("{:.3}", found.refined.overlap)),
            ("inlier_rmse", format!("{:.6}", found.refined.inlier_rmse)),
            ("open_axis", found.undetermined.axis.is_some().to_string()),
            ("open_slide", found.undetermined.slide.is_some().to_string()),
            ("other_poses", {
                let given = found.refined.target_from_source;
                found.undetermined.copies(given).count().to_string()
            }),
        ]);
    }
    let value = |(key, value): (&str, String)| KeyValue {
        key: key.into(),
        value,
    };
    values.into_iter().map(value).collect()
}
