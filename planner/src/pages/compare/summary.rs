//! The figures by which two plans are judged first: a dozen of them, those of one structure.

use bonemill_verify::Short;

use super::{Comparison, lines};

/// Group and name of a figure, what it is in words, and its factor; `*` stands for the structure that is most important.
const FIGURES: [(&str, &str, &str, f64); 15] = [
    ("rest", "removed_share", "target removed, %", 100.0),
    ("volumes", "removed_bone_mm3", "bone removed, mm³", 1.0),
    (
        "volumes",
        "untargeted_bone_by_voxels_mm3",
        "bone removed outside the target, by voxel centres, mm³",
        1.0,
    ),
    ("times", "total_time_s", "time, s", 1.0),
    ("forces", "mean_force_n", "mean force, N", 1.0),
    ("forces", "peak_force_n", "peak force, N", 1.0),
    ("forces", "peak_thrust_n", "peak thrust, N", 1.0),
    ("rest", "peak_torque_nmm", "peak torque, N mm", 1.0),
    ("structure *", "least_surface_distance_mm", "least distance of the burr's surface from *, mm", 1.0),
    ("structure *", "near.mean_force_toward_n", "mean force toward * within 2 mm, N", 1.0),
    ("structure *", "near.peak_force_toward_n", "peak force toward * within 2 mm, N", 1.0),
    (
        "forces",
        "compared.straight.near.*.mean_force_toward_n",
        "  of a straight shaft with the least force in that time: mean",
        1.0,
    ),
    ("forces", "compared.straight.near.*.peak_force_toward_n", "    peak", 1.0),
    ("rest", "kept.*.clearance_mm", "least distance of the tool's surface from *, mm", 1.0),
    ("rest", "kept.*.touch_probability", "probability of touching *", 1.0),
];

impl Comparison {
    /// The figures that matter most, and the keys and inputs that differ, as a table for a terminal.
    pub fn summary(&self, names: [&str; 2]) -> String {
        let structure = self.most_important.as_deref().unwrap_or("");
        let mut rows = vec![["".to_owned(), names[0].into(), names[1].into(), "second - first".into()]];
        for (group, name, words, factor) in FIGURES {
            let [group, name, words] = [group, name, words].map(|text| text.replace('*', structure));
            let group = self.groups.iter().find(|found| found.title == group);
            let Some(figure) = group.and_then(|group| group.figures.iter().find(|f| f.name == name)) else {
                continue;
            };
            let short = |v: Option<f64>| v.map_or("-".into(), |v| Short(factor * v).to_string());
            let [a, b] = figure.values.map(short);
            rows.push([words, a, b, short(figure.difference())]);
        }
        let apart = self.between.entries().into_iter().find(|(name, _)| *name == "hausdorff_mm");
        rows.extend(apart.map(|(_, mm)| {
            ["largest distance between the paths, mm".into(), "".into(), "".into(), Short(mm).to_string()]
        }));
        rows.extend(self.differing_rows());
        lines(rows)
    }
}
