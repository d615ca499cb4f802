//! Describes a plan's files: every column and key with its unit, its frame and its meaning.
//!
//! One table has three uses: the writers take the columns' names from it, `docs/columns.md` and `bonemill columns` are
//! printed from it, and every report shows it.

mod channel;
mod csv;
mod modelled;
pub mod prosthesis;
mod toml;

use std::fmt::Write;

pub use csv::{ACCESS, DROPPED, FORCES_ROWS, PLUNGE_ROWS, SIMULATION_ROWS, WAYPOINTS};

/// A column of a table or a key of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Column {
    /// Name in the file; `NAME` stands for a name that the case gives, `1..n` for one column per joint.
    pub name: &'static str,
    /// Unit; `1` for numbers without one, `text` for words.
    pub unit: &'static str,
    /// The frame of a vector's component; empty for other values.
    pub frame: &'static str,
    /// What the value means.
    pub meaning: &'static str,
}

impl Column {
    const fn new(name: &'static str, unit: &'static str, frame: &'static str, meaning: &'static str) -> Self {
        Self { name, unit, frame, meaning }
    }
}

/// The names of a file's columns, in order.
pub const fn names<const N: usize>(columns: &[Column; N]) -> [&'static str; N] {
    let mut names = [""; N];
    let mut n = 0;
    while n < N {
        names[n] = columns[n].name;
        n += 1;
    }
    names
}

/// A file of a plan, or a table in one.
#[derive(Debug, Clone, Copy)]
pub struct Described {
    /// The file's name, and the table's.
    pub title: &'static str,
    /// What it holds.
    pub about: &'static str,
    /// Its columns or keys.
    pub columns: &'static [Column],
}

/// Every file and table, in the order of the reference.
pub const DESCRIBED: &[Described] = &[
    Described {
        title: "waypoints.csv",
        about: "One row per waypoint. Everything in a row belongs to the move that ends there; the first row is where the \
                motion begins. An empty cell: there is no such value.",
        columns: &WAYPOINTS,
    },
    Described {
        title: "forces.csv",
        about: "One row for each waypoint and each structure within its influence, that is, within its clearance plus 8 mm of the burr's surface.",
        columns: &FORCES_ROWS,
    },
    Described {
        title: "trajectory.csv",
        about: "One row per controller period (`robot.rate_hz`): the motion of the joints of `robot.urdf`, on the clock of \
                `waypoints.csv`.",
        columns: &csv::TRAJECTORY,
    },
    Described {
        title: "simulation.csv",
        about: "Written by `bonemill simulate`: one row per simulated pose. An empty cell means that there is no such value.",
        columns: &SIMULATION_ROWS,
    },
    Described {
        title: "simulate --json, figures",
        about: "A name that `plan.toml` has too has the same value there; what is simulated anew has a name of its own. Of a channel `bone` is all that is removed.",
        columns: csv::SIMULATION_FIGURES,
    },
    Described {
        title: "access.csv",
        about: "One row per waypoint: the free directions of the shaft there.",
        columns: &ACCESS,
    },
    Described {
        title: "dropped.csv",
        about: "One row per waypoint that the path leaves out because the shank had no free direction there.",
        columns: &DROPPED,
    },
    Described {
        title: "plunge.csv",
        about: "For a drilled or reamed channel: one row per waypoint with the loads on the tool.",
        columns: &PLUNGE_ROWS,
    },
    Described { title: "plan.toml", about: "The plan's settings and figures.", columns: toml::PLAN },
    Described {
        title: "plan.toml [frames]",
        about: "`a_from_b` converts coordinates of b to coordinates of a: p_a = rotation · p_b + translation_mm; a rotation is \
                written by rows.",
        columns: toml::FRAMES,
    },
    Described {
        title: "plan.toml [metrics]",
        about: "Volumes are counts of voxels of the planning grid. Each voxel of the target stands for the same volume, such that all \
                voxels in the label or shape have the volume that it has on its own grid or as a solid. A table of volumes has three keys: `all_mm3`, with air \
                cells; `material_mm3`, above `density.air_hu`; `bone_mm3`, above `density.bone_hu`.",
        columns: toml::METRICS,
    },
    Described {
        title: "plan.toml [modelled]",
        about: "What was modelled, and the error of each approximation.",
        columns: modelled::MODELLED,
    },
    Described {
        title: "plan.toml [metrics] of a channel",
        about: "Beside those above that apply. Volumes are what the tool's front passes from the first bone to the end.",
        columns: channel::METRICS,
    },
    Described {
        title: "plan.toml [modelled] of a channel",
        about: "Beside those above that apply.",
        columns: channel::MODELLED,
    },
    Described {
        title: "verification.toml",
        about: "Written by `bonemill verify`: the verdict and one `[[check]]` for each check.",
        columns: toml::VERIFICATION,
    },
];

