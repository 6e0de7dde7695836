//! Certificates that a session shows or trusts, and whether they are valid by this machine's clock.
#![allow(
    clippy::disallowed_types,
    reason = "certificates hold by the clock, on a robot too"
)]

use std::path::{Path, PathBuf};
use std::time::SystemTime;
use x509_parser::pem::parse_x509_pem;
use zenoh::Config;

const DAY: i64 = 24 * 3600;
/// A certificate that expires sooner is reported.
const SOON: i64 = 30 * DAY;

/// A certificate in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Certificate {
    /// The file.
    pub path: PathBuf,
    /// Start of its validity, seconds since 1970.
    pub from: i64,
    /// End of its validity, seconds since 1970.
    pub until: i64,
    /// Both as text.
    times: [String; 2],
}

/// The certificates that a configuration names, as far as they can be read. Zenoh refuses the others.
pub fn named_in(config: &Config) -> Vec<Certificate> {
    let keys = [
        "connect_certificate",
        "listen_certificate",
        "root_ca_certificate",
    ];
    let mut found: Vec<Certificate> = Vec::new();
    for key in keys {
        let value = config.get_json(&format!("transport/link/tls/{key}"));
        let path = value
            .ok()
            .and_then(|text| serde_json::from_str::<PathBuf>(&text).ok());
        let certificate = path.as_deref().and_then(Certificate::read);
        found.extend(certificate.filter(|new| found.iter().all(|other| other.path != new.path)));
    }
    found
}

/// Seconds since 1970 by this machine's clock.
pub fn now() -> i64 {
    let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    since_1970.map_or(0, |time| i64::try_from(time.as_secs()).unwrap_or(i64::MAX))
}

impl Certificate {
    fn read(path: &Path) -> Option<Certificate> {
        let bytes = std::fs::read(path).ok()?;
        let (_, pem) = parse_x509_pem(&bytes).ok()?;
        let validity = pem.parse_x509().ok()?.validity().clone();
        Some(Certificate {
            path: path.into(),
            from: validity.not_before.timestamp(),
            until: validity.not_after.timestamp(),
            times: [validity.not_before, validity.not_after].map(|time| time.to_string()),
        })
    }

    /// Whether it is valid at a time.
    pub fn holds(&self, now: i64) -> bool {
        (self.from..=self.until).contains(&now)
    }

    /// What an operator should know about it at a time.
    pub fn notice(&self, now: i64) -> Option<String> {
        let path = self.path.display();
        let [from, until] = &self.times;
        let left = self.until - now;
        if now < self.from {
            Some(format!(
                "certificate {path} holds from {from} on, and it is earlier by this machine's clock: is that right?"
            ))
        } else if left < 0 {
            Some(format!(
                "certificate {path} has expired on {until} by this machine's clock; make a new one, or set the clock"
            ))
        } else if left < SOON {
            let left = match left / DAY {
                0 => "in less than a day".into(),
                1 => "in a day".into(),
                days => format!("in {days} days"),
            };
            Some(format!(
                "certificate {path} expires {left}, on {until}: make a new one"
            ))
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_ends_soon_has_ended_or_has_not_begun_is_told() {
        let certificate = Certificate {
            path: "arm1.pem".into(),
            from: 100 * DAY,
            until: 925 * DAY,
            times: ["Monday".into(), "Friday".into()],
        };
        let said = |now| certificate.notice(now).unwrap_or_default();
        assert_eq!(said(100 * DAY), "");
        assert_eq!(said(895 * DAY), "");
        for (now, holds, expected) in [
            (100 * DAY - 1, false, "holds from Monday on"),
            (896 * DAY, true, "expires in 29 days, on Friday"),
            (924 * DAY, true, "expires in a day"),
            (925 * DAY, true, "expires in less than a day"),
            (925 * DAY + 1, false, "has expired on Friday"),
        ] {
            assert!(said(now).contains(expected), "{}", said(now));
            assert_eq!(certificate.holds(now), holds);
        }
    }
}
