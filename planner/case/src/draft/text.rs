//! The text of a case that was made from labels, and what the user should know of it.

use std::fmt::Write as _;
use std::path::Path;

use bonemill_arm::ur::UrModel;
use nalgebra::Vector3;

use super::choice::{TargetChoice, structure_name};
use super::kinds::{Meaning, Side};
use super::{Draft, DraftError, FoundLabel, KnownPlace, Role};
use crate::DEFAULT_BONE_HU;
use crate::write::{self, float, list, rigid, text, vector};

/// Where comments begin behind a value.
const COMMENT: usize = 33;
/// A case without structures.
const NOTHING_SPARED: &str = "no label is taken for something to spare: only bone outside the target is kept";
/// How far a handpiece straight on the flange holds the burr before it, mm. Assumed.
const STRAIGHT_MM: f64 = 180.0;

/// The case file.
pub(super) fn case_text(draft: &Draft<'_>) -> Result<String, DraftError> {
    let mut out = Lines(String::new());
    out.comment("A case made from a CT and its labels by `bonemill case`. Its values are to start from: read them before anything is milled.");
    out.comment("Lengths are mm, directions are in the image's RAS+ frame (\"ct\"): +x right, +y front, +z up. Paths are relative to this file.");
    out.comment("A key that is left out has its documented default; `bonemill keys` lists all.");
    let side = draft.side.side.map_or("not known", Side::word);
    out.comment(&format!("Side: {side}: {}.", draft.side.reason));
    if draft.choice.structures.is_empty() {
        out.line("\nstructure = []", NOTHING_SPARED);
    }
    images(&mut out, draft)?;
    target(&mut out, draft)?;
    structures(&mut out, draft)?;
    others(&mut out, draft);
    approach(&mut out, draft)?;
    tool(&mut out);
    robot(&mut out, draft)?;
    Ok(out.0)
}

fn images(out: &mut Lines, draft: &Draft<'_>) -> Result<(), DraftError> {
    out.table("[images]");
    out.key("ct", path(&draft.images.ct)?, "");
    if let Some(name) = &draft.images.ct_series {
        out.key("ct_series", text(name), "");
    }
    out.key("labels", path(&draft.images.labels)?, "");
    out.table("[density]");
    out.comment("Assumed for clinical CT. Read two values off this scan, of muscle and of the thinnest bone to be kept, and take their middle.");
    out.key(
        "bone_hu",
        float(DEFAULT_BONE_HU),
        "at or above: bone, which burr and shank may not touch outside the target",
    );
    Ok(())
}

fn target(out: &mut Lines, draft: &Draft<'_>) -> Result<(), DraftError> {
    out.table("[target]");
    match &draft.choice.target {
        TargetChoice::Label(place) => {
            if let Some(label) = draft.labels.get(*place) {
                out.label(label, &figures(label))?;
            }
            let taken = touching(draft);
            if !taken.is_empty() {
                out.comment("The target touches these structures: they and what lies within the margin are taken away from it.");
                let region = |label: &FoundLabel, margin_mm: f64| -> Result<String, DraftError> {
                    let lines =
                        label_lines(label)?.into_iter().map(|(key, value)| format!("{key} = {value}, "));
                    Ok(format!("{{ {}margin_mm = {} }}", lines.collect::<String>(), float(margin_mm)))
                };
                let regions = taken.iter().map(|(label, margin_mm)| region(label, *margin_mm));
                let regions: Vec<String> = regions.collect::<Result<_, _>>()?;
                out.key("less", format!("[{}]", regions.join(", ")), "");
            }
        }
        TargetChoice::Shape(shape) => {
            out.comment("Bone and enclosed air in a shape, less every structure and its clearance.");
            write::target(shape).into_iter().for_each(|(key, value)| out.key(key, value, ""));
        }
    }
    Ok(())
}

fn structures(out: &mut Lines, draft: &Draft<'_>) -> Result<(), DraftError> {
    let mut is_first = true;
    for (n, (label, kind)) in chosen(draft).into_iter().enumerate() {
        out.blank();
        if std::mem::take(&mut is_first) {
            out.comment("Structures by their usual importance. clearance_mm is the least distance of the burr's surface: usual values, to start from.");
        }
        out.line("[[structure]]", kind.name);
        out.key("name", text(&structure_name(label)), &figures(label));
        out.label(label, "")?;
        out.key("clearance_mm", float(kind.clearance_mm()), "");
        out.key("priority", (n + 1).to_string(), "");
    }
    Ok(())
}

