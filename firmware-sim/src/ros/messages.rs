//! Messages, in the order of their definitions in `common_interfaces`, and their CDR.

use byteorder::{BigEndian, LittleEndian};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// `builtin_interfaces/Time`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Time {
    pub(crate) sec: i32,
    pub(crate) nanosec: u32,
}

/// `std_msgs/Header`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Header {
    pub(crate) stamp: Time,
    pub(crate) frame_id: String,
}

/// `sensor_msgs/PointField`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct PointField {
    pub(crate) name: String,
    pub(crate) offset: u32,
    pub(crate) datatype: u8,
    pub(crate) count: u32,
}

/// `sensor_msgs/PointCloud2`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct PointCloud2 {
    pub(crate) header: Header,
    pub(crate) height: u32,
    pub(crate) width: u32,
    pub(crate) fields: Vec<PointField>,
    pub(crate) is_bigendian: bool,
    pub(crate) point_step: u32,
    pub(crate) row_step: u32,
    pub(crate) data: Vec<u8>,
    pub(crate) is_dense: bool,
}

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

/// Levels of a diagnostic.
pub(crate) const OK: u8 = 0;
pub(crate) const WARN: u8 = 1;
pub(crate) const ERROR: u8 = 2;

/// Why bytes are no message.
#[derive(Debug, Error, PartialEq, Eq)]
pub(crate) enum CdrError {
    /// They begin otherwise than plain CDR does.
    #[error(
        "the message begins with {0:02x?}, and plain CDR with 00 00 or 00 01 and two bytes of options"
    )]
    Encapsulation(Vec<u8>),
    /// They end early, or hold what cannot be.
    #[error("the message is not one of its type: {0}")]
    Content(String),
}

/// Little-endian, with the encapsulation header of DDS.
pub(crate) fn to_cdr(message: &impl Serialize) -> Vec<u8> {
    let mut bytes = vec![0, 1, 0, 0];
    let body = cdr_encoding::to_vec::<_, LittleEndian>(message);
    bytes.extend(body.expect("messages hold nothing that CDR does not"));
    bytes
}

/// In either byte order.
pub(crate) fn from_cdr<'b, T: Deserialize<'b>>(bytes: &'b [u8]) -> Result<T, CdrError> {
    let read = match bytes {
        [0, 1, _, _, body @ ..] => cdr_encoding::from_bytes::<T, LittleEndian>(body),
        [0, 0, _, _, body @ ..] => cdr_encoding::from_bytes::<T, BigEndian>(body),
        _ => return Err(CdrError::Encapsulation(bytes[..bytes.len().min(4)].into())),
    };
    let read = read.map_err(|error| CdrError::Content(error.to_string()))?;
    Ok(read.0)
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn both_byte_orders_are_read_and_what_is_neither_is_refused() {
        let header = |bytes: &[u8]| from_cdr::<Header>(bytes);
        let expected = Header {
            stamp: Time { sec: 1, nanosec: 2 },
            frame_id: "a".into(),
        };
        let little = bytes("00010000 01000000 02000000 02000000 6100");
        let big = bytes("00000000 00000001 00000002 00000002 6100");
        assert_eq!(
            (header(&little).as_ref(), header(&big).as_ref()),
            (Ok(&expected), Ok(&expected))
        );
        assert!(matches!(header(&[]), Err(CdrError::Encapsulation(_))));
        assert!(matches!(
            header(&bytes("00070000 01000000")),
            Err(CdrError::Encapsulation(_))
        ));
        for cut in 4..little.len() {
            assert!(
                matches!(header(&little[..cut]), Err(CdrError::Content(_))),
                "{cut}"
            );
        }
        // A length that no message has.
        let endless = bytes("00010000 01000000 02000000 ffffffff 61");
        assert!(matches!(header(&endless), Err(CdrError::Content(_))));
    }
}
