//! Curves, thinned to what a chart can show.

/// Points of a curve that are drawn at most.
const DRAWN: usize = 240;

/// A curve, with the range that its thinned points stand for.
#[derive(Clone, Debug, Default)]
pub(crate) struct Line {
    /// Name in the legend.
    pub name: String,
    /// Place of its colour in the palette.
    pub colour: usize,
    /// Points in the order of x; a y that is not finite leaves a gap.
    pub points: Vec<(f64, f64)>,
    /// Least and greatest value at each point where several were averaged, else empty.
    pub band: Vec<(f64, f64)>,
    /// Whether the points are marked.
    pub dots: bool,
}

impl Line {
    /// A curve through points; many are averaged over windows of equal length.
    pub(crate) fn new(name: impl Into<String>, colour: usize, points: Vec<(f64, f64)>) -> Line {
        let name = name.into();
        if points.len() <= DRAWN {
            let dots = points.len() <= 40;
            return Line {
                name,
                colour,
                points,
                band: Vec::new(),
                dots,
            };
        }
        let window = points.len().div_ceil(DRAWN);
        let (mut thinned, mut band) = (Vec::new(), Vec::new());
        for points in points.chunks(window) {
            let finite = points.iter().map(|p| p.1).filter(|y| y.is_finite());
            let mean = finite.clone().sum::<f64>() / finite.clone().count() as f64;
            let x = points.iter().map(|p| p.0).sum::<f64>() / points.len() as f64;
            thinned.push((x, mean));
            band.push((
                finite.clone().fold(f64::INFINITY, f64::min),
                finite.fold(f64::NEG_INFINITY, f64::max),
            ));
        }
        Line {
            name,
            colour,
            points: thinned,
            band,
            dots: false,
        }
    }

    /// Its finite points.
    pub(crate) fn finite(&self) -> impl Iterator<Item = (f64, f64)> + Clone + '_ {
        let finite = |p: &(f64, f64)| p.0.is_finite() && p.1.is_finite();
        self.points.iter().copied().filter(finite)
    }

    /// Its finite pieces: indices of points.
    pub(crate) fn pieces(&self) -> Vec<Vec<usize>> {
        let finite = |i: &usize| self.points[*i].0.is_finite() && self.points[*i].1.is_finite();
        let all: Vec<usize> = (0..self.points.len()).collect();
        all.split(|i| !finite(i))
            .filter(|piece| !piece.is_empty())
            .map(<[usize]>::to_vec)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_split_a_line() {
        let line = Line::new(
            "a",
            0,
            vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, 2.0), (3.0, 3.0)],
        );
        assert_eq!(line.pieces(), [vec![0], vec![2, 3]]);
    }

    #[test]
    fn long_lines_are_averaged_and_keep_their_range() {
        let points = (0..1000)
            .map(|i| (f64::from(i), f64::from(i % 2)))
            .collect();
        let line = Line::new("a", 0, points);
        assert!(line.points.len() <= DRAWN);
        assert!(line.points.iter().all(|p| (0.3..0.7).contains(&p.1)));
        assert!(line.band.iter().all(|b| *b == (0.0, 1.0)));
    }

    #[test]
    fn a_window_without_numbers_is_a_gap() {
        let points = (0..1000).map(|i| (f64::from(i), f64::NAN)).collect();
        assert!(Line::new("a", 0, points).pieces().is_empty());
    }
}
