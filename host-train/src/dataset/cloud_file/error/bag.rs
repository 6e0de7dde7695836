//! Why a bag was refused.

use std::path::PathBuf;

/// Why a bag was refused, or why reading it ended early.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// The operating system refused to read.
    #[error("{}: {source}", path.display())]
    Io {
        /// File concerned.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The bag is an SQLite database.
    #[error(
        "{0}: a bag in SQLite is not read; convert it to MCAP: \
         echo 'output_bags: [{{uri: converted, storage_id: mcap, all: true}}]' > mcap.yaml && ros2 bag convert -i {0} -o mcap.yaml",
        path.display()
    )]
    Sqlite {
        /// The bag.
        path: PathBuf,
    },
    /// The file was compressed after the recording.
    #[error("{0}: the file is compressed as a whole; decompress it: zstd -d {0}", path.display())]
    CompressedFile {
        /// File concerned.
        path: PathBuf,
    },
    /// The messages were compressed one by one.
    #[error(
        "{}: it is compressed by itself; convert the bag with ros2 bag convert, to compression_mode: none",
        path.display()
    )]
    CompressedMessage {
        /// The message.
        path: PathBuf,
    },
    /// A folder with `metadata.yaml` and no files of a bag.
    #[error("{}: the bag's folder has no .mcap files", path.display())]
    NoFiles {
        /// The folder.
        path: PathBuf,
    },
    /// The file is not an MCAP file.
    #[error("{}: it is no MCAP file: it does not begin as one", path.display())]
    NotMcap {
        /// File concerned.
        path: PathBuf,
    },
    /// The file has no bytes.
    #[error("{}: no points: the file is empty", path.display())]
    Empty {
        /// File concerned.
        path: PathBuf,
    },
    /// The file ends early.
    #[error(
        "{}: the bag is cut off at {bytes} bytes, as an interrupted recording or copy is; copy it again, or save what is whole: mcap recover",
        path.display()
    )]
    CutOff {
        /// File concerned.
        path: PathBuf,
        /// Its length.
        bytes: u64,
    },
    /// A record is malformed.
    #[error("{}: the bag is damaged before byte {byte} ({reason}); copy it again, or save what is whole: mcap recover", path.display())]
    Damaged {
        /// File concerned.
        path: PathBuf,
        /// Bytes read until then.
        byte: u64,
        /// What the MCAP reader said.
        reason: String,
    },
    /// No topic has clouds.
    #[error(
        "{}: no topic of the bag has clouds (sensor_msgs/msg/PointCloud2); its topics: {}",
        path.display(), if topics.is_empty() { "none".into() } else { topics.join(", ") }
    )]
    NoClouds {
        /// The bag.
        path: PathBuf,
        /// Topics and their types.
        topics: Vec<String>,
    },
    /// Several topics have clouds.
    #[error("{}: several topics of the bag have clouds; name one with --topic: {clouds}", path.display())]
    SeveralTopics {
        /// The bag.
        path: PathBuf,
        /// The topics.
        clouds: String,
    },
    /// The same where no topic can be asked for.
    #[error(
        "{0}: several topics of the bag have clouds, and no topic is asked for here; keep one alone: mcap filter {0} -y TOPIC -o one.mcap; \
         they are {clouds}",
        path.display()
    )]
    SeveralTopicsHere {
        /// The bag.
        path: PathBuf,
        /// The topics.
        clouds: String,
    },
    /// There is no such topic.
    #[error("{}: the bag has no topic {topic}; topics with clouds: {clouds}", path.display())]
    NoTopic {
        /// The bag.
        path: PathBuf,
        /// Topic that was asked for.
        topic: String,
        /// Topics with clouds.
        clouds: String,
    },
    /// The topic has other messages.
    #[error(
        "{}: topic {topic} of the bag is {of}, and clouds are sensor_msgs/msg/PointCloud2; topics with clouds: {clouds}",
        path.display()
    )]
    OtherType {
        /// The bag.
        path: PathBuf,
        /// Topic that was asked for.
        topic: String,
        /// Its type.
        of: String,
        /// Topics with clouds.
        clouds: String,
    },
    /// There is no such message.
    #[error(
        "{}: topic {topic} of the bag has {count} messages, the last {last_s:.3} s after the bag's start; ask for one of them, from 0",
        path.display()
    )]
    NoMessage {
        /// The bag.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// How many it has.
        count: u64,
        /// When the last was recorded, seconds after the bag's first message of any topic.
        last_s: f64,
    },
}
