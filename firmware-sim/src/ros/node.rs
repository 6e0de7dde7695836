//! A node on the network: its tokens, its publishers and its subscriptions.

use super::clock::unix_ns;
use super::keys::{self, Gid, Kind, Node, Qos, Type};
use super::service::{Service, Services};
use host_train::dataset::ros::cdr::to_cdr;
use serde::Serialize;
use std::time::Duration;
use zenoh::bytes::ZBytes;
use zenoh::handlers::{RingChannel, RingChannelHandler};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub;
use zenoh::query::{Query, Queryable};
use zenoh::sample::{Sample, SourceInfo};
use zenoh::{Session, Wait};

/// How long to wait for the network's answer about other nodes.
const PATIENCE: Duration = Duration::from_secs(1);

/// A session with one node in it, as other `rmw_zenoh` nodes see it.
pub(crate) struct Member {
    session: Session,
    pub(crate) node: Node,
    _token: LivelinessToken,
    /// Publishers, subscriptions and services so far.
    endpoints: u32,
}

/// A publisher of one topic. Dropping it takes it off the graph.
pub(crate) struct Publisher {
    publisher: pubsub::Publisher<'static>,
    gid: Gid,
    published: i64,
    _token: LivelinessToken,
}

/// A message on a topic of its own. Later subscribers receive it, too. Dropping it takes it off the graph.
pub(crate) struct Latched {
    _publisher: Publisher,
    _cache: Queryable<()>,
    _found: LivelinessToken,
}

/// A subscription to one topic that keeps only the newest message.
pub(crate) struct Subscription {
    heard: pubsub::Subscriber<RingChannelHandler<Sample>>,
    _token: LivelinessToken,
}

impl Member {
    /// Appears on the graph.
    pub(crate) async fn join(
        session: Session,
        domain: u8,
        namespace: &str,
        name: &str,
    ) -> zenoh::Result<Member> {
        let node = Node {
            domain,
            zid: session.zid().to_string(),
            namespace: namespace.into(),
            name: name.into(),
        };
        let token = session.liveliness().declare_token(node.token()).await?;
        Ok(Member {
            session,
            node,
            _token: token,
            endpoints: 0,
        })
    }

    /// Whether another node has its name.
    pub(crate) async fn has_namesake(&self) -> zenoh::Result<bool> {
        let Node { domain, zid, .. } = &self.node;
        let own = self.node.token();
        let (_, name) = own.split_once("/NN/").unwrap_or_default();
        let nodes = format!("@ros2_lv/{domain}/*/*/*/NN/{name}");
        let found = self.session.liveliness().get(nodes);
        let found = found.timeout(PATIENCE).await?;
        while let Ok(reply) = found.recv_async().await {
            let of_another =
                |sample: &Sample| !sample.key_expr().split('/').any(|part| part == zid);
            if reply.result().is_ok_and(of_another) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Declares the token of the next publisher, subscription or service. Returns it with the identity that follows from it.
    async fn declare(
        &mut self,
        kind: Kind,
        what: (&str, Type, Qos),
    ) -> zenoh::Result<(LivelinessToken, Gid)> {
        self.endpoints += 1;
        let token = self.node.endpoint_token(self.endpoints, kind, what);
        let gid = keys::gid(&token);
        Ok((self.session.liveliness().declare_token(token).await?, gid))
    }

    /// Declares a publisher of a topic.
    pub(crate) async fn publisher(
        &mut self,
        topic: &str,
        of: Type,
        qos: Qos,
    ) -> zenoh::Result<Publisher> {
        let key = self.node.topic_key(topic, of);
        let publisher = self.session.declare_publisher(key).await?;
        let (token, gid) = self.declare(Kind::Publisher, (topic, of, qos)).await?;
        Ok(Publisher {
            publisher,
            gid,
            published: 0,
            _token: token,
        })
    }

    /// Publishes one message for all current and later subscribers. Later ones query the key where publishers of `zenoh-ext` keep
    /// their last messages. A liveliness token tells them that there is something to query.
    pub(crate) async fn latch(
        &mut self,
        topic: &str,
        of: Type,
        message: &impl Serialize,
    ) -> zenoh::Result<Latched> {
        let mut publisher = self.publisher(topic, of, Qos::Latched).await?;
        let (key, id) = (
            publisher.publisher.key_expr().clone(),
            publisher.publisher.id(),
        );
        let kept_at = format!("{key}/@adv/pub/{}/{}/_", id.zid(), id.eid());
        let [bytes, attachment] = publisher.next(message);
        // A subscriber that receives the message twice recognises it by this.
        let source = SourceInfo::new(id, 0);
        let first = publisher.publisher.put(bytes.clone());
        let first = first.attachment(attachment.clone());
        first.source_info(source.clone()).await?;
        let answer = move |query: Query| {
            let reply = query.reply(&key, bytes.clone());
            let reply = reply.attachment(attachment.clone());
            // It fails only if the subscriber is gone.
            let _ = reply.source_info(source.clone()).wait();
        };
        let cache = self.session.declare_queryable(&kept_at).callback(answer);
        Ok(Latched {
            _cache: cache.await?,
            _found: self.session.liveliness().declare_token(kept_at).await?,
            _publisher: publisher,
        })
    }

    /// Offers a service of the node's own.
    pub(crate) async fn serve(
        &mut self,
        services: &mut Services,
        (name, of, qos): (&str, Type, Qos),
    ) -> zenoh::Result<()> {
        let name = self.node.own_topic(name);
        let key = self.node.topic_key(&name, of);
        let asked = self.session.declare_queryable(key).complete(true);
        let asked = asked.callback(services.hear(of)).await?;
        let (token, _) = self.declare(Kind::Service, (&name, of, qos)).await?;
        services.add(Service {
            _asked: asked,
            _token: token,
        });
        Ok(())
    }

    /// Subscribes to a sensor's topic.
    pub(crate) async fn subscribe(&mut self, topic: &str, of: Type) -> zenoh::Result<Subscription> {
        let key = self.node.topic_key(topic, of);
        let heard = self
            .session
            .declare_subscriber(key)
            .with(RingChannel::new(1))
            .await?;
        let (token, _) = self
            .declare(Kind::Subscription, (topic, of, Qos::Sensor))
            .await?;
        Ok(Subscription {
            heard,
            _token: token,
        })
    }
}

impl Publisher {
    /// Publishes a message.
    pub(crate) fn publish(&mut self, message: &impl Serialize) -> zenoh::Result<()> {
        let [bytes, attachment] = self.next(message);
        let put = self.publisher.put(bytes);
        put.attachment(attachment).wait()
    }

    /// The next message and its attachment.
    fn next(&mut self, message: &impl Serialize) -> [ZBytes; 2] {
        self.published += 1;
        let attachment = keys::attachment(self.published, unix_ns(), self.gid);
        [to_cdr(message).into(), attachment.into()]
    }
}

impl Subscription {
    /// Waits for the newest message that was not taken yet.
    pub(crate) async fn next(&self) -> zenoh::Result<Vec<u8>> {
        let sample = self.heard.recv_async().await?;
        Ok(sample.payload().to_bytes().into_owned())
    }

    /// That message, if it is there already.
    pub(crate) fn waiting(&self) -> zenoh::Result<Option<Vec<u8>>> {
        let sample = self.heard.try_recv()?;
        Ok(sample.map(|sample| sample.payload().to_bytes().into_owned()))
    }
}
