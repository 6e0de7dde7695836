//! Zenoh key expressions. Names are checked, so none can contain a wildcard or a slash.
//!
//! ```text
//! reagent/v1/<fleet>/policy/manifest
//! reagent/v1/<fleet>/policy/<sha256>/<n>
//! reagent/v1/<fleet>/policy/<sha256>/table
//! reagent/v1/<fleet>/robot/<id>/refine
//! reagent/v1/<fleet>/robot/<id>/status
//! reagent/v1/<fleet>/robot/<id>/alive
//! reagent/v1/<fleet>/robot/<id>/trace
//! reagent/v1/<fleet>/robot/<id>/cancel
//! reagent/v1/<fleet>/client/<number>/alive
//! ```

use crate::error::Error;
use core::fmt::{self, Write};

/// Longest fleet or robot name, bytes.
pub const NAME_BYTES: usize = 32;
/// A key expression; all those defined here fit.
pub type Key = heapless::String<160>;

/// Where the signed manifest of the newest policy is published and answered.
pub fn manifest(fleet: &str) -> Result<Key, Error> {
    key(format_args!("{}/policy/manifest", Fleet::new(fleet)?))
}

/// Where chunk `index` of the policy file with this SHA-256 is answered.
pub fn chunk(fleet: &str, sha256: &[u8; 32], index: u32) -> Result<Key, Error> {
    let (fleet, sha256) = (Fleet::new(fleet)?, Hex(sha256));
    key(format_args!("{fleet}/policy/{sha256}/{index}"))
}

/// Where the table of chunks of the policy file with this SHA-256 is answered.
pub fn table(fleet: &str, sha256: &[u8; 32]) -> Result<Key, Error> {
    let (fleet, sha256) = (Fleet::new(fleet)?, Hex(sha256));
    key(format_args!("{fleet}/policy/{sha256}/table"))
}

/// Whether this is the key of a table of chunks.
pub fn is_table(key: &str) -> bool {
    key.rsplit_once('/')
        .is_some_and(|(_, leaf)| leaf == "table")
}

/// All chunks of the policy file with this SHA-256, and their table.
pub fn chunks(fleet: &str, sha256: &[u8; 32]) -> Result<Key, Error> {
    let (fleet, sha256) = (Fleet::new(fleet)?, Hex(sha256));
    key(format_args!("{fleet}/policy/{sha256}/*"))
}

/// Where a robot answers refine requests.
pub fn refine(fleet: &str, robot: &str) -> Result<Key, Error> {
    of_robot(fleet, robot, "refine")
}

/// Where a robot publishes and answers its status.
pub fn status(fleet: &str, robot: &str) -> Result<Key, Error> {
    of_robot(fleet, robot, "status")
}

/// Liveliness token of a robot.
pub fn alive(fleet: &str, robot: &str) -> Result<Key, Error> {
    of_robot(fleet, robot, "alive")
}

/// Where a robot publishes traces of the registrations that it is asked to trace.
pub fn trace(fleet: &str, robot: &str) -> Result<Key, Error> {
    of_robot(fleet, robot, "trace")
}

/// The traces of every robot of the fleet.
pub fn all_traces(fleet: &str) -> Result<Key, Error> {
    key(format_args!("{}/robot/*/trace", Fleet::new(fleet)?))
}

/// Where a robot listens for cancelled requests.
pub fn cancel(fleet: &str, robot: &str) -> Result<Key, Error> {
    of_robot(fleet, robot, "cancel")
}

/// Liveliness token of a client.
pub fn client_alive(fleet: &str, client: u64) -> Result<Key, Error> {
    let fleet = Fleet::new(fleet)?;
    key(format_args!("{fleet}/client/{client:016x}/alive"))
}

/// The liveliness tokens of every client of the fleet.
pub fn all_clients_alive(fleet: &str) -> Result<Key, Error> {
    key(format_args!("{}/client/*/alive", Fleet::new(fleet)?))
}

/// The client of a key. Only the spelling of [`client_alive`] counts: a token under another one would be a second token of the
/// same client.
pub fn client_of(key: &str) -> Option<u64> {
    let mut parts = key.split('/').skip(3);
    let number = (parts.next() == Some("client")).then(|| parts.next())??;
    let spelled = number.len() == 16
        && number
            .bytes()
            .all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
    spelled.then(|| u64::from_str_radix(number, 16).ok())?
}

/// The status of every robot of the fleet.
pub fn all_status(fleet: &str) -> Result<Key, Error> {
    key(format_args!("{}/robot/*/status", Fleet::new(fleet)?))
}

/// The liveliness tokens of every robot of the fleet.
pub fn all_alive(fleet: &str) -> Result<Key, Error> {
    key(format_args!("{}/robot/*/alive", Fleet::new(fleet)?))
}

/// The robot of a key.
pub fn robot_of(key: &str) -> Option<&str> {
    let mut parts = key.split('/').skip(3);
    (parts.next() == Some("robot")).then(|| parts.next())?
}

/// The number of the chunk of a key, in the one spelling that [`chunk`] gives it.
pub fn chunk_index(key: &str) -> Option<u32> {
    let number = key.rsplit_once('/')?.1;
    let spelled = number == "0" || number.starts_with(|c: char| matches!(c, '1'..='9'));
    spelled.then(|| number.parse().ok())?
}

