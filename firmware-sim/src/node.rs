//! A simulated robot: fetches the fleet's policy, keeps it, and answers refine requests with it.

use crate::board::Board;
use crate::bridge;
pub use crate::config::NodeConfig;
use crate::frames::{Outlet, small_frame};
use crate::identity::draw_instance;
use crate::policy::UpdateError;
use crate::presence::{follow_clients, instances, watch_for_duplicates};
pub use crate::queue::PLACES;
use crate::queue::Queue;
use crate::service::serve;
use crate::session::plain;
use crate::updates::Updates;
use crate::view::View;
use reagent_core::wire::{Message, keys};
use reagent_link::routers::follow_routers;
use std::sync::Arc;
use std::time::Duration;
use thiserror::Error;
use tokio::runtime::Handle;
use tokio::sync::watch;
use tokio::task::JoinHandle;
use zenoh::handlers::RingChannel;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::query::Queryable;
use zenoh::session::TransportEventsListener;
use zenoh::{Session, Wait};

/// The robot id by which `refine` means "any robot".
pub const ANY: &str = "any";
/// Least time between two publications of the status.
const STATUS_INTERVAL: Duration = Duration::from_millis(20);

/// Why a node did not start.
#[derive(Debug, Error)]
pub enum NodeError {
    /// A name cannot be part of a key expression.
    #[error("fleet {fleet:?}, robot {robot:?}: {reason}")]
    Name {
        /// As given.
        fleet: String,
        /// As given.
        robot: String,
        /// What is allowed.
        reason: reagent_core::Error,
    },
    /// The name is the one that means any robot.
    #[error("a robot cannot be called {ANY:?}: clients use it for whichever robot is there")]
    Reserved,
    /// A robot of this name is already there.
    #[error("robot {robot:?} of fleet {fleet:?} is there already; give each robot its own name")]
    Duplicate {
        /// As given.
        fleet: String,
        /// As given.
        robot: String,
    },
    /// Nobody hears what it publishes.
    #[error(
        "nobody hears robot {robot:?} of fleet {fleet:?}: the router does not let its certificate speak under this name; \
         give each robot the configuration that was made for it, see whether the fleet's name is right, and restart a router \
         whose configuration is new"
    )]
    Unheard {
        /// As given.
        fleet: String,
        /// As given.
        robot: String,
    },
    /// The system has no thread left for its work.
    #[error("no thread for the robot's work: {0}")]
    Worker(std::io::Error),
    /// The state directory cannot be used.
    #[error(transparent)]
    Store(#[from] UpdateError),
    /// The session failed.
    #[error("zenoh: {}", plain(.0))]
    Zenoh(#[from] zenoh::Error),
}

/// A running node. Dropping it takes it off the network.
#[derive(Debug)]
pub struct Node {
    config: NodeConfig,
    instance: u32,
    view: watch::Receiver<View>,
    told: Arc<watch::Sender<View>>,
    tasks: [JoinHandle<()>; 3],
    _queue: Closing,
    _refine: Queryable<()>,
    _status: Queryable<()>,
    _listening: [Subscriber<()>; 3],
    _routers: TransportEventsListener<()>,
    _alive: LivelinessToken,
}

impl Node {
    /// Starts a node on an open session. It answers at once, and serves as soon as it has a policy: one that it kept, or one that
    /// is announced.
    ///
    /// # Errors
    /// See [`NodeError`]. A damaged policy in the state directory is only logged.
    pub async fn start(session: Session, config: NodeConfig) -> Result<Node, NodeError> {
        Node::start_with(session, config, None).await
    }

    /// As [`Node::start`], with a board that does the work.
    ///
    /// # Errors
    /// As [`Node::start`].
    pub async fn start_with(
        session: Session,
        config: NodeConfig,
        board: Option<Board>,
    ) -> Result<Node, NodeError> {
        let NodeConfig { fleet, robot, .. } = &config;
        if robot == ANY {
            return Err(NodeError::Reserved);
        }
        let name = |reason| NodeError::Name {
            fleet: fleet.clone(),
            robot: robot.clone(),
            reason,
        };
        let duplicate = || NodeError::Duplicate {
            fleet: fleet.clone(),
            robot: robot.clone(),
        };
        let refine_key = keys::refine(fleet, robot).map_err(name)?;
        let status_key = keys::status(fleet, robot).map_err(name)?;
        let alive_key = keys::alive(fleet, robot).map_err(name)?;
        let trace_key = keys::trace(fleet, robot).map_err(name)?;
        if !instances(&session, &status_key).await?.is_empty() {
            return Err(duplicate());
        }

        let instance = draw_instance();
        let (view, seen) = watch::channel(View {
            instance,
            ..View::default()
        });
        let view = Arc::new(view);
        let counted = view.clone();
        let routers = follow_routers(&session, move |routers| {
            counted.send_modify(|view| view.routers = Some(routers));
        });
        let routers = routers.await?;
        let (answered, reply_key) = (seen.clone(), status_key.clone());
        let status = session
            .declare_queryable(status_key.as_str())
            .complete(true)
            .callback(move |query| {
                let frame = small_frame(&Message::Status(answered.borrow().status()));
                if let Err(error) = query.reply(reply_key.as_str(), frame).wait() {
                    tracing::warn!("status was not sent: {error}");
                }
            })
            .await?;
        // If two start at the same moment, the one with the lower number stays.
        let others = instances(&session, &status_key).await?;
        if others.iter().any(|&other| other < instance) {
            return Err(duplicate());
        }
        let updates = Updates::new(session.clone(), config.clone(), view.clone()).await?;

        let queue = Closing(Arc::new(Queue::new(view.clone())));
        let (jobs, policies) = (queue.0.clone(), updates.policies());
        let outlet = Outlet {
            robot: robot.clone(),
            session: session.clone(),
            reply_key: refine_key.clone(),
            trace_key,
            view: view.clone(),
        };
        let runtime = Handle::current();
        // A thread of its own, since it never ends: the runtime has only 512 threads for blocking work.
        let work = move || {
            let _within = runtime.enter();
            match board {
                Some(board) => bridge::serve(board, &jobs, policies, &outlet),
                None => serve(&jobs, policies, &outlet),
            }
        };
        let worker = std::thread::Builder::new().name(robot.clone());
        worker.spawn(work).map_err(NodeError::Worker)?;
        let (expiring, offered) = (queue.0.clone(), queue.0.clone());
        let refine = session
            .declare_queryable(refine_key.as_str())
            .complete(true)
            .callback(move |query| offered.offer(query))
            .await?;
        let [cancelled, gone] = follow_clients(&session, fleet, robot, queue.0.clone()).await?;
        let told = view.clone();
        let duplicates = watch_for_duplicates(&session, &status_key, instance, view).await?;
        let publishing = publish_status(session.clone(), status_key, seen.clone());

        let manifest_key = keys::manifest(fleet).map_err(name)?;
        let announced = session
            .declare_subscriber(manifest_key.as_str())
            .with(RingChannel::new(4))
            .await?;
        let alive = session
            .liveliness()
            .declare_token(alive_key.as_str())
            .await?;
        Ok(Node {
            config,
            instance,
            view: seen,
            told,
            tasks: [
                tokio::spawn(publishing),
                tokio::spawn(updates.follow(manifest_key, announced)),
                tokio::spawn(async move { expiring.expire().await }),
            ],
            _queue: queue,
            _refine: refine,
            _status: status,
            _listening: [cancelled, gone, duplicates],
            _routers: routers,
            _alive: alive,
        })
    }

    /// Takes the node off the network and waits until its flash is free for another.
    pub async fn stop(mut self) {
        for task in &mut self.tasks {
            task.abort();
            // The error only says that the task was cancelled.
            task.await.ok();
        }
    }

    /// Asks for the node's status from another session, as other programs do.
    ///
    /// # Errors
    /// `Unheard` if this node does not answer; `Zenoh`.
    pub async fn check_heard(&self, from: &Session) -> Result<(), NodeError> {
        let NodeConfig { fleet, robot, .. } = self.config.clone();
        let key = keys::status(&fleet, &robot).map_err(|reason| NodeError::Name {
            fleet: fleet.clone(),
            robot: robot.clone(),
            reason,
        })?;
        match instances(from, &key).await?.contains(&self.instance) {
            true => Ok(()),
            false => Err(NodeError::Unheard { fleet, robot }),
        }
    }

    /// Lets others know whether the certificates of its session hold.
    pub fn note_certificates(&self, hold: bool) {
        self.told.send_if_modified(|view| {
            let before = std::mem::replace(&mut view.certificate_invalid, !hold);
            before == hold
        });
    }

    /// The robot's name.
    pub fn name(&self) -> &str {
        &self.config.robot
    }

    /// Watches the node's state.
    pub fn watch(&self) -> watch::Receiver<View> {
        self.view.clone()
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        self.tasks.iter().for_each(JoinHandle::abort);
    }
}

/// Closes the queue, which ends the work of its server.
#[derive(Debug)]
struct Closing(Arc<Queue>);

impl Drop for Closing {
    fn drop(&mut self) {
        self.0.close();
    }
}

/// Publishes the status whenever it has changed. Changes in quick succession give one publication.
async fn publish_status(session: Session, key: keys::Key, mut seen: watch::Receiver<View>) {
    loop {
        let frame = small_frame(&Message::Status(seen.borrow_and_update().status()));
        if let Err(error) = session.put(key.as_str(), frame).await {
            tracing::warn!("status was not published: {error}");
        }
        tokio::time::sleep(STATUS_INTERVAL).await;
        if seen.changed().await.is_err() {
            return;
        }
    }
}
