//! Curves over the plan's time, and axes that leave room for a legend.
//!
//! A viewer draws the legend over the plot's upper right corner. Where a plot has several curves, its axes extend beyond them,
//! upwards or to the right, whichever takes less space, so that the legend covers no curve. A single curve is named by the
//! plot's title.

use bonemill_arm::{Joint, JointKind};
use bonemill_planfile::Waypoint;

use super::{Moment, STRUCTURE_COLOURS, Show};

/// Width of all plots side by side and height of one, pixels, in a window of 1600 × 1000.
const PLOTS_PX: [f64; 2] = [1600.0, 200.0];
/// Width of a plot's ticks and frame, pixels.
const FRAME_PX: f64 = 30.0;
/// Height of a line of the legend, and the margin above and below all lines, pixels.
const LINE_PX: [f64; 2] = [22.5, 10.0];
/// Width of a letter of the legend, and the margin beside all letters, pixels.
const LETTER_PX: [f64; 2] = [6.0, 50.0];
/// Margin between the curves and the axes' ends, as a share of the curves' range.
const PAD: f64 = 0.04;

/// Largest share of a plot for the legend.
const MOST_ROOM: f64 = 0.6;

const BLUE: [u8; 3] = [86, 156, 214];
const ORANGE: [u8; 3] = [232, 140, 50];
const RED: [u8; 3] = [230, 80, 80];

/// A function that gives a waypoint's value, if it has one.
type Value<'a> = &'a dyn Fn(&Waypoint) -> Option<f64>;

/// A curve over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Part of its entity's path.
    pub entity: String,
    /// Its name.
    pub name: String,
    /// Its colour.
    pub colour: [u8; 3],
    /// Times, s.
    pub time_s: Vec<f64>,
    /// The values, one per time.
    pub values: Vec<f64>,
}

/// Curves with a common unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Plot {
    /// Part of its entity's path.
    pub entity: &'static str,
    /// Title, with the unit.
    pub title: String,
    /// Curves, none of them empty.
    pub curves: Vec<Curve>,
    /// Ends of the time axis, s.
    pub time_s: [f64; 2],
    /// Ends of the value axis.
    pub values: [f64; 2],
}

impl Plot {
    /// Whether the plot needs a legend.
    pub fn legend(&self) -> bool {
        self.curves.len() > 1
    }
}

