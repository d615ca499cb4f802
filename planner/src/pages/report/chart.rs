//! Line charts over time as SVG, with axes, ticks and units; the page's style sheet sets the colours.
//!
//! Each chart is drawn twice, for a wide page and for a narrow one, so that text and curves have the right size on both; the
//! style sheet shows one of them.

use std::fmt::Write;

/// A drawing's size and margins, in pixels of the page for which it is made.
struct Shape {
    /// CSS class.
    class: &'static str,
    width: f64,
    height: f64,
    left: f64,
    /// Approximate number of ticks on the time axis.
    ticks: usize,
}

const RIGHT: f64 = 12.0;
const TOP: f64 = 10.0;
const BOTTOM: f64 = 26.0;
const WIDE: Shape = Shape { class: "on-wide", width: 1000.0, height: 190.0, left: 64.0, ticks: 8 };
const NARROW: Shape = Shape { class: "on-narrow", width: 380.0, height: 170.0, left: 38.0, ticks: 4 };

/// One curve; a gap where there is no value.
pub struct Series<'a> {
    /// Its name in the legend.
    pub name: &'a str,
    /// CSS class that colours it.
    pub class: &'static str,
    /// (time s, value).
    pub points: Vec<(f64, Option<f64>)>,
}

/// A horizontal line to compare with.
pub struct Level<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its value.
    pub value: f64,
}

/// A chart of several series over time. `unit` labels the vertical axis.
pub fn chart(title: &str, unit: &str, series: &[Series], levels: &[Level]) -> String {
    chart_over("time [s]", [title, unit], series, levels)
}

/// The same over something else, which may begin below 0; `over` is its name and unit.
pub fn chart_over(over: &str, [title, unit]: [&str; 2], series: &[Series], levels: &[Level]) -> String {
    format!(
        "<figure><figcaption>{title} <span class=\"unit\">[{unit}] over {over}</span>{}</figcaption>{}{}</figure>",
        legend(unit, series, levels),
        WIDE.draw(title, series, levels),
        NARROW.draw(title, series, levels)
    )
}

impl Shape {
    fn draw(&self, title: &str, series: &[Series], levels: &[Level]) -> String {
        let &Shape { class, width, height, left, .. } = self;
        let values = || series.iter().flat_map(|s| s.points.iter().filter_map(|p| p.1));
        let top = values().chain(levels.iter().map(|l| l.value)).fold(0.0, f64::max);
        let bottom = values().fold(0.0, f64::min);
        let drawn = || series.iter().filter(|s| !s.points.is_empty());
        let start = drawn().map(|s| s.points[0].0).reduce(f64::min).unwrap_or(0.0);
        let end_s = drawn().map(|s| s.points[s.points.len() - 1].0).reduce(f64::max).unwrap_or(0.0);
        let end_s = end_s.max(start + 1e-9);
        let (y_step, _) = ticks((top - bottom).max(1e-9), 4);
        // what is beyond a tick by less than a line's width needs no further one
        let tick = |value: f64| (value / y_step - 1e-3).ceil() * y_step;
        let y_start = -tick(-bottom);
        let y_end = tick(top).max(y_start + y_step);
        let (x_step, _) = ticks(end_s - start, self.ticks);
        let x = |t: f64| left + (t - start) / (end_s - start) * (width - left - RIGHT);
        let y = |v: f64| height - BOTTOM - (v - y_start) / (y_end - y_start) * (height - TOP - BOTTOM);
        let mut svg = format!(
            "<svg class=\"{class}\" viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{title}\">"
        );
        let ticks = ((y_end - y_start) / y_step).round() as i64;
        for v in (0..=ticks).map(|n| y_start + n as f64 * y_step) {
            let at = y(v);
            let _ = write!(
                svg,
                "<line class=\"grid\" x1=\"{left}\" x2=\"{:.1}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>\
                 <text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                width - RIGHT,
                left - 6.0,
                at + 4.0,
                number(v + 0.0, y_step)
            );
        }
        let mut t = (start / x_step).ceil() * x_step;
        while t <= end_s {
            let _ = write!(
                svg,
                "<text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                x(t),
                height - 6.0,
                number(t + 0.0, x_step)
            );
            t += x_step;
        }
        for s in series {
            for line in curves(&s.points, &x, &y) {
                let _ = write!(svg, "<path class=\"{}\" d=\"{line}\"/>", s.class);
            }
        }
        for level in levels {
            let at = y(level.value);
            let _ = write!(
                svg,
                "<line class=\"level\" x1=\"{left}\" x2=\"{:.1}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>",
                width - RIGHT
            );
        }
        svg + "</svg>"
    }
}

