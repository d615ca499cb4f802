//! `access.csv` and `dropped.csv`: the directions that are free for the shank at every waypoint, and the places that it cannot reach.
//!
//! Both are for a reader; nothing is planned from them again.

use std::fmt::Write as _;

use bonemill_planfile::columns::{ACCESS, DROPPED, names};
use bonemill_toolpath::orientation::{OpenAround, Permissible};
use bonemill_toolpath::scene::Scene;

use crate::Dropped;

/// One row per waypoint: the columns of [`ACCESS`].
pub(super) fn access_csv(allowed: &[Permissible]) -> String {
    let mut text = names(&ACCESS).join(",") + "\n";
    for (index, Permissible { free, pieces, around }) in allowed.iter().enumerate() {
        // writing to a String cannot fail; + 0.0 makes −0 a plain 0
        let _ = match around {
            OpenAround::Interval { low_rad, at_rad, high_rad } => {
                let [low, at, high] = [low_rad, at_rad, high_rad].map(|angle| angle + 0.0);
                writeln!(text, "{index},{free},{pieces},{at:.6},{low:.6},{high:.6},")
            }
            OpenAround::Cap { radius_rad } => writeln!(text, "{index},{free},{pieces},,,,{radius_rad:.6}"),
        };
    }
    text
}

/// One row per place that the path leaves out: the columns of [`DROPPED`].
pub(super) fn dropped_csv(dropped: &[Dropped], scene: &Scene) -> String {
    let mut text = names(&DROPPED).join(",") + "\n";
    for Dropped { position, reason } in dropped {
        let p = scene.ct_from_work * *position;
        let reason = reason.replace('"', "\"\"");
        let _ = writeln!(text, "{:?},{:?},{:?},\"{reason}\"", p.x(), p.y(), p.z());
    }
    text
}
