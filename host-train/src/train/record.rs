//! The run directory: the record of a run and of what it measured.
//!
//! | file | what |
//! |---|---|
//! | `config.json` | complete configuration, seed, fingerprint of the data, version |
//! | `metrics.jsonl` | one line an update (`update`, …), one an epoch (`epoch`, `updates`, `validation`, …) |
//! | `last.safetensors`, `previous.safetensors` | newest checkpoints |
//! | `best/checkpoint.safetensors` | checkpoint with the lowest validation error |
//! | `diverged.json`, `diverged.safetensors` | the mini-batch whose loss was not a number, and the state before it |

use super::config::TrainConfig;
use super::error::TrainError;
use super::learning_rate::Anneal;
use super::trainer::Diverged;
use crate::files;
use reagent_link::files::plain;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::fs::{File, TryLockError};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

const CONFIG: &str = "config.json";
const METRICS: &str = "metrics.jsonl";
/// Locked as long as a process trains here.
const LOCK: &str = ".lock";

/// What `config.json` holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunRecord {
    /// Version of the program that started the run.
    pub version: String,
    /// SHA-256 of the training clouds.
    pub data_sha256: String,
    /// The configuration.
    #[serde(flatten)]
    pub config: TrainConfig,
}

impl RunRecord {
    /// Reads the record of a run.
    ///
    /// # Errors
    /// [`TrainError::Record`] where there is none, or another version wrote it.
    pub fn load(run: &Path) -> Result<Self, TrainError> {
        let path = run.join(CONFIG);
        let unreadable = |what: String| TrainError::Record {
            path: path.clone(),
            what,
        };
        let text = std::fs::read(&path).map_err(|e| unreadable(e.to_string()))?;
        serde_json::from_slice(&text).map_err(|e| unreadable(e.to_string()))
    }

    /// Refuses to go on with this run as `now`.
    pub(super) fn check_resumed(&self, now: &RunRecord) -> Result<(), TrainError> {
        let differences = self.differences(now);
        match differences.is_empty() {
            true => Ok(()),
            false => Err(TrainError::Incompatible {
                path: now.config.out.clone(),
                differences: differences.join("; "),
            }),
        }
    }

    /// Names the settings that may not change when a run is resumed and yet differ, each with both values.
    fn differences(&self, now: &RunRecord) -> Vec<String> {
        let mut differences = Vec::new();
        let value = |record: &RunRecord| serde_json::to_value(record).unwrap_or(Value::Null);
        compare("", &value(self), &value(now), &mut differences);
        let same_end = now.config.learning_rate.anneal == Anneal::Halve;
        differences.retain(|(field, _)| match field.as_str() {
            "out" | "threads" | "init" | "checkpoint_minutes" | "version" => false,
            "epochs" => !same_end,
            _ => true,
        });
        differences.into_iter().map(|(_, text)| text).collect()
    }
}

/// Collects the leaves in which two values differ, as `(path, text)`.
fn compare(path: &str, before: &Value, now: &Value, differences: &mut Vec<(String, String)>) {
    if let (Value::Object(a), Value::Object(b)) = (before, now) {
        for (name, value) in a {
            let path = if path.is_empty() {
                name.clone()
            } else {
                format!("{path}.{name}")
            };
            compare(
                &path,
                value,
                b.get(name).unwrap_or(&Value::Null),
                differences,
            );
        }
    } else if before != now {
        differences.push((path.into(), format!("{path} was {before} and is {now}")));
    }
}

/// Takes a run directory for this process, until the file is dropped.
///
/// # Errors
/// [`TrainError::Busy`] if another process has it.
pub(super) fn lock(run: &Path) -> Result<File, TrainError> {
    std::fs::create_dir_all(run).map_err(|e| unusable(run, e))?;
    let path = run.join(LOCK);
    let mut options = File::options();
    let file = options.create(true).truncate(false).write(true).open(&path);
    let file = file.map_err(|e| unusable(&path, e))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(TrainError::Busy(run.into())),
        // Some file systems know no locks.
        Err(TryLockError::Error(e)) if e.kind() == ErrorKind::Unsupported => Ok(file),
        Err(TryLockError::Error(e)) => Err(unusable(&path, e)),
    }
}

/// An open run directory.
pub(super) struct RunDirectory {
    path: PathBuf,
    metrics: File,
}

impl RunDirectory {
    /// Checks that the directory can be written and has room for `bytes`, and starts the metrics. Those of a resumed
    /// run go on after those of its first `updates` updates.
    pub(super) fn open(
        record: &RunRecord,
        resumed: Option<u64>,
        bytes: usize,
    ) -> Result<Self, TrainError> {
        let path = record.config.out.clone();
        std::fs::create_dir_all(path.join("best")).map_err(|e| unusable(&path, e))?;
        for folder in [path.clone(), path.join("best")] {
            remove_unfinished(&folder).map_err(|e| unusable(&folder, e))?;
        }
        probe(&path, bytes)?;
        let text = serde_json::to_string_pretty(record).map_err(|e| unusable(&path, e.into()))?;
        files::write(&path.join(CONFIG), text.as_bytes()).map_err(|e| unusable(&path, e))?;
        let file = path.join(METRICS);
        let kept = match resumed {
            Some(updates) => match std::fs::read_to_string(&file) {
                Ok(text) => measured_by(&text, updates),
                Err(e) if e.kind() == ErrorKind::NotFound => String::new(),
                Err(e) => return Err(unusable(&file, e)),
            },
            None => String::new(),
        };
        files::write(&file, kept.as_bytes()).map_err(|e| unusable(&file, e))?;
        let metrics = File::options()
            .append(true)
            .open(&file)
            .map_err(|e| unusable(&file, e))?;
        Ok(RunDirectory { path, metrics })
    }

