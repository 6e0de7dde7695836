//! What a publisher asks the robots of its fleet.

use super::followed::{Followed, there};
use super::{Heard, PublishError, Publisher, Reception, refused};
use reagent_core::wire::{Manifest, keys};
use std::collections::BTreeMap;
use std::time::Duration;
use tokio::time::Instant;
use zenoh::handlers::FifoChannelHandler;
use zenoh::pubsub::Subscriber;
use zenoh::sample::Sample;

impl Publisher {
    /// The robots that answer now, ordered by name.
    ///
    /// # Errors
    /// `Zenoh`.
    pub async fn robots(&self) -> Result<Vec<Heard>, PublishError> {
        there(&self.session, &self.fleet).await
    }

    /// Subscribes to the robots' status from now on.
    ///
    /// # Errors
    /// `Zenoh`.
    pub async fn follow_robots(
        &self,
    ) -> Result<Subscriber<FifoChannelHandler<Sample>>, PublishError> {
        let key = keys::all_status(&self.fleet).map_err(refused(&self.fleet))?;
        Ok(self.session.declare_subscriber(key.as_str()).await?)
    }

    /// Follows the robots: those that were there before the newest policy was announced, and those that answer now.
    pub(super) async fn follow(&self) -> Result<Followed, PublishError> {
        Followed::begin(&self.session, &self.fleet, self.before.clone()).await
    }

    /// Waits until every online robot has taken a policy or said why not, but no longer than `wait`. A robot that
    /// refused the same policy before it was announced has that time to take it. One that leaves is not waited for.
    ///
    /// # Errors
    /// `Zenoh`.
    pub async fn reception(
        &self,
        manifest: &Manifest,
        wait: Duration,
    ) -> Result<Reception, PublishError> {
        let deadline = Instant::now() + wait;
        let mut fleet = self.follow().await?;
        loop {
            let reception = Reception::of(&fleet.robots, manifest, &self.before);
            let reception = reception.where_left(|robot| fleet.has_left(robot));
            if reception.silent.is_empty() {
                return Ok(reception);
            }
            match tokio::time::timeout_at(deadline, fleet.changed()).await {
                Err(_) => {
                    let reception = Reception::of(&fleet.robots, manifest, &BTreeMap::new());
                    return Ok(reception.where_left(|robot| fleet.has_left(robot)));
                }
                Ok(changed) => changed?,
            }
        }
    }
}
