//! Line charts as SVG. Colours and fonts come from the page's style sheet, which has a light and a dark theme.

use super::curves::{Points, smoothed, thinned};
use super::format::{axis, escape};

/// Size of the drawing and of the frame within it, user units.
const SIZE: (f64, f64) = (540.0, 260.0);
const LEFT: f64 = 52.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 40.0;
/// Upper bound of the points of a curve: the drawing does not resolve more.
const MOST_POINTS: usize = 400;
/// In an SVG file: height of the title, and of each entry of the legend, user units.
const ABOVE: f64 = 30.0;
const KEY_LINE: f64 = 18.0;
/// The light theme of the page, for an SVG file.
const FILE_STYLE: &str = "text{font:12px system-ui,'DejaVu Sans',sans-serif;fill:#5b6470}text.x{text-anchor:middle}\
    text.y{text-anchor:end}.grid{stroke:#dfe3e8}.axis{stroke:#5b6470}.level{stroke:#1b1f24;stroke-width:1.5;\
    stroke-dasharray:1.5 3}polyline{fill:none;stroke-linejoin:round}polyline.line{stroke-width:2}\
    polyline.faint{opacity:.3}polyline.c1{stroke:#1f6feb}polyline.c2{stroke:#c4570b}polyline.c3{stroke:#18805a}\
    circle.c1{fill:#1f6feb}circle.c2{fill:#c4570b}circle.c3{fill:#18805a}";
/// Fraction of a curve that smoothing averages over.
const SMOOTH: f64 = 0.04;

/// A chart over steps or training time.
pub struct Chart<'a> {
    /// Heading of the figure.
    pub title: &'a str,
    /// Label of the horizontal axis.
    pub over: &'a str,
    /// The curves, in the order of the legend.
    pub series: Vec<Series<'a>>,
    /// Steps or times of the vertical marks, and their meaning.
    pub marks: (&'a [f64], &'a str),
    /// A value to compare with, and its name.
    pub level: Level<'a>,
    /// True if the vertical axis begins at 0.
    pub from_zero: bool,
}

/// One curve of a chart, with its legend.
pub struct Series<'a> {
    /// Name of the curve in the legend.
    pub name: &'a str,
    /// (x, y) in the order of x.
    pub points: &'a Points,
    /// Style in which the curve is drawn.
    pub look: Look,
}

/// The style of a curve.
#[derive(Clone, Copy, PartialEq)]
pub enum Look {
    /// A line through all points.
    Line,
    /// Noisy values, drawn faintly, and their running mean.
    Noisy,
    /// Few values, drawn as a line with dots.
    Dots,
}

impl Chart<'_> {
    /// A `figure` with title, legend and drawing; empty if there is nothing to draw.
    pub fn html(&self) -> String {
        let Some((frame, drawn, level)) = self.drawn() else { return String::new() };
        let marks: Vec<f64> = self.marks.0.iter().copied().filter(|m| (frame.x.0..=frame.x.1).contains(m)).collect();
        let svg = format!("<svg {}\n{}</svg>", self.opening(0.0), self.body(&frame, &drawn, &marks, level));
        let mut keys: String = (drawn.iter())
            .map(|(_, _, color)| format!("<span class=\"key c{color}\">{}</span>", escape(self.series[color - 1].name)))
            .collect();
        if !marks.is_empty() {
            keys += &format!("<span class=\"key dashed\">{}</span>", escape(self.marks.1));
        }
        if let Some((_, name)) = level {
            keys += &format!("<span class=\"key level\">{}</span>", escape(name));
        }
        format!("<figure class=\"chart\"><figcaption><b>{}</b>{keys}</figcaption>{svg}</figure>\n", escape(self.title))
    }
}

/// Thinned curves, the style of each, and the index of its colour.
type Drawn = Vec<(Points, Look, usize)>;

/// A value to compare with, and its name.
type Level<'a> = Option<(f64, &'a str)>;

impl<'a> Chart<'a> {
    /// What the chart draws: the frame, the curves and the level; `None` without points.
    fn drawn(&self) -> Option<(Frame, Drawn, Level<'a>)> {
        let drawn: Drawn = (self.series.iter().enumerate())
            .map(|(i, s)| (thinned(s.points, MOST_POINTS), s.look, i + 1))
            .filter(|(points, ..)| !points.is_empty())
            .collect();
        let level = self.level.filter(|(value, _)| value.is_finite());
        let values = drawn.iter().flat_map(|(points, ..)| points);
        let frame = Frame::around(values, level.map(|(value, _)| value), self.from_zero)?;
        Some((frame, drawn, level))
    }