    /// Adds a line to the metrics.
    pub(super) fn log(&mut self, line: &Value) -> Result<(), TrainError> {
        // One write per line, so that a killed process leaves whole lines only.
        let text = format!("{line}\n");
        let written = self.metrics.write_all(text.as_bytes());
        written.map_err(|e| unusable(&self.path.join(METRICS), e))
    }

    /// Saves the mini-batch that broke a run.
    pub(super) fn save_diverged(
        &self,
        update: u64,
        what: &Diverged,
    ) -> Result<PathBuf, TrainError> {
        let path = self.path.join("diverged.json");
        let observations: Vec<Value> = what
            .observations
            .iter()
            .map(|o| {
                json!({
                    "problem": o.problem, "pose": o.pose.to_rows(), "expert": o.expert,
                    "action": o.action, "log_probability": o.log_probability, "value": o.value,
                    "reward": o.reward, "return": o.discounted_return, "advantage": o.advantage,
                })
            })
            .collect();
        let problems: Vec<Value> = what
            .problems
            .iter()
            .map(|p| {
                json!({
                    "source": p.source, "target": p.target, "true_pose": p.true_pose.to_rows(),
                })
            })
            .collect();
        // Values that are not numbers become null.
        let document = json!({
            "update": update, "mini_batch": what.mini_batch, "losses": what.losses,
            "gradient_norm": what.gradient_norm, "observations": observations, "problems": problems,
        });
        files::write(&path, document.to_string().as_bytes()).map_err(|e| unusable(&path, e))?;
        Ok(path)
    }
}

/// Removes files that a killed process left half written (see [`crate::files`]).
fn remove_unfinished(folder: &Path) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name();
        if name.to_string_lossy().starts_with(".tmp") && entry.file_type()?.is_file() {
            std::fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

/// Checks for room: writes a file of the given size and removes it.
fn probe(directory: &Path, bytes: usize) -> Result<(), TrainError> {
    let write = || -> std::io::Result<()> {
        let mut file = tempfile::NamedTempFile::new_in(directory)?;
        let block = vec![0x5a; 1 << 20];
        for _ in 0..bytes.div_ceil(block.len()) {
            file.write_all(&block)?;
        }
        file.flush()
    };
    write().map_err(|e| unusable(directory, plain(e)))
}

fn unusable(path: &Path, source: std::io::Error) -> TrainError {
    TrainError::Directory {
        path: path.into(),
        source,
    }
}

/// The whole lines of a metrics file that the first `updates` updates wrote.
fn measured_by(text: &str, updates: u64) -> String {
    let number = |line: &Value, name: &str| line.get(name).and_then(Value::as_u64);
    text.split_inclusive('\n')
        .filter(|line| {
            serde_json::from_str::<Value>(line).is_ok_and(|line| {
                number(&line, "update").is_some_and(|update| update < updates)
                    || number(&line, "updates").is_some_and(|done| done <= updates)
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::{DataSource, Stage};

    #[cfg(target_os = "linux")]
    #[test]
    fn a_folder_that_takes_no_file_is_named_without_a_temporary_one() {
        let said = probe(Path::new("/proc/self"), 1).expect_err("no file is made there");
        let said = format!("{said}: {:?}", std::error::Error::source(&said));
        assert!(
            said.contains("/proc/self") && !said.contains(".tmp"),
            "{said}"
        );
    }

    #[test]
    fn metrics_beyond_a_checkpoint_and_torn_lines_are_dropped() {
        let text =
            "{\"update\":0}\n{\"update\":1}\n{\"epoch\":0,\"updates\":2}\n{\"update\":2}\n{\"upd";
        assert_eq!(
            measured_by(text, 2),
            "{\"update\":0}\n{\"update\":1}\n{\"epoch\":0,\"updates\":2}\n"
        );
        assert_eq!(measured_by(text, 1), "{\"update\":0}\n");
    }

    #[test]
    fn what_may_not_change_is_named() {
        let config = TrainConfig::new(Stage::Il, vec![DataSource::Procedural(9)], "a".into());
        let record = RunRecord {
            version: "1".into(),
            data_sha256: "x".into(),
            config,
        };
        let mut other = record.clone();
        other.config.threads = 7;
        other.config.out = "b".into();
        other.config.epochs = 99;
        assert_eq!(record.differences(&other), Vec::<String>::new());
        other.config.method.ppo.alpha = 0.5;
        other.config.points = 5;
        assert_eq!(
            record.differences(&other),
            [
                "method.ppo.alpha was 0.0 and is 0.5",
                "points was 1024 and is 5"
            ]
        );
        other = record.clone();
        other.config.learning_rate.anneal = Anneal::Cosine;
        other.config.epochs = 99;
        assert_eq!(record.differences(&other).len(), 2);
    }
}
