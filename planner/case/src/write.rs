//! The resolved case as TOML, every default spelled out: what a plan stores, and what reads back as an equal case.

use std::fmt::Write;

use nalgebra::Vector3;

use super::keys as k;
use super::{Case, Job, LabelRef, Registration, Target, TargetRegion, write_channel};

impl Case {
    /// The case as a case file with every key.
    ///
    /// A parsed case reads back equal, bit for bit; angles are written so that their conversion to rad gives the
    /// same number.
    pub fn to_toml(&self) -> String {
        self.to_toml_under("")
    }

    /// The same, with every table below `prefix` (e.g. `case`) of a larger file; empty for none.
    pub fn to_toml_under(&self, prefix: &str) -> String {
        let mut out = Text { out: String::new(), prefix: prefix.into() };
        if !prefix.is_empty() {
            out.line(format!("[{prefix}]"));
        }
        out.lines(&[("preset", text(k::PRESET.word(self.paper)))]);
        if self.structures.is_empty() {
            // a bare key must stand before the tables
            out.lines(&[("structure", "[]".into())]);
        }
        self.write_scene(&mut out);
        self.write_tool(&mut out);
        self.write_planning(&mut out);
        self.write_robot(&mut out);
        out.table("registration", &[("max_fre_mm", float(self.registration.max_fre_mm))]);
        out.table(
            "grid",
            &[("spacing_mm", float(self.grid.spacing_mm)), ("margin_mm", float(self.grid.margin_mm))],
        );
        let accuracy = &self.accuracy;
        let mut entries = vec![
            ("level", text(k::LEVEL.word(accuracy.level))),
            ("force_elements", accuracy.force_elements.to_string()),
            ("force_directions", accuracy.force_directions.to_string()),
            ("force_change", float(accuracy.force_change)),
            ("axis_spacing_deg", float(degrees(accuracy.axis_spacing_rad))),
        ];
        let asked = &accuracy.asked;
        let errors = [("force", asked.force), ("removed", asked.removed), ("distance_mm", asked.distance_mm)];
        entries.extend(errors.into_iter().filter_map(|(key, error)| Some((key, float(error?)))));
        out.table("accuracy", &entries);
        out.out
    }

    fn write_scene(&self, out: &mut Text) {
        let mut images = vec![
            ("ct", text(&self.images.ct.to_string_lossy())),
            ("labels", text(&self.images.labels.to_string_lossy())),
            ("ct_affine", text(k::CT_AFFINE.word(self.images.ct_affine))),
            ("labels_affine", text(k::LABELS_AFFINE.word(self.images.labels_affine))),
        ];
        images.extend(self.images.ct_series.as_deref().map(|uid| ("ct_series", text(uid))));
        out.table("images", &images);
        out.table(
            "density",
            &[
                ("hu", list(self.density.table.hu())),
                ("g_cm3", list(self.density.table.g_cm3())),
                ("air_hu", float(self.density.air_hu)),
                ("bone_hu", float(self.density.bone_hu)),
            ],
        );
        let rules = [("least_share", float(self.least_share)), ("sheets", text(k::SHEETS.word(self.sheets)))];
        let target = target(&self.target);
        if !target.is_empty() {
            let regions = [("also", &self.also), ("less", &self.less)];
            let regions =
                regions.iter().filter(|(_, of)| !of.is_empty()).map(|(key, of)| (*key, list_of(of)));
            out.table("target", &[&target[..], &regions.collect::<Vec<_>>(), &rules[..]].concat());
        }
        for s in &self.structures {
            let numbers = [
                ("clearance_mm", float(s.clearance_mm)),
                ("priority", s.priority.to_string()),
                ("shank_clearance_mm", float(s.shank_clearance_mm)),
            ];
            let lines = [&[("name", text(&s.name))][..], &label_lines(&s.label), &numbers[..]].concat();
            out.array_table("structure", &lines);
        }
        for obstacle in &self.obstacles {
            out.array_table("obstacle", &obstacle.lines());
        }
        for hold in &self.holds {
            let lines = [("structure", text(&hold.structure)), ("distance_mm", float(hold.distance_mm))];
            out.array_table("hold", &lines);
        }
        if let Some(direction) = &self.approach {
            out.table("approach", &[("direction", vector(direction))]);
        }
    }