    /// Attributes of the `svg` element, with `above` user units above the frame.
    fn opening(&self, above: f64) -> String {
        let label = escape(&format!("{} over {}", self.title, self.over));
        let (width, height) = (SIZE.0, SIZE.1 + above);
        format!("viewBox=\"0 {} {width} {height}\" role=\"img\" aria-label=\"{label}\">", 0.0 - above)
    }

    /// The axes and curves as SVG elements.
    fn body(&self, frame: &Frame, drawn: &Drawn, marks: &[f64], level: Level<'_>) -> String {
        let mut svg = frame.axes(self.over);
        marks.iter().for_each(|&mark| svg += &frame.mark(mark, self.marks.1));
        drawn.iter().for_each(|(points, look, color)| svg += &frame.curve(points, *look, *color));
        level.iter().for_each(|&(value, name)| svg += &frame.level(value, name));
        svg
    }

    /// The chart as an SVG file with title and legend, readable on light and dark pages; `None` without points.
    pub fn svg_file(&self) -> Option<String> {
        let (frame, drawn, level) = self.drawn()?;
        let above = ABOVE + KEY_LINE * (drawn.len() + usize::from(level.is_some())) as f64;
        let mut head = format!(
            "<rect x=\"0\" y=\"{}\" width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n\
             <text x=\"{LEFT}\" y=\"{}\" style=\"font-weight:600;fill:#1b1f24\">{}</text>\n",
            -above,
            ABOVE - above - 12.0,
            escape(self.title)
        );
        let keys = drawn.iter().map(|(_, _, color)| (format!("line c{color}"), self.series[color - 1].name));
        for (i, (class, name)) in keys.chain(level.map(|(_, name)| ("level".into(), name))).enumerate() {
            let y = ABOVE - above + KEY_LINE * i as f64;
            let (end, text) = (LEFT + 22.0, LEFT + 30.0);
            head += &format!("<polyline class=\"{class}\" points=\"{LEFT},{y} {end},{y}\"/>");
            head += &format!("<text x=\"{text}\" y=\"{}\">{}</text>\n", y + 4.0, escape(name));
        }
        let body = self.body(&frame, &drawn, &[], level);
        let (opening, style) = (self.opening(above), FILE_STYLE);
        Some(format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" {opening}\n<style>{style}</style>\n{head}{body}</svg>\n"
        ))
    }
}

/// The value ranges of the two axes.
struct Frame {
    x: (f64, f64),
    y: (f64, f64),
}

