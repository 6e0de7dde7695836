//! `firmware-sim fleet watch`: a running fleet, as it changes.

use super::table::Table;
use crate::client::Client;
use crate::session::{SessionArgs, open};
use std::time::Duration;

/// Time between two drawings in place.
const FRAME: Duration = Duration::from_millis(500);

/// Show a running fleet: policies, queues and verdicts of its robots, until Ctrl-C
#[derive(clap::Args, Clone, Debug)]
pub struct WatchArgs {
    /// Fleet to watch (a-z A-Z 0-9 _ -)
    #[arg(long, value_name = "NAME")]
    pub fleet: String,
    /// Print one table and end
    #[arg(long)]
    pub once: bool,
    /// The network.
    #[command(flatten)]
    pub session: SessionArgs,
}

impl WatchArgs {
    /// Runs the command.
    ///
    /// # Errors
    /// No session.
    pub async fn run(self) -> anyhow::Result<()> {
        let client = Client::new(open(&self.session).await?, &self.fleet).await?;
        client.follow_robots().await?;
        let mut table = Table::new();
        let pause = if table.is_live() { FRAME } else { 20 * FRAME };
        loop {
            table.draw(&client);
            if self.once {
                return Ok(());
            }
            tokio::select! {
                () = tokio::time::sleep(pause) => {}
                ended = tokio::signal::ctrl_c() => return Ok(ended?),
            }
        }
    }
}
