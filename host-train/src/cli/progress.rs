//! A progress bar on a terminal, or else a line at each quarter; both on stderr.

use indicatif::{ProgressBar, ProgressStyle};
use std::sync::atomic::{AtomicU64, Ordering};

/// Progress over a known number of equal parts.
pub(super) struct Progress {
    bar: ProgressBar,
    done: AtomicU64,
    total: u64,
    what: &'static str,
}

impl Progress {
    /// Starts at none of `total` parts; `what` is their name in the plural.
    pub(super) fn new(total: usize, what: &'static str) -> Progress {
        let total = total as u64;
        let style = ProgressStyle::with_template("{bar:40} {pos}/{len} {msg} ({eta} left)")
            .expect("a valid template");
        let bar = ProgressBar::new(total).with_style(style).with_message(what);
        Progress {
            bar,
            done: AtomicU64::new(0),
            total,
            what,
        }
    }

    /// Counts one more part; may be called from any thread.
    pub(super) fn tick(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        self.bar.inc(1);
        let quarter = |n: u64| 4 * n / self.total.max(1);
        if self.bar.is_hidden() && quarter(done) > quarter(done - 1) {
            eprintln!("{done}/{} {}", self.total, self.what);
        }
    }

    /// Removes the bar.
    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
