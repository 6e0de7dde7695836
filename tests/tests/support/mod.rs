//! A Zenoh network on loopback, random policies and clouds, for tests that need a fleet.
#![allow(dead_code, reason = "each test program uses a part")]

use firmware_sim::node::{Node, NodeConfig};
use firmware_sim::session::{SessionArgs, open};
use firmware_sim::view::View;
use host_train::export::WeightFile;
use host_train::nn::{Parameters, Shape};
use host_train::random::{Purpose, Rng, stream};
use rand::RngExt;
use std::net::TcpListener;
use std::time::Duration;
use tokio::sync::watch;
use zenoh::Session;

/// A router that only this test knows.
pub(crate) struct Network {
    pub(crate) endpoint: String,
    pub(crate) router: Session,
}

impl Network {
    pub(crate) async fn start() -> Network {
        let endpoint = unused_endpoint();
        let args = SessionArgs {
            listen: vec![endpoint.clone()],
            ..SessionArgs::default()
        };
        Network {
            router: open(&args).await.expect("the port is free"),
            endpoint,
        }
    }

    /// A session of its own, connected to the router.
    pub(crate) async fn join(&self) -> Session {
        open(&SessionArgs {
            connect: vec![self.endpoint.clone()],
            ..SessionArgs::default()
        })
        .await
        .expect("the router listens")
    }

    /// A node without state directory that takes any signed policy.
    pub(crate) async fn node(&self, fleet: &str, robot: &str) -> Node {
        let config = NodeConfig {
            fleet: fleet.into(),
            robot: robot.into(),
            trusted: vec![],
            state: None,
        };
        let node = Node::start(self.join().await, config);
        node.await.expect("the names are good")
    }
}

/// A loopback endpoint on which nothing listens.
pub(crate) fn unused_endpoint() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = listener.local_addr().expect("it is bound");
    format!("tcp/{address}")
}

/// Waits until the node's state is as wanted; only a broken node lets the watchdog bite.
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

/// Seeded random points in a box.
pub(crate) fn random_cloud(seed: u64, points: usize) -> Vec<[f32; 3]> {
    let mut rng: Rng = stream(seed, Purpose::Shape, 0);
    let point = |_| [(); 3].map(|()| rng.random_range(-3.0..5.0));
    (0..points).map(point).collect()
}
