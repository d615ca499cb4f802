//! Left or right: by names, and by where the target lies in a scan that holds both sides.

use super::choice::{Choice, TargetChoice};
use super::kinds::{Side, side_in};
use super::{FoundLabel, Role};
use crate::Target;

/// Bone that reaches this far from left to right belongs to both sides, mm: a skull is 120 to 160 mm wide at the ears, the field of view
/// of one temporal bone 60 to 100 mm. Assumed.
const BOTH_SIDES_MM: f64 = 110.0;
/// A target this far from the middle lies on a side, as a share of the bone's width. Assumed.
const OFF_MIDDLE_SHARE: f64 = 0.15;

/// Which side a case is on, and how that is known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SideFound {
    /// The side; `None` where it is not certain.
    pub side: Option<Side>,
    /// How it is known, or why not.
    pub reason: String,
    /// Whether names and places contradict each other.
    pub is_contradicted: bool,
}

/// The side of the target; `bone_x_mm`: from where to where bone reaches in x, ct.
pub fn side(labels: &[FoundLabel], choice: &Choice, bone_x_mm: Option<[f64; 2]>) -> SideFound {
    let named = named(labels, choice);
    let lies = lies(labels, choice, bone_x_mm);
    match (named, lies) {
        (Some((name, by)), Some(lies)) if name != lies => SideFound {
            side: None,
            reason: format!(
                "{by} says {}, but the target lies on the scan's {} side: one of the two is wrong, or the images are mirrored",
                name.word(),
                lies.word()
            ),
            is_contradicted: true,
        },
        (Some((side, by)), _) => found(side, format!("{by} says so")),
        (None, Some(side)) => found(side, "the target lies on that side of a scan that holds both".into()),
        (None, None) => SideFound {
            side: None,
            reason:
                "no name says it, and the scan does not hold both sides, or the target lies in its middle"
                    .into(),
            is_contradicted: false,
        },
    }
}

fn found(side: Side, reason: String) -> SideFound {
    SideFound { side: Some(side), reason, is_contradicted: false }
}

/// The side by the target's name, else by those of the structures where they agree, and whose name it is.
fn named(labels: &[FoundLabel], choice: &Choice) -> Option<(Side, String)> {
    let of = |role: fn(&Role) -> bool| {
        let chosen = labels.iter().zip(&choice.roles).filter(move |(_, r)| role(r));
        chosen.filter_map(|(label, _)| Some((side_in(label.name.as_deref()?)?, label.called())))
    };
    if let Some((side, name)) = of(|role| *role == Role::Target).next() {
        return Some((side, format!("the target's name {name:?}")));
    }
    let mut structures = of(|role| matches!(role, Role::Structure(_)));
    let (side, name) = structures.next()?;
    structures.all(|(other, _)| other == side).then(|| (side, format!("the structure's name {name:?}")))
}

/// The side by where the target's middle lies.
fn lies(labels: &[FoundLabel], choice: &Choice, bone_x_mm: Option<[f64; 2]>) -> Option<Side> {
    let [low, high] = bone_x_mm.filter(|[low, high]| high - low >= BOTH_SIDES_MM)?;
    let x_mm = match choice.target {
        TargetChoice::Label(place) => labels.get(place)?.survey.as_ref()?.center.coords.x,
        TargetChoice::Shape(ref shape) => middle_x_mm(shape)?,
    };
    let off_mm = x_mm - 0.5 * (low + high);
    let is_off = off_mm.abs() >= OFF_MIDDLE_SHARE * (high - low);
    is_off.then_some(if off_mm > 0.0 { Side::Right } else { Side::Left })
}

/// Where the middle of a shape lies in x, ct.
fn middle_x_mm(shape: &Target) -> Option<f64> {
    match shape {
        Target::Label(_) | Target::Swept => None,
        Target::Box { min_mm: a, max_mm: b } | Target::Frustum { from_mm: a, to_mm: b, .. } => {
            Some(0.5 * (a.x + b.x))
        }
        Target::Ball { center_mm, .. } => Some(center_mm.x),
    }
}