/// The legend, where there is more than one curve or line.
fn legend(unit: &str, series: &[Series], levels: &[Level]) -> String {
    if series.len() + levels.len() < 2 {
        return String::new();
    }
    let curve = |s: &Series| format!(" <span class=\"key {}\">{}</span>", s.class, s.name);
    let level =
        |l: &Level| format!(" <span class=\"key line-b\">{} ({} {unit}, dashed)</span>", l.name, l.value);
    series.iter().map(curve).chain(levels.iter().map(level)).collect()
}

/// The curve as polylines with at most two points per pixel: the least and the largest value in it. Gaps split the curve.
fn curves(points: &[(f64, Option<f64>)], x: &impl Fn(f64) -> f64, y: &impl Fn(f64) -> f64) -> Vec<String> {
    let mut curves = Vec::new();
    let mut line = String::new();
    let mut pixel: Option<(i64, f64, f64)> = None;
    let flush = |line: &mut String, pixel: &mut Option<(i64, f64, f64)>| {
        if let Some((column, low, high)) = pixel.take() {
            let begin = if line.is_empty() { 'M' } else { 'L' };
            let at = column as f64;
            let _ = write!(line, "{begin}{at} {:.1}", y(low));
            if high > low {
                let _ = write!(line, "L{at} {:.1}", y(high));
            }
        }
    };
    for (t, value) in points {
        let Some(v) = value else {
            flush(&mut line, &mut pixel);
            if !line.is_empty() {
                curves.push(std::mem::take(&mut line));
            }
            continue;
        };
        let column = x(*t).round() as i64;
        match &mut pixel {
            Some((c, low, high)) if *c == column => (*low, *high) = (low.min(*v), high.max(*v)),
            _ => {
                flush(&mut line, &mut pixel);
                pixel = Some((column, *v, *v));
            }
        }
    }
    flush(&mut line, &mut pixel);
    if !line.is_empty() {
        curves.push(line);
    }
    curves
}

/// A round step that gives about `count` ticks up to `end`, and the last tick's value.
fn ticks(end: f64, count: usize) -> (f64, f64) {
    let raw = end / count as f64;
    let power = 10f64.powf(raw.log10().floor());
    let step =
        [1.0, 2.0, 2.5, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= raw * 0.999).unwrap_or(raw);
    (step, (end / step - 1e-9).ceil() * step)
}

/// A tick's label, with as many decimals as its step needs.
fn number(value: f64, step: f64) -> String {
    let decimals =
        (0..6).find(|d| (step * 10f64.powi(*d) - (step * 10f64.powi(*d)).round()).abs() < 1e-6).unwrap_or(6);
    format!("{value:.*}", decimals as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_cover_the_range() {
        for end in [0.03, 0.7, 1.0, 3.9, 42.0, 2600.0] {
            let (step, last) = ticks(end, 4);
            assert!(last >= end * 0.999 && last / step <= 5.01, "{end}: {step} {last}");
        }
        assert_eq!(number(0.75, 0.25), "0.75");
        assert_eq!(number(400.0, 200.0), "400");
    }

    #[test]
    fn many_points_become_a_short_curve_that_keeps_the_peak() {
        let points =
            (0..100_000).map(|n| (f64::from(n), Some(if n == 77_777 { 9.0 } else { 1.0 }))).collect();
        let svg = chart("Force", "N", &[Series { name: "F", class: "a", points }], &[]);
        assert!(svg.len() < 40_000);
        let top = svg.split("<path").nth(1).unwrap();
        assert!(
            top.contains(&format!("{:.1}", WIDE.height - BOTTOM - 9.0 / 10.0 * (WIDE.height - TOP - BOTTOM)))
        );
    }

    #[test]
    fn gaps_split_the_curve_and_an_empty_chart_is_a_chart() {
        let points = vec![(0.0, Some(1.0)), (1.0, None), (2.0, Some(2.0))];
        let svg = WIDE.draw("x", &[Series { name: "x", class: "a", points }], &[]);
        assert_eq!(svg.matches("<path").count(), 2);
        assert!(chart("x", "mm", &[], &[]).contains("</svg>"));
    }

    #[test]
    fn a_level_is_named_with_its_unit() {
        let points = vec![(0.0, Some(1.0))];
        let page = chart(
            "x",
            "mm",
            &[Series { name: "distance", class: "a", points }],
            &[Level { name: "least", value: 0.5 }],
        );
        assert!(page.contains(">distance<") && page.contains(">least (0.5 mm, dashed)<"), "{page}");
        assert_eq!(page.matches("class=\"level\"").count(), 2);
    }
}
