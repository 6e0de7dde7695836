//! Requests in flight.

use super::Client;
use crate::frames::small_frame;
use reagent_core::wire::{Cancel, Message, keys};
use zenoh::Wait;

/// A request in flight. If it is dropped before it is answered, it is taken back.
pub(super) struct Asked<'c> {
    client: &'c Client,
    robot: &'c str,
    request: Cancel,
    pub(super) answered: bool,
}

impl<'c> Asked<'c> {
    pub(super) fn new(client: &'c Client, robot: &'c str, request: Cancel) -> Self {
        let mut robots = client.robots.lock();
        robots.entry(robot.into()).or_default().asked += 1;
        Asked {
            client,
            robot,
            request,
            answered: false,
        }
    }
}

impl Drop for Asked<'_> {
    fn drop(&mut self) {
        if let Some(robot) = self.client.robots.lock().get_mut(self.robot) {
            robot.asked = robot.asked.saturating_sub(1);
        }
        if self.answered {
            return;
        }
        let Ok(key) = keys::cancel(&self.client.fleet, self.robot) else {
            return;
        };
        let frame = small_frame(&Message::Cancel(self.request));
        if let Err(error) = self
            .client
            .session
            .put(key.as_str(), frame)
            .source_info(self.client.source())
            .wait()
        {
            tracing::debug!("request {} was not taken back: {error}", self.request.id);
        }
    }
}