    fn write_tool(&self, out: &mut Text) {
        let segments: Vec<_> = self.shank.iter().map(|s| list(&[s.length_mm, s.radius_mm])).collect();
        let [k_t, k_r, k_a] = self.material.k_n_mm2;
        let [k_te, k_re, k_ae] = self.material.k_edge_n_mm;
        out.table("tool", &[("kind", text(self.tool.word()))]);
        if let Some((table, lines)) = self.tool.lines() {
            out.table(table, &lines);
        }
        out.table(
            "burr",
            &[
                ("radius_mm", float(self.burr.radius_mm)),
                ("flutes", self.burr.flutes.to_string()),
                ("spindle_rpm", float(self.burr.spindle_rpm)),
                ("spin", self.burr.spin.to_string()),
                ("turns", text(k::TURNS.word(self.burr.turns_both_ways))),
                ("neck_radius_mm", float(self.burr.neck_radius_mm)),
            ],
        );
        out.table("shank", &[("segments", format!("[{}]", segments.join(", ")))]);
        out.table(
            "material",
            &[
                ("k_t", float(k_t)),
                ("k_r", float(k_r)),
                ("k_a", float(k_a)),
                ("k_te", float(k_te)),
                ("k_re", float(k_re)),
                ("k_ae", float(k_ae)),
                ("rho_ref_g_cm3", float(self.material.rho_ref_g_cm3)),
                ("exponent", float(self.material.exponent)),
                ("measure", text(k::MEASURE.word(self.material.measure))),
                ("t0_mm", float(self.material.t0_mm)),
                ("edge_model", text(k::tool::EDGE_MODEL.word(self.edge_material.model))),
                ("k_normal", list(&self.edge_material.k_normal)),
                ("k_friction", list(&self.edge_material.k_friction)),
            ],
        );
    }

    fn write_planning(&self, out: &mut Text) {
        if let Job::Channel(channel) = &self.job {
            out.table("path", &write_channel::lines(channel));
            out.table("speed", &[("link_mm_s", float(self.speed.link_mm_s))]);
            return;
        }
        let mut path = vec![
            ("pattern", text(k::PATTERN.word(super::Pattern::Lawnmower))),
            ("layer_mm", float(self.path.layer_mm)),
            ("stepover_mm", float(self.path.stepover_mm)),
            ("step_mm", float(self.path.step_mm)),
            ("sense", text(k::SENSE.word(self.path.sense))),
        ];
        path.extend(self.path.raster_rad.map(|rad| ("raster_deg", float(degrees(rad)))));
        out.table("path", &path);
        out.table(
            "cost",
            &[
                ("kappa_per_mm", float(self.cost.kappa_per_mm)),
                ("alpha_max", float(self.cost.alpha_max)),
                ("force", text(k::COST_FORCE.word(self.cost.force))),
                ("objective", text(k::OBJECTIVE.word(self.cost.objective))),
                ("structures", text(k::COST_STRUCTURES.word(self.cost.structures))),
            ],
        );
        out.table(
            "orientation",
            &[
                ("mode", text(k::ORIENTATION.word(self.orientation.mode))),
                ("angles", self.orientation.angles.to_string()),
                ("tilt_limit_deg", float(degrees(self.orientation.tilt_limit_rad))),
            ],
        );
        let mut speed = vec![
            ("mode", text(k::SPEED_MODE.word(self.speed.mode))),
            ("min_mm_s", float(self.speed.min_mm_s)),
            ("max_mm_s", float(self.speed.max_mm_s)),
            ("nominal_mm_s", float(self.speed.nominal_mm_s)),
            ("link_mm_s", float(self.speed.link_mm_s)),
        ];
        speed.extend(self.speed.total_time_s.map(|s| ("total_time_s", float(s))));
        speed.push(("force_room", float(self.speed.force_room)));
        let caps = &self.speed.caps;
        let numbers =
            [("force_n", caps.force_n), ("deflection_um", caps.deflection_um), ("power_w", caps.power_w)];
        speed.extend(numbers.into_iter().filter_map(|(key, cap)| Some((key, float(cap?)))));
        if let Some(curve) = &caps.force_toward_n {
            let points: Vec<_> = curve.points().iter().map(|p| list(p)).collect();
            speed.push(("force_toward_n", format!("[{}]", points.join(", "))));
        }
        speed.push(("acceleration_mm_s2", float(caps.acceleration_mm_s2)));
        out.table("speed", &speed);
    }

