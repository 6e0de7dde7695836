//! How a long-running program is asked to end.

use std::io;
use tokio::signal::ctrl_c;

/// Waits for Ctrl-C, or for SIGTERM as service managers and containers send it. The program can then leave the network properly,
/// so that others notice at once and not only when a lease has passed.
///
/// # Errors
/// The system's.
pub async fn stop_requested() -> io::Result<()> {
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        let mut terminated = signal(SignalKind::terminate())?;
        tokio::select! {
            interrupted = ctrl_c() => interrupted,
            _ = terminated.recv() => Ok(()),
        }
    }
    #[cfg(not(unix))]
    ctrl_c().await
}