/// Labels that are neither target nor structure.
fn others(out: &mut Lines, draft: &Draft<'_>) {
    let mut is_first = true;
    for (label, role) in draft.labels.iter().zip(&draft.choice.roles) {
        if matches!(role, Role::Target | Role::Structure(_)) {
            continue;
        }
        if std::mem::take(&mut is_first) {
            out.blank();
            out.comment(
                "Labels that are neither target nor structure. To spare one, add a [[structure]] for it.",
            );
        }
        out.comment(&format!("- {}: {}; {}", label.described(), volume(label), role.words()));
    }
}

fn approach(out: &mut Lines, draft: &Draft<'_>) -> Result<(), DraftError> {
    out.blank();
    if let Some(direction) = draft.approach {
        let unit = direction.try_normalize(1e-6).ok_or(DraftError::Approach)?;
        let rounded = unit.map(|v| (v * 1e6).round() / 1e6);
        out.line("[approach]", "");
        out.key("direction", vector(&rounded), "out of the bone, along the points that were given");
        return Ok(());
    }
    out.comment("[approach] is left out: the planner takes the direction along which burr and shank reach most of the target, and says which.");
    let x = match draft.side.side {
        Some(Side::Right) => "direction = [1.0, 0.0, 0.0] is straight out of a right ear",
        Some(Side::Left) => "direction = [-1.0, 0.0, 0.0] is straight out of a left ear",
        None => {
            "direction = [1.0, 0.0, 0.0] is straight out of a right ear, [-1.0, 0.0, 0.0] out of a left one"
        }
    };
    out.comment(&format!("To give it: {x}."));
    Ok(())
}

fn tool(out: &mut Lines) {
    out.table("[burr]");
    out.key("radius_mm", "2.0".into(), "half of the diameter on the package");
    out.key("flutes", "8".into(), "assumed");
    out.key("spindle_rpm", "60000".into(), "assumed: otologic drills turn at 60 000 to 80 000");
    out.key("spin", "-1".into(), "-1: clockwise seen from the handpiece");
    out.key("neck_radius_mm", "1.1".into(), "where the flutes end");
    out.table("[shank]");
    out.comment("[length, radius] from the burr outwards: a thin shank, then the handpiece. Measure them.");
    out.key("segments", "[[25.0, 1.1], [60.0, 6.0]]".into(), "");
}

fn robot(out: &mut Lines, draft: &Draft<'_>) -> Result<(), DraftError> {
    out.table("[robot]");
    out.key("model", text(draft.robot), "");
    if UrModel::by_name(draft.robot).is_some() {
        let mount = |translation: [f64; 3], roll: f64| {
            format!("{{ translation_mm = {}, rpy_rad = {} }}", list(&translation), list(&[roll, 0.0, 0.0]))
        };
        out.comment("The burr on the flange: z from the burr to the handpiece. A handpiece straight on the flange, burr 180 mm before it; measure it.");
        out.key("flange_from_burr", mount([0.0, 0.0, STRAIGHT_MM], std::f64::consts::PI), "");
        out.comment("Or bent by 30 degrees, which keeps the arm out of the surgeon's view:");
        let bent = mount([0.0, -90.0, 155.0], 150.0_f64.to_radians());
        out.comment(&format!("flange_from_burr = {bent}"));
    }
    match &draft.place {
        KnownPlace::Unknown => out.comment("base_from_ct, the registration, is left out: a place in the middle of the arm's reach is assumed, and stated in the plan."),
        KnownPlace::Registered(base_from_ct) => {
            out.key("base_from_ct", rigid(base_from_ct.rotation.matrix(), &base_from_ct.translation_mm), "");
        }
        KnownPlace::Fiducials(points) => {
            if points.len() < 3 {
                return Err(DraftError::Fiducials { found: points.len() });
            }
            let all = |point: &dyn Fn(&Vector3<f64>) -> String| {
                points.iter().map(|p| point(&p.coords)).collect::<Vec<_>>().join(", ")
            };
            out.comment("The registration by fiducials: touch them with the arm in this order, write the places in base for the zeros, and take away");
            out.comment("the `#` before the key. Until then a place is assumed.");
            let (ct, base) = (all(&vector), all(&|_| "[0, 0, 0]".into()));
            out.comment(&format!("base_from_ct = {{ fiducials = {{ ct_mm = [{ct}], base_mm = [{base}] }} }}"));
        }
    }
    Ok(())
}

