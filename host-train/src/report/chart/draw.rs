//! Charts on any backend of the drawing library. All sizes are in backend pixels, two for each CSS pixel of
//! the page, so that curves are smooth and images sharp.

use super::axis::Fitted;
use super::{BoxStats, Boxes, Chart, Line, Marks};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Okabe and Ito's palette, safe for colour-blind readers, without the yellow that white swallows. The page's
/// style sheet knows these values and replaces them on dark backgrounds.
pub(super) const COLOURS: [RGBColor; 7] = [
    RGBColor(0x00, 0x72, 0xB2),
    RGBColor(0xD5, 0x5E, 0x00),
    RGBColor(0x00, 0x9E, 0x73),
    RGBColor(0xCC, 0x79, 0xA7),
    RGBColor(0xE6, 0x9F, 0x00),
    RGBColor(0x56, 0xB4, 0xE9),
    RGBColor(0x7A, 0x7A, 0x7A),
];
/// Place of the grey in the palette.
pub(super) const GREY: usize = 6;
const INK: RGBColor = RGBColor(0x1F, 0x24, 0x30);
const MUTED: RGBColor = RGBColor(0x5B, 0x62, 0x70);
const GRID: RGBColor = RGBColor(0xDF, 0xE3, 0xE8);

pub(super) const FONT: &str = "sans-serif";
const WIDTH: u32 = 880;
const HEIGHT: u32 = 560;
/// The library divides sizes by 1.24.
const TEXT: f64 = 31.0;
const TITLE: f64 = 36.0;
const TITLE_HEIGHT: i32 = 52;
const LEGEND_LINE: i32 = 38;
/// Height of one category's row of horizontal boxes.
const ROW: u32 = 56;
const LINE_WIDTH: u32 = 4;

type Plane = Cartesian2d<Fitted, Fitted>;
type Failure<DB> = DrawingAreaErrorKind<<DB as DrawingBackend>::ErrorType>;

/// Width and height.
pub(super) fn size(chart: &Chart) -> (u32, u32) {
    match &chart.marks {
        Marks::Boxes {
            categories,
            horizontal: true,
            ..
        } => (WIDTH, 190 + ROW * categories.len() as u32),
        _ => (WIDTH, HEIGHT),
    }
}

fn colour(index: usize) -> RGBColor {
    COLOURS[index % COLOURS.len()]
}

fn text(size: f64, colour: &RGBColor) -> TextStyle<'static> {
    (FONT, size)
        .into_font()
        .color(colour)
        .pos(Pos::new(HPos::Left, VPos::Center))
}

/// Draws the chart.
pub(super) fn draw<DB: DrawingBackend>(
    chart: &Chart,
    root: &DrawingArea<DB, Shift>,
) -> Result<(), Failure<DB>> {
    root.fill(&WHITE)?;
    let title = text(TITLE, &INK);
    root.draw(&Text::new(
        chart.title.clone(),
        (24, TITLE_HEIGHT / 2),
        title,
    ))?;
    let below = legend(chart, root)?;
    let (_, plot) = root.split_vertically(below);

    let (x, y) = fit(chart);
    let label_width = y
        .labels()
        .map(|label| width(root, label))
        .max()
        .unwrap_or(0);
    let described = |label: &str| if label.is_empty() { 0 } else { 36 };
    let mut context = ChartBuilder::on(&plot)
        .margin_right(36)
        .margin_top(14)
        .margin_bottom(8)
        .margin_left(12)
        .x_label_area_size(44 + described(&chart.x.label))
        .y_label_area_size(24 + label_width + described(&chart.y.label))
        .build_cartesian_2d(x, y)?;
    let mut mesh = context.configure_mesh();
    mesh.light_line_style(TRANSPARENT)
        .bold_line_style(GRID.stroke_width(2))
        .axis_style(GRID.stroke_width(2))
        .label_style(text(TEXT, &MUTED))
        .axis_desc_style(text(TEXT, &MUTED))
        .x_desc(chart.x.label.clone())
        .y_desc(chart.y.label.clone());
    if let Marks::Boxes { horizontal, .. } = chart.marks {
        // No grid through the categories.
        if horizontal {
            mesh.disable_y_mesh();
        } else {
            mesh.disable_x_mesh();
        }
    }
    mesh.draw()?;
    let area = context.plotting_area();
    match &chart.marks {
        Marks::Lines(lines) => {
            for line in lines {
                draw_line(area, line)?;
            }
        }
        Marks::Boxes {
            groups, horizontal, ..
        } => draw_boxes(area, groups, *horizontal)?,
    }
    root.present()
}

