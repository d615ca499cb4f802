//! `access.csv` and `dropped.csv`: what the shank leaves open at every waypoint, and what it kept the path from.
//!
//! Both are for a reader; nothing is planned from them again.

use std::fmt::Write as _;

use bonemill_imaging::Scene;

use crate::orientation::{Around, Permissible};
use crate::pipeline::Dropped;

/// One row per waypoint: `index,free,pieces,angle_rad,low_rad,high_rad,cap_rad`.
///
/// `free`: directions of the set that are free, and within the tilt limit where that binds; `pieces`: into how many parts they
/// fall; for one angle that of the tilt plane and the free interval around it, for two the cap around the axis chosen.
pub(super) fn access_csv(allowed: &[Permissible]) -> String {
    let mut text = String::from("index,free,pieces,angle_rad,low_rad,high_rad,cap_rad\n");
    for (index, Permissible { free, pieces, around }) in allowed.iter().enumerate() {
        // writing to a String cannot fail; + 0.0 makes −0 a plain 0
        let _ = match around {
            Around::Interval { low_rad, at_rad, high_rad } => {
                let [low, at, high] = [low_rad, at_rad, high_rad].map(|angle| angle + 0.0);
                writeln!(text, "{index},{free},{pieces},{at:.6},{low:.6},{high:.6},")
            }
            Around::Cap { radius_rad } => writeln!(text, "{index},{free},{pieces},,,,{radius_rad:.6}"),
        };
    }
    text
}

/// One row per place that the path leaves out: `x_mm,y_mm,z_mm,reason`, ct.
pub(super) fn dropped_csv(dropped: &[Dropped], scene: &Scene) -> String {
    let mut text = String::from("x_mm,y_mm,z_mm,reason\n");
    for Dropped { position, reason } in dropped {
        let p = scene.ct_from_work * *position;
        let reason = reason.replace('"', "\"\"");
        let _ = writeln!(text, "{:?},{:?},{:?},\"{reason}\"", p.x(), p.y(), p.z());
    }
    text
}
