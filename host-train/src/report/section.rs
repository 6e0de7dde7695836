//! Parts of a report.

use super::chart::Chart;
use super::table::Table;

/// A part of the page with a heading of its own.
#[derive(Debug)]
pub(crate) struct Section {
    /// Heading.
    pub title: String,
    /// What is in it, in order.
    pub blocks: Vec<Block>,
}

/// A block of a section.
#[derive(Debug)]
pub(crate) enum Block {
    /// A paragraph.
    Text(String),
    /// A table.
    Table(Table),
    /// Charts side by side, under a heading.
    Charts(String, Vec<Chart>),
    /// Blocks that are shown on demand, under a heading.
    More(String, Vec<Block>),
    /// Text as it is, such as a configuration.
    Listing(String),
    /// Registrations to turn and step through: JSON for the page's script.
    Viewer(String),
}

impl Section {
    /// Its charts, in order.
    pub(crate) fn charts(&self) -> Vec<&Chart> {
        fn collect<'a>(blocks: &'a [Block], charts: &mut Vec<&'a Chart>) {
            for block in blocks {
                match block {
                    Block::Charts(_, of_block) => charts.extend(of_block),
                    Block::More(_, inner) => collect(inner, charts),
                    _ => {}
                }
            }
        }
        let mut charts = Vec::new();
        collect(&self.blocks, &mut charts);
        charts
    }
}
