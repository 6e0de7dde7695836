//! A fleet's state as a table, drawn in place on a terminal.
#![allow(
    clippy::disallowed_types,
    reason = "the clock of who watches, not of a robot"
)]

use crate::client::{Client, Heard};
use host_train::words::count;
use reagent_core::verdict::Verdict;
use reagent_core::wire::{NotTaken, Status};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::io::IsTerminal;
use std::time::SystemTime;

/// Most rows of robots; the rest is only counted.
const ROWS: usize = 24;
/// Lines besides those of the robots, including the cursor's.
const OTHER_LINES: usize = 8;

/// A table that is drawn again and again over its last drawing.
#[derive(Debug)]
pub(super) struct Table {
    in_place: bool,
    /// The last drawing, which the next one covers, and the terminal's rows and columns then.
    drawn: Option<(String, (u16, u16))>,
}

impl Table {
    pub(super) fn new() -> Table {
        Table {
            in_place: std::io::stdout().is_terminal(),
            drawn: None,
        }
    }

    /// Whether it is drawn in place. Otherwise every drawing is a new table.
    pub(super) fn is_live(&self) -> bool {
        self.in_place
    }

    /// Draws the fleet, unless that would change nothing.
    pub(super) fn draw(&mut self, client: &Client) {
        if !self.in_place {
            let text = text(&client.heard(), ROWS);
            return reagent_link::print::stdout(format_args!("{text}"));
        }
        let size @ (height, width) = console::Term::stdout().size();
        let rows = usize::from(height).saturating_sub(OTHER_LINES);
        let text = text(&client.heard(), rows.clamp(1, ROWS));
        let next = Some((cut(&text, width.into()), size));
        if self.drawn != next
            && let Some((text, _)) = &next
        {
            let over = over(self.rows(), text);
            reagent_link::print::stdout(format_args!("{over}"));
            self.drawn = next;
        }
    }

    /// Puts text above the next drawing.
    pub(super) fn say(&mut self, text: &str) {
        match self.in_place {
            true => reagent_link::print::stdout(format_args!("{}", over(self.rows(), text))),
            false => println!("{text}"),
        }
        self.drawn = None;
    }

    /// Rows of the terminal that the last drawing takes up now.
    fn rows(&self) -> usize {
        let (height, width) = console::Term::stdout().size();
        let drawn = self
            .drawn
            .as_ref()
            .map(|(text, _)| rows(text, width.into()));
        drawn
            .unwrap_or_default()
            .min(usize::from(height).saturating_sub(1))
    }
}

/// Rows of a terminal of this width that lines take up, which may have been wider when they were drawn.
fn rows(text: &str, width: usize) -> usize {
    let rows = |line| {
        console::measure_text_width(line)
            .div_ceil(width.max(1))
            .max(1)
    };
    text.lines().map(rows).sum()
}

/// Text that takes the place of so many rows above the cursor. It goes over them line by line: terminals keep a copy of a screen
/// that is cleared from its first row on.
fn over(rows: usize, text: &str) -> String {
    let up = match rows {
        0 => String::new(),
        rows => format!("\x1b[{rows}A\r"),
    };
    let lines: String = text.lines().map(|line| format!("\x1b[K{line}\n")).collect();
    format!("{up}{lines}\x1b[J")
}

/// Cuts lines to the terminal's width: a wrapped line would not be covered by the next drawing.
fn cut(text: &str, width: usize) -> String {
    let lines = text
        .lines()
        .map(|line| console::truncate_str(line, width, "…") + "\n");
    lines.collect()
}

/// The time of day of a moment.
fn time_of_day(moment: SystemTime) -> String {
    let since_1970 = moment.duration_since(SystemTime::UNIX_EPOCH);
    let seconds = since_1970.map_or(0, |time| time.as_secs());
    let (hours, minutes) = (seconds / 3600 % 24, seconds / 60 % 60);
    format!("{hours:02}:{minutes:02}:{:02} UTC", seconds % 60)
}

/// The busiest robots first, those that are away last, and below them the totals of those that are there.
fn text(robots: &[Heard], rows: usize) -> String {
    let mut text = String::new();
    let mut line = |line: std::fmt::Arguments<'_>| {
        // Writing to a string cannot fail.
        writeln!(text, "{line}").ok();
    };
    let here = || robots.iter().filter(|heard| heard.offline_since.is_none());
    let total = count(here().count(), "robot", "robots");
    let names = robots.iter().map(|heard| heard.robot.as_str());
    let names = names.chain(["robot", &total]).map(str::len);
    let wide = names.max().unwrap_or_default();
    let verdicts = Verdict::ALL.map(|verdict| format!("{:>15}", verdict.to_string()));
    line(format_args!(
        "{:wide$} {:>12} {:>5} {:>8} {:>8} {}",
        "robot",
        "policy",
        "queue",
        "served",
        "refused",
        verdicts.concat()
    ));
    let mut sorted: Vec<_> = robots.iter().collect();
    sorted.sort_by_key(|heard| {
        let in_hand = std::cmp::Reverse(heard.status.in_hand);
        (heard.offline_since, in_hand, &heard.robot)
    });
    for heard in sorted.iter().take(rows) {
        match heard.offline_since {
            None => line(format_args!("{}", row(&heard.robot, wide, &heard.status))),
            Some(since) => line(format_args!(
                "{:wide$} offline since {}",
                heard.robot,
                time_of_day(since)
            )),
        }
    }
    if sorted.len() > rows {
        line(format_args!("… and {} more", sorted.len() - rows));
    }
    let mut all = Status::default();
    let mut versions = BTreeMap::<_, usize>::new();
    for Heard { status, .. } in here() {
        *versions
            .entry(status.policy.map(|policy| policy.release()))
            .or_default() += 1;
        all.served += status.served;
        all.refused += status.refused;
        all.in_hand = all.in_hand.saturating_add(status.in_hand);
        for (sum, count) in all.verdicts.iter_mut().zip(status.verdicts) {
            *sum += count;
        }
    }
    line(format_args!("{}", row(&total, wide, &all)));
    let versions = versions.iter().map(|(version, robots)| match version {
        Some(version) => format!("version {version}: {robots}"),
        None => format!("none: {robots}"),
    });
    let versions: Vec<_> = versions.collect();
    line(format_args!("policies in use: {}", versions.join(", ")));
    for Heard { robot, status, .. } in here() {
        if let Some(NotTaken { policy, reason }) = status.not_taken {
            let release = policy.release();
            line(format_args!(
                "{robot} did not take version {release}: {reason}"
            ));
        }
    }
    for Heard { robot, status, .. } in here() {
        for fault in status.health.faults() {
            line(format_args!("{robot}: {fault}"));
        }
    }
    let twice = robots.iter().filter(|heard| heard.duplicate);
    for Heard { robot, .. } in twice {
        line(format_args!(
            "two robots are called {robot}: give each its own name"
        ));
    }
    text
}

