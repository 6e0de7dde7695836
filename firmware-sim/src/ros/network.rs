//! The network of a node: as nodes of `rmw_zenoh` do, it goes to the router of this machine unless another network is named, and
//! waits for it.

use crate::session::{SessionArgs, SessionError, open};
use zenoh::Session;

/// Where the router that `ros2 run rmw_zenoh_cpp rmw_zenohd` starts is found on its own machine.
const ROUTER: &str = "tcp/localhost:7447";

/// A network to join.
#[derive(Debug)]
pub(super) struct Network {
    pub(super) args: SessionArgs,
    /// Whether a network that nobody named is waited for.
    waits: bool,
}

impl Network {
    /// The network that the options name, or the router of this machine.
    pub(super) fn named(args: SessionArgs) -> Network {
        Network::or_at(args, ROUTER)
    }

    fn or_at(args: SessionArgs, router: &str) -> Network {
        let SessionArgs {
            zenoh,
            connect,
            listen,
        } = &args;
        let waits = zenoh.is_none() && connect.is_empty() && listen.is_empty();
        let connect = match waits {
            true => vec![router.into()],
            false => args.connect,
        };
        let args = SessionArgs { connect, ..args };
        Network { args, waits }
    }

    /// Opens a session. If the router of this machine does not answer, says so once by `tell` and goes on trying.
    ///
    /// # Errors
    /// See [`SessionError`]; of this machine's router, only what trying again does not help.
    pub(super) async fn join(&self, tell: impl Fn(&str)) -> Result<Session, SessionError> {
        let mut is_told = false;
        loop {
            match open(&self.args).await {
                Err(SessionError::Open { .. }) if self.waits => {}
                joined => return joined,
            }
            if !is_told {
                tell(&self.advice());
                is_told = true;
            }
        }
    }

    /// What to do if the router does not answer.
    fn advice(&self) -> String {
        let router = self.args.connect.join(", ");
        format!(
            "no router answers at {router}: start it with `ros2 run rmw_zenoh_cpp rmw_zenohd`, or name another one with \
             --connect tcp/HOST:7447; trying until one answers"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use reagent_link::session::unused_endpoint;
    use std::time::Duration;
    use tokio::sync::mpsc::unbounded_channel;
    use tokio::time::timeout;

    fn at(endpoint: &str) -> Vec<String> {
        vec![endpoint.into()]
    }

    #[test]
    fn only_a_network_that_nobody_names_is_the_router_of_this_machine() {
        let unnamed = Network::named(SessionArgs::default());
        assert!(unnamed.waits && unnamed.args.connect == at(ROUTER));
        let listens = SessionArgs {
            listen: at("tcp/127.0.0.1:1"),
            ..SessionArgs::default()
        };
        let connects = SessionArgs {
            connect: at("tcp/127.0.0.1:1"),
            ..SessionArgs::default()
        };
        let configured = SessionArgs {
            zenoh: Some("zenoh.json5".into()),
            ..SessionArgs::default()
        };
        for named in [listens, connects, configured] {
            let network = Network::named(named.clone());
            assert!(!network.waits);
            assert_eq!(network.args.connect, named.connect);
        }
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn a_router_that_is_not_there_yet_is_waited_for() {
        let endpoint = unused_endpoint().expect("a free port");
        let network = Network::or_at(SessionArgs::default(), &endpoint);
        let (tell, mut told) = unbounded_channel();
        let joins = tokio::spawn(async move {
            let joined = network.join(|said| tell.send(said.to_owned()).expect("heard"));
            joined.await.map(drop)
        });
        let patience = Duration::from_secs(60);
        let said = timeout(patience, told.recv()).await.expect("in time");
        let said = said.expect("a sentence");
        let expected = format!("no router answers at {endpoint}: start it with `ros2 run");
        assert!(said.starts_with(&expected), "{said}");
        let args = SessionArgs {
            listen: at(&endpoint),
            ..SessionArgs::default()
        };
        let _router = open(&args).await.expect("the port is free");
        let joined = timeout(patience, joins).await.expect("in time");
        assert!(joined.expect("no panic").is_ok());
        assert_eq!(told.recv().await, None, "it is told once");
    }
}
