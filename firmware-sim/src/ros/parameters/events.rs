//! Publishes changes of parameters on `/parameter_events`.

use super::messages::{Parameter, ParameterEvent};
use crate::ros::clock::unix_ns;
use crate::ros::keys::{self, Qos};
use crate::ros::node::{Member, Publisher};
use host_train::dataset::ros::point_cloud2::Time;

/// The publisher.
pub(crate) struct Events {
    publisher: Publisher,
    node: String,
}

impl Events {
    /// Declares the publisher, and publishes the parameters that the node starts with.
    pub(crate) async fn declare(
        member: &mut Member,
        new_parameters: Vec<Parameter>,
    ) -> zenoh::Result<Events> {
        let publisher =
            member.publisher("/parameter_events", keys::PARAMETER_EVENT, Qos::Parameters);
        let mut events = Events {
            publisher: publisher.await?,
            node: member.node.full_name(),
        };
        events.tell(new_parameters, Vec::new())?;
        Ok(events)
    }

    /// Publishes the parameters that were set.
    pub(crate) fn set(&mut self, parameters: Vec<Parameter>) -> zenoh::Result<()> {
        match parameters.is_empty() {
            true => Ok(()),
            false => self.tell(Vec::new(), parameters),
        }
    }

    fn tell(
        &mut self,
        new_parameters: Vec<Parameter>,
        changed_parameters: Vec<Parameter>,
    ) -> zenoh::Result<()> {
        let now = unix_ns();
        self.publisher.publish(&ParameterEvent {
            stamp: Time {
                sec: (now / 1_000_000_000) as i32,
                nanosec: (now % 1_000_000_000) as u32,
            },
            node: self.node.clone(),
            new_parameters,
            changed_parameters,
            deleted_parameters: Vec::new(),
        })
    }
}
