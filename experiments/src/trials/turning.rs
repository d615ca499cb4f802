//! How much the arm decides what turning the shaft earns: gains against the joints' accelerations, the tilt limit, and the mount's lever.

use bonemill_imaging::phantom::{BlockParams, block};
use bonemill_planner::Progress;
use bonemill_planner::case::Case;
use bonemill_robot::arm::bone_attached::ACCELERATION_LIMITS;

use super::felt::{ArmKind, COLUMNS, change_cells, planned};
use crate::body::Body;
use crate::{ExperimentError, Size, Table};

/// Full acceleration within 0.02 s.
const JERK_PER_S: f64 = 50.0;
/// Multiples of the bone-attached arm's.
const ACCELERATIONS: [f64; 6] = [0.25, 0.5, 1.0, 2.0, 4.0, 8.0];
const TILTS_DEG: [f64; 4] = [15.0, 30.0, 45.0, 60.0];
/// From the flange's axis to the burr, mm.
const LEVERS_MM: [f64; 4] = [0.0, 45.0, 90.0, 180.0];
/// Largest number of blocks.
const MOST_BLOCKS: u64 = 3;

/// Runs foam blocks.
///
/// # Errors
/// When a body cannot be made or planned.
pub fn run(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let blocks = size.seeds.min(MOST_BLOCKS);
    let title = format!(
        "What the arm decides, over {blocks} foam blocks: change in % against the mean of the two controls; against the straight shaft \
         with the least force, mean ± standard deviation / worst. Each row has references of its own, by the same arm."
    );
    let head: Vec<&str> = ["changed", "to"].into_iter().chain(COLUMNS).collect();
    let mut table = Table::new("turning", title, &head);
    let mut row = |changed: &str, to: String, adjust: &dyn Fn(&mut Case)| -> Result<(), ExperimentError> {
        progress.stage(changed);
        let mut found = Vec::new();
        for seed in 1..=blocks {
            let body = Body::phantom(&block(&BlockParams::paper(), seed))?;
            found.extend(planned(&format!("block {seed}"), &body, adjust)?);
        }
        let cells = change_cells(&found.iter().collect::<Vec<_>>());
        table.push([changed.to_owned(), to].into_iter().chain(cells).collect());
        Ok(())
    };
    for times in ACCELERATIONS {
        row("accelerations, bone-attached arm", format!("×{times}"), &|case| {
            let acceleration = ACCELERATION_LIMITS.map(|a| times * a).to_vec();
            case.robot.jerk_limits = Some(acceleration.iter().map(|a| JERK_PER_S * a).collect());
            case.robot.acceleration_limits = Some(acceleration);
        })?;
    }
    for tilt_deg in TILTS_DEG {
        row("tilt limit, bone-attached arm", format!("{tilt_deg}°"), &|case| {
            case.orientation.tilt_limit_rad = tilt_deg.to_radians();
        })?;
    }
    for lever_mm in LEVERS_MM {
        row("lever of the mount, UR5e, 1 angle", format!("{lever_mm} mm"), &|case| {
            ArmKind::Ur5e(1).put_into(case);
            if let Some((translation_mm, _)) = &mut case.robot.flange_from_burr {
                translation_mm[1] = -lever_mm;
            }
        })?;
    }
    Ok(vec![table])
}
