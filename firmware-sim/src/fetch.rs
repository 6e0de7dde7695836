//! Fetching a policy file by query, chunk by chunk, into the idle slot.
//!
//! Chunks that the policy in use also has are copied from it. Chunks that came before a lost link or a restart are kept.
//! All robots of a fleet learn of a policy at the same moment. So each robot waits for a short time of its own before it
//! asks, and longer after every failure.

use crate::flash::RobotFlash;
use crate::policy::UpdateError;
use reagent_core::wire::{CHUNK_BYTES, Manifest, keys};
use reagent_slots::{SlotError, Slots};
use sha2::{Digest, Sha256};
use std::collections::VecDeque;
use std::time::Duration;
use zenoh::Session;
use zenoh::bytes::ZBytes;
use zenoh::handlers::FifoChannelHandler;
use zenoh::query::Reply;

/// Queries in flight at once.
const IN_FLIGHT: usize = 8;
/// A chunk that takes longer is asked for again.
const CHUNK_TIMEOUT: Duration = Duration::from_secs(5);
/// After so many rounds without a new chunk the download is given up, until the policy is announced again.
const IDLE_ROUNDS: u32 = 4;
/// Longest wait before the first round.
const SPREAD: Duration = Duration::from_millis(100);
/// Longest wait after the first failed round; it doubles with each further one.
const BACK_OFF: Duration = Duration::from_millis(200);

/// Pseudo-random waiting times of one robot.
#[derive(Clone, Debug)]
pub(crate) struct Jitter {
    seed: [u8; 32],
}

impl Jitter {
    /// Seeded by the robot's name, so that robots wait for different times.
    pub(crate) fn of(robot: &str) -> Self {
        Jitter {
            seed: Sha256::digest(robot).into(),
        }
    }

    /// A time between zero and `longest`.
    fn wait(&mut self, longest: Duration) -> Duration {
        self.seed = Sha256::digest(self.seed).into();
        let [a, b, ..] = self.seed;
        longest.mul_f64(f64::from(u16::from_le_bytes([a, b])) / f64::from(u16::MAX))
    }
}

/// Brings the file that `manifest` announces into the idle slot. `frame` is the signed manifest.
///
/// # Errors
/// `Chunk` if a chunk, after several attempts, does not come or is not the one in the manifest; `Length`, `Frame`, `Zenoh`,
/// `Slots`.
pub(crate) async fn download(
    session: &Session,
    fleet: &str,
    manifest: &Manifest,
    frame: &[u8],
    slots: &mut Slots<RobotFlash>,
    jitter: &mut Jitter,
) -> Result<(), UpdateError> {
    if manifest.chunk_length as usize != CHUNK_BYTES {
        return Err(UpdateError::Length {
            length: manifest.length,
            chunk_length: manifest.chunk_length,
        });
    }
    tokio::time::sleep(jitter.wait(SPREAD)).await;
    let mut fetch = Fetch {
        session,
        fleet,
        manifest,
        slots,
    };
    let mut failures = 0;
    let mut back_off = async |failures: u32| {
        tokio::time::sleep(jitter.wait(BACK_OFF * 2u32.pow(failures))).await;
    };
    let table = loop {
        match fetch.table().await {
            Ok(table) => break table,
            Err(error) if failures == IDLE_ROUNDS => return Err(error),
            Err(_) => back_off(failures).await,
        }
        failures += 1;
    };
    fetch.slots.begin(frame, manifest.length, &table).await?;
    let mut missing = fetch.missing().await?;
    let mut failures = 0;
    loop {
        let before = missing.len();
        let error = fetch.round(&mut missing).await?;
        let Some(error) = error else { return Ok(()) };
        if missing.len() < before {
            failures = 0;
        } else if failures == IDLE_ROUNDS {
            return Err(error);
        }
        back_off(failures).await;
        failures += 1;
    }
}

