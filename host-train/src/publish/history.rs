//! The history of a fleet: a file that grows by a line of JSON whenever a robot's policy changes, and whenever a robot goes away or comes back.

use super::{Heard, PublishError};
use crate::files;
use crate::words::count;
use reagent_core::wire::{Manifest, PolicyId, WhyNot};
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, VecDeque};
use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Most lines that wait until they can be written.
const WAITING: usize = 10_000;

/// The file's last line about each event and robot, and the lines that could not be written yet. The file is opened for every
/// line, since it may have been moved away. Where there is none, the next line creates it, whole.
#[derive(Debug)]
pub(super) struct History {
    path: PathBuf,
    /// The last line of each event and robot, without its time.
    last: BTreeMap<(String, String), Map<String, Value>>,
    /// Lines that are not written yet, in order.
    waiting: VecDeque<String>,
    /// Whether there was no room for a line among them.
    lost: bool,
    /// Why they cannot be written.
    reason: Option<String>,
}

/// What a line is about: its event, and its robot if it names one.
fn about(line: &Map<String, Value>) -> (String, String) {
    let text = |key: &str| line.get(key).and_then(Value::as_str).unwrap_or_default();
    (text("event").into(), text("robot").into())
}

/// Keeps the last line about an event and robot. A robot that was offline runs its policy anew.
fn remember(last: &mut BTreeMap<(String, String), Map<String, Value>>, line: Map<String, Value>) {
    let (event, robot) = about(&line);
    for [one, other] in [["runs", "offline"], ["offline", "runs"]] {
        if event == one {
            last.remove(&(other.to_owned(), robot.clone()));
        }
    }
    last.insert((event, robot), line);
}

impl History {
    /// Opens a file to go on with it, or prepares to create one. A last line that was cut short stays as it is.
    pub(super) fn open(path: &Path) -> io::Result<History> {
        let file = match appended(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                files::place(path)?;
                None
            }
            opened => Some(opened?),
        };
        let mut last = BTreeMap::new();
        if let Some(file) = &file
            && file.metadata()?.is_file()
        {
            let mut reader = BufReader::new(file);
            let mut bytes = Vec::new();
            while reader.read_until(b'\n', &mut bytes)? > 0 {
                if let Ok(mut line) = serde_json::from_slice::<Map<String, Value>>(&bytes) {
                    line.remove("time");
                    remember(&mut last, line);
                }
                bytes.clear();
            }
        }
        let path = path.into();
        Ok(History {
            path,
            last,
            waiting: VecDeque::new(),
            lost: false,
            reason: None,
        })
    }

    /// Records that a policy was announced with this key.
    pub(super) fn published(&mut self, manifest: &Manifest, key: &[u8; 32]) {
        let (name, key) = (manifest.name.as_str(), const_hex::encode(key));
        self.add(
            "published",
            json!({ "name": name, "key": key }),
            &manifest.id(),
        );
    }

    /// Records a robot's status if it runs or refuses another policy than before. A robot that waits for its stage refuses nothing.
    pub(super) fn heard(&mut self, Heard { robot, status }: &Heard) {
        if let Some(policy) = &status.policy {
            self.add("runs", json!({ "robot": robot }), policy);
        }
        if let Some(not) = &status.not_taken
            && not.reason != WhyNot::NotYet
        {
            let reason = not.reason.to_string();
            let more = json!({ "robot": robot, "reason": reason });
            self.add("refuses", more, &not.policy);
        }
    }

    /// Records that a robot with this policy went away. When it is heard again, a line says what it runs then.
    pub(super) fn offline(&mut self, robot: &str, policy: &PolicyId) {
        self.add("offline", json!({ "robot": robot }), policy);
    }

    /// What is wrong with the file, if anything is.
    pub(super) fn wrong(&self) -> Option<String> {
        let reason = self.reason.as_ref()?;
        let path = self.path.display();
        let waiting = count(self.waiting.len(), "line waits", "lines wait");
        let lost = if self.lost {
            ", and later ones are lost"
        } else {
            ""
        };
        Some(format!(
            "{path} cannot be written: {reason}; {waiting} until it can{lost}"
        ))
    }

    /// Writes the lines that wait, for the last time.
    ///
    /// # Errors
    /// `Record` says what is lost.
    pub(super) fn end(&mut self) -> Result<(), PublishError> {
        self.write();
        let lost = count(self.waiting.len(), "line is lost", "lines are lost");
        let reason = match (&self.reason, self.lost) {
            (Some(reason), _) => format!("the history cannot be written: {reason}; {lost}"),
            (None, true) => "lines were lost while the history could not be written".into(),
            (None, false) => return Ok(()),
        };
        let path = self.path.clone();
        Err(PublishError::Record { path, reason })
    }

    /// Adds a line. One that only repeats the last one is skipped, so that a restarted publisher repeats nothing.
    fn add(&mut self, event: &str, more: Value, policy: &PolicyId) {
        let mut line = Map::new();
        line.insert("event".into(), event.into());
        line.insert("epoch".into(), policy.epoch.into());
        line.insert("version".into(), policy.version.into());
        line.insert("sha256".into(), const_hex::encode(policy.sha256).into());
        if let Value::Object(more) = more {
            line.extend(more);
        }
        if self.last.get(&about(&line)) == Some(&line) {
            return;
        }
        if self.waiting.len() >= WAITING {
            self.lost = true;
            return;
        }
        let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        let mut timed = line.clone();
        let time = since_1970.map_or(0, |time| time.as_secs());
        timed.insert("time".into(), time.into());
        let timed = Value::Object(timed);
        self.waiting.push_back(format!("{timed}\n"));
        remember(&mut self.last, line);
        self.write();
    }

    /// Writes the lines that wait, as far as that is possible. The log says when it is not, and when it is again.
    pub(super) fn write(&mut self) {
        while let Some(line) = self.waiting.front().cloned() {
            if let Err(error) = self.append(&line) {
                let is_new = self.reason.replace(error.to_string()).is_none();
                if is_new && let Some(wrong) = self.wrong() {
                    tracing::error!("the history {wrong}");
                }
                return;
            }
            self.waiting.pop_front();
        }
        if self.reason.take().is_some() {
            tracing::warn!("the history {} is written again", self.path.display());
        }
    }

    /// Appends a line in one write, so that lines of two publishers do not mix.
    fn append(&self, line: &str) -> io::Result<()> {
        if !self.path.exists() {
            return files::write(&self.path, line.as_bytes());
        }
        let mut file = appended(&self.path)?;
        let before = if is_cut(&mut file)? { "\n" } else { "" };
        file.write_all(format!("{before}{line}").as_bytes())
    }
}

