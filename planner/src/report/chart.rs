//! Line charts over time as SVG: axes, ticks, units; themed by the page's style sheet.

use std::fmt::Write;

const WIDTH: f64 = 1000.0;
const HEIGHT: f64 = 190.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 12.0;
const TOP: f64 = 10.0;
const BOTTOM: f64 = 26.0;

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
    /// Where.
    pub value: f64,
}

/// A chart of several series over time. `unit` labels the vertical axis.
pub fn chart(title: &str, unit: &str, series: &[Series], levels: &[Level]) -> String {
    let values = || series.iter().flat_map(|s| s.points.iter().filter_map(|p| p.1));
    let top = values().chain(levels.iter().map(|l| l.value)).fold(0.0, f64::max);
    let end_s = series.iter().flat_map(|s| s.points.last().map(|p| p.0)).fold(0.0, f64::max).max(1e-9);
    let (y_step, y_end) = ticks(top.max(1e-9), 4);
    let (x_step, _) = ticks(end_s, 8);
    let x = |t: f64| LEFT + t / end_s * (WIDTH - LEFT - RIGHT);
    let y = |v: f64| HEIGHT - BOTTOM - v / y_end * (HEIGHT - TOP - BOTTOM);
    let mut svg = format!(
        "<figure><figcaption>{title} <span class=\"unit\">[{unit}] over time [s]</span>{}</figcaption>\
         <svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{title}\">",
        legend(series)
    );
    let mut v = 0.0;
    while v <= y_end * 1.0001 {
        let at = y(v);
        let _ = write!(
            svg,
            "<line class=\"grid\" x1=\"{LEFT}\" x2=\"{:.1}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>\
             <text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            WIDTH - RIGHT,
            LEFT - 6.0,
            at + 4.0,
            number(v, y_step)
        );
        v += y_step;
    }
    let (mut t, mut n) = (0.0, 0);
    while t <= end_s {
        // a narrow page shows every second one
        let class = if n % 2 == 1 { "tick minor" } else { "tick" };
        let _ = write!(
            svg,
            "<text class=\"{class}\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            x(t),
            HEIGHT - 6.0,
            number(t, x_step)
        );
        t += x_step;
        n += 1;
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
            "<line class=\"level\" x1=\"{LEFT}\" x2=\"{:.1}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>\
             <text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            WIDTH - RIGHT,
            LEFT + 4.0,
            at - 4.0,
            level.name
        );
    }
    svg.push_str("</svg></figure>");
    svg
}

fn legend(series: &[Series]) -> String {
    if series.len() < 2 {
        return String::new();
    }
    let item = |s: &Series| format!(" <span class=\"key {}\">{}</span>", s.class, s.name);
    series.iter().map(item).collect()
}

/// At most two points a pixel: the least and the largest value that falls into it. Gaps split the curve.
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
        assert!(top.contains(&format!("{:.1}", HEIGHT - BOTTOM - 9.0 / 10.0 * (HEIGHT - TOP - BOTTOM))));
    }

    #[test]
    fn gaps_split_the_curve_and_an_empty_chart_is_a_chart() {
        let points = vec![(0.0, Some(1.0)), (1.0, None), (2.0, Some(2.0))];
        let svg = chart("x", "mm", &[Series { name: "x", class: "a", points }], &[]);
        assert_eq!(svg.matches("<path").count(), 2);
        assert!(chart("x", "mm", &[], &[]).contains("</svg>"));
    }
}
