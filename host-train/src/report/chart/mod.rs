//! Charts as data: lines and boxes on two axes. `draw` puts them on a backend, `file` makes SVG and PNG.

mod axis;
mod boxes;
mod draw;
mod file;
mod line;

pub(crate) use axis::Axis;
pub(crate) use boxes::{BoxStats, Boxes};
pub(crate) use file::{png, svg};
pub(crate) use line::Line;

/// A chart with its name and title.
#[derive(Clone, Debug)]
pub(crate) struct Chart {
    /// File stem: letters, digits, dots, dashes.
    pub name: String,
    /// Title drawn above.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// What is drawn.
    pub marks: Marks,
}

/// What a chart shows.
#[derive(Clone, Debug)]
pub(crate) enum Marks {
    /// Curves over x.
    Lines(Vec<Line>),
    /// Boxes in categories; each element has one box a category.
    Boxes {
        /// Names of the categories.
        categories: Vec<String>,
        /// Coloured groups within a category.
        groups: Vec<Boxes>,
        /// Values run along x and the categories down y.
        horizontal: bool,
    },
}

impl Chart {
    /// Whether there is anything finite to draw.
    pub(crate) fn has_data(&self) -> bool {
        match &self.marks {
            Marks::Lines(lines) => lines.iter().any(|line| line.finite().next().is_some()),
            Marks::Boxes { groups, .. } => {
                groups.iter().any(|g| g.boxes.iter().any(Option::is_some))
            }
        }
    }

    /// Names in the legend and their colours; none where there is nothing to tell apart.
    fn legend(&self) -> Vec<(&str, usize)> {
        let names: Vec<(&str, usize)> = match &self.marks {
            Marks::Lines(lines) => lines.iter().map(|l| (l.name.as_str(), l.colour)).collect(),
            Marks::Boxes { groups, .. } => groups
                .iter()
                .map(|g| (g.name.as_str(), g.colours.first().copied().unwrap_or(0)))
                .collect(),
        };
        match names.as_slice() {
            [("", _)] => Vec::new(),
            _ => names,
        }
    }
}

/// Colours of methods, the same in all charts of them: grey for doing nothing, the others in order.
pub(crate) fn palette<'a>(methods: impl Iterator<Item = &'a str>) -> Vec<usize> {
    let mut next = 0..;
    methods
        .map(|method| match method {
            "init" => draw::GREY,
            _ => next.next().unwrap_or(0) % draw::GREY,
        })
        .collect()
}

/// A file stem from any text.
pub(crate) fn slug(text: &str) -> String {
    let slug: String = text
        .chars()
        .map(|c| {
            if c.is_ascii_alphanumeric() {
                c.to_ascii_lowercase()
            } else {
                '-'
            }
        })
        .collect();
    slug.split('-')
        .filter(|s| !s.is_empty())
        .collect::<Vec<_>>()
        .join("-")
}