/// Whether the last line of a file was cut short.
fn is_cut(file: &mut File) -> io::Result<bool> {
    let length = file.metadata()?.len();
    if length == 0 {
        return Ok(false);
    }
    let mut last = [0];
    file.seek(SeekFrom::Start(length - 1))?;
    file.read_exact(&mut last)?;
    Ok(last != *b"\n")
}

/// Opens a file to append to it.
fn appended(path: &Path) -> io::Result<File> {
    OpenOptions::new().read(true).append(true).open(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::WeightFile;
    use reagent_core::wire::{NotTaken, Status, WhyNot};

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
            history.heard(&heard(robot, 1, None));
        }
        history.heard(&heard("a", 2, None));
        for _ in 0..2 {
            let refuses = heard("b", 1, Some(WhyNot::SelfTest));
            history.heard(&refuses);
        }
        drop(history);
        let first = ["a runs 1", "b runs 1", "a runs 2", "b refuses 1"];
        assert_eq!(events(), first);

        // As if the power had failed within the last line.
        let text = std::fs::read_to_string(&path).expect("readable");
        std::fs::write(&path, format!("{text}{{\"time\"")).expect("writable");
        let mut history = History::open(&path).expect("writable");
        for (robot, version, refuses) in [
            ("a", 2, None),
            ("b", 1, Some(WhyNot::SelfTest)),
            ("b", 3, Some(WhyNot::NotKept)),
        ] {
            let heard = heard(robot, version, refuses);
            history.heard(&heard);
        }
        // One that waits for its stage refuses nothing.
        history.heard(&heard("b", 3, Some(WhyNot::NotYet)));
        let more = ["cut", "b runs 3", "b refuses 3"];
        assert_eq!(events(), [&first[..], &more].concat());
        // It dies twice; the second time, another publisher sees it come back.
        let policy = heard("b", 3, None).status.policy.expect("it has one");
        for _ in 0..2 {
            history.offline("b", &policy);
            history.offline("b", &policy);
            history = History::open(&path).expect("writable");
            history.heard(&heard("b", 3, None));
        }
        let again = ["b offline 3", "b runs 3"].repeat(2);
        assert_eq!(events()[first.len() + more.len()..], again);
        assert!(History::open(folder.path()).is_err());
        History::open(Path::new("/dev/null")).expect("a device is written through");
        if let Ok(mut full) = History::open(Path::new("/dev/full")) {
            full.heard(&heard("a", 1, None));
            let wrong = full.wrong().expect("it is full");
            let said = "/dev/full cannot be written: No space left on device";
            assert!(wrong.starts_with(said), "{wrong}");
            let error = full.end().expect_err("it is full").to_string();
            assert!(error.ends_with("; 1 line is lost"), "{error}");
            for robot in 0..WAITING + 3 {
                full.heard(&heard(&robot.to_string(), 1, None));
            }
            assert_eq!(full.waiting.len(), WAITING);
            assert!(
                full.wrong()
                    .is_some_and(|wrong| wrong.ends_with("are lost"))
            );
        }
    }

    #[test]
    fn a_file_that_is_moved_away_is_followed_by_a_new_one() {
        let folder = tempfile::tempdir().expect("a temporary directory");
        let (path, moved) = (folder.path().join("history.jsonl"), folder.path().join("1"));
        let mut history = History::open(&path).expect("writable");
        for version in 1..=3 {
            history.heard(&heard("a", version, None));
            std::fs::rename(&path, &moved).expect("it is there");
            let text = std::fs::read_to_string(&moved).expect("readable");
            assert_eq!(text.lines().count(), 1, "{text}");
            let own = format!("\"version\":{version}");
            assert!(text.contains(&own), "{text}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn on_a_full_disk_no_file_is_begun_and_none_is_lost() {
        let folder = tempfile::tempdir().expect("a temporary directory");
        let path = folder.path().join("history.jsonl");
        let Some(unmount) = files::tests::small_disk(folder.path()) else {
            return;
        };
        let outcome = std::panic::catch_unwind(|| {
            let filling = folder.path().join("filling");
            let mut history = History::open(&path).expect("a name is free");
            assert!(!path.exists());
            std::fs::write(&filling, vec![7; 200_000]).expect_err("it is full");
            history.heard(&heard("a", 1, None));
            history.heard(&heard("b", 1, None));
            let wrong = history.wrong().expect("it is full");
            assert!(
                wrong.contains("history.jsonl cannot be written: No space"),
                "{wrong}"
            );
            assert!(wrong.ends_with("2 lines wait until it can"), "{wrong}");
            assert!(!path.exists());
            let versions = || {
                let text = std::fs::read_to_string(&path).expect("readable");
                let line = |line| serde_json::from_str::<Value>(line).expect("whole");
                let lines = text.lines().map(line);
                lines
                    .map(|line| format!("{} {}", line["robot"], line["version"]))
                    .collect::<Vec<_>>()
            };
            std::fs::remove_file(&filling).expect("it is there");
            history.write();
            assert_eq!(history.wrong(), None);
            history.end().expect("all of it is written");
            let first = [r#""a" 1"#, r#""b" 1"#];
            assert_eq!(versions(), first);
            // The disk is full again, now with the file on it.
            std::fs::write(&filling, vec![7; 200_000]).expect_err("it is full");
            for version in 2..200 {
                history.heard(&heard("a", version, None));
            }
            assert!(history.wrong().is_some());
            std::fs::remove_file(&filling).expect("it is there");
            history.heard(&heard("a", 200, None));
            assert_eq!(history.wrong(), None);
            let text = std::fs::read_to_string(&path).expect("readable");
            let whole = text
                .lines()
                .filter_map(|line| serde_json::from_str::<Value>(line).ok());
            let versions: Vec<_> = whole.filter_map(|line| line["version"].as_u64()).collect();
            assert_eq!(
                versions,
                [1, 1].into_iter().chain(2..=200).collect::<Vec<_>>()
            );
        });
        unmount();
        outcome.expect("nothing is lost");
    }

    #[test]
    fn a_publisher_that_starts_again_has_published_nothing_new() {
        let folder = tempfile::tempdir().expect("a temporary directory");
        let path = folder.path().join("history.jsonl");
        let manifest = |version| super::super::manifest(version, "p", &WeightFile::pretrained());
        for (version, key, lines) in [(1, 1, 1), (1, 1, 1), (1, 2, 2), (2, 2, 3), (2, 2, 3)] {
            let mut history = History::open(&path).expect("writable");
            let manifest = manifest(version).expect("a good name");
            history.published(&manifest, &[key; 32]);
            let text = std::fs::read_to_string(&path).expect("readable");
            assert_eq!(text.lines().count(), lines, "{text}");
        }
    }
}
