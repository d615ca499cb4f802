//! Curves in panels, as SVG: forces on a logarithmic axis; a ring marks the default of each curve.

use std::fmt::Write;

/// One plan of a curve.
pub struct PlotPoint {
    pub x: f64,
    pub y: f64,
    pub is_default: bool,
}

/// Curves on one pair of axes; y is logarithmic.
pub struct Panel {
    pub x: &'static str,
    pub y: &'static str,
    pub is_log_x: bool,
    /// Name and points, in the order of x.
    pub series: Vec<(String, Vec<PlotPoint>)>,
}

const WIDTH: f64 = 460.0;
const HEIGHT: f64 = 320.0;
/// Margins left, right, above and below the axes.
const MARGIN: [f64; 4] = [64.0, 16.0, 34.0, 48.0];
/// Colours of curves, distinct in hue and in lightness.
const COLOURS: [&str; 4] = ["#0b5fa5", "#d1731f", "#3c8d4f", "#8a4fa0"];
/// The ring that marks a default.
const RING: &str = "r=\"7\" fill=\"none\" stroke=\"#222\"";
/// Smaller forces are drawn at this value, N.
const LEAST: f64 = 1e-4;

/// All panels, two in a row.
pub fn svg(panels: &[Panel]) -> String {
    let rows = panels.len().div_ceil(2) as f64;
    let (width, height) = (2.0 * WIDTH, rows * HEIGHT + 30.0);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
         font-family=\"sans-serif\" font-size=\"12\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>"
    );
    for (n, panel) in panels.iter().enumerate() {
        let (x, y) = ((n % 2) as f64 * WIDTH, (n / 2) as f64 * HEIGHT);
        let _ = write!(out, "<g transform=\"translate({x},{y})\">{}</g>", draw(panel));
    }
    let mut legend = |n: usize, mark: &str, name: &str| {
        let (x, y) = (MARGIN[0] + 150.0 * n as f64, rows * HEIGHT + 14.0);
        let text = format!("<text x=\"{}\" y=\"{}\">{name}</text>", x + 12.0, y + 4.0);
        let _ = write!(out, "<circle cx=\"{x}\" cy=\"{y}\" {mark}/>{text}");
    };
    let names = panels.first().map_or(&[][..], |p| &p.series);
    for (n, ((name, _), colour)) in names.iter().zip(COLOURS).enumerate() {
        legend(n, &format!("r=\"4\" fill=\"{colour}\""), name);
    }
    legend(names.len(), RING, "default");
    out + "</svg>"
}

/// Maps data to a position on an axis.
struct Axis {
    low: f64,
    high: f64,
    is_log: bool,
}

impl Axis {
    fn over(values: impl Iterator<Item = f64> + Clone, is_log: bool) -> Self {
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if is_log {
            return Self { low: low.max(LEAST) / 1.3, high: high.max(2.0 * LEAST) * 1.3, is_log };
        }
        let pad = (0.08 * (high - low)).max(0.5);
        Self { low: low - pad, high: high + pad, is_log }
    }

