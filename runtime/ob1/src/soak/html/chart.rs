//! Charts as SVG: bars and lines over a linear or a logarithmic axis. Colours are those of the page.

use std::fmt::Write as _;

use super::escape;

const WIDTH: f64 = 860.0;
const HEIGHT: f64 = 240.0;
/// Room for the labels of the axes.
const LEFT: f64 = 76.0;
const RIGHT: f64 = 36.0;
const BOTTOM: f64 = 34.0;
const TOP: f64 = 16.0;

/// An axis: from one value to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Axis {
    from: f64,
    to: f64,
    log: bool,
}

impl Axis {
    /// From 0 to at least the greatest of the values.
    pub(super) fn linear(values: impl Iterator<Item = f64>) -> Self {
        let to = values.fold(0.0, f64::max);
        Self { from: 0.0, to: if to > 0.0 { to * 1.05 } else { 1.0 }, log: false }
    }

    /// A linear axis around the values, with some room at both ends.
    pub(super) fn around(values: impl Iterator<Item = f64>) -> Self {
        let (from, to) = values.fold((f64::MAX, f64::MIN), |(from, to), value| (from.min(value), to.max(value)));
        if from > to {
            return Self::linear(std::iter::empty());
        }
        let room = ((to - from) * 0.08).max(to.abs() * 0.005).max(0.5);
        Self { from: from - room, to: to + room, log: false }
    }

    /// Logarithmic, over whole decades around the values, none of which counts as less than 1.
    pub(super) fn decades(values: impl Iterator<Item = f64>) -> Self {
        let (from, to) = values.fold((f64::MAX, 1.0), |(from, to): (f64, f64), value| (from.min(value), to.max(value)));
        let from = 10f64.powf(from.clamp(1.0, to).log10().floor());
        let to = 10f64.powf(to.log10().ceil()).max(from * 10.0);
        Self { from, to, log: true }
    }

    /// Logarithmic, for counts: a bar of 1 can be seen.
    pub(super) fn counts(counts: impl Iterator<Item = u64>) -> Self {
        Self { from: 0.5, ..Self::decades(counts.map(|count| count as f64).chain([1.0])) }
    }

    /// Where a value lies, from 0 to 1.
    fn place(self, value: f64) -> f64 {
        let place = if self.log {
            (value.max(self.from) / self.from).ln() / (self.to / self.from).ln()
        } else {
            (value - self.from) / (self.to - self.from)
        };
        place.clamp(0.0, 1.0)
    }

    /// Values that get a label.
    fn ticks(self) -> Vec<f64> {
        if self.log {
            let (first, last) = (self.from.log10().ceil() as i32, self.to.log10().round() as i32);
            return (first..=last).map(|decade| 10f64.powi(decade)).collect();
        }
        let rough = (self.to - self.from) / 5.0;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|n| n * power).into_iter().find(|step| *step >= rough).unwrap_or(rough);
        let first = (self.from / step).ceil() as i64;
        (first..).map(|n| n as f64 * step).take_while(|value| *value <= self.to).collect()
    }
}

/// A chart under way.
pub(super) struct Chart {
    svg: String,
    x: Axis,
    y: Axis,
    lines: usize,
}

impl Chart {
    /// With both axes drawn. The labels are made by the functions.
    pub(super) fn new(
        title: &str,
        x: Axis,
        y: Axis,
        of_x: impl Fn(f64) -> String,
        of_y: impl Fn(f64) -> String,
    ) -> Self {
        let mut svg = format!(
            "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{0}\"><title>{0}</title>\n",
            escape(title)
        );
        let mut chart = Self { svg: String::new(), x, y, lines: 0 };
        for value in y.ticks() {
            let at = chart.at_y(value);
            let (right, label) = (WIDTH - RIGHT, escape(&of_y(value)));
            let _ = writeln!(
                svg,
                "<path class=\"grid\" d=\"M{LEFT} {at:.1}H{right}\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
                LEFT - 6.0,
                at + 4.0
            );
        }
        for value in x.ticks() {
            let at = chart.at_x(value);
            let (bottom, label) = (HEIGHT - BOTTOM, escape(&of_x(value)));
            let _ = writeln!(
                svg,
                "<path class=\"grid\" d=\"M{at:.1} {TOP}V{bottom}\"/><text x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{label}</text>",
                HEIGHT - BOTTOM + 16.0
            );
        }
        chart.svg = svg;
        chart
    }

