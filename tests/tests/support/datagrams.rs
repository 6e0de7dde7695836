//! A link of datagrams with faults: it delays them, loses some, and lets others overtake, with a seed.

use host_train::random::{Purpose, Rng, stream};
use rand::RngExt;
use std::collections::HashMap;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::net::UdpSocket;
use tokio::task::JoinHandle;

/// Least delay, one way.
const DELAY: Duration = Duration::from_millis(100);
/// Largest additional delay, drawn for each datagram: those that follow within it may overtake.
const JITTER: Duration = Duration::from_millis(100);
/// Share of datagrams that are lost.
const LOSS: f64 = 0.3;

/// A link to a router on this machine, perfect until [`Datagrams::spoil`].
pub(crate) struct Datagrams {
    pub(crate) port: u16,
    state: Arc<State>,
    passing: JoinHandle<()>,
}

struct State {
    bad: AtomicBool,
    rng: Mutex<Rng>,
    /// Number of the datagram sent last.
    sent: AtomicU64,
    /// The largest number that has arrived.
    arrived: AtomicU64,
    lost: AtomicU64,
    overtaken: AtomicU64,
}

impl Datagrams {
    pub(crate) async fn to(router: u16, seed: u64) -> Datagrams {
        let bind = || UdpSocket::bind((Ipv4Addr::LOCALHOST, 0));
        let near = Arc::new(bind().await.expect("a free port"));
        let port = near.local_addr().expect("it is bound").port();
        let state = Arc::new(State {
            bad: AtomicBool::new(false),
            rng: Mutex::new(stream(seed, Purpose::Shape, 0)),
            sent: AtomicU64::new(0),
            arrived: AtomicU64::new(0),
            lost: AtomicU64::new(0),
            overtaken: AtomicU64::new(0),
        });
        let passed = state.clone();
        let passing = tokio::spawn(async move {
            let mut far_sides = HashMap::<SocketAddr, Arc<UdpSocket>>::new();
            let mut buffer = vec![0; 1 << 16];
            while let Ok((count, from)) = near.recv_from(&mut buffer).await {
                let far = match far_sides.get(&from) {
                    Some(far) => far.clone(),
                    None => {
                        let far = Arc::new(bind().await.expect("a free port"));
                        let router = (Ipv4Addr::LOCALHOST, router);
                        far.connect(router).await.expect("loopback");
                        far_sides.insert(from, far.clone());
                        tokio::spawn(passed.clone().back(far.clone(), near.clone(), from));
                        far
                    }
                };
                passed.pass(&buffer[..count], far, None);
            }
        });
        Datagrams {
            port,
            state,
            passing,
        }
    }

    /// Makes the link bad from now on.
    pub(crate) fn spoil(&self) {
        self.state.bad.store(true, Ordering::Relaxed);
    }

    /// Numbers of datagrams that were lost and that others overtook.
    pub(crate) fn harm(&self) -> [u64; 2] {
        let State {
            lost, overtaken, ..
        } = &*self.state;
        [lost, overtaken].map(|count| count.load(Ordering::Relaxed))
    }
}

impl Drop for Datagrams {
    fn drop(&mut self) {
        self.passing.abort();
    }
}

impl State {
    async fn back(self: Arc<Self>, far: Arc<UdpSocket>, near: Arc<UdpSocket>, to: SocketAddr) {
        let mut buffer = vec![0; 1 << 16];
        // An error means that nobody listens there at the moment; the next datagram may arrive.
        while let Ok(count) = far.recv(&mut buffer).await {
            self.pass(&buffer[..count], near.clone(), Some(to));
        }
    }

    fn pass(self: &Arc<Self>, datagram: &[u8], by: Arc<UdpSocket>, to: Option<SocketAddr>) {
        let bad = self.bad.load(Ordering::Relaxed);
        let (lost, share) = {
            let mut rng = self.rng.lock().expect("no holder panics");
            (rng.random_bool(LOSS), rng.random_range(0.0..1.0))
        };
        if bad && lost {
            self.lost.fetch_add(1, Ordering::Relaxed);
            return;
        }
        let (state, datagram) = (self.clone(), datagram.to_vec());
        let number = self.sent.fetch_add(1, Ordering::Relaxed);
        tokio::spawn(async move {
            if bad {
                tokio::time::sleep(DELAY + JITTER.mul_f64(share)).await;
            }
            if state.arrived.fetch_max(number, Ordering::Relaxed) > number {
                state.overtaken.fetch_add(1, Ordering::Relaxed);
            }
            let sent = match to {
                Some(to) => by.send_to(&datagram, to).await,
                None => by.send(&datagram).await,
            };
            // A full buffer loses the datagram, as networks do.
            sent.ok();
        });
    }
}
