//! A Zenoh network on loopback, random policies and clouds, for tests that need a fleet.
#![allow(dead_code, reason = "each test program uses a part")]

use firmware_sim::node::{Node, NodeConfig};
use firmware_sim::session::{SessionArgs, open};
use firmware_sim::view::View;
use host_train::random::{Purpose, Rng, stream};
use rand::RngExt;
use reagent_core::dims::{LAYER_SHAPES, LAYERS, padded};
use reagent_core::weights::{self, ARRAY_ALIGN, HEADER, OFFSETS, TABLE_ROW};
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

/// A policy file with seeded random weights whose actions depend on the clouds.
pub(crate) fn random_policy(seed: u64) -> Vec<u8> {
    let mut rng = stream(seed, Purpose::Init, 0);
    let mut file = vec![0; weights::FILE_LEN];
    file[..4].copy_from_slice(&weights::MAGIC);
    file[4..6].copy_from_slice(&weights::VERSION.to_le_bytes());
    put(&mut file, 8, weights::FILE_LEN);
    put(&mut file, 12, LAYERS);
    for (i, width) in weights::SHAPE.iter().enumerate() {
        file[16 + 2 * i..18 + 2 * i].copy_from_slice(&width.to_le_bytes());
    }
    for (i, (&(inputs, outputs), &(at, bias))) in LAYER_SHAPES.iter().zip(&OFFSETS).enumerate() {
        assert!(at.is_multiple_of(ARRAY_ALIGN));
        for (k, value) in [inputs, outputs, at, bias].into_iter().enumerate() {
            put(&mut file, HEADER + i * TABLE_ROW + 4 * k, value);
        }
        let bound = (6.0 / inputs as f32).sqrt();
        for value in file[at..at + 4 * inputs * padded(outputs)].chunks_exact_mut(4) {
            value.copy_from_slice(&rng.random_range(-bound..bound).to_le_bytes());
        }
    }
    let (body, sum) = file.split_at_mut(weights::FILE_LEN - 4);
    sum.copy_from_slice(&weights::checksum(body).to_le_bytes());
    file
}

fn put(file: &mut [u8], at: usize, value: usize) {
    let value = u32::try_from(value).expect("the format stores it in 32 bits");
    file[at..at + 4].copy_from_slice(&value.to_le_bytes());
}

/// Seeded random points in a box.
pub(crate) fn random_cloud(seed: u64, points: usize) -> Vec<[f32; 3]> {
    let mut rng: Rng = stream(seed, Purpose::Shape, 0);
    let point = |_| [(); 3].map(|()| rng.random_range(-3.0..5.0));
    (0..points).map(point).collect()
}
