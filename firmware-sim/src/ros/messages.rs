//! Messages that the node publishes, in the order of their definitions in `common_interfaces`.

use host_train::dataset::ros::point_cloud2::Header;
use serde::{Deserialize, Serialize};

/// `geometry_msgs/Pose`: position, and a quaternion x, y, z, w.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Pose {
    pub(crate) position: [f64; 3],
    pub(crate) orientation: [f64; 4],
}

/// `geometry_msgs/PoseStamped`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct PoseStamped {
    pub(crate) header: Header,
    pub(crate) pose: Pose,
}

/// `geometry_msgs/PoseWithCovarianceStamped`: rows of the covariance of x, y, z and turns about these axes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct PoseWithCovarianceStamped {
    pub(crate) header: Header,
    pub(crate) pose: Pose,
    pub(crate) covariance: [[f64; 6]; 6],
}

/// `geometry_msgs/TransformStamped`: where the child's frame is in the header's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct TransformStamped {
    pub(crate) header: Header,
    pub(crate) child_frame_id: String,
    /// `geometry_msgs/Transform` has a pose's numbers in a pose's order.
    pub(crate) transform: Pose,
}

/// `tf2_msgs/TFMessage`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Transforms {
    pub(crate) transforms: Vec<TransformStamped>,
}

/// `diagnostic_msgs/KeyValue`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct KeyValue {
    pub(crate) key: String,
    pub(crate) value: String,
}

/// `diagnostic_msgs/DiagnosticStatus`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct DiagnosticStatus {
    pub(crate) level: u8,
    pub(crate) name: String,
    pub(crate) message: String,
    pub(crate) hardware_id: String,
    pub(crate) values: Vec<KeyValue>,
}

/// `diagnostic_msgs/DiagnosticArray`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct DiagnosticArray {
    pub(crate) header: Header,
    pub(crate) status: Vec<DiagnosticStatus>,
}

/// `std_srvs/Trigger_Response`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Triggered {
    pub(crate) success: bool,
    pub(crate) message: String,
}

/// Levels of a diagnostic.
pub(crate) const OK: u8 = 0;
pub(crate) const WARN: u8 = 1;
pub(crate) const ERROR: u8 = 2;

#[cfg(test)]
mod tests {
    use super::*;
    use host_train::dataset::ros::cdr::{from_cdr, to_cdr};
    use host_train::dataset::ros::point_cloud2::Time;

    fn bytes(hex: &str) -> Vec<u8> {
        const_hex::decode(hex.replace([' ', '\n'], "")).expect("digits")
    }

    /// Written by rosbags, a Python implementation of CDR.
    #[test]
    fn a_pose_is_written_as_others_write_it() {
        let message = PoseStamped {
            header: Header {
                stamp: Time { sec: 7, nanosec: 9 },
                frame_id: "cam".into(),
            },
            pose: Pose {
                position: [1.0, -2.0, 0.5],
                orientation: [0.0, 0.0, 0.0, 1.0],
            },
        };
        let written = bytes(
            "00010000 07000000 09000000 04000000 63616d00 000000000000f03f 00000000000000c0 000000000000e03f
             0000000000000000 0000000000000000 0000000000000000 000000000000f03f",
        );
        assert_eq!(to_cdr(&message), written);
        assert_eq!(from_cdr::<PoseStamped>(&written).as_ref(), Ok(&message));
    }
}