impl Frame {
    /// The frame around the points; `None` without points, as a level alone is not a curve.
    fn around<'p>(points: impl Iterator<Item = &'p (f64, f64)>, level: Option<f64>, from_zero: bool) -> Option<Self> {
        let (mut last, mut low, mut high) = (0.0f64, f64::INFINITY, f64::NEG_INFINITY);
        for &(x, y) in points {
            (last, low, high) = (last.max(x), low.min(y), high.max(y));
        }
        if low > high {
            return None;
        }
        (low, high) = level.map_or((low, high), |value| (low.min(value), high.max(value)));
        if from_zero {
            low = low.min(0.0);
        }
        // A flat curve gets a margin above and below.
        let room = if high > low { 0.04 * (high - low) } else { 0.5 * high.abs().max(1.0) };
        let below = if from_zero && low == 0.0 { 0.0 } else { room };
        Some(Self { x: (0.0, last.max(1.0)), y: (low - below, high + room) })
    }

    fn at(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let part = |v: f64, (low, high): (f64, f64)| ((v - low) / (high - low)).clamp(0.0, 1.0);
        let (width, height) = (SIZE.0 - LEFT - RIGHT, SIZE.1 - TOP - BOTTOM);
        (LEFT + part(x, self.x) * width, TOP + (1.0 - part(y, self.y)) * height)
    }

    fn axes(&self, over: &str) -> String {
        let mut out = String::new();
        let (right, bottom) = (SIZE.0 - RIGHT, SIZE.1 - BOTTOM);
        for tick in ticks(self.y, 5) {
            let y = self.at((0.0, tick)).1;
            out += &format!("<line class=\"grid\" x1=\"{LEFT}\" x2=\"{right}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>");
            out += &format!("<text class=\"y\" x=\"{}\" y=\"{:.1}\">{}</text>\n", LEFT - 8.0, y + 4.0, axis(tick));
        }
        for tick in ticks(self.x, 6) {
            let x = self.at((tick, 0.0)).0;
            out += &format!("<text class=\"x\" x=\"{x:.1}\" y=\"{}\">{}</text>\n", bottom + 17.0, axis(tick));
        }
        out += &format!("<line class=\"axis\" x1=\"{LEFT}\" x2=\"{right}\" y1=\"{bottom}\" y2=\"{bottom}\"/>");
        let (x, y) = ((LEFT + right) / 2.0, bottom + 34.0);
        out + &format!("<text class=\"x\" x=\"{x}\" y=\"{y}\">{}</text>\n", escape(over))
    }

    /// A vertical line at `at` on the horizontal axis, with its name.
    fn mark(&self, at: f64, name: &str) -> String {
        let (x, bottom) = (self.at((at, 0.0)).0, SIZE.1 - BOTTOM);
        let title = format!("{} at {}", escape(name), axis(at));
        format!(
            "<line class=\"mark\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{TOP}\" y2=\"{bottom}\"><title>{title}</title></line>\n"
        )
    }

    /// A horizontal line at `value`, with its name.
    fn level(&self, value: f64, name: &str) -> String {
        let (y, right) = (self.at((0.0, value)).1, SIZE.0 - RIGHT);
        let title = format!("{}: {}", escape(name), axis(value));
        format!(
            "<line class=\"level\" x1=\"{LEFT}\" x2=\"{right}\" y1=\"{y:.1}\" y2=\"{y:.1}\"><title>{title}</title></line>\n"
        )
    }

    fn curve(&self, points: &Points, look: Look, color: usize) -> String {
        let line = |points: &Points, class: &str| {
            let path: Vec<String> = points.iter().map(|&p| self.at(p)).map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
            format!("<polyline class=\"{class} c{color}\" points=\"{}\"/>\n", path.join(" "))
        };
        match look {
            Look::Line => line(points, "line"),
            Look::Noisy => {
                let window = (points.len() as f64 * SMOOTH).ceil() as usize | 1;
                line(points, "faint") + &line(&smoothed(points, window), "line")
            }
            Look::Dots => {
                let dots: String = (points.iter())
                    .map(|&p| {
                        let ((x, y), label) = (self.at(p), format!("{:.3} at {}", p.1, axis(p.0)));
                        format!("<circle class=\"c{color}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\"><title>{label}</title></circle>")
                    })
                    .collect();
                line(points, "line") + &dots + "\n"
            }
        }
    }
}

/// Multiples of 1, 2 or 5 times a power of ten within the range, about `wanted` of them.
fn ticks((low, high): (f64, f64), wanted: usize) -> Vec<f64> {
    let rough = (high - low) / wanted as f64;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= rough).unwrap_or(rough);
    let first = (low / step).ceil() as i64;
    // The range may be too small for its distance from 0 to be resolved.
    (0..=2 * wanted as i64).map(|i| (first + i) as f64 * step).take_while(|t| *t <= high + step * 1e-9).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks((0.0, 30_000.0), 6), [0.0, 5000.0, 10_000.0, 15_000.0, 20_000.0, 25_000.0, 30_000.0]);
        assert_eq!(ticks((17.3, 24.1), 5), [18.0, 20.0, 22.0, 24.0]);
        assert_eq!(ticks((-0.1, 0.1), 4).len(), 5);
        assert!(ticks((1e15, 1e15 + 0.2), 5).len() <= 11);
    }

    #[test]
    fn a_chart_draws_what_it_is_given_and_nothing_of_nothing() {
        let (line, none) = (vec![(0.0, 1.0), (100.0, 3.0)], Vec::new());
        let chart = |points, level| Chart {
            title: "A < B",
            over: "step",
            series: vec![Series { name: "one", points, look: Look::Line }],
            marks: (&[50.0, 500.0], "reset"),
            level,
            from_zero: true,
        };
        assert_eq!(chart(&none, Some((2.0, "goal"))).html(), "");
        let nan = vec![(1.0, f64::NAN)];
        assert_eq!(chart(&nan, None).html(), "");
        let html = chart(&line, None).html();
        // The frame is 474 wide and 208 high, the range 0 to 3.12: 1 is at 220 - 208 / 3.12.
        assert!(html.contains("points=\"52.0,153.3 526.0,20.0\""), "{html}");
        assert!(html.contains("A &lt; B") && html.matches("class=\"mark\"").count() == 1, "{html}");
        assert!(!html.contains("level"));
        // A level widens the range: it is now 0 to 4.16, and the line is at 220 - 208 * 4 / 4.16.
        let html = chart(&line, Some((4.0, "goal"))).html();
        assert!(html.contains("class=\"level\" x1=\"52\" x2=\"526\" y1=\"20.0\""), "{html}");
        assert!(!chart(&line, Some((f64::NAN, "goal"))).html().contains("goal"));
    }
}