/// What the user should know.
pub(super) fn notes(draft: &Draft<'_>) -> Vec<String> {
    let mut notes = Vec::new();
    for (label, role) in draft.labels.iter().zip(&draft.choice.roles) {
        match role {
            Role::Left(Meaning::Unknown | Meaning::Target) => notes.push(format!(
                "label {} is not known by its name: it is not spared; --structure spares it, --ignore silences this",
                label.described()
            )),
            Role::Empty => notes.push(format!("label {} is in no voxel: left out", label.described())),
            _ => {}
        }
    }
    if draft.choice.structures.is_empty() {
        notes.push(NOTHING_SPARED.into());
    }
    let taken = touching(draft);
    if !taken.is_empty() {
        let names: Vec<String> =
            taken.iter().map(|(label, mm)| format!("{} by {mm} mm", structure_name(label))).collect();
        notes.push(format!(
            "the target touches structures, which are taken away from it with a margin: {}",
            names.join(", ")
        ));
    }
    if draft.side.is_contradicted {
        notes.push(draft.side.reason.clone());
    }
    notes.extend(target_note(draft));
    notes
}

/// A target that is no bone by the threshold.
fn target_note(draft: &Draft<'_>) -> Option<String> {
    let TargetChoice::Label(place) = draft.choice.target else { return None };
    let hu = draft.labels.get(place)?.survey.as_ref()?.hu?;
    (hu.high_hu < DEFAULT_BONE_HU).then(|| format!(
        "95 % of the target are below {} HU, and density.bone_hu is {DEFAULT_BONE_HU}: the target holds no bone by that threshold",
        hu.high_hu
    ))
}

/// A label to be taken away from the target, and its margin, mm.
type Taken<'a> = (&'a FoundLabel, f64);

/// Structures that the target touches, which are taken away from it, each with a margin.
fn touching<'a>(draft: &Draft<'a>) -> Vec<Taken<'a>> {
    if !matches!(draft.choice.target, TargetChoice::Label(_)) {
        return vec![];
    }
    let beside = chosen(draft).into_iter().filter(|(label, _)| draft.beside_target.contains(&label.number));
    // what is left must not touch either: a voxel's diagonal apart, to a tenth
    let apart_mm = (draft.diagonal_mm * 10.0).ceil() / 10.0;
    beside.map(|(label, kind)| (label, kind.clearance_mm().max(apart_mm))).collect()
}

/// The structures by their importance.
fn chosen<'a>(draft: &Draft<'a>) -> Vec<(&'a FoundLabel, &'static super::StructureKind)> {
    let of = |place: &usize| match (draft.labels.get(*place), draft.choice.roles.get(*place)) {
        (Some(label), Some(Role::Structure(kind))) => Some((label, *kind)),
        _ => None,
    };
    draft.choice.structures.iter().filter_map(of).collect()
}

/// The keys that name a label.
fn label_lines(label: &FoundLabel) -> Result<Vec<(&'static str, String)>, DraftError> {
    label.of.file().map_or(Ok(()), |file| path(file).map(|_| ()))?;
    Ok(write::label_lines(&label.of))
}

/// A label's number and figures.
fn figures(label: &FoundLabel) -> String {
    let is_in_map = label.of.file().is_none();
    let number = if is_in_map { format!("label {}: ", label.number) } else { String::new() };
    number + &volume(label)
}

/// A label's volume and mean.
fn volume(label: &FoundLabel) -> String {
    let hu = label.survey.as_ref().and_then(|survey| survey.hu);
    let hu = hu.map_or("beyond the CT".into(), |hu| format!("mean {:.0} HU", hu.mean_hu));
    let voxels = label.survey.as_ref().map(|survey| format!("{:.1} mm³, {hu}", survey.volume_mm3));
    voxels.unwrap_or_else(|| "no voxel".into())
}

fn path(path: &Path) -> Result<String, DraftError> {
    path.to_str().map(text).ok_or_else(|| DraftError::Path { path: path.into() })
}

/// Lines of the file.
struct Lines(String);

impl Lines {
    fn blank(&mut self) {
        self.0.push('\n');
    }

    fn table(&mut self, head: &str) {
        self.blank();
        self.line(head, "");
    }

    /// The keys that name a label, with a comment to the first.
    fn label(&mut self, label: &FoundLabel, comment: &str) -> Result<(), DraftError> {
        for (n, (key, value)) in label_lines(label)?.into_iter().enumerate() {
            self.key(key, value, if n == 0 { comment } else { "" });
        }
        Ok(())
    }

    fn key(&mut self, key: &str, value: String, comment: &str) {
        self.line(&format!("{key} = {value}"), comment);
    }

    fn line(&mut self, line: &str, comment: &str) {
        self.0.push_str(line);
        if !comment.is_empty() {
            // writing to a string does not fail
            let _ = write!(
                self.0,
                "{} # {}",
                " ".repeat(COMMENT.saturating_sub(line.chars().count() + 1)),
                harmless(comment)
            );
        }
        self.blank();
    }

    fn comment(&mut self, comment: &str) {
        self.0.push_str("# ");
        self.0.push_str(&harmless(comment));
        self.blank();
    }
}

/// A comment without characters that end its line.
fn harmless(comment: &str) -> String {
    comment.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}
