//! Announcements that a robot could not follow and considers again, after pauses that grow.

use std::time::Duration;
use tokio::time::Instant;

/// The first pause; each further one is twice as long.
const FIRST: Duration = Duration::from_secs(10);
/// The longest pause.
const LONGEST: Duration = Duration::from_secs(600);

/// Announcements that were refused for a reason that can pass.
#[derive(Debug, Default)]
pub(crate) struct Later {
    frames: Vec<Vec<u8>>,
    /// When the pause ends, and how long it is.
    pause: Option<(Instant, Duration)>,
}

impl Later {
    /// Puts an announcement off until the next pause is over.
    pub(crate) fn put_off(&mut self, frame: &[u8], now: Instant) {
        let length = self.pause.map_or(FIRST, |(_, last)| LONGEST.min(2 * last));
        self.pause = Some((now + length, length));
        if !self.frames.iter().any(|known| known == frame) {
            self.frames.push(frame.to_vec());
        }
    }

    /// Hands out the announcements if the pause is over.
    pub(crate) fn due(&mut self, now: Instant) -> Vec<Vec<u8>> {
        match self.pause {
            Some((end, _)) if end <= now => std::mem::take(&mut self.frames),
            _ => Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_grow() {
        let (mut later, mut now) = (Later::default(), Instant::now());
        let mut pauses = Vec::new();
        for _ in 0..8 {
            later.put_off(b"policy", now);
            let begun = now;
            while later.due(now).is_empty() {
                now += Duration::from_secs(1);
            }
            pauses.push((now - begun).as_secs());
        }
        assert_eq!(pauses, [10, 20, 40, 80, 160, 320, 600, 600]);
        assert!(later.due(now).is_empty(), "it is handed out once");
    }
}
