//! CDR, the encoding of messages in DDS and the middlewares of ROS 2.

use byteorder::{BigEndian, LittleEndian};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Why bytes are not a message.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum CdrError {
    /// They do not begin as plain CDR does.
    #[error(
        "the message begins with {0:02x?}, and plain CDR with 00 00 or 00 01 and two bytes of options"
    )]
    Encapsulation(Vec<u8>),
    /// They end early, or have impossible contents.
    #[error("the message is not one of its type: {0}")]
    Content(String),
}

/// Encodes a message in little-endian CDR, with the encapsulation header of DDS. Messages hold nothing that CDR cannot.
pub fn to_cdr(message: &impl Serialize) -> Vec<u8> {
    let mut bytes = vec![0, 1, 0, 0];
    let body = cdr_encoding::to_vec::<_, LittleEndian>(message);
    bytes.extend(body.expect("messages hold nothing that CDR does not"));
    bytes
}

/// Decodes a message of either byte order.
///
/// # Errors
/// Bytes that are not a message of the type in plain CDR.
pub fn from_cdr<'b, T: Deserialize<'b>>(bytes: &'b [u8]) -> Result<T, CdrError> {
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
    use crate::dataset::ros::point_cloud2::{Header, Time};

    fn bytes(hex: &str) -> Vec<u8> {
        const_hex::decode(hex.replace(' ', "")).expect("digits")
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
        // A length that no message can have.
        let endless = bytes("00010000 01000000 02000000 ffffffff 61");
        assert!(matches!(header(&endless), Err(CdrError::Content(_))));
    }
}
