//! Services of a node: requests arrive as queries.

use super::clock::unix_ns;
use super::keys::{self, Gid, Type};
use host_train::dataset::ros::cdr::{from_cdr, to_cdr};
use serde::{Deserialize, Serialize};
use tokio::sync::mpsc::{Receiver, Sender, channel};
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::query::{Query, Queryable};

/// Most waiting requests. More are dropped, as in a full queue of ROS.
const WAITING: usize = 10;

/// The services of a node. Requests are answered one after the other.
pub(crate) struct Services {
    calls: Receiver<Call>,
    sender: Sender<Call>,
    declared: Vec<Service>,
}

/// A service. Dropping it takes it off the graph.
pub(crate) struct Service {
    pub(crate) _asked: Queryable<()>,
    pub(crate) _token: LivelinessToken,
}

/// A request that waits for its answer.
pub(crate) struct Call {
    /// The type of the service.
    pub(crate) of: Type,
    query: Query,
    /// The request's number and its client: the answer repeats both.
    sequence: i64,
    client: Gid,
}

impl Services {
    pub(crate) fn new() -> Services {
        let (sender, calls) = channel(WAITING);
        Services {
            calls,
            sender,
            declared: Vec::new(),
        }
    }

    pub(crate) fn add(&mut self, service: Service) {
        self.declared.push(service);
    }

    /// A callback that takes queries for a service of this type.
    pub(crate) fn hear(&self, of: Type) -> impl Fn(Query) + Send + Sync + 'static {
        let sender = self.sender.clone();
        move |query| {
            let attachment = query.attachment().map(|bytes| bytes.to_bytes());
            match attachment.as_deref().and_then(keys::sender_of) {
                Some((sequence, client)) => {
                    // A query that is dropped gets no answer.
                    let _ = sender.try_send(Call {
                        of,
                        query,
                        sequence,
                        client,
                    });
                }
                // It fails only if the client is gone.
                None => drop(query.reply_err(NO_SENDER).wait()),
            }
        }
    }

    /// The next request.
    pub(crate) async fn next(&mut self) -> Call {
        let call = self.calls.recv().await;
        call.expect("the sender is kept beside it")
    }
}

/// The error for queries that are no ROS requests.
const NO_SENDER: &str = "a request has an attachment of 33 bytes with its number, its time and its client, as rmw_zenoh has it";

impl Call {
    /// Decodes the request and answers it, or answers that it cannot be read.
    pub(crate) fn reply<Q, A>(self, answer: impl FnOnce(Q) -> A)
    where
        Q: for<'b> Deserialize<'b>,
        A: Serialize,
    {
        let payload = self.query.payload().map(|bytes| bytes.to_bytes());
        match from_cdr(payload.as_deref().unwrap_or_default()) {
            Ok(asked) => {
                let answer = answer(asked);
                drop(payload);
                self.answer(&answer);
            }
            // It fails only if the client is gone.
            Err(error) => drop(self.query.reply_err(error.to_string()).wait()),
        }
    }

    /// Sends the answer.
    pub(crate) fn answer(self, response: &impl Serialize) {
        let attachment = keys::attachment(self.sequence, unix_ns(), self.client);
        let reply = self.query.reply(self.query.key_expr(), to_cdr(response));
        // It fails only if the client is gone.
        let _ = reply.attachment(attachment).wait();
    }
}
