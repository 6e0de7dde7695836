//! A Zenoh network on loopback, random policies and clouds, for tests that need a fleet.
#![allow(dead_code, reason = "each test program uses a part")]

pub(crate) mod datagrams;
pub(crate) mod link;
pub(crate) mod process;
pub(crate) mod rollout;
pub(crate) mod secured;

use ed25519_dalek::SigningKey;
use firmware_sim::node::{Node, NodeConfig};
use firmware_sim::policy::Trust;
use firmware_sim::session::{SessionArgs, open};
use firmware_sim::view::View;
use host_train::dataset::procedural;
use host_train::learn::nn::{Parameters, Shape};
use host_train::policy::WeightFile;
use host_train::protocol::{self, Protocol};
use host_train::publish::{Publisher, chunk_table, sign};
use host_train::random::{Purpose, Rng, stream};
use rand::RngExt;
use reagent_core::net::Scratch;
use reagent_core::wire::{self, CloudView, Manifest, Mode, RefineRequest, keys};
use reagent_core::{Decision, Frame, Pose, Registrar};
use reagent_tests::network::network;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::sync::watch;
use zenoh::key_expr::KeyExpr;
use zenoh::pubsub::Subscriber;
use zenoh::query::{Query, Queryable};
use zenoh::{Session, Wait};

/// A private router of a test.
pub(crate) struct Network {
    pub(crate) endpoint: String,
    pub(crate) router: Session,
}

impl Network {
    pub(crate) async fn start() -> Network {
        let (router, endpoint) = network().await;
        Network { endpoint, router }
    }

    /// Opens another session that is connected to the router.
    pub(crate) async fn join(&self) -> Session {
        open(&SessionArgs {
            connect: vec![self.endpoint.clone()],
            ..SessionArgs::default()
        })
        .await
        .expect("the router listens")
    }

    /// A node without a state directory that takes any signed policy.
    pub(crate) async fn node(&self, fleet: &str, robot: &str) -> Node {
        let config = NodeConfig {
            fleet: fleet.into(),
            robot: robot.into(),
            trust: Trust::AnyKey,
            state: None,
        };
        let node = Node::start(self.join().await, config);
        node.await.expect("the names are good")
    }
}

/// A robot of the fleet that keeps its policy in a directory and takes any signed one.
pub(crate) fn config(state: &Path) -> NodeConfig {
    NodeConfig {
        fleet: FLEET.into(),
        robot: "r1".into(),
        trust: Trust::AnyKey,
        state: Some(state.into()),
    }
}

/// Waits until somebody serves a key, as this session sees it.
pub(crate) async fn served(session: &Session, key: &str) {
    let querier = session.declare_querier(key.to_owned()).await;
    let querier = querier.expect("an open session");
    let changes = querier.matching_listener().await.expect("an open session");
    let mut status = querier.matching_status().await.expect("an open session");
    while !status.matching() {
        status = changes.recv_async().await.expect("an open session");
    }
}

/// Waits until the node's state is as wanted; only a broken node triggers the watchdog.
pub(crate) async fn until(node: &Node, wanted: impl FnMut(&View) -> bool) -> View {
    let mut view: watch::Receiver<View> = node.watch();
    let reached = tokio::time::timeout(Duration::from_secs(60), view.wait_for(wanted));
    let reached = reached.await.expect("the node gets there within a minute");
    reached.expect("the node runs").clone()
}

/// A policy file with seeded random weights.
pub(crate) fn random_policy(seed: u64) -> WeightFile {
    WeightFile::from_parameters(&Parameters::random(Shape::PAPER, seed)).expect("deployable")
}

/// The bundled policy in 8-bit integers, with its decision rule.
pub(crate) fn int8_policy() -> WeightFile {
    let parameters = WeightFile::pretrained().parameters(0).expect("f32");
    let models = procedural::models(1, 4);
    let calibration = protocol::draw(&models, Protocol::M40Models, 4, 1);
    let file = WeightFile::from_parameters_int8(&parameters, &calibration).expect("deployable");
    file.deciding(Decision::default())
}

/// Seeded random points in a box.
pub(crate) fn random_cloud(seed: u64, points: usize) -> Vec<[f32; 3]> {
    let mut rng: Rng = stream(seed, Purpose::Shape, 0);
    let point = |_| [(); 3].map(|()| rng.random_range(-3.0..5.0));
    (0..points).map(point).collect()
}

/// The fleet of the tests.
pub(crate) const FLEET: &str = "test";

/// One of a few signing keys.
pub(crate) fn key(seed: u8) -> SigningKey {
    SigningKey::from_bytes(&[seed; 32])
}

/// A publisher that signs with the first key, on a session of its own.
pub(crate) async fn publisher(network: &Network) -> Publisher {
    Publisher::new(network.join().await, FLEET, key(1)).expect("a good name")
}

