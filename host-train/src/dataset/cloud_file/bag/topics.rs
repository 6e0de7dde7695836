//! The topics of a bag and their message types.

use super::BagError;
use super::records::Records;
use mcap::records::Record;
use std::collections::BTreeMap;
use std::path::Path;

/// The message type of clouds, as ROS 2 schemas name it.
const CLOUDS: &str = "sensor_msgs/msg/PointCloud2";

/// A file's channels by number, and the topics of all files.
#[derive(Debug, Default)]
pub(super) struct Topics {
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, String>,
    /// The type of each topic's messages.
    types: BTreeMap<String, String>,
}

impl Topics {
    /// Takes in a schema or channel record.
    pub(super) fn take(&mut self, record: Record<'_>) {
        match record {
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name);
            }
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id);
                let of = kind(schema.map(String::as_str), &channel.message_encoding);
                self.types.insert(channel.topic.clone(), of);
                self.channels.insert(channel.id, channel.topic);
            }
            _ => {}
        }
    }

    /// Whether a channel carries messages of a topic.
    pub(super) fn is_of(&self, channel: u16, topic: &str) -> bool {
        self.channels.get(&channel).is_some_and(|of| of == topic)
    }

    /// The topics in the records, and the error that ended them early, if one did.
    fn of(mut records: Records) -> (Topics, Option<BagError>) {
        let mut topics = Topics::default();
        let end = records.find(|record| {
            topics.take(record);
            None::<()>
        });
        (topics, end.and_then(Result::err))
    }

    /// Takes in the topics of a file from its summary, or, if that is unusable, from all records that can be read.
    pub(super) fn read(&mut self, file: &Path) -> Result<(), BagError> {
        let summary = Records::of_summary(file).map(Topics::of);
        let found = match summary {
            Some((topics, None)) if !topics.channels.is_empty() => topics,
            _ => match Topics::of(Records::open(file)?) {
                (topics, Some(error)) if topics.channels.is_empty() => return Err(error),
                (topics, _) => topics,
            },
        };
        self.types.extend(found.types);
        Ok(())
    }

    /// The topic asked for, or else the only one that has clouds.
    pub(super) fn choose(&self, path: &Path, asked: Option<&str>) -> Result<String, BagError> {
        let path = path.to_path_buf();
        let clouds = self.types.iter().filter(|(_, of)| *of == CLOUDS);
        let clouds: Vec<&str> = clouds.map(|(topic, _)| topic.as_str()).collect();
        let listed = match clouds.as_slice() {
            [] => "none".into(),
            _ => clouds.join(", "),
        };
        match (asked, clouds.as_slice()) {
            (Some(topic), _) => match self.types.get(topic) {
                Some(of) if of == CLOUDS => Ok(topic.into()),
                Some(of) => Err(BagError::OtherType {
                    path,
                    topic: topic.into(),
                    of: of.clone(),
                    clouds: listed,
                }),
                None => Err(BagError::NoTopic {
                    path,
                    topic: topic.into(),
                    clouds: listed,
                }),
            },
            (None, [topic]) => Ok((*topic).into()),
            (None, []) => {
                let topics = self
                    .types
                    .iter()
                    .map(|(topic, of)| format!("{topic} ({of})"));
                Err(BagError::NoClouds {
                    path,
                    topics: topics.collect(),
                })
            }
            (None, _) => Err(BagError::SeveralTopics {
                path,
                clouds: listed,
            }),
        }
    }
}

/// The message type of a channel, with its encoding if that is not ROS 2's.
fn kind(schema: Option<&str>, encoding: &str) -> String {
    let schema = schema.unwrap_or("no type");
    match encoding {
        "cdr" => schema.into(),
        _ => format!("{schema}, encoded as {encoding:?}"),
    }
}
