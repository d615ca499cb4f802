//! The resolved job as TOML, every default spelled out; it reads back as an equal job.

use super::keys as k;
use super::{BlockSource, CutterKind, ProsthesisJob};
use crate::write::{degrees, float, list, text};

impl ProsthesisJob {
    /// The job as a job file with every key.
    pub fn to_toml(&self) -> String {
        let mut out = String::new();
        let mut table = |name: &str, lines: &[(&str, String)]| {
            let blank = if out.is_empty() { "" } else { "\n" };
            out += &format!("{blank}[{name}]\n");
            out.extend(lines.iter().map(|(key, value)| format!("{key} = {value}\n")));
        };
        table(
            "part",
            &[
                ("stl", text(&self.part.file.to_string_lossy())),
                ("unit", text(k::MESH_UNIT.word(self.part.unit))),
            ],
        );
        table("orient", &[("mode", text(k::ORIENT.word(self.orient)))]);
        table("stock", &self.stock_lines());
        let [x, y, z] = self.stock.gap_mm.map(float);
        table("stock.gap_mm", &[("x", x), ("y", y), ("z", z)]);
        table("tool", &self.tool_lines());
        table("process", &self.process_lines());
        table("machine", &self.machine_lines());
        out
    }

    fn stock_lines(&self) -> Vec<(&'static str, String)> {
        let source = match &self.stock.source {
            BlockSource::Catalogue(path) => ("catalogue", text(&path.to_string_lossy())),
            BlockSource::Blocks(blocks) => {
                let block = |b: &super::BlockSpec| {
                    format!("{{ id = {}, size_mm = {}, count = {} }}", text(&b.id), list(&b.size_mm), b.count)
                };
                ("blocks", format!("[{}]", blocks.iter().map(block).collect::<Vec<_>>().join(", ")))
            }
        };
        vec![source, ("grip_mm", float(self.stock.grip_mm))]
    }

    fn tool_lines(&self) -> Vec<(&'static str, String)> {
        let t = &self.tool;
        let holder: Vec<String> = t.holder_mm.iter().map(|piece| list(piece)).collect();
        let mut lines = vec![("kind", text(k::CUTTER.word(t.kind))), ("diameter_mm", float(t.diameter_mm))];
        if t.kind == CutterKind::Bull {
            lines.push(("corner_radius_mm", float(t.corner_radius_mm)));
        }
        lines.extend([
            ("flutes", t.flutes.to_string()),
            ("length_mm", float(t.length_mm)),
            ("holder", format!("[{}]", holder.join(", "))),
        ]);
        lines
    }

    fn process_lines(&self) -> Vec<(&'static str, String)> {
        let p = &self.process;
        vec![
            ("spindle_rpm", float(p.spindle_rpm)),
            ("feed_per_tooth_mm", float(p.feed_per_tooth_mm)),
            ("side_load", float(p.side_load)),
            ("depth_of_cut", float(p.depth_of_cut)),
            ("finishing_step_mm", float(p.finishing_step_mm)),
            ("strip_mm", float(p.strip_mm)),
            ("clearance_mm", float(p.clearance_mm)),
            ("sense", text(k::CUT_SENSE.word(p.sense))),
        ]
    }

    fn machine_lines(&self) -> Vec<(&'static str, String)> {
        let m = &self.machine;
        let mut lines = vec![
            ("kind", text(k::MACHINE.word(m.kind))),
            ("dialect", text(k::DIALECT.word(m.dialect))),
            ("on_flange", text(k::ON_FLANGE.word(m.on_flange))),
            ("rotary", text("A")),
            ("travel_mm", list(&m.travel_mm)),
            ("rotary_range_deg", list(&m.rotary_range_rad.map(degrees))),
            ("max_feed_mm_min", float(m.max_feed_mm_min)),
            ("rapid_mm_min", float(m.rapid_mm_min)),
            ("rotary_deg_s", float(degrees(m.rotary_rad_s))),
            ("acceleration_mm_s2", float(m.acceleration_mm_s2)),
            ("jerk_mm_s3", float(m.jerk_mm_s3)),
        ];
        lines.extend(m.max_time_min.map(|t| ("max_time_min", float(t))));
        lines
    }
}
