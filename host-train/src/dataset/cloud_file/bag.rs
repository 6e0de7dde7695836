//! Clouds from ROS 2 bags: messages of type `sensor_msgs/msg/PointCloud2` on one topic, in MCAP files.
//!
//! A bag is read from its start to the message asked for, one record at a time, so that its length does not matter.
//! The whole records of an interrupted recording are read as well.

mod records;
mod topics;

pub use super::error::BagError;

use super::{CloudError, CloudFile, Note, extension, lines};
use crate::dataset::ros::cdr::from_cdr;
use crate::dataset::ros::point_cloud2::{PointCloud2, Time};
use mcap::records::Record;
use records::Records;
use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;
use topics::Topics;

/// First bytes of a message that was compressed by itself.
const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Selects a message of a topic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MessageSelector {
    /// By its number, from 0.
    Number(u64),
    /// The first one recorded at least this long after the bag's first message of any topic.
    After(Duration),
}

impl MessageSelector {
    /// The first one.
    pub const FIRST: MessageSelector = MessageSelector::Number(0);
}

impl FromStr for MessageSelector {
    type Err = String;

    fn from_str(text: &str) -> Result<MessageSelector, String> {
        let which = match text.strip_suffix('s') {
            Some(seconds) => {
                let seconds = seconds.parse().ok();
                let after = seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
                after.map(MessageSelector::After)
            }
            None => text.parse().ok().map(MessageSelector::Number),
        };
        which.ok_or_else(|| {
            "a message is its number from 0, or seconds after the bag's start, such as 2.5s".into()
        })
    }
}

/// Whether a path is a bag: by its extension, or for a folder by the `metadata.yaml` in it. For kinds that are not
/// read, [`Bag::open`] says what to do.
pub fn is_bag(path: &Path) -> bool {
    match extension(path).as_str() {
        "mcap" | "db3" => true,
        "zstd" => extension(&path.with_extension("")) == "mcap",
        _ => path.join("metadata.yaml").is_file(),
    }
}

/// A bag, and the one topic whose clouds are read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Bag {
    path: PathBuf,
    /// In the order of recording.
    files: Vec<PathBuf>,
    topic: String,
}

/// A message with a cloud.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// Its number among the topic's messages, from 0.
    pub number: u64,
    /// Time of its recording since the bag's first message of any topic.
    pub after: Duration,
    /// Its name in errors.
    pub label: PathBuf,
    topic: String,
    bytes: Vec<u8>,
}

impl Bag {
    /// Opens a bag: a file, or a folder with `metadata.yaml`. `topic` is optional if only one topic has clouds.
    ///
    /// # Errors
    /// A path that is not a bag, or one of another kind; a topic that is missing or has no clouds; none or several to
    /// choose.
    pub fn open(path: &Path, topic: Option<&str>) -> Result<Bag, BagError> {
        let files = files(path)?;
        let mut topics = Topics::default();
        for file in &files {
            topics.read(file)?;
        }
        let topic = topics.choose(path, topic)?;
        Ok(Bag {
            path: path.into(),
            files,
            topic,
        })
    }

    /// The messages of the topic in the order of recording. Nothing follows an error.
    pub fn messages(&self) -> impl Iterator<Item = Result<Message, BagError>> {
        let mut number = 0;
        let mut start = None;
        let messages = self.files.iter().flat_map(|file| raw(file, &self.topic));
        let messages = messages.filter_map(move |message| {
            let (time, bytes) = match message {
                Ok(message) => message,
                Err(error) => return Some(Err(error)),
            };
            let after = time.saturating_sub(*start.get_or_insert(time));
            let bytes = bytes?;
            let label = format!(
                "{}, message {number} of {}",
                self.path.display(),
                self.topic
            );
            number += 1;
            Some(Ok(Message {
                number: number - 1,
                after: Duration::from_nanos(after),
                label: label.into(),
                topic: self.topic.clone(),
                bytes,
            }))
        });
        let mut failed = false;
        messages.take_while(move |message| !std::mem::replace(&mut failed, message.is_err()))
    }

    /// Reads one message.
    ///
    /// # Errors
    /// A bag that has no such message or is damaged before it.
    pub fn message(&self, which: MessageSelector) -> Result<Message, BagError> {
        let (mut count, mut last) = (0, Duration::ZERO);
        for message in self.messages() {
            let message = message?;
            let found = match which {
                MessageSelector::Number(number) => message.number == number,
                MessageSelector::After(after) => message.after >= after,
            };
            if found {
                return Ok(message);
            }
            (count, last) = (message.number + 1, message.after);
        }
        Err(BagError::NoMessage {
            path: self.path.clone(),
            topic: self.topic.clone(),
            count,
            last_s: last.as_secs_f64(),
        })
    }
}

