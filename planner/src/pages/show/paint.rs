//! The values by which the path can be coloured, and the legend.

use bonemill_planfile::{StoredPlan, Waypoint};

use super::{Show, scale_colour};

/// Length of the force's arrow, mm per N.
pub const ARROW_MM_PER_N: f64 = 10.0;

/// A value along the path.
#[derive(Debug, Clone, Copy)]
pub struct Paint {
    /// Its name.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// The value of a waypoint, if it has one.
    pub value: fn(&Waypoint) -> Option<f64>,
}

/// Every value that the path can be coloured by; the first is shown first.
pub const PAINTS: [Paint; 4] = [
    Paint { name: "force toward structures", unit: "N", value: |w| w.force_toward_n },
    Paint { name: "speed", unit: "mm/s", value: |w| Some(w.speed_mm_s) },
    Paint { name: "mass ahead", unit: "mg", value: |w| Some(w.mass_mg).filter(|m| *m > 0.0) },
    Paint { name: "deflection toward structures", unit: "µm", value: |w| w.deflection_toward_um },
];

impl Paint {
    /// The name as part of an entity's path.
    pub fn entity(&self) -> String {
        self.name.replace(' ', "_")
    }

    /// The least value and the 99 % quantile; `None` where no waypoint has a value.
    pub fn range(&self, plan: &StoredPlan) -> Option<(f64, f64)> {
        let mut values: Vec<f64> = plan.waypoints.iter().filter_map(self.value).collect();
        values.sort_by(f64::total_cmp);
        Some((*values.first()?, *values.get((values.len() - 1) * 99 / 100)?))
    }

    /// The colour of every waypoint.
    pub fn colours(&self, plan: &StoredPlan) -> Vec<[u8; 3]> {
        let (low, high) = self.range(plan).unwrap_or((0.0, 1.0));
        let share = |w: &Waypoint| (self.value)(w).map(|v| (v - low) / (high - low).max(1e-12));
        plan.waypoints.iter().map(|w| scale_colour(share(w))).collect()
    }
}

impl Show<'_> {
    /// The legend, Markdown.
    pub fn about(&self) -> String {
        let plan = self.plan();
        let m = &plan.record.metrics;
        let mut text = format!(
            "# Milling plan\n\nRemoved {:.0} of {:.0} mm³ that the tool can reach, in {:.0} s. bonemill {}; research \
             software, not a medical device.\n\n**3-D** (z is the approach, out of the bone; mm): sand: what is still there \
             of the target; structures with the surface at their clearance around them; tool and arm; red: force on \
             the tool, {ARROW_MM_PER_N} mm per N.\n\n**Path**, dark violet to yellow, grey where there is no value:\n\n\
             | tab | from | to (99 % of it) |\n|---|---|---|\n",
            m.removed_mm3, m.reachable_mm3, m.total_time_s, plan.record.version
        );
        for paint in PAINTS {
            let row = match paint.range(plan) {
                Some((low, high)) => format!("{low:.3} {unit} | {high:.3} {unit}", unit = paint.unit),
                None => "not modelled | ".into(),
            };
            text += &format!("| {} | {row} |\n", paint.name);
        }
        if let Some(spec) = plan.record.case.job.channel() {
            text += &format!(
                "\n**Corridor** (transparent): what the tool passes, widened by the registration's error that is exceeded with a \
                 probability of {}.\n",
                spec.touch_probability
            );
        }
        if self.images().is_some() {
            text += "\n**Slices** go through the tool (white outline): CT, target lime, cut black, structures in their colours.\n";
        } else {
            text += "\n**Without images**: target, structures and slices are not drawn.\n";
        }
        let missing = plan.inputs.missing().iter();
        text.extend(
            missing.map(|input| format!("\n- not found: {input}; its folder can be named with --inputs DIR")),
        );
        for problem in plan.record.shortfalls.iter().chain(&plan.record.warnings) {
            text += &format!("\n- {problem}");
        }
        text
    }
}