fn row(name: &str, wide: usize, status: &Status) -> String {
    let version = status.policy.map(|policy| policy.release().to_string());
    let verdicts = status.verdicts.map(|count| format!("{count:>15}"));
    format!(
        "{name:wide$} {:>12} {:>5} {:>8} {:>8} {}",
        version.as_deref().unwrap_or("-"),
        status.in_hand,
        status.served,
        status.refused,
        verdicts.concat()
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use reagent_core::wire::PolicyId;

    #[test]
    fn robots_are_listed_and_summed_up() {
        let policy = |version| PolicyId {
            epoch: 0,
            version,
            sha256: [0; 32],
        };
        let status = |version: Option<u64>, in_hand| Status {
            policy: version.map(policy),
            served: 10,
            refused: 1,
            in_hand,
            instance: 5,
            verdicts: [4, 3, 2, 1, 0, 0, 0, 0],
            ..Status::default()
        };
        let heard = |robot: String, status| Heard {
            duplicate: robot == "r07",
            robot,
            status,
            offline_since: None,
        };
        let mut robots: Vec<_> = (0..30)
            .map(|i| heard(format!("r{i:02}"), status(Some(7), 0)))
            .collect();
        robots.push(heard("z".into(), status(None, 3)));
        let text = text(&robots, ROWS);
        let lines: Vec<_> = text.lines().collect();
        assert!(lines[0].contains("converged") && lines[0].ends_with("mirrored"));
        assert!(
            lines[1].starts_with('z') && lines[1].contains(" - "),
            "{text}"
        );
        assert_eq!(lines.len(), 1 + ROWS + 4);
        assert_eq!(lines[ROWS + 1], "… and 7 more");
        let words: Vec<_> = lines[ROWS + 2].split_whitespace().collect();
        assert_eq!(
            words,
            [
                "31", "robots", "-", "3", "310", "31", "124", "93", "62", "31", "0", "0", "0", "0"
            ]
        );
        assert_eq!(lines[ROWS + 3], "policies in use: none: 1, version 7: 30");
        assert!(lines[ROWS + 4].starts_with("two robots are called r07"));
    }

    #[test]
    fn who_is_away_is_told_from_when_on() {
        let heard = |robot: &str, offline_since| Heard {
            robot: robot.into(),
            status: Status::default(),
            duplicate: false,
            offline_since,
        };
        let since = SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(86_400 + 3_723);
        let text = text(&[heard("a", Some(since)), heard("b", None)], ROWS);
        let lines: Vec<_> = text.lines().collect();
        assert!(lines[1].starts_with("b "), "{text}");
        let words: Vec<_> = lines[2].split_whitespace().collect();
        assert_eq!(words, ["a", "offline", "since", "01:02:03", "UTC"]);
        assert!(lines[3].starts_with("1 robot "), "{text}");
        assert!(lines[0].starts_with("robot         policy "), "{text}");
        let at_80 = cut(lines[0], 80);
        assert!(at_80.contains(" converged"), "{at_80}");
    }

    #[test]
    fn a_drawing_goes_over_the_last_one_line_by_line() {
        assert_eq!(over(0, "a\nb\n"), "\x1b[Ka\n\x1b[Kb\n\x1b[J");
        assert_eq!(over(3, "a\n"), "\x1b[3A\r\x1b[Ka\n\x1b[J");
        // What was drawn on a wider terminal takes more rows now.
        let text = format!("{}\n{}\n\n", "x".repeat(100), "y".repeat(50));
        assert_eq!([100, 50, 49].map(|width| rows(&text, width)), [3, 4, 6]);
    }

    #[test]
    fn faults_that_robots_report_are_told() {
        let mut status = Status::default();
        status.health.state_lost = true;
        let heard = Heard {
            robot: "a".into(),
            status,
            duplicate: false,
            offline_since: None,
        };
        let text = text(&[heard], ROWS);
        assert!(
            text.ends_with("\na: its state directory is gone\n"),
            "{text}"
        );
    }

    #[test]
    fn no_line_is_longer_than_the_terminal_is_wide() {
        let narrow = cut("robot     policy\nx\n", 8);
        assert_eq!(narrow, "robot  …\nx\n");
    }
}
