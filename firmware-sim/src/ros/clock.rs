//! The time that messages carry.
#![allow(
    clippy::disallowed_types,
    reason = "messages carry the time of who publishes them"
)]

use std::time::SystemTime;

/// The time now, by this machine's clock.
pub(super) fn unix_ns() -> i64 {
    let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    since_1970.map_or(0, |time| i64::try_from(time.as_nanos()).unwrap_or(i64::MAX))
}