    fn write_robot(&self, out: &mut Text) {
        let robot = &self.robot;
        let mut lines = vec![("model", text(&robot.model))];
        lines.extend(robot.calibration.as_ref().map(|path| ("calibration", text(&path.to_string_lossy()))));
        lines.extend(robot.branch.map(|branches| ("branch", text(&branches.to_string()))));
        let joints = [
            ("joint_stiffness", &robot.joint_stiffness),
            ("velocity_limits", &robot.velocity_limits),
            ("acceleration_limits", &robot.acceleration_limits),
            ("jerk_limits", &robot.jerk_limits),
        ];
        lines.extend(joints.into_iter().filter_map(|(key, v)| Some((key, list(v.as_ref()?)))));
        lines.extend(robot.room.lines());
        lines.push(("rate_hz", float(robot.rate_hz)));
        if let Registration::Given { rotation, translation_mm } = &robot.base_from_ct {
            lines.push(("base_from_ct", rigid(rotation.matrix(), translation_mm)));
        }
        if let Registration::Fiducials { ct_mm, base_mm } = &robot.base_from_ct {
            let rows = |points: &[[f64; 3]]| points.iter().map(|p| list(p)).collect::<Vec<_>>().join(", ");
            let fiducials =
                format!("{{ fiducials = {{ ct_mm = [{}], base_mm = [{}] }} }}", rows(ct_mm), rows(base_mm));
            lines.push(("base_from_ct", fiducials));
        }
        if let Some((translation_mm, rpy_rad)) = &robot.flange_from_burr {
            let mount =
                format!("{{ translation_mm = {}, rpy_rad = {} }}", list(translation_mm), list(rpy_rad));
            lines.push(("flange_from_burr", mount));
        }
        out.table("robot", &lines);
    }
}

/// `{ rotation = [[..], [..], [..]], translation_mm = [..] }`.
pub fn rigid(rotation: &nalgebra::Matrix3<f64>, translation_mm: &Vector3<f64>) -> String {
    let rows: Vec<_> = rotation.row_iter().map(|r| list(&[r[0], r[1], r[2]])).collect();
    format!("{{ rotation = [{}], translation_mm = {} }}", rows.join(", "), vector(translation_mm))
}

/// The shortest decimal that reads back as the same number.
pub fn float(v: f64) -> String {
    format!("{v:?}")
}

/// A TOML array.
pub fn list(v: &[f64]) -> String {
    let items: Vec<_> = v.iter().map(|v| float(*v)).collect();
    format!("[{}]", items.join(", "))
}

/// A TOML array of x, y, z.
pub fn vector(v: &Vector3<f64>) -> String {
    list(&[v.x, v.y, v.z])
}

/// A TOML basic string.
pub fn text(s: &str) -> String {
    let mut out = String::with_capacity(s.len() + 2);
    out.push('"');
    for c in s.chars() {
        match c {
            '"' => out.push_str("\\\""),
            '\\' => out.push_str("\\\\"),
            c if c.is_control() => {
                let _ = write!(out, "\\u{:04X}", u32::from(c));
            }
            c => out.push(c),
        }
    }
    out.push('"');
    out
}

/// Degrees that convert to exactly `rad`, the roundest that do; the nearest where none does.
pub(crate) fn degrees(rad: f64) -> f64 {
    let nearest = rad.to_degrees();
    let round = (nearest * 1e9).round() / 1e9;
    let candidates = [round, nearest, nearest.next_up(), nearest.next_down()];
    let exact = candidates.into_iter().find(|deg| deg.to_radians().to_bits() == rad.to_bits());
    exact.unwrap_or(nearest)
}

pub(super) fn label(label: &LabelRef) -> String {
    match label {
        LabelRef::Number(n) => n.to_string(),
        LabelRef::Name(name) => text(name),
        LabelRef::File { path, .. } => text(&path.to_string_lossy()),
    }
}

/// The keys that name a label: its own, or its file and its label there.
pub(super) fn label_lines(of: &LabelRef) -> Vec<(&'static str, String)> {
    let within = match of {
        LabelRef::File { label: Some(within), .. } => Some(("label", label(within))),
        _ => None,
    };
    [(of.key(), label(of))].into_iter().chain(within).collect()
}

fn list_of(regions: &[TargetRegion]) -> String {
    let table = |region: &TargetRegion| {
        let place: String =
            target(&region.of).iter().map(|(key, value)| format!("{key} = {value}, ")).collect();
        format!("{{ {place}margin_mm = {} }}", float(region.margin_mm))
    };
    format!("[{}]", regions.iter().map(table).collect::<Vec<_>>().join(", "))
}

