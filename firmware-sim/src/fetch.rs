//! Fetching a policy file by query, chunk by chunk.

use crate::policy::UpdateError;
use reagent_core::wire::{Manifest, keys};
use std::collections::VecDeque;
use std::time::Duration;
use zenoh::Session;

/// Queries under way at once.
const IN_FLIGHT: u32 = 4;
/// A chunk that takes longer is an error.
const CHUNK_TIMEOUT: Duration = Duration::from_secs(5);

/// Fetches the file that `manifest` announces. Lengths are checked here, the hash is not.
///
/// # Errors
/// `Chunk` for the first chunk that does not come or has a wrong length; `Length`, `Frame`, `Zenoh`.
pub async fn fetch(
    session: &Session,
    fleet: &str,
    manifest: &Manifest,
) -> Result<Vec<u8>, UpdateError> {
    let chunks = manifest.chunks().ok_or(UpdateError::Length {
        length: manifest.length,
        chunk_length: manifest.chunk_length,
    })?;
    let mut file = Vec::with_capacity(manifest.length as usize);
    let mut waiting = VecDeque::new();
    let mut asked = 0;
    for index in 0..chunks {
        while asked < chunks.min(index + IN_FLIGHT) {
            let key = keys::chunk(fleet, &manifest.sha256, asked).map_err(UpdateError::Frame)?;
            let replies = session.get(key.as_str()).timeout(CHUNK_TIMEOUT).await;
            waiting.push_back((key, replies.map_err(UpdateError::Zenoh)?));
            asked += 1;
        }
        let (key, replies) = waiting.pop_front().expect("one was asked for just now");
        let failed = |reason: String| UpdateError::Chunk {
            index,
            chunks,
            key: key.to_string(),
            reason,
        };
        let reply = replies.recv_async().await;
        let reply = reply.map_err(|_| failed("nobody answered".into()))?;
        let sample = reply.result().map_err(|refused| {
            failed(String::from_utf8_lossy(&refused.payload().to_bytes()).into_owned())
        })?;
        let left = manifest.length as usize - file.len();
        let expected = left.min(manifest.chunk_length as usize);
        let found = sample.payload().len();
        if found != expected {
            return Err(failed(format!("{found} bytes where {expected} are right")));
        }
        file.extend_from_slice(&sample.payload().to_bytes());
    }
    Ok(file)
}
