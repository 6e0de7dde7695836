//! The section with the interactive view of registrations.

use super::input::{TRACED, TraceFile};
use super::section::{Block, Section};
use crate::register::trace::Traced;
use crate::register::view::View;
use std::collections::BTreeMap;

/// Registrations that are shown at most.
const SHOWN: usize = 48;

/// The section with the view of all traces, and a note on what is not shown.
pub(super) fn section(files: &[TraceFile]) -> (Section, Option<String>) {
    let all: Vec<&Traced> = files.iter().flat_map(|file| &file.traced).collect();
    // As many of each policy, so that they can be compared.
    let mut of_policy: BTreeMap<&str, Vec<&Traced>> = BTreeMap::new();
    for one in &all {
        of_policy.entry(&one.header.policy).or_default().push(one);
    }
    let each = (SHOWN / of_policy.len().max(1)).max(1);
    let shown: Vec<&Traced> = of_policy
        .values()
        .flat_map(|of| of.iter().take(each).copied())
        .collect();
    let views: Vec<View<'_>> = shown.iter().map(|one| View::of(one)).collect();
    let text = serde_json::to_string(&views).unwrap_or_else(|_| "[]".into());

    let count: usize = files.iter().map(|file| file.count).sum();
    let note = (count > views.len()).then(|| {
        let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
        format!(
            "{}: {} of {count} registrations are shown, at most {TRACED} of a file and {SHOWN} of a report",
            names.join(", "),
            views.len(),
        )
    });
    let section = Section {
        title: "Registrations, step by step".into(),
        blocks: vec![Block::Viewer(text)],
    };
    (section, note)
}