/// The keys that name a target: none of what a tool sweeps.
pub(super) fn target(target: &Target) -> Vec<(&'static str, String)> {
    let shape = match target {
        Target::Swept => return vec![],
        Target::Label(of) => return label_lines(of),
        Target::Box { min_mm, max_mm } => {
            ("box", format!("{{ min_mm = {}, max_mm = {} }}", vector(min_mm), vector(max_mm)))
        }
        Target::Ball { center_mm, radius_mm } => {
            ("ball", format!("{{ center_mm = {}, radius_mm = {} }}", vector(center_mm), float(*radius_mm)))
        }
        Target::Frustum { from_mm, to_mm, from_radius_mm, to_radius_mm } => (
            "frustum",
            format!(
                "{{ from_mm = {}, to_mm = {}, from_radius_mm = {}, to_radius_mm = {} }}",
                vector(from_mm),
                vector(to_mm),
                float(*from_radius_mm),
                float(*to_radius_mm)
            ),
        ),
    };
    vec![shape]
}

/// TOML text with tables below a prefix.
struct Text {
    out: String,
    prefix: String,
}

impl Text {
    fn line(&mut self, line: String) {
        self.out.push_str(&line);
        self.out.push('\n');
    }

    fn path(&self, name: &str) -> String {
        if self.prefix.is_empty() { name.into() } else { format!("{}.{name}", self.prefix) }
    }

    fn lines(&mut self, lines: &[(&str, String)]) {
        for (key, value) in lines {
            self.line(format!("{key} = {value}"));
        }
    }

    fn table(&mut self, name: &str, lines: &[(&str, String)]) {
        self.line(format!("\n[{}]", self.path(name)));
        self.lines(lines);
    }

    fn array_table(&mut self, name: &str, lines: &[(&str, String)]) {
        self.line(format!("\n[[{}]]", self.path(name)));
        self.lines(lines);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Case, LabelRef, Target, TargetRegion};

    #[test]
    fn regions_are_read_written_and_refused_with_their_place() {
        let parse = |target: &str| {
            let text = format!("structure = []\n[images]\nct = \"c\"\nlabels = \"l\"\n[target]\n{target}\n");
            Case::parse(&text, std::path::Path::new("case.toml"))
        };
        let ball = "ball = { center_mm = [1, 2, 3], radius_mm = 4 }";
        let text = format!(
            "label = 7\nalso = [{{ {ball} }}]\nless = [{{ label = \"nerve\", margin_mm = 1.5 }}, {{ {ball} }}]"
        );
        let case = parse(&text).unwrap();
        let TargetRegion { of: Target::Ball { radius_mm, .. }, margin_mm } = &case.also[0] else {
            panic!("{case:?}")
        };
        assert_eq!((*radius_mm, *margin_mm, case.less.len()), (4.0, 0.0, 2));
        let nerve = TargetRegion { of: Target::Label(LabelRef::Name("nerve".into())), margin_mm: 1.5 };
        assert_eq!(case.less[0], nerve);
        assert_eq!(Case::parse(&case.to_toml(), std::path::Path::new("again.toml")).unwrap(), case);
        let files = parse("file = \"t.nii\"\nless = [{ file = \"n.nii\", label = \"nerve\" }]").unwrap();
        let in_file = |path: &str, label: Option<&str>| {
            let label = label.map(|name| Box::new(LabelRef::Name(name.into())));
            Target::Label(LabelRef::File { path: path.into(), label })
        };
        assert_eq!(
            (&files.target, &files.less[0].of),
            (&in_file("t.nii", None), &in_file("n.nii", Some("nerve")))
        );
        assert_eq!(Case::parse(&files.to_toml(), std::path::Path::new("again.toml")).unwrap(), files);
        for (target, parts) in [
            ("file = \"t.nii\"\nlabel = 7\nsegment = \"a\"", ["`target`", "`label` and `segment`"]),
            ("file = \"t.nii\"\nball = 3", ["`target` has `file` and `ball`", "exactly one of"]),
            ("label = 7\nless = [{ margin_mm = 1 }]", ["target.less[0]", "exactly one of"]),
            ("label = 7\nalso = [{ label = 1, ball = 2 }]", ["target.also[0]", "exactly one of"]),
            ("label = 7\nalso = 3", ["`target.also`", "a list of tables"]),
            ("label = 7\nless = [{ label = 1, margin = 2 }]", ["target.less[0].margin", "margin_mm"]),
            (
                "label = 7\nless = [{ label = 1, margin_mm = -1 }]",
                ["target.less[0].margin_mm", "expected 0 to 50"],
            ),
            (
                "label = 7\nless = [{ box = { min_mm = [0, 0, 0], max_mm = [1, 0, 1] } }]",
                ["case.toml:7: `target.less[0].box.max_mm`", "the same coordinate"],
            ),
        ] {
            let said = parse(target).unwrap_err().to_string();
            assert!(parts.iter().all(|part| said.contains(part)), "{said}");
        }
    }
}
