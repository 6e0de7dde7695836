//! Who ran what when: a file that grows by a line of JSON for every change in the fleet.

use super::Heard;
use reagent_core::wire::{Manifest, NotTaken, PolicyId};
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Write};
use std::path::Path;
use std::time::SystemTime;

/// The file, and what it said last of every robot.
#[derive(Debug)]
pub(super) struct History {
    file: File,
    /// Whether its last line was cut short.
    cut: bool,
    /// Epoch, version and SHA-256 of what each robot runs.
    runs: BTreeMap<String, (u32, u64, String)>,
    refuses: BTreeMap<String, NotTaken>,
}

/// What is read again of a line.
#[derive(Deserialize)]
struct Line {
    event: String,
    robot: String,
    epoch: u32,
    version: u64,
    sha256: String,
}

impl History {
    /// Goes on with a file, or begins one. A last line that was cut short stays as it is.
    pub(super) fn open(path: &Path) -> io::Result<History> {
        let mut options = OpenOptions::new();
        let file = options.create(true).read(true).append(true).open(path)?;
        let mut runs = BTreeMap::new();
        let mut cut = false;
        if file.metadata()?.is_file() {
            let mut reader = BufReader::new(&file);
            let mut bytes = Vec::new();
            while reader.read_until(b'\n', &mut bytes)? > 0 {
                cut = !bytes.ends_with(b"\n");
                if let Ok(line) = serde_json::from_slice::<Line>(&bytes)
                    && line.event == "runs"
                {
                    runs.insert(line.robot, (line.epoch, line.version, line.sha256));
                }
                bytes.clear();
            }
        }
        Ok(History {
            file,
            cut,
            runs,
            refuses: BTreeMap::new(),
        })
    }

    /// A policy was announced with this key.
    pub(super) fn published(&mut self, manifest: &Manifest, key: &[u8; 32]) -> io::Result<()> {
        let (name, key) = (manifest.name.as_str(), const_hex::encode(key));
        self.add(
            "published",
            json!({ "name": name, "key": key }),
            &manifest.id(),
        )
    }

    /// A robot has said how it is: told where what it runs or refuses is another policy than before.
    pub(super) fn heard(&mut self, Heard { robot, status }: &Heard) -> io::Result<()> {
        if let Some(policy) = &status.policy {
            let sha256 = const_hex::encode(policy.sha256);
            let runs = (policy.epoch, policy.version, sha256);
            if self.runs.get(robot) != Some(&runs) {
                self.add("runs", json!({ "robot": robot }), policy)?;
                self.runs.insert(robot.clone(), runs);
            }
        }
        if let Some(not) = &status.not_taken
            && self.refuses.get(robot) != Some(not)
        {
            let reason = not.reason.to_string();
            let more = json!({ "robot": robot, "reason": reason });
            self.add("refuses", more, &not.policy)?;
            self.refuses.insert(robot.clone(), *not);
        }
        Ok(())
    }

    /// One write for a line, so that lines of two publishers do not mix.
    fn add(&mut self, event: &str, more: Value, policy: &PolicyId) -> io::Result<()> {
        let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        let mut line = json!({
            "time": since_1970.map_or(0, |time| time.as_secs()),
            "event": event,
            "epoch": policy.epoch,
            "version": policy.version,
            "sha256": const_hex::encode(policy.sha256),
        });
        if let (Value::Object(line), Value::Object(more)) = (&mut line, more) {
            line.extend(more);
        }
        let before = if self.cut { "\n" } else { "" };
        let written = self.file.write_all(format!("{before}{line}\n").as_bytes());
        self.cut = written.is_err();
        written
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use reagent_core::wire::{Status, WhyNot};

    fn heard(robot: &str, version: u8, refuses: Option<WhyNot>) -> Heard {
        let policy = PolicyId {
            epoch: 0,
            version: version.into(),
            sha256: [version; 32],
        };
        let not_taken = refuses.map(|reason| NotTaken { policy, reason });
        Heard {
            robot: robot.into(),
            status: Status {
                policy: Some(policy),
                not_taken,
                ..Status::default()
            },
        }
    }

    #[test]
    fn changes_are_told_once_also_by_the_next_publisher() {
        let folder = tempfile::tempdir().expect("a temporary directory");
        let path = folder.path().join("history.jsonl");
        let events = || {
            let text = std::fs::read_to_string(&path).expect("readable");
            let event = |line: &str| {
                let Ok(line) = serde_json::from_str::<Value>(line) else {
                    return "cut".into();
                };
                assert!(line["time"].as_u64() > Some(1_700_000_000), "{line}");
                let text = |key: &str| line[key].as_str().unwrap_or_default().to_owned();
                format!("{} {} {}", text("robot"), text("event"), line["version"])
            };
            text.lines().map(event).collect::<Vec<_>>()
        };
        let mut history = History::open(&path).expect("writable");
        for robot in ["a", "b", "a", "a"] {
            history.heard(&heard(robot, 1, None)).expect("written");
        }
        history.heard(&heard("a", 2, None)).expect("written");
        for _ in 0..2 {
            let refuses = heard("b", 1, Some(WhyNot::SelfTest));
            history.heard(&refuses).expect("written");
        }
        drop(history);
        let first = ["a runs 1", "b runs 1", "a runs 2", "b refuses 1"];
        assert_eq!(events(), first);

        // Power failed within the last line.
        let text = std::fs::read_to_string(&path).expect("readable");
        std::fs::write(&path, format!("{text}{{\"time\"")).expect("writable");
        let mut history = History::open(&path).expect("writable");
        for (robot, version) in [("a", 2), ("b", 1), ("b", 3)] {
            history
                .heard(&heard(robot, version, None))
                .expect("written");
        }
        assert_eq!(events(), [&first[..], &["cut", "b runs 3"]].concat());
        assert!(History::open(folder.path()).is_err());
        History::open(Path::new("/dev/null")).expect("a device is written through");
        if let Ok(mut full) = History::open(Path::new("/dev/full")) {
            let unwritten = full.heard(&heard("a", 1, None)).expect_err("it is full");
            assert_eq!(unwritten.kind(), io::ErrorKind::StorageFull);
        }
    }
}
