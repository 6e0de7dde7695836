//! A Zenoh network of a test's own, on loopback.

use reagent_link::session::{SessionArgs, open, unused_endpoint};
use zenoh::Session;

/// A router at an endpoint.
pub async fn router(endpoint: &str) -> Session {
    let args = SessionArgs {
        listen: vec![endpoint.into()],
        ..SessionArgs::default()
    };
    open(&args).await.expect("the port is free")
}

/// A router, and the endpoint that it listens at.
pub async fn network() -> (Session, String) {
    let endpoint = unused_endpoint().expect("a free port");
    (router(&endpoint).await, endpoint)
}
