//! A link with faults, between sessions and a router: it delays, loses and is cut, with a seed.
//!
//! It carries TCP, so that lost segments are sent again, come late, and hold up everything after them.

use host_train::random::{Purpose, Rng, stream};
use rand::RngExt;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Notify, mpsc};
use tokio::task::JoinHandle;
use tokio::time::Instant;

/// How bad a link is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Faults {
    /// Delay, one way.
    pub(crate) delay: Duration,
    /// Share of segments that are lost, and come again after [`Self::again`].
    pub(crate) loss: f64,
    pub(crate) again: Duration,
}

/// A link that passes on what arrives at its endpoint.
pub(crate) struct Link {
    pub(crate) endpoint: String,
    cut: Arc<Notify>,
    accepting: JoinHandle<()>,
}

impl Link {
    /// A link to a router's endpoint.
    pub(crate) async fn to(router: &str, faults: Faults, seed: u64) -> Link {
        let listener = TcpListener::bind("127.0.0.1:0").await;
        let listener = listener.expect("a free port");
        let address = listener.local_addr().expect("it is bound");
        let router = router.trim_start_matches("tcp/").to_owned();
        let cut = Arc::new(Notify::new());
        let cutting = cut.clone();
        let accepting = tokio::spawn(async move {
            let mut number = 0;
            while let Ok((near, _)) = listener.accept().await {
                // Nobody listens there, and the caller's connection ends.
                let Ok(far) = TcpStream::connect(&router).await else {
                    continue;
                };
                let rngs = [0, 1].map(|way| stream(seed, Purpose::Shape, 2 * number + way));
                number += 1;
                tokio::spawn(connect(near, far, faults, rngs, cutting.clone()));
            }
        });
        Link {
            endpoint: format!("tcp/{address}"),
            cut,
            accepting,
        }
    }

    /// Cuts every connection; new ones may be made.
    pub(crate) fn cut(&self) {
        self.cut.notify_waiters();
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.accepting.abort();
        self.cut();
    }
}

async fn connect(
    near: TcpStream,
    far: TcpStream,
    faults: Faults,
    [there, back]: [Rng; 2],
    cut: Arc<Notify>,
) {
    let (near_read, near_write) = near.into_split();
    let (far_read, far_write) = far.into_split();
    tokio::select! {
        () = pass(near_read, far_write, faults, there) => {}
        () = pass(far_read, near_write, faults, back) => {}
        () = cut.notified() => {}
    }
}

async fn pass(
    mut from: impl AsyncReadExt + Unpin,
    mut to: impl AsyncWriteExt + Unpin,
    faults: Faults,
    mut rng: Rng,
) {
    // As much may be in flight as TCP's window would allow.
    let (sender, mut under_way) = mpsc::channel::<(Instant, Vec<u8>)>(256);
    let reading = async {
        let mut segment = vec![0; 1 << 14];
        let mut last = Instant::now();
        while let Ok(count @ 1..) = from.read(&mut segment).await {
            let lost = rng.random_bool(faults.loss);
            let late = if lost { faults.again } else { Duration::ZERO };
            last = last.max(Instant::now() + faults.delay + late);
            if sender
                .send((last, segment[..count].to_vec()))
                .await
                .is_err()
            {
                return;
            }
        }
    };
    let writing = async {
        while let Some((at, segment)) = under_way.recv().await {
            tokio::time::sleep_until(at).await;
            if to.write_all(&segment).await.is_err() {
                return;
            }
        }
    };
    tokio::select! {
        () = reading => {}
        () = writing => {}
    }
}
