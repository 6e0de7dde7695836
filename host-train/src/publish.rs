//! Shipping policies: a signed announcement, and the file in small chunks on request.

mod arguments;
mod command;
mod comparison;
mod error;
mod followed;
mod halt;
mod history;
mod judgement;
mod key;
mod provenance;
mod reception;
mod robots;
mod roll_out;
mod stages;
mod statistics;
mod stored;
mod version;
mod witness;

pub use crate::policy::manifest::{chunk_table, manifest};
pub use arguments::PublishArgs;
pub use command::run;
pub use comparison::{Comparison, Paired};
pub use error::PublishError;
pub use halt::Halt;
pub use key::{KeyError, keygen, read_key};
pub use provenance::Provenance;
pub use reagent_link::session::{
    SessionArgs, SessionError, has_certificate, open as open_session, plain,
};
pub use reception::{Heard, Reception};
pub use roll_out::Gate;
pub use stages::Stages;

use crate::policy::WeightFile;
use ed25519_dalek::{Signer, SigningKey};
use reagent_core::Error;
use reagent_core::wire::{self, Manifest, Message, SignedManifest, Status, keys};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use zenoh::query::{Query, Queryable};
use zenoh::{Session, Wait};

/// How long a router may take to pass on an announcement.
const KNOWN_WITHIN: Duration = Duration::from_secs(2);

/// A publisher's newest manifest, plain and as a signed frame, shared with whoever serves it.
type Newest = Arc<Mutex<Option<(Manifest, Vec<u8>)>>>;

/// Serves one fleet's policies while it lives. It answers requests for the newest manifest and for the chunks of every
/// policy published, so that a robot can finish an older one that it has begun.
#[derive(Debug)]
pub struct Publisher {
    session: Session,
    fleet: String,
    key: SigningKey,
    newest: Newest,
    queryables: Vec<Queryable<()>>,
    announcing: Option<Queryable<()>>,
    /// What robots reported before the newest policy was announced.
    before: BTreeMap<String, Status>,
    /// Provenance of the policies published from now on.
    pub provenance: Provenance,
    /// Epoch of the policies published from now on. The next epoch is the way back from a version that should never
    /// have been.
    pub epoch: u32,
    /// A session with the same rights, which checks that announcements are heard.
    pub listener: Option<Session>,
}

impl Publisher {
    /// A publisher for `fleet` that has nothing to publish yet.
    ///
    /// # Errors
    /// `Name` for a fleet name that cannot be part of a key expression.
    pub fn new(session: Session, fleet: &str, key: SigningKey) -> Result<Self, PublishError> {
        keys::checked_name(fleet).map_err(refused(fleet))?;
        Ok(Publisher {
            session,
            fleet: fleet.into(),
            key,
            newest: Arc::default(),
            queryables: Vec::new(),
            announcing: None,
            before: BTreeMap::new(),
            provenance: Provenance::default(),
            epoch: 0,
            listener: None,
        })
    }

    /// Serves a policy file's chunks and announces it to the fleet.
    ///
    /// # Errors
    /// `Name` for a name longer than 32 bytes; `Version` for a version that is not newer, or that somebody else has
    /// announced with other content; `Epoch`; `FarAhead`; `Unheard` if there is a listener; `Zenoh`.
    pub async fn publish(
        &mut self,
        version: u64,
        name: &str,
        file: WeightFile,
    ) -> Result<Manifest, PublishError> {
        let manifest = self.prepare(version, name, &file).await?;
        self.serve(&manifest, file).await?;
        self.announce(&manifest).await?;
        Ok(manifest)
    }

    /// Serves a policy's chunks from now on.
    async fn serve(&mut self, manifest: &Manifest, file: WeightFile) -> Result<(), PublishError> {
        let table = chunk_table(file.bytes()).concat();
        let chunks = keys::chunks(&self.fleet, &manifest.sha256).map_err(refused(&self.fleet))?;
        let served = self
            .session
            .declare_queryable(chunks.as_str())
            .complete(true)
            .callback(move |query| answer_chunk(&query, file.bytes(), &table));
        self.queryables.push(served.await?);
        Ok(())
    }

