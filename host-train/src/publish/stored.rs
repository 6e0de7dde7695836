//! Policies in a router's storage, where they stay when their publisher is gone.

use super::{PublishError, Publisher, chunk_table, refused, sign};
use crate::policy::WeightFile;
use reagent_core::wire::{self, Manifest, Message, keys};
use sha2::{Digest, Sha256};
use std::collections::BTreeSet;
use std::time::Duration;
use zenoh::Session;
use zenoh::qos::CongestionControl;
use zenoh::query::{ConsolidationMode, QueryTarget};

/// Time within which publishers and storages answer for manifests.
const ANSWER_TIME: Duration = Duration::from_secs(2);
/// Time for a storage to return a whole policy.
const READ_TIME: Duration = Duration::from_secs(60);

/// The manifests that others serve now; signatures are not checked.
pub(super) async fn announced(session: &Session, key: &str) -> zenoh::Result<Vec<Manifest>> {
    let replies = session
        .get(key)
        .target(QueryTarget::All)
        .consolidation(ConsolidationMode::None)
        .timeout(ANSWER_TIME)
        .await?;
    let mut found = Vec::new();
    while let Ok(reply) = replies.recv_async().await {
        let Ok(sample) = reply.result() else { continue };
        let frame = sample.payload().to_bytes();
        if let Ok(Message::SignedManifest(signed)) = wire::decode(&frame)
            && let Ok(Message::Manifest(manifest)) = wire::decode(signed.manifest)
        {
            found.push(manifest);
        }
    }
    Ok(found)
}

impl Publisher {
    /// Puts a policy's chunks where storages keep them, reads them back, and then puts its manifest, which announces it
    /// to the fleet. The storages serve it when this publisher is gone.
    ///
    /// # Errors
    /// As [`Publisher::publish`]; `NotStored` if other chunks come back than were put.
    pub async fn store(
        &mut self,
        version: u64,
        name: &str,
        file: &WeightFile,
    ) -> Result<Manifest, PublishError> {
        let manifest = self.prepare(version, name, file).await?;
        let name = |error| refused(&self.fleet)(error);
        let sha256 = &manifest.sha256;
        let table = chunk_table(file.bytes());
        let put = async |key: keys::Key, bytes: &[u8]| {
            let put = self.session.put(key.as_str(), bytes);
            put.congestion_control(CongestionControl::Block).await
        };
        for (index, chunk) in (0..).zip(file.bytes().chunks(wire::CHUNK_BYTES)) {
            put(
                keys::chunk(&self.fleet, sha256, index).map_err(name)?,
                chunk,
            )
            .await?;
        }
        put(
            keys::table(&self.fleet, sha256).map_err(name)?,
            &table.concat(),
        )
        .await?;
        self.read_back(&manifest, &table).await?;
        let signed = sign(&self.key, &manifest);
        put(keys::manifest(&self.fleet).map_err(name)?, &signed).await?;
        *self.newest.lock().expect("no holder panics") = Some((manifest.clone(), signed));
        Ok(manifest)
    }

    async fn read_back(&self, manifest: &Manifest, table: &[[u8; 32]]) -> Result<(), PublishError> {
        let key = keys::chunks(&self.fleet, &manifest.sha256).map_err(refused(&self.fleet))?;
        let replies = self
            .session
            .get(key.as_str())
            .target(QueryTarget::All)
            .timeout(READ_TIME)
            .await?;
        let mut stored = BTreeSet::new();
        while let Ok(reply) = replies.recv_async().await {
            let Ok(sample) = reply.result() else { continue };
            let found: [u8; 32] = Sha256::digest(sample.payload().to_bytes()).into();
            let index = keys::chunk_index(sample.key_expr().as_str());
            stored.extend(index.filter(|&i| table.get(i as usize) == Some(&found)));
        }
        if stored.len() == table.len() {
            Ok(())
        } else {
            Err(PublishError::NotStored {
                stored: stored.len(),
                chunks: table.len(),
                key: key.to_string(),
            })
        }
    }
}
