//! Certificates that a session shows or trusts, and whether they are valid by this machine's clock.
#![allow(
    clippy::disallowed_types,
    reason = "certificates hold by the clock, on a robot too"
)]

use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};
use tokio::task::JoinHandle;
use tokio::time::{Instant, interval_at};
use x509_parser::pem::parse_x509_pem;
use x509_parser::public_key::PublicKey;
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

/// The certificates of a running session. While this lives, the log says once a day which of them have expired or will soon.
#[derive(Debug)]
pub struct Certificates {
    files: Vec<PathBuf>,
    reminding: JoinHandle<()>,
}

impl Drop for Certificates {
    fn drop(&mut self) {
        self.reminding.abort();
    }
}

impl Certificates {
    /// Those that a configuration names. The log says what is wrong with them from tomorrow on.
    pub(crate) fn named_in(config: &Config) -> Certificates {
        let files = files_in(config);
        let watched = files.clone();
        let reminding = async move {
            let day = Duration::from_secs(DAY.unsigned_abs());
            let mut days = interval_at(Instant::now() + day, day);
            loop {
                days.tick().await;
                for notice in notices(&read(&watched), now()) {
                    tracing::warn!("{notice}");
                }
            }
        };
        Certificates {
            files,
            reminding: tokio::spawn(reminding),
        }
    }

    /// Whether all of them hold now by this machine's clock.
    pub fn hold(&self) -> bool {
        let now = now();
        self.read().iter().all(|found| found.holds(now))
    }

    /// The certificates as their files are now: they may have been renewed.
    pub fn read(&self) -> Vec<Certificate> {
        read(&self.files)
    }
}

/// What an operator should know about certificates at a time.
pub(crate) fn notices(certificates: &[Certificate], now: i64) -> Vec<String> {
    let notices = certificates.iter().filter_map(|found| found.notice(now));
    notices.collect()
}

/// The certificates in files, as far as they can be read. Zenoh refuses the others.
pub(crate) fn read(files: &[PathBuf]) -> Vec<Certificate> {
    let found = files.iter().filter_map(|path| Certificate::read(path));
    found.collect()
}

/// The files of certificates that a configuration names.
pub(crate) fn files_in(config: &Config) -> Vec<PathBuf> {
    let keys = [
        "connect_certificate",
        "listen_certificate",
        "root_ca_certificate",
    ];
    let mut found: Vec<PathBuf> = Vec::new();
    for key in keys {
        found.extend(file_of(config, key).filter(|new| !found.contains(new)));
    }
    found
}

fn file_of(config: &Config, key: &str) -> Option<PathBuf> {
    let value = config.get_json(&format!("transport/link/tls/{key}"));
    serde_json::from_str(&value.ok()?).ok()
}

/// What is wrong with the files of keys and certificates that a configuration names, if anything is: one cannot be read, or a key
/// is another certificate's. Zenoh says only that nobody answers.
pub(crate) fn fault(config: &Config) -> Option<String> {
    let keys = ["connect_private_key", "listen_private_key"].map(|key| file_of(config, key));
    let files = files_in(config)
        .into_iter()
        .chain(keys.into_iter().flatten());
    let mut unreadable = files.filter_map(|path| {
        let error = std::fs::read(&path).err()?;
        Some(format!("{}: {error}", path.display()))
    });
    unreadable.next().or_else(|| {
        let mut foreign = ["connect", "listen"].into_iter().filter_map(|end| {
            let key = file_of(config, &format!("{end}_private_key"))?;
            let certificate = file_of(config, &format!("{end}_certificate"))?;
            let (of_key, of_certificate) = (std::fs::read(&key), std::fs::read(&certificate));
            let belongs = belongs(&of_key.ok()?, &of_certificate.ok()?)?;
            let (key, certificate) = (key.display(), certificate.display());
            (!belongs).then(|| format!("{key} does not seem to be the key of {certificate}"))
        });
        foreign.next()
    })
}

/// Whether a file holds the private key of a certificate, as far as that is known: one of elliptic curves or RSA usually holds the
/// public key, too.
fn belongs(key: &[u8], certificate: &[u8]) -> Option<bool> {
    let (_, key) = parse_x509_pem(key).ok()?;
    let (_, pem) = parse_x509_pem(certificate).ok()?;
    let certificate = pem.parse_x509().ok()?;
    let of_certificate = certificate.public_key().parsed().ok()?;
    let public = match &of_certificate {
        PublicKey::EC(point) => point.data(),
        PublicKey::RSA(key) => key.modulus,
        _ => return None,
    };
    let mut parts = key.contents.windows(public.len().max(1));
    Some(parts.any(|part| part == public))
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

    #[cfg(test)]
    pub(crate) fn for_test(path: &str, from: i64, until: i64) -> Certificate {
        let (path, times) = (path.into(), ["Monday", "Friday"].map(String::from));
        Certificate {
            path,
            from,
            until,
            times,
        }
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
        let certificate = Certificate::for_test("arm1.pem", 100 * DAY, 925 * DAY);
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

    #[test]
    fn days_later_those_are_told_that_have_run_out_by_then() {
        let certificates = [("a.pem", 100 * DAY), ("b.pem", 900 * DAY)];
        let certificates = certificates.map(|(path, until)| Certificate::for_test(path, 0, until));
        let told = |day: i64| notices(&certificates, day * DAY).join("\n");
        assert_eq!(told(1), "");
        assert!(told(80).starts_with("certificate a.pem expires in 20 days"));
        assert!(told(101).starts_with("certificate a.pem has expired"));
        assert_eq!(told(899).lines().count(), 2);
    }
}
