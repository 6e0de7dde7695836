//! A node on the network: its tokens, what it publishes, and what it hears.
#![allow(
    clippy::disallowed_types,
    reason = "messages carry the time of who publishes them"
)]

use super::keys::{self, Gid, Kind, Node, Qos, Type};
use super::service::{Service, Services};
use host_train::dataset::ros::cdr::to_cdr;
use serde::Serialize;
use std::time::{Duration, SystemTime};
use zenoh::bytes::ZBytes;
use zenoh::handlers::{RingChannel, RingChannelHandler};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub;
use zenoh::query::{Query, Queryable};
use zenoh::sample::{Sample, SourceInfo};
use zenoh::{Session, Wait};

/// Time that the network has to tell of other nodes.
const PATIENCE: Duration = Duration::from_secs(1);

/// A session with one node in it, as `rmw_zenoh`'s others see it.
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

/// A message of a topic of its own, which whoever subscribes later gets, too. Dropping it takes it off the graph.
pub(crate) struct Latched {
    _publisher: Publisher,
    _cache: Queryable<()>,
    _found: LivelinessToken,
}

/// A subscription to one topic, of which the newest message counts.
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

    /// The token of its next publisher, subscription or service, and the identity that follows.
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

    /// Publishes on a topic.
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

    /// Publishes one message for all who subscribe, now or later: those ask, where the publishers of `zenoh-ext` keep what they
    /// published last, and are told that there is something to ask for.
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
        // By this those who hear it twice know that it is one message.
        let source = SourceInfo::new(id, 0);
        let first = publisher.publisher.put(bytes.clone());
        let first = first.attachment(attachment.clone());
        first.source_info(source.clone()).await?;
        let answer = move |query: Query| {
            let reply = query.reply(&key, bytes.clone());
            let reply = reply.attachment(attachment.clone());
            // Whoever asked is gone where it fails.
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

    /// Hears a sensor's topic.
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

/// Time of whoever publishes or answers.
pub(super) fn unix_ns() -> i64 {
    let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    since_1970.map_or(0, |time| i64::try_from(time.as_nanos()).unwrap_or(i64::MAX))
}

impl Publisher {
    /// Publishes a message.
    pub(crate) fn publish(&mut self, message: &impl Serialize) -> zenoh::Result<()> {
        let [bytes, attachment] = self.next(message);
        let put = self.publisher.put(bytes);
        put.attachment(attachment).wait()
    }

    /// The next message and what comes with it.
    fn next(&mut self, message: &impl Serialize) -> [ZBytes; 2] {
        self.published += 1;
        let attachment = keys::attachment(self.published, unix_ns(), self.gid);
        [to_cdr(message).into(), attachment.into()]
    }
}

impl Subscription {
    /// The newest message that was not taken yet, once there is one.
    pub(crate) async fn next(&self) -> zenoh::Result<Vec<u8>> {
        let sample = self.heard.recv_async().await?;
        Ok(sample.payload().to_bytes().into_owned())
    }

    /// The same, if it is there.
    pub(crate) fn waiting(&self) -> zenoh::Result<Option<Vec<u8>>> {
        let sample = self.heard.try_recv()?;
        Ok(sample.map(|sample| sample.payload().to_bytes().into_owned()))
    }
}