impl Show<'_> {
    /// The plots, from left to right: force, distance, speed, joints; plots without curves are left out.
    pub fn plots(&self, moments: &[Moment]) -> Vec<Plot> {
        let mut found: Vec<_> =
            self.sets(moments).into_iter().filter(|(.., curves)| !curves.is_empty()).collect();
        for (_, title, curves) in &mut found {
            if let [only] = &curves[..]
                && title.starts_with("joints")
            {
                *title = title.replacen("joints", &only.name, 1);
            }
        }
        let width_px = PLOTS_PX[0] / found.len() as f64 - FRAME_PX;
        let end_s = self.plan.trajectory.time_s.last().copied().unwrap_or(0.0);
        let plot = |(entity, title, curves): (_, _, Vec<Curve>)| {
            let [above, beside] = room(&curves, width_px);
            let values = curves.iter().flat_map(|c| c.values.iter().copied());
            Plot {
                entity,
                title,
                time_s: axis([0.0, end_s].into_iter(), beside),
                values: axis(values, above),
                curves,
            }
        };
        found.into_iter().map(plot).collect()
    }

    /// Entity, title and curves of every plot.
    fn sets(&self, moments: &[Moment]) -> [(&'static str, String, Vec<Curve>); 5] {
        let case = &self.plan.record.case;
        let structures = &case.structures;
        let radius_mm = self.plan.record.cutter_radius_mm();
        let force = |w: &Waypoint| Some(w.force_n.norm());
        let toward = |w: &Waypoint| (!structures.is_empty()).then(|| w.force_toward_n.unwrap_or(0.0));
        let distance = |w: &Waypoint| w.distance_mm.map(|d| d - radius_mm);
        let clearance = |w: &Waypoint| Some(structures.get(w.structure?)?.clearance_mm);
        [
            (
                "force",
                "force [N]".into(),
                self.along([
                    ("magnitude", "magnitude", BLUE, &force),
                    ("toward", "toward the nearest structure", ORANGE, &toward),
                ]),
            ),
            (
                "distance",
                "distance [mm]".into(),
                self.along([
                    ("surface", "tool's surface to structure", BLUE, &distance),
                    ("clearance", "clearance kept from it", RED, &clearance),
                ]),
            ),
            ("speed", "speed [mm/s]".into(), self.along([("cap", "speed", BLUE, &|w| Some(w.speed_mm_s))])),
            ("joints_linear", "joints [mm]".into(), self.joints(moments, JointKind::Prismatic)),
            ("joints_turning", "joints [rad]".into(), self.joints(moments, JointKind::Revolute)),
        ]
    }

    /// Curves of the waypoints' values; curves without values are left out.
    fn along<const N: usize>(&self, asked: [(&str, &str, [u8; 3], Value<'_>); N]) -> Vec<Curve> {
        let curve = |(entity, name, colour, value): (&str, &str, [u8; 3], Value<'_>)| {
            let there = self.plan.waypoints.iter().filter_map(|w| Some((w.time_s, value(w)?)));
            let (time_s, values) = there.unzip();
            Curve { entity: entity.into(), name: name.into(), colour, time_s, values }
        };
        asked.into_iter().map(curve).filter(|c| !c.values.is_empty()).collect()
    }

    /// Curves of the joints of one kind.
    fn joints(&self, moments: &[Moment], kind: JointKind) -> Vec<Curve> {
        let joints = self.plan.arm.joints().iter().enumerate().filter(|(_, j)| j.kind == kind);
        let curve = |(n, joint): (usize, &Joint)| {
            let (time_s, values) = moments.iter().filter_map(|m| Some((m.time_s, *m.q.get(n)?))).unzip();
            let colour = STRUCTURE_COLOURS[n % STRUCTURE_COLOURS.len()];
            Curve { entity: format!("q{}", n + 1), name: joint.name.clone(), colour, time_s, values }
        };
        joints.map(curve).filter(|c| !c.values.is_empty()).collect()
    }
}

/// Shares of a plot's height and width that the legend needs; the larger one is set to 0.
fn room(curves: &[Curve], width_px: f64) -> [f64; 2] {
    if curves.len() < 2 {
        return [0.0; 2];
    }
    let longest = curves.iter().map(|c| c.name.chars().count()).max().unwrap_or(0);
    let above = (LINE_PX[0] * curves.len() as f64 + LINE_PX[1]) / PLOTS_PX[1];
    let beside = (LETTER_PX[0] * longest as f64 + LETTER_PX[1]) / width_px;
    if above <= beside { [above.min(MOST_ROOM), 0.0] } else { [0.0, beside.min(MOST_ROOM)] }
}

/// The ends of an axis of which the upper share `room` stays free.
fn axis(values: impl Iterator<Item = f64>, room: f64) -> [f64; 2] {
    let (low, high) =
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    // a constant is drawn in the middle of a tenth of itself
    let (low, high) = if high > low {
        (low, high)
    } else {
        (low - 0.05 * low.abs().max(1e-3), high + 0.05 * high.abs().max(1e-3))
    };
    let span = high - low;
    let low = low - PAD * span;
    [low, low + (1.0 + 2.0 * PAD) * span / (1.0 - room)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(name: &str) -> Curve {
        Curve { entity: name.into(), name: name.into(), colour: BLUE, time_s: vec![0.0], values: vec![1.0] }
    }

    #[test]
    fn names_get_room_where_it_costs_less() {
        let long = ["toward the nearest structure", "magnitude"].map(curve);
        let [above, beside] = room(&long, 290.0);
        assert!(above > 0.2 && above < 0.3 && beside == 0.0, "{above}");
        let many: Vec<_> = (1..=7).map(|n| curve(&format!("joint {n}"))).collect();
        let [above, beside] = room(&many, 290.0);
        assert!(beside > 0.25 && beside < 0.4 && above == 0.0, "{beside}");
        assert_eq!(room(&long[..1], 290.0), [0.0; 2]);
    }

    #[test]
    fn an_axis_holds_every_value_below_its_room() {
        let [low, high] = axis([3.0, -1.0, 2.0].into_iter(), 0.25);
        assert!(low < -1.0 && (high - 3.0) / (high - low) > 0.25, "{low} {high}");
        for constant in [0.0, 10.0, -2.0] {
            let [low, high] = axis([constant].into_iter(), 0.0);
            assert!(low < constant && constant < high, "{low} {high}");
        }
    }
}
