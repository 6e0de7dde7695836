//! A private Zenoh network for a test, on loopback.

use reagent_link::session::{SessionArgs, open, unused_endpoint};
use zenoh::Session;

/// Opens a router at an endpoint.
pub async fn router(endpoint: &str) -> Session {
    let args = SessionArgs {
        listen: vec![endpoint.into()],
        ..SessionArgs::default()
    };
    open(&args).await.expect("the port is free")
}

/// Opens a router, and returns it with the endpoint that it listens on.
pub async fn network() -> (Session, String) {
    let endpoint = unused_endpoint().expect("a free port");
    (router(&endpoint).await, endpoint)
}