    /// Position on the axis, 0 to 1.
    fn share(&self, value: f64) -> f64 {
        if self.is_log {
            (value.max(LEAST) / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        }
    }

    fn ticks(&self) -> Vec<f64> {
        if self.is_log {
            let decades = (self.low.log10().floor() as i32)..=(self.high.log10().ceil() as i32);
            let all = decades.flat_map(|d| [1.0, 2.0, 5.0].map(|m| m * 10f64.powi(d)));
            let ticks: Vec<f64> = all.filter(|t| (self.low..=self.high).contains(t)).collect();
            let decades_only = ticks.len() > 9;
            let is_decade = |t: &f64| (t.log10() - t.log10().round()).abs() < 1e-9;
            return ticks.into_iter().filter(|t| !decades_only || is_decade(t)).collect();
        }
        let rough = (self.high - self.low) / 5.0;
        let power = 10f64.powf(rough.log10().floor());
        let step =
            [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= rough).unwrap_or(rough);
        let first = (self.low / step).ceil() as i64;
        (first..=(self.high / step).floor() as i64).map(|n| n as f64 * step).collect()
    }
}

fn draw(panel: &Panel) -> String {
    let points = || panel.series.iter().flat_map(|(_, points)| points);
    let x_axis = Axis::over(points().map(|p| p.x), panel.is_log_x);
    let y_axis = Axis::over(points().map(|p| p.y), true);
    let [left, right, top, bottom] = MARGIN;
    let x = |v: f64| left + (WIDTH - left - right) * x_axis.share(v);
    let y = |v: f64| HEIGHT - bottom - (HEIGHT - top - bottom) * y_axis.share(v);
    let mut out = String::new();
    for tick in x_axis.ticks() {
        let _ = write!(
            out,
            "<line x1=\"{0:.1}\" x2=\"{0:.1}\" y1=\"{top}\" y2=\"{1}\" stroke=\"#e4e4e4\"/><text x=\"{0:.1}\" y=\"{2}\" text-anchor=\"middle\">{tick}</text>",
            x(tick),
            HEIGHT - bottom,
            HEIGHT - bottom + 16.0,
        );
    }
    for tick in y_axis.ticks() {
        let _ = write!(
            out,
            "<line x1=\"{left}\" x2=\"{1}\" y1=\"{0:.1}\" y2=\"{0:.1}\" stroke=\"#e4e4e4\"/><text x=\"{2}\" y=\"{3:.1}\" text-anchor=\"end\">{tick}</text>",
            y(tick),
            WIDTH - right,
            left - 6.0,
            y(tick) + 4.0,
        );
    }
    for ((_, points), colour) in panel.series.iter().zip(COLOURS) {
        let line: Vec<String> = points.iter().map(|p| format!("{:.1},{:.1}", x(p.x), y(p.y))).collect();
        let _ = write!(
            out,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\"/>",
            line.join(" ")
        );
        for p in points {
            let (cx, cy) = (x(p.x), y(p.y));
            let _ = write!(out, "<circle cx=\"{cx:.1}\" cy=\"{cy:.1}\" r=\"3.5\" fill=\"{colour}\"/>");
            if p.is_default {
                let _ = write!(out, "<circle cx=\"{cx:.1}\" cy=\"{cy:.1}\" {RING}/>");
            }
        }
    }
    let middle = left + 0.5 * (WIDTH - left - right);
    let _ = write!(
        out,
        "<text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">{}</text><text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\" font-weight=\"bold\">{}</text>",
        HEIGHT - 12.0,
        panel.x,
        top - 12.0,
        panel.y
    );
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_lie_on_their_axis() {
        for (low, high, is_log) in
            [(0.001, 4.0, true), (91.3, 99.8, false), (3.0, 3.0, false), (0.0, 0.0, true)]
        {
            let axis = Axis::over([low, high].into_iter(), is_log);
            let ticks = axis.ticks();
            assert!(ticks.len() >= 2, "{low} to {high}: {ticks:?}");
            assert!(ticks.iter().all(|t| (-1e-9..=1.0 + 1e-9).contains(&axis.share(*t))));
        }
    }

    #[test]
    fn every_curve_has_one_ring_in_every_panel() {
        let curve = |name: &str| {
            let points = [(1.0, 0.2), (2.0, 0.1), (4.0, 0.0)];
            let point = |(n, (x, y)): (usize, (f64, f64))| PlotPoint { x, y, is_default: n == 1 };
            (name.to_owned(), points.into_iter().enumerate().map(point).collect())
        };
        let panel =
            || Panel { x: "t [min]", y: "F [N]", is_log_x: true, series: vec![curve("a"), curve("b")] };
        let text = svg(&[panel(), panel()]);
        // two curves in two panels, and one in the legend
        assert_eq!(text.matches("stroke=\"#222\"").count(), 5);
        assert!(!text.contains("NaN") && !text.contains("inf"));
    }
}