fn of_robot(fleet: &str, robot: &str, leaf: &str) -> Result<Key, Error> {
    key(format_args!(
        "{}/robot/{}/{leaf}",
        Fleet::new(fleet)?,
        checked_name(robot)?
    ))
}

/// The name, if it is 1 to 32 characters of `a-z A-Z 0-9 _ -`.
pub fn checked_name(name: &str) -> Result<&str, Error> {
    let allowed = |b: u8| b.is_ascii_alphanumeric() || b == b'_' || b == b'-';
    let fits = (1..=NAME_BYTES).contains(&name.len());
    if fits && name.bytes().all(allowed) {
        Ok(name)
    } else {
        Err(Error::Name)
    }
}

fn key(text: fmt::Arguments<'_>) -> Result<Key, Error> {
    let mut key = Key::new();
    key.write_fmt(text).map_err(|_| Error::Name)?;
    Ok(key)
}

/// The common prefix of a fleet's keys.
struct Fleet<'a>(&'a str);

impl<'a> Fleet<'a> {
    fn new(name: &'a str) -> Result<Self, Error> {
        checked_name(name).map(Fleet)
    }
}

impl fmt::Display for Fleet<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "reagent/v1/{}", self.0)
    }
}

/// Bytes as lower-case hexadecimal digits.
pub struct Hex<'a>(pub &'a [u8]);

impl fmt::Display for Hex<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_these_characters() {
        let sha = [0xa5; 32];
        let hex = "a5".repeat(32);
        let text = |key: Result<Key, Error>| key.map(|k| String::from(k.as_str()));
        let expected = |s: &str| Ok(format!("reagent/v1/dock-7/{s}"));
        assert_eq!(text(manifest("dock-7")), expected("policy/manifest"));
        assert_eq!(
            text(chunk("dock-7", &sha, 12)),
            expected(&format!("policy/{hex}/12"))
        );
        assert_eq!(
            text(chunks("dock-7", &sha)),
            expected(&format!("policy/{hex}/*"))
        );
        assert_eq!(
            text(table("dock-7", &sha)),
            expected(&format!("policy/{hex}/table"))
        );
        assert_eq!(text(refine("dock-7", "r1")), expected("robot/r1/refine"));
        assert_eq!(text(status("dock-7", "r1")), expected("robot/r1/status"));
        assert_eq!(text(alive("dock-7", "r1")), expected("robot/r1/alive"));
        assert_eq!(text(all_status("dock-7")), expected("robot/*/status"));
        assert_eq!(text(trace("dock-7", "r1")), expected("robot/r1/trace"));
        assert_eq!(text(all_traces("dock-7")), expected("robot/*/trace"));
        assert_eq!(text(cancel("dock-7", "r1")), expected("robot/r1/cancel"));
        assert_eq!(text(all_alive("dock-7")), expected("robot/*/alive"));
        let client = expected("client/00000000000000ff/alive");
        assert_eq!(text(client_alive("dock-7", 255)), client);
        let clients = expected("client/*/alive");
        assert_eq!(text(all_clients_alive("dock-7")), clients);
    }

    #[test]
    fn the_longest_names_fit() {
        let name = "n".repeat(NAME_BYTES);
        assert!(chunk(&name, &[0xff; 32], u32::MAX).is_ok());
        assert!(refine(&name, &name).is_ok());
    }

    #[test]
    fn names_with_other_characters_are_refused() {
        let long = "n".repeat(NAME_BYTES + 1);
        for name in ["", "a/b", "*", "**", "a b", "a?b", "å", "$*", "#", &long] {
            assert_eq!(manifest(name), Err(Error::Name), "{name}");
            assert_eq!(refine("f", name), Err(Error::Name), "{name}");
        }
    }

    #[test]
    fn parts_are_read_back() {
        let key = alive("f", "arm_2").expect("names are good");
        assert_eq!(robot_of(&key), Some("arm_2"));
        assert_eq!(robot_of("reagent/v1/f/policy/manifest"), None);
        assert_eq!(robot_of(""), None);
        let client = client_alive("f", u64::MAX).expect("the name is good");
        assert_eq!(client_of(&client), Some(u64::MAX));
        assert_eq!(client_of(&key), None);
        assert_eq!(chunk_index("reagent/v1/f/policy/00/77"), Some(77));
        assert_eq!(chunk_index("reagent/v1/f/policy/00/*"), None);
        assert_eq!(chunk_index("7"), None);
        assert_eq!(chunk_index("reagent/v1/f/policy/00/0"), Some(0));
        assert!(is_table("reagent/v1/f/policy/00/table"));
        assert!(!is_table("reagent/v1/f/policy/00/7"));
    }

    #[test]
    fn a_number_has_one_spelling() {
        let client = |number: &str| client_of(&format!("reagent/v1/f/client/{number}/alive"));
        assert_eq!(client("00000000deadbeef"), Some(0xdead_beef));
        let others = [
            "deadbeef",
            "00000000DEADBEEF",
            "+0000000deadbeef",
            "000000000deadbeef",
            "",
        ];
        for number in others {
            assert_eq!(client(number), None, "{number}");
        }
        for number in ["+7", "07", "00", "-0", "", "4294967296"] {
            assert_eq!(
                chunk_index(&format!("policy/00/{number}")),
                None,
                "{number}"
            );
        }
    }
}