    /// Announces a policy whose chunks are served, now and to whoever asks later.
    async fn announce(&mut self, manifest: &Manifest) -> Result<(), PublishError> {
        let signed = sign(&self.key, manifest);
        let key = keys::manifest(&self.fleet).map_err(refused(&self.fleet))?;
        *self.newest.lock().expect("no holder panics") = Some((manifest.clone(), signed.clone()));
        if self.announcing.is_none() {
            let (newest, reply_key) = (self.newest.clone(), key.clone());
            let served = self
                .session
                .declare_queryable(key.as_str())
                .complete(true)
                .callback(move |query| {
                    let newest = newest.lock().expect("no holder panics").clone();
                    if let Some((_, frame)) = newest {
                        log_failure(query.reply(reply_key.as_str(), frame).wait());
                    }
                });
            self.announcing = Some(served.await?);
        }
        self.session.put(key.as_str(), signed).await?;
        match &self.listener {
            Some(from) => self.check_heard(from).await,
            None => Ok(()),
        }
    }

    /// Asks for the newest manifest from another session, as robots do, until a router has had time to pass it on.
    async fn check_heard(&self, from: &Session) -> Result<(), PublishError> {
        let own = self.newest.lock().expect("no holder panics").clone();
        let own = own.map(|(manifest, _)| manifest.id());
        let key = keys::manifest(&self.fleet).map_err(refused(&self.fleet))?;
        let begun = Instant::now();
        loop {
            let announced = stored::announced(from, &key).await?;
            if announced.iter().any(|found| Some(found.id()) == own) {
                return Ok(());
            }
            if begun.elapsed() > KNOWN_WITHIN {
                let fleet = self.fleet.clone();
                return Err(PublishError::Unheard { fleet });
            }
            tokio::time::sleep(KNOWN_WITHIN / 40).await;
        }
    }

    /// Makes the manifest of a policy, and checks that the fleet may be given it.
    ///
    /// # Errors
    /// As [`Publisher::publish`].
    pub async fn prepare(
        &mut self,
        version: u64,
        name: &str,
        file: &WeightFile,
    ) -> Result<Manifest, PublishError> {
        let manifest = self.manifest(version, name, file)?;
        self.check_version(&manifest).await?;
        Ok(manifest)
    }

    fn manifest(
        &self,
        version: u64,
        name: &str,
        file: &WeightFile,
    ) -> Result<Manifest, PublishError> {
        Ok(Manifest {
            epoch: self.epoch,
            training_sha256: self.provenance.training,
            evaluation_sha256: self.provenance.evaluation,
            ..manifest(version, name, file).map_err(refused(name))?
        })
    }
}

/// The signed manifest frame that robots check.
pub fn sign(key: &SigningKey, manifest: &Manifest) -> Vec<u8> {
    let mut buffer = [0; wire::SMALL_FRAME_BYTES];
    let inner = wire::encode(&Message::Manifest(manifest.clone()), &mut buffer)
        .expect("small frames fit their buffer");
    let signature = key.sign(inner);
    let signed = Message::SignedManifest(SignedManifest {
        manifest: inner,
        public_key: key.verifying_key().to_bytes(),
        signature: [*signature.r_bytes(), *signature.s_bytes()],
    });
    let mut buffer = [0; wire::SMALL_FRAME_BYTES];
    wire::encode(&signed, &mut buffer)
        .expect("small frames fit their buffer")
        .to_vec()
}

fn answer_chunk(query: &Query, file: &[u8], table: &[u8]) {
    if keys::is_table(query.key_expr().as_str()) {
        log_failure(query.reply(query.key_expr().clone(), table).wait());
        return;
    }
    let chunk = keys::chunk_index(query.key_expr().as_str())
        .and_then(|index| file.chunks(wire::CHUNK_BYTES).nth(index as usize));
    log_failure(match chunk {
        Some(chunk) => query.reply(query.key_expr().clone(), chunk).wait(),
        None => query.reply_err("no such chunk").wait(),
    });
}

fn log_failure(sent: zenoh::Result<()>) {
    if let Err(error) = sent {
        tracing::warn!("an answer was not sent: {error}");
    }
}

fn refused(name: &str) -> impl FnOnce(Error) -> PublishError {
    let name = name.to_owned();
    move |reason| PublishError::Name { name, reason }
}
