//! Keeps the traces that robots publish in a file.

use crate::client::{Client, MARGIN, RefineError};
use anyhow::Context;
use host_train::files;
use reagent_core::wire::{self, Message, keys, serial};
use std::path::{Path, PathBuf};
use zenoh::handlers::FifoChannelHandler;
use zenoh::pubsub::Subscriber;
use zenoh::sample::Sample;

/// Collects traces and writes them to a file, as frames as on a serial line.
pub(super) struct Traces {
    published: Subscriber<FifoChannelHandler<Sample>>,
    path: PathBuf,
    lines: Vec<u8>,
}

impl Traces {
    pub(super) async fn start(client: &Client, fleet: &str, path: &Path) -> anyhow::Result<Traces> {
        let key = keys::all_traces(fleet).map_err(RefineError::Request)?;
        let published = client.session().declare_subscriber(key.as_str()).await;
        Ok(Traces {
            published: published.map_err(RefineError::Zenoh)?,
            path: path.into(),
            lines: Vec::new(),
        })
    }

    /// Waits for the trace of an answer.
    pub(super) async fn take(&mut self, robot: &str, id: u64) -> anyhow::Result<()> {
        let published = async {
            loop {
                let sample = self.published.recv_async().await;
                let sample = sample.map_err(RefineError::Zenoh)?;
                if keys::robot_of(sample.key_expr().as_str()) != Some(robot) {
                    continue;
                }
                let frame = sample.payload().to_bytes();
                if let Ok(Message::Trace(trace)) = wire::decode(&frame)
                    && trace.reply.id == id
                {
                    return anyhow::Ok(frame.into_owned());
                }
            }
        };
        let frame = tokio::time::timeout(MARGIN, published).await;
        let frame = frame.with_context(|| format!("robot {robot} published no trace"))??;
        serial::write(&frame, |byte| self.lines.push(byte));
        Ok(())
    }

    /// Writes the file with the traces that have come.
    pub(super) fn write(&self) -> anyhow::Result<()> {
        files::write(&self.path, &self.lines)
            .with_context(|| format!("cannot write {}", self.path.display()))
    }
}
