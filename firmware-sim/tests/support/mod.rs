//! A network of a test's own.
#![allow(dead_code, reason = "each test program uses a part")]

use firmware_sim::session::{SessionArgs, open};
use std::net::{Ipv4Addr, TcpListener};
use std::sync::atomic::{AtomicU8, Ordering};
use zenoh::Session;

/// On a loopback address of its own: no connection of another test takes its port before it is listened on.
pub(crate) fn unused_endpoint() -> String {
    static ENDPOINTS: AtomicU8 = AtomicU8::new(2);
    let last = ENDPOINTS.fetch_add(1, Ordering::Relaxed);
    let [_, _, a, b] = std::process::id().to_be_bytes();
    let listener = TcpListener::bind((Ipv4Addr::new(127, a, b, last), 0)).expect("a free port");
    format!("tcp/{}", listener.local_addr().expect("it is bound"))
}

/// A router at an endpoint.
pub(crate) async fn router(endpoint: &str) -> Session {
    let args = SessionArgs {
        listen: vec![endpoint.into()],
        ..SessionArgs::default()
    };
    open(&args).await.expect("the port is free")
}

/// A router, and the endpoint that it listens at.
pub(crate) async fn network() -> (Session, String) {
    let endpoint = unused_endpoint();
    (router(&endpoint).await, endpoint)
}