/// The frames by name and meaning.
pub const FRAMES: [(&str, &str); 6] = [
    (
        "ct",
        "The scan's RAS+ mm world, in which the images' headers place their voxels. Plans are stored in it.",
    ),
    (
        "work",
        "The frame in which θ and φ are measured: origin at the centre of the planning grid's first voxel, z along the approach, \
         out of the bone; x and y follow from z alone.",
    ),
    (
        "grid",
        "The planning grid: work, turned about z by `frames.grid.turn_rad` to lie along the scan's voxels.",
    ),
    ("base", "The arm's base: `base_link` of `robot.urdf`, else its root."),
    ("flange", "The end of `robot.urdf`, to which the tool is fixed."),
    ("tool, burr", "Origin at the burr's centre, z along the shaft to the handpiece."),
];

const INTRODUCTION: &str = "\
# The files of a plan

Every column and key with its unit, frame and meaning. Lengths are mm, forces N, angles rad; names end in their unit. Distances
in the tables (`distance_mm`) are measured from the burr's centre; subtract its radius for those from its surface, which names with `surface` state. The keys of `[case]` are
those of the [case file](case.md).

This page is generated from the table that the writers use: `bonemill columns` prints it.

## Frames

| frame | meaning |
|---|---|
";

/// The reference of all columns and keys as Markdown.
pub fn reference() -> String {
    let mut out = String::from(INTRODUCTION);
    // writing to a String cannot fail
    for (name, meaning) in FRAMES {
        let _ = writeln!(out, "| {name} | {meaning} |");
    }
    for Described { title, about, columns } in DESCRIBED.iter().chain(prosthesis::DESCRIBED) {
        let _ =
            write!(out, "\n## {title}\n\n{about}\n\n| name | unit | frame | meaning |\n|---|---|---|---|\n");
        for c in *columns {
            let _ = writeln!(
                out,
                "| `{}` | {} | {} | {} |",
                c.name,
                c.unit,
                c.frame,
                c.meaning.replace('|', "\\|")
            );
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn docs_columns_md_is_this_reference() {
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/columns.md");
        let found = std::fs::read_to_string(&file).unwrap_or_default();
        assert!(
            found == reference(),
            "docs/columns.md is out of date: run `bonemill columns > docs/columns.md`"
        );
    }

    #[test]
    fn names_are_unique_and_units_agree_with_their_endings() {
        for Described { title, columns, .. } in DESCRIBED.iter().chain(prosthesis::DESCRIBED) {
            for (n, c) in columns.iter().enumerate() {
                assert!(
                    !columns[..n].iter().any(|before| before.name == c.name),
                    "{title}: {} stands twice",
                    c.name
                );
                assert!(c.meaning.ends_with('.') && !c.unit.is_empty(), "{title}: {}", c.name);
                let ending = [
                    ("_mm", "mm"),
                    ("_n", "N"),
                    ("_s", "s"),
                    ("_mm_s", "mm/s"),
                    ("_rad", "rad"),
                    ("_mm3", "mm³"),
                ];
                let ending =
                    ending.into_iter().filter(|(e, _)| c.name.ends_with(e)).max_by_key(|(e, _)| e.len());
                let is_rate = c.name.ends_with("_mm3_s");
                assert!(
                    is_rate || ending.is_none_or(|(_, unit)| c.unit == unit),
                    "{title}: {} in {}",
                    c.name,
                    c.unit
                );
            }
        }
    }
}