/// Both axes, fitted to the marks.
fn fit(chart: &Chart) -> (Fitted, Fitted) {
    match &chart.marks {
        Marks::Lines(lines) => {
            let xs = lines.iter().flat_map(Line::finite).map(|p| p.0);
            let ys = lines.iter().flat_map(|line| {
                let ends = line.band.iter().flat_map(|&(low, high)| [low, high]);
                line.finite().map(|p| p.1).chain(ends)
            });
            (Fitted::new(&chart.x, xs), Fitted::new(&chart.y, ys))
        }
        Marks::Boxes {
            categories,
            groups,
            horizontal,
        } => {
            let values = groups
                .iter()
                .flat_map(|g| g.boxes.iter().flatten())
                .flat_map(BoxStats::values);
            let names = Fitted::categories(categories, *horizontal);
            if *horizontal {
                (Fitted::new(&chart.x, values), names)
            } else {
                (names, Fitted::new(&chart.y, values))
            }
        }
    }
}

fn width<DB: DrawingBackend>(root: &DrawingArea<DB, Shift>, label: &str) -> i32 {
    root.estimate_text_size(label, &text(TEXT, &INK))
        .map_or(0, |(width, _)| width as i32)
}

/// Draws the legend in as many lines as it needs; returns where it ends.
fn legend<DB: DrawingBackend>(
    chart: &Chart,
    root: &DrawingArea<DB, Shift>,
) -> Result<i32, Failure<DB>> {
    const SWATCH: i32 = 30;
    let names = chart.legend();
    let (mut x, mut y) = (24, TITLE_HEIGHT + LEGEND_LINE / 2);
    for (name, index) in &names {
        let entry = SWATCH + 12 + width(root, name) + 28;
        if x > 24 && x + entry > root.dim_in_pixel().0 as i32 {
            (x, y) = (24, y + LEGEND_LINE);
        }
        let swatch = [(x, y - 5), (x + SWATCH, y + 5)];
        root.draw(&Rectangle::new(swatch, colour(*index).filled()))?;
        let at = (x + SWATCH + 12, y);
        root.draw(&Text::new((*name).to_owned(), at, text(TEXT, &INK)))?;
        x += entry;
    }
    let end = y + LEGEND_LINE / 2;
    Ok(if names.is_empty() { TITLE_HEIGHT } else { end })
}

fn draw_line<DB: DrawingBackend>(
    area: &DrawingArea<DB, Plane>,
    line: &Line,
) -> Result<(), Failure<DB>> {
    let colour = colour(line.colour);
    for piece in line.pieces() {
        if !line.band.is_empty() {
            let low = piece.iter().map(|i| (line.points[*i].0, line.band[*i].0));
            let high = piece.iter().map(|i| (line.points[*i].0, line.band[*i].1));
            let outline: Vec<(f64, f64)> = low.chain(high.rev()).collect();
            area.draw(&Polygon::new(outline, colour.mix(0.18).filled()))?;
        }
        let places: Vec<(f64, f64)> = piece.iter().map(|i| line.points[*i]).collect();
        if line.dots || places.len() == 1 {
            for place in &places {
                area.draw(&Circle::new(*place, 6, colour.filled()))?;
            }
        }
        area.draw(&PathElement::new(places, colour.stroke_width(LINE_WIDTH)))?;
    }
    Ok(())
}

fn draw_boxes<DB: DrawingBackend>(
    area: &DrawingArea<DB, Plane>,
    groups: &[Boxes],
    horizontal: bool,
) -> Result<(), Failure<DB>> {
    let at = |across: f64, value: f64| {
        if horizontal {
            (value, across)
        } else {
            (across, value)
        }
    };
    let share = 0.8 / groups.len().max(1) as f64;
    for (g, group) in groups.iter().enumerate() {
        for (c, stats) in group.boxes.iter().enumerate() {
            let Some(BoxStats {
                quartiles: [q1, median, q3],
                whiskers: [low, high],
                outliers,
            }) = stats
            else {
                continue;
            };
            let colour = colour(group.colours.get(c).copied().unwrap_or(0));
            let middle = c as f64 - 0.4 + share * (g as f64 + 0.5);
            let (half, cap) = (0.38 * share, 0.2 * share);
            let stroke = colour.stroke_width(LINE_WIDTH);
            for (from, to) in [(low, q1), (q3, high)] {
                let whisker = vec![at(middle, *from), at(middle, *to)];
                area.draw(&PathElement::new(whisker, stroke))?;
            }
            for end in [low, high] {
                let ends = vec![at(middle - cap, *end), at(middle + cap, *end)];
                area.draw(&PathElement::new(ends, stroke))?;
            }
            let corners = [at(middle - half, *q1), at(middle + half, *q3)];
            area.draw(&Rectangle::new(corners, colour.mix(0.3).filled()))?;
            let [a, b] = corners;
            let outline = vec![a, (b.0, a.1), b, (a.0, b.1), a];
            area.draw(&PathElement::new(outline, colour.stroke_width(3)))?;
            let line = vec![at(middle - half, *median), at(middle + half, *median)];
            area.draw(&PathElement::new(line, INK.stroke_width(5)))?;
            for outlier in outliers {
                let dot = Circle::new(at(middle, *outlier), 4, colour.mix(0.6).filled());
                area.draw(&dot)?;
            }
        }
    }
    Ok(())
}
