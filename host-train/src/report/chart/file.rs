//! Charts as SVG text and PNG bytes. The font comes with the program, so both need nothing of the system.

use super::Chart;
use super::draw::{FONT, draw, size};
use crate::report::ReportError;
use plotters::prelude::*;
use plotters::style::register_font;
use std::fmt::Display;
use std::sync::Once;

/// The chart as an SVG document.
pub(crate) fn svg(chart: &Chart) -> Result<String, ReportError> {
    embedded_font();
    let mut text = String::new();
    {
        let root = SVGBackend::with_string(&mut text, size(chart)).into_drawing_area();
        draw(chart, &root).map_err(|error| failed(chart, error))?;
    }
    Ok(text)
}

/// The chart as a PNG file.
pub(crate) fn png(chart: &Chart) -> Result<Vec<u8>, ReportError> {
    embedded_font();
    let (width, height) = size(chart);
    let mut pixels = vec![0; width as usize * height as usize * 3];
    {
        let root = BitMapBackend::with_buffer(&mut pixels, (width, height)).into_drawing_area();
        draw(chart, &root).map_err(|error| failed(chart, error))?;
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    let write = |encoder: png::Encoder<'_, &mut Vec<u8>>| {
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&pixels)?;
        writer.finish()
    };
    write(encoder).map_err(|error| failed(chart, error))?;
    Ok(bytes)
}

fn failed(chart: &Chart, error: impl Display) -> ReportError {
    ReportError::Draw {
        chart: chart.name.clone(),
        reason: error.to_string(),
    }
}

/// Makes the bundled font known to the drawing library; without it no text has a size.
fn embedded_font() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // A font that cannot be parsed leaves the library without one, which `draw` reports.
        let _ = register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT);
    });
}

#[cfg(test)]
mod tests {
    use super::super::{Axis, BoxStats, Boxes, Line, Marks};
    use super::*;

    fn chart(marks: Marks) -> Chart {
        Chart {
            name: "c".into(),
            title: "errors <of> methods".into(),
            x: Axis::linear("x"),
            y: Axis::linear("y"),
            marks,
        }
    }

    #[test]
    fn a_chart_becomes_svg_and_png() {
        let line = Line::new(
            "a & b",
            0,
            vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, 0.5), (3.0, 2.0)],
        );
        let chart = chart(Marks::Lines(vec![line]));
        let text = svg(&chart).expect("drawn");
        assert!(text.starts_with("<svg") && text.trim_end().ends_with("</svg>"));
        assert!(text.contains("a &amp; b") && text.contains("errors &lt;of&gt;"));
        assert!(!text.contains("NaN"));
        let bytes = png(&chart).expect("drawn");
        assert!(bytes.starts_with(b"\x89PNG"));
        // Text is drawn in the PNG too: ink darker than any other colour of the chart.
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes))
            .read_info()
            .expect("PNG");
        let mut pixels = vec![0; reader.output_buffer_size().expect("fits")];
        reader.next_frame(&mut pixels).expect("pixels");
        let dark = pixels
            .chunks(3)
            .filter(|p| p.iter().all(|v| *v < 0x60))
            .count();
        assert!(dark > 200, "{dark} dark pixels");
    }

    #[test]
    fn charts_without_numbers_are_drawn_empty() {
        let nothing = Line::new("a", 0, vec![(0.0, f64::NAN)]);
        for marks in [
            Marks::Lines(vec![nothing]),
            Marks::Lines(Vec::new()),
            Marks::Boxes {
                categories: vec!["a".into()],
                groups: vec![Boxes {
                    name: "b".into(),
                    boxes: vec![BoxStats::of(&[])],
                    colours: vec![0],
                }],
                horizontal: false,
            },
        ] {
            let chart = chart(marks);
            assert!(!chart.has_data());
            assert!(!svg(&chart).expect("drawn").contains("NaN"));
        }
    }
}
