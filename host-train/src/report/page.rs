//! The HTML file: style and script are in it, and nothing is fetched.

use super::ReportError;
use super::chart::{Chart, svg};
use super::section::{Block, Section};
use super::table::Table;
use std::fmt::Write;

pub(super) const STYLE: &str = include_str!("page/report.css");
pub(super) const SCRIPT: &str = include_str!("page/viewer.js");
pub(super) const VIEWER: &str = include_str!("page/viewer.html");
const START: &str = "view(JSON.parse(document.getElementById('registrations').textContent));\n";
/// Even a mistake in the page could not load anything.
const POLICY: &str =
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:";

/// The whole document.
pub(super) fn html(sections: &[Section], notes: &[String]) -> Result<String, ReportError> {
    let mut contents = String::new();
    let mut body = String::new();
    for (i, section) in sections.iter().enumerate() {
        let title = escape(&section.title);
        contents += &format!("<a href=\"#s{i}\">{title}</a>\n");
        body += &format!("<section id=\"s{i}\">\n<h2>{title}</h2>\n");
        for block in &section.blocks {
            render(&mut body, block)?;
        }
        body += "</section>\n";
    }
    let notes: String = notes
        .iter()
        .map(|note| format!("<p class=\"note\">{}</p>\n", escape(note)))
        .collect();
    let has_viewer = sections.iter().any(|s| {
        s.blocks
            .iter()
            .any(|block| matches!(block, Block::Viewer(_)))
    });
    let script = if has_viewer {
        format!("<script>\n{SCRIPT}{START}</script>\n")
    } else {
        String::new()
    };
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
         <link rel=\"icon\" href=\"data:,\">\n\
         <title>ReAgent report</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
         <header>\n<h1>ReAgent report</h1>\n<nav aria-label=\"Sections\">\n{contents}</nav>\n{notes}</header>\n\
         <main>\n{body}</main>\n<footer>host-train {}</footer>\n{script}</body>\n</html>\n",
        env!("CARGO_PKG_VERSION"),
    ))
}

fn render(body: &mut String, block: &Block) -> Result<(), ReportError> {
    match block {
        Block::Text(text) => *body += &format!("<p>{}</p>\n", escape(text)),
        Block::Listing(text) => *body += &format!("<pre>{}</pre>\n", escape(text)),
        Block::Table(table) => *body += &render_table(table),
        Block::Charts(heading, charts) => {
            *body += &format!("<h3>{}</h3>\n<div class=\"charts\">\n", escape(heading));
            for chart in charts {
                *body += &figure(chart)?;
            }
            *body += "</div>\n";
        }
        Block::More(heading, blocks) => {
            *body += &format!("<details>\n<summary>{}</summary>\n", escape(heading));
            for block in blocks {
                render(body, block)?;
            }
            *body += "</details>\n";
        }
        Block::Viewer(data) => {
            // Within a script element only "<" could end it.
            let data = data.replace('<', "\\u003c");
            *body += VIEWER;
            *body += "<noscript><p class=\"note\">The view needs JavaScript.</p></noscript>\n";
            *body += &format!(
                "<script type=\"application/json\" id=\"registrations\">{data}</script>\n"
            );
        }
    }
    Ok(())
}

fn figure(chart: &Chart) -> Result<String, ReportError> {
    let label = [chart.title.as_str(), &chart.y.label, &chart.x.label];
    let label: Vec<&str> = label.into_iter().filter(|part| !part.is_empty()).collect();
    Ok(format!(
        "<figure class=\"chart\" role=\"img\" aria-label=\"Chart: {}\">\n{}</figure>\n",
        escape(&label.join(", ")),
        svg(chart)?,
    ))
}

fn render_table(table: &Table) -> String {
    let caption = escape(&table.caption);
    let mut text = format!(
        "<p class=\"caption\">{caption}</p>\n<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{caption}\">\n\
         <table aria-label=\"{caption}\">\n<thead><tr>",
    );
    for (i, (name, unit)) in table.columns.iter().enumerate() {
        let class = if i < table.labels {
            " class=\"name\""
        } else {
            ""
        };
        let unit = match unit.as_str() {
            "" => String::new(),
            unit => format!("<span class=\"unit\">{}</span>", escape(unit)),
        };
        write!(text, "<th scope=\"col\"{class}>{}{unit}</th>", escape(name))
            .expect("a string takes everything");
    }
    text += "</tr></thead>\n<tbody>\n";
    for row in &table.rows {
        text += "<tr>";
        for (i, cell) in row.iter().enumerate() {
            let content = escape(&cell.text);
            text += &match (i < table.labels, cell.best) {
                (true, _) => format!("<th scope=\"row\" class=\"name\">{content}</th>"),
                (false, true) => format!("<td><strong>{content}</strong></td>"),
                (false, false) => format!("<td>{content}</td>"),
            };
        }
        text += "</tr>\n";
    }
    text + "</tbody>\n</table>\n</div>\n"
}

fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            c => escaped.push(c),
        }
    }
    escaped
}