/// A download in progress.
struct Fetch<'a> {
    session: &'a Session,
    fleet: &'a str,
    manifest: &'a Manifest,
    slots: &'a mut Slots<RobotFlash>,
}

impl Fetch<'_> {
    /// The SHA-256 of every chunk.
    async fn table(&self) -> Result<Vec<[u8; 32]>, UpdateError> {
        let key = keys::table(self.fleet, &self.manifest.sha256).map_err(UpdateError::Frame)?;
        let failed = |reason: String| self.failed(0, &key, reason);
        let replies = self.ask(&key).await?;
        let bytes = answer(replies)
            .await
            .map_err(failed)?
            .to_bytes()
            .into_owned();
        let found: [u8; 32] = Sha256::digest(&bytes).into();
        if found != self.manifest.table_sha256 {
            return Err(failed("another table than the manifest says".into()));
        }
        Ok(bytes.as_chunks().0.to_vec())
    }

    /// The chunks that have not come yet. Chunks that the policy in use has are copied and not listed.
    async fn missing(&mut self) -> Result<VecDeque<u32>, UpdateError> {
        let mut buffer = vec![0; CHUNK_BYTES];
        let (mut missing, mut from) = (VecDeque::new(), 0);
        while let Some(index) = self.slots.missing(from).await? {
            if !self.slots.reuse_chunk(index, &mut buffer).await? {
                missing.push_back(index);
            }
            from = index + 1;
        }
        Ok(missing)
    }

    /// Asks once for every missing chunk. Chunks that fail stay in `missing`, and the last reason is returned.
    async fn round(
        &mut self,
        missing: &mut VecDeque<u32>,
    ) -> Result<Option<UpdateError>, UpdateError> {
        let mut left = std::mem::take(missing);
        let mut waiting = VecDeque::new();
        let mut last = None;
        loop {
            while waiting.len() < IN_FLIGHT
                && let Some(index) = left.pop_front()
            {
                let key = keys::chunk(self.fleet, &self.manifest.sha256, index);
                let key = key.map_err(UpdateError::Frame)?;
                let replies = self.ask(&key).await?;
                waiting.push_back((index, key, replies));
            }
            let Some((index, key, replies)) = waiting.pop_front() else {
                return Ok(last);
            };
            let kept = match answer(replies).await {
                Ok(bytes) => self.slots.write_chunk(index, &bytes.to_bytes()).await,
                Err(reason) => {
                    last = Some(self.failed(index, &key, reason));
                    missing.push_back(index);
                    continue;
                }
            };
            match kept {
                Ok(()) => {}
                Err(wrong @ (SlotError::Hash { .. } | SlotError::Length { .. })) => {
                    last = Some(self.failed(index, &key, wrong.to_string()));
                    missing.push_back(index);
                }
                Err(error) => {
                    // Receive the answers that are still on their way.
                    for (_, _, replies) in waiting {
                        while replies.recv_async().await.is_ok() {}
                    }
                    return Err(error.into());
                }
            }
        }
    }

    async fn ask(&self, key: &keys::Key) -> Result<FifoChannelHandler<Reply>, UpdateError> {
        let replies = self.session.get(key.as_str()).timeout(CHUNK_TIMEOUT).await;
        replies.map_err(UpdateError::Zenoh)
    }

    fn failed(&self, index: u32, key: &keys::Key, reason: String) -> UpdateError {
        UpdateError::Chunk {
            index,
            chunks: self.manifest.chunks().unwrap_or(0),
            key: key.to_string(),
            reason,
        }
    }
}

/// The first answer.
async fn answer(replies: FifoChannelHandler<Reply>) -> Result<ZBytes, String> {
    let reply = replies.recv_async().await;
    let reply = reply.map_err(|_| "nobody answered".to_owned())?;
    match reply.result() {
        Ok(sample) => Ok(sample.payload().clone()),
        Err(refused) => Err(String::from_utf8_lossy(&refused.payload().to_bytes()).into_owned()),
    }
}