/// A host that announces a policy and serves its chunks, as a broken or hostile one might.
pub(crate) struct Host {
    pub(crate) manifest: Manifest,
    pub(crate) signed: Vec<u8>,
    /// Number of chunks that were asked for so far.
    pub(crate) asked: Arc<AtomicU32>,
    _serving: Queryable<()>,
}

impl Host {
    /// Serves `table`, and what `chunk` returns for each index; an error reply for `None`.
    pub(crate) async fn serve(
        session: &Session,
        manifest: Manifest,
        table: Vec<u8>,
        chunk: impl Fn(u32) -> Option<Vec<u8>> + Send + Sync + 'static,
    ) -> Host {
        let asked = Arc::new(AtomicU32::new(0));
        let count = asked.clone();
        let chunks = keys::chunks(FLEET, &manifest.sha256).expect("a good name");
        let answer = move |query: Query| {
            let bytes = match keys::chunk_index(query.key_expr().as_str()) {
                None => Some(table.clone()),
                Some(index) => {
                    count.fetch_add(1, Ordering::Relaxed);
                    chunk(index)
                }
            };
            match bytes {
                Some(bytes) => query.reply(query.key_expr().clone(), bytes).wait(),
                None => query.reply_err("not now").wait(),
            }
            .expect("an open session");
        };
        let serving = session.declare_queryable(chunks.as_str()).callback(answer);
        Host {
            signed: sign(&key(1), &manifest),
            manifest,
            asked,
            _serving: serving.await.expect("an open session"),
        }
    }

    /// Serves a file whose manifest is `manifest`.
    pub(crate) async fn of_file(session: &Session, manifest: Manifest, file: Vec<u8>) -> Host {
        let table = chunk_table(&file).concat();
        let chunk = move |index: u32| {
            let chunk = file.chunks(wire::CHUNK_BYTES).nth(index as usize);
            chunk.map(<[u8]>::to_vec)
        };
        Host::serve(session, manifest, table, chunk).await
    }

    pub(crate) async fn announce(&self, session: &Session) {
        put_manifest(session, self.signed.clone()).await;
    }

    pub(crate) fn asked(&self) -> u32 {
        self.asked.load(Ordering::Relaxed)
    }
}

/// Keeps the fleet's policies as a router's storage does: it stores what is put, and answers with it.
pub(crate) async fn storage(router: &Session) -> (Subscriber<()>, Queryable<()>) {
    let kept: Arc<Mutex<BTreeMap<String, Vec<u8>>>> = Arc::default();
    let everything = format!("reagent/v1/{FLEET}/policy/**");
    let keeping = kept.clone();
    let put = router.declare_subscriber(&everything);
    let put = put.callback(move |sample| {
        let (key, bytes) = (sample.key_expr().to_string(), sample.payload().to_bytes());
        let mut kept = keeping.lock().expect("no holder panics");
        kept.insert(key, bytes.into_owned());
    });
    let put = put.await.expect("an open session");
    let asked = router.declare_queryable(&everything).complete(true);
    let asked = asked.callback(move |query| {
        let kept = kept.lock().expect("no holder panics").clone();
        for (key, bytes) in kept {
            let key = KeyExpr::try_from(key).expect("it was a key");
            if query.key_expr().intersects(&key) {
                query.reply(key, bytes).wait().expect("an open session");
            }
        }
    });
    (put, asked.await.expect("an open session"))
}

/// Publishes a frame where manifests are announced, once a robot listens there.
pub(crate) async fn put_manifest(session: &Session, frame: Vec<u8>) {
    let manifest = keys::manifest(FLEET).expect("a good name");
    let publisher = session.declare_publisher(manifest.as_str()).await;
    let publisher = publisher.expect("an open session");
    let listener = publisher
        .matching_listener()
        .await
        .expect("an open session");
    let mut heard = publisher.matching_status().await.expect("an open session");
    while !heard.matching() {
        heard = listener.recv_async().await.expect("an open session");
    }
    publisher.put(frame).await.expect("an open session");
}

/// A request for ten steps of the policy, with enough time on a busy machine.
pub(crate) fn request<'a>(source: &'a [[f32; 3]], target: &'a [[f32; 3]]) -> RefineRequest<'a> {
    RefineRequest {
        mode: Mode::Fast,
        budget_ms: 60_000,
        ..RefineRequest::new(77, CloudView::of(source), CloudView::of(target))
    }
}

/// The pose that core computes here for the same clouds.
pub(crate) fn local_pose(
    policy: &WeightFile,
    source: &[[f32; 3]],
    target: &[[f32; 3]],
    start: Pose,
) -> Pose {
    let mut scratch = Scratch::new();
    let frame = Frame::of(target).expect("a good cloud");
    Registrar::new(policy.policy(), &mut scratch)
        .register(source, target, frame, start, 10)
        .expect("good clouds")
        .target_from_source
}