    fn at_x(&self, value: f64) -> f64 {
        LEFT + self.x.place(value) * (WIDTH - LEFT - RIGHT)
    }

    fn at_y(&self, value: f64) -> f64 {
        HEIGHT - BOTTOM - self.y.place(value) * (HEIGHT - BOTTOM - TOP)
    }

    /// A bar from one place to another; the text is shown by a pointer on it.
    pub(super) fn bar(&mut self, from: f64, to: f64, height: f64, text: &str) {
        let (left, right, top) = (self.at_x(from), self.at_x(to), self.at_y(height));
        let _ = writeln!(
            self.svg,
            "<rect class=\"bar\" x=\"{left:.1}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{:.1}\"><title>{}</title></rect>",
            (right - left - 0.5).max(0.5),
            HEIGHT - BOTTOM - top,
            escape(text)
        );
    }

    /// A line with a name; its colour is that of its place in the legend.
    pub(super) fn line(&mut self, name: &str, points: &[(f64, f64)]) {
        let mut path = String::new();
        for (x, y) in points {
            let command = if path.is_empty() { 'M' } else { 'L' };
            let _ = write!(path, "{command}{:.1} {:.1}", self.at_x(*x), self.at_y(*y));
        }
        let _ = writeln!(self.svg, "<path class=\"line l{}\" d=\"{path}\"/>", self.lines);
        let x = LEFT + 8.0 + 130.0 * self.lines as f64;
        let _ = writeln!(
            self.svg,
            "<path class=\"line l{}\" d=\"M{x} 8h16\"/><text x=\"{}\" y=\"12\">{}</text>",
            self.lines,
            x + 20.0,
            escape(name)
        );
        self.lines += 1;
    }

    /// A limit across the chart, at a value of the x axis.
    pub(super) fn limit(&mut self, value: f64, text: &str) {
        let (at, bottom) = (self.at_x(value), HEIGHT - BOTTOM);
        let _ = writeln!(
            self.svg,
            "<path class=\"limit\" d=\"M{at:.1} {TOP}V{bottom}\"/><text class=\"limit\" x=\"{:.1}\" y=\"{}\" text-anchor=\"end\">{}</text>",
            at - 4.0,
            TOP + 10.0,
            escape(text)
        );
    }

    pub(super) fn finish(mut self) -> String {
        self.svg += "</svg>\n";
        self.svg
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes() {
        let log = Axis::decades([300.0, 20_000.0].into_iter());
        assert_eq!(log.ticks(), [100.0, 1e3, 1e4, 1e5]);
        assert_eq!((log.place(100.0), log.place(100_000.0)), (0.0, 1.0));
        assert!((log.place(1e4) - 2.0 / 3.0).abs() < 1e-9);
        assert_eq!(Axis::linear([0.0, 10.0].into_iter()).ticks(), [0.0, 5.0, 10.0]);
        let counts = Axis::counts([3, 40].into_iter());
        assert_eq!(counts.ticks(), [1.0, 10.0, 100.0]);
        assert!(counts.place(1.0) > 0.1);
        // Nothing, and one value only, have axes too.
        assert_eq!(Axis::linear(std::iter::empty()).ticks().len(), 6);
        assert!(Axis::decades(std::iter::empty()).ticks().len() >= 2);
        let constant = Axis::around([1000.0, 1000.0].into_iter());
        assert!((constant.place(1000.0) - 0.5).abs() < 1e-9);
    }

    #[test]
    fn text_is_escaped() {
        let axis = Axis::linear([1.0].into_iter());
        let mut chart = Chart::new("a<b", axis, axis, |_| "&".into(), |_| String::new());
        chart.bar(0.0, 1.0, 1.0, "x>y");
        chart.line("\"q\"", &[(0.0, 0.0), (1.0, 1.0)]);
        let svg = chart.finish();
        assert!(
            svg.contains("a&lt;b") && svg.contains("x&gt;y") && svg.contains("&quot;q&quot;") && svg.contains("&amp;")
        );
    }
}
