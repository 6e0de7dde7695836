//! Numbers by which starts of robots and sessions of clients are told apart.

use sha2::{Digest, Sha256};
use std::hash::{BuildHasher, Hasher, RandomState};
use zenoh::session::ZenohId;

/// A random number, almost certainly different at every start of every robot.
pub(crate) fn draw_instance() -> u32 {
    let [a, b, c, d, ..] = RandomState::new().build_hasher().finish().to_le_bytes();
    u32::from_le_bytes([a, b, c, d])
}

/// The number of a session's liveliness token and of its requests. It belongs to this session alone and reveals nothing else
/// about it.
pub(crate) fn number_of(session: ZenohId) -> u64 {
    let hash: [u8; 32] = Sha256::digest(session.to_le_bytes()).into();
    let [a, b, c, d, e, f, g, h, ..] = hash;
    u64::from_be_bytes([a, b, c, d, e, f, g, h])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clients_in_other_languages_find_the_same_number() {
        // int.from_bytes(hashlib.sha256(0xa1b2.to_bytes(16, "little")).digest()[:8], "big")
        let session: ZenohId = "a1b2".parse().expect("an identity");
        assert_eq!(number_of(session), 0xd182_fe8c_2e62_df9c);
    }
}
