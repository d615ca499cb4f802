//! Why too little of the target is removed, and what would help.

use bonemill_case::Case;
use bonemill_cutting::cutter::Ball;
use bonemill_imaging::ImageError;
use bonemill_toolpath::scene::Scene;
use bonemill_toolpath::space::BurrSpace;

use super::metrics::Coverage;
use super::percent::percent;
use super::rest::RestCause;

/// A clearance above this is compared with it, a smaller one with its half, mm: the case file's default.
const USUAL_CLEARANCE_MM: f64 = 1.0;
/// Smaller volumes are not reported, mm³: they would read 0.0.
const TOLD_MM3: f64 = 0.05;

/// Why too little of the target is removed, if it is: what keeps the rest, and what would help against the largest cause.
///
/// # Errors
/// When a distance field cannot be made.
pub(super) fn too_little(
    case: &Case,
    scene: &Scene,
    space: &BurrSpace,
    coverage: &Coverage,
) -> Result<Option<String>, ImageError> {
    let share = coverage.removed_share();
    let (Some((largest, _)), true) = (coverage.rest.first(), share < case.least_share) else {
        return Ok(None);
    };
    let parts: Vec<String> = coverage
        .rest
        .iter()
        .filter(|(_, mm3)| *mm3 >= TOLD_MM3)
        .map(|(cause, mm3)| format!("{mm3:.1} mm³ by the {}", cause.text(case)))
        .collect();
    Ok(Some(format!(
        "only {} of the target is removed (target.least_share = {}: {:.0} %); kept are {}; {}",
        percent(share),
        case.least_share,
        100.0 * case.least_share,
        parts.join(", "),
        help(case, scene, space, coverage, largest)?
    )))
}

/// What would help against a cause, with the mm³ that it would make reachable where that is one more free space.
fn help(
    case: &Case,
    scene: &Scene,
    space: &BurrSpace,
    coverage: &Coverage,
    cause: &RestCause,
) -> Result<String, ImageError> {
    let lower = |mm: f64| if mm > USUAL_CLEARANCE_MM { USUAL_CLEARANCE_MM } else { 0.5 * mm };
    let clearances = |lowered: &dyn Fn(usize) -> bool| -> Vec<f64> {
        let structures = case.structures.iter().enumerate();
        structures.map(|(n, s)| if lowered(n) { lower(s.clearance_mm) } else { s.clearance_mm }).collect()
    };
    let gain = |radius_mm: f64, clearances_mm: &[f64]| -> Result<String, ImageError> {
        let changed = BurrSpace::new(scene, Ball { radius_mm }, clearances_mm)?;
        let more =
            changed.reachable().iter().zip(space.reachable()).filter(|(now, before)| **now && !**before);
        let mm3 = more.count() as f64 * scene.target_voxel_mm3;
        Ok(format!("would let the burr reach {mm3:.1} mm³ more"))
    };
    let radius_mm = case.burr.radius_mm;
    Ok(match cause {
        RestCause::Clearance(structure) => {
            let (name, from_mm) = case
                .structures
                .get(*structure)
                .map_or(("", 0.0), |s| (s.name.as_str(), s.clearance_mm));
            let gain = gain(radius_mm, &clearances(&|n| n == *structure))?;
            format!("clearance_mm of {name} {from_mm} -> {} {gain}", lower(from_mm))
        }
        RestCause::Clearances => format!(
            "clearance_mm of every structure lowered to {USUAL_CLEARANCE_MM}, and where it is that already by half, {}",
            gain(radius_mm, &clearances(&|_| true))?
        ),
        RestCause::BurrRadius => {
            format!("burr.radius_mm {radius_mm} -> {} {}", 0.5 * radius_mm, gain(0.5 * radius_mm, &clearances(&|_| false))?)
        }
        RestCause::Bone => format!(
            "{:.0} % of the target is bone itself: if that is little, the labels may lie beside their bone (check both images' \
             affines); else take the bone in the way into the target, or choose another approach.direction",
            100.0 * coverage.target.bone_mm3 / coverage.target.all_mm3
        ),
        RestCause::ThinBone => "target.sheets = \"cut\" would let the burr through it".into(),
        RestCause::Shank(_) => {
            "a longer or thinner shank (shank.segments), a larger orientation.tilt_limit_deg or another approach.direction may \
             help"
                .into()
        }
        RestCause::Spacing => "smaller path.layer_mm and path.stepover_mm would help".into(),
        RestCause::OutsideScan => "a scan that holds the target would help".into(),
    })
}