impl Message {
    /// Its cloud, and the sensor's time stamp.
    ///
    /// # Errors
    /// Bytes that are not a cloud, and clouds without valid points.
    pub fn cloud(&self) -> Result<(CloudFile, Time), CloudError> {
        let path = &self.label;
        let malformed = |reason: String| CloudError::Malformed {
            path: path.clone(),
            reason,
        };
        if self.bytes.starts_with(&ZSTD) {
            return Err(BagError::CompressedMessage { path: path.clone() }.into());
        }
        let cloud: PointCloud2 = from_cdr(&self.bytes).map_err(|e| malformed(e.to_string()))?;
        let stamp = cloud.header.stamp;
        let mut notes = vec![Note::Message {
            topic: self.topic.clone(),
            number: self.number,
            sec: stamp.sec,
            nanosec: stamp.nanosec,
        }];
        let others = cloud.fields.iter().map(|field| field.name.as_str());
        let others: Vec<&str> = others
            .filter(|name| !["x", "y", "z"].contains(name))
            .collect();
        if !others.is_empty() {
            let what = lines::excerpt(&others.join(", "));
            notes.push(Note::Ignored { what });
        }
        let file = CloudFile {
            points: cloud.positions().map_err(|e| malformed(e.to_string()))?,
            notes,
            ..CloudFile::default()
        };
        Ok((file.checked(path)?, stamp))
    }
}

/// Reads one cloud of a bag.
///
/// # Errors
/// As [`Bag::open`], [`Bag::message`] and [`Message::cloud`].
pub fn read(
    path: &Path,
    topic: Option<&str>,
    which: MessageSelector,
) -> Result<CloudFile, CloudError> {
    let message = Bag::open(path, topic)?.message(which)?;
    Ok(message.cloud()?.0)
}

/// Reads the first cloud of a bag where nobody can name a topic.
///
/// # Errors
/// As [`read`].
pub fn read_first(path: &Path) -> Result<CloudFile, CloudError> {
    read(path, None, MessageSelector::FIRST).map_err(|error| match error {
        CloudError::Bag(BagError::SeveralTopics { path, clouds }) => {
            BagError::SeveralTopicsHere { path, clouds }.into()
        }
        error => error,
    })
}

/// The MCAP files of a bag.
fn files(path: &Path) -> Result<Vec<PathBuf>, BagError> {
    let io = |source| BagError::Io {
        path: path.into(),
        source,
    };
    let path_buf = || path.to_path_buf();
    if !path.is_dir() {
        return match extension(path).as_str() {
            "db3" => Err(BagError::Sqlite { path: path_buf() }),
            "zstd" => Err(BagError::CompressedFile { path: path_buf() }),
            _ => Ok(vec![path_buf()]),
        };
    }
    let entries = fs::read_dir(path).map_err(io)?;
    let files: Result<Vec<PathBuf>, _> = entries.map(|entry| Ok(entry?.path())).collect();
    let files = files.map_err(io)?;
    let of = |kind| {
        let files = files.iter().filter(move |file| extension(file) == kind);
        files.cloned().collect::<Vec<_>>()
    };
    let mut found = of("mcap");
    // bag_2 before bag_10.
    found.sort_by_key(|file| (file.as_os_str().len(), file.clone()));
    if !found.is_empty() {
        return Ok(found);
    }
    Err(if !of("db3").is_empty() {
        BagError::Sqlite { path: path_buf() }
    } else if let Some(path) = of("zstd").pop() {
        BagError::CompressedFile { path }
    } else {
        BagError::NoFiles { path: path_buf() }
    })
}

/// For all messages of a file, the time of recording in nanoseconds; for those of `topic` also the contents.
fn raw(file: &Path, topic: &str) -> impl Iterator<Item = Result<(u64, Option<Vec<u8>>), BagError>> {
    let mut topics = Topics::default();
    let topic = topic.to_owned();
    let mut records = Some(Records::open(file));
    std::iter::from_fn(move || {
        let records = match records.as_mut()? {
            Ok(records) => records,
            Err(_) => return records.take()?.err().map(Err),
        };
        records.find(|record| match record {
            Record::Message { header, data } => {
                let asked = topics.is_of(header.channel_id, &topic);
                Some((header.log_time, asked.then(|| data.into_owned())))
            }
            other => {
                topics.take(other);
                None
            }
        })
    })
}

#[cfg(test)]
mod tests;
