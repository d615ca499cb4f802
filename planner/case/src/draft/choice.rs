//! Which label is the target, which are spared, and which are left: by usual names, and by what the user asks for.

use super::kinds::{Meaning, OTHER, StructureKind, meaning, same_name};
use super::{DraftError, FoundLabel};
use crate::{LabelRef, Target, nearest};

/// What the user asks for; labels by their name or number.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Wishes {
    /// The target, if names are not to tell it.
    pub target: Option<TargetWish>,
    /// Further structures.
    pub structures: Vec<String>,
    /// Labels that are not to be spared, whatever their names tell.
    pub ignored: Vec<String>,
}

/// A target that the user asks for.
#[derive(Debug, Clone, PartialEq)]
pub enum TargetWish {
    /// A label by its name or number.
    Label(String),
    /// A shape.
    Shape(Target),
}

/// What a label is taken for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// What is to be removed.
    Target,
    /// What is spared.
    Structure(&'static StructureKind),
    /// Neither, by the user's word.
    Ignored,
    /// Neither, by its name, which may tell nothing.
    Left(Meaning),
    /// A name without a voxel.
    Empty,
}

impl Role {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Target => "target",
            Self::Structure(kind) => kind.name,
            Self::Ignored => "ignored: --ignore",
            Self::Left(Meaning::Bone) => "ignored: bone, kept outside the target",
            Self::Left(Meaning::Air) => "ignored: air",
            Self::Left(Meaning::SoftTissue) => "ignored: soft tissue",
            Self::Left(_) => "not known",
            Self::Empty => "no voxel",
        }
    }
}

/// The target of a choice.
#[derive(Debug, Clone, PartialEq)]
pub enum TargetChoice {
    /// The place of its label in the list.
    Label(usize),
    /// A shape.
    Shape(Target),
}

/// What every label is taken for.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// The target.
    pub target: TargetChoice,
    /// Of each label, in the order of the list.
    pub roles: Vec<Role>,
    /// Places of the structures' labels in the list, by their importance.
    pub structures: Vec<usize>,
}

const TARGET: &str = "--target";
const STRUCTURE: &str = "--structure";
const IGNORE: &str = "--ignore";

/// Chooses target and structures.
///
/// # Errors
/// [`DraftError`] when no name or several tell the target, when an option names no label, an empty one or one that has its role
/// already, and when two structures would have one name.
pub fn choose(labels: &[FoundLabel], wishes: &Wishes) -> Result<Choice, DraftError> {
    let mut given: Vec<(usize, &'static str)> = Vec::new();
    let mut take = |option: &'static str, name: &str| {
        let place = find(labels, option, name)?;
        if let Some((_, first)) = given.iter().find(|(other, _)| *other == place) {
            return Err(DraftError::Twice { name: described(labels, place), first, second: option });
        }
        given.push((place, option));
        Ok(place)
    };
    let target = match &wishes.target {
        Some(TargetWish::Label(name)) => Some(TargetChoice::Label(take(TARGET, name)?)),
        Some(TargetWish::Shape(shape)) => Some(TargetChoice::Shape(shape.clone())),
        None => None,
    };
    for name in &wishes.structures {
        take(STRUCTURE, name)?;
    }
    for name in &wishes.ignored {
        take(IGNORE, name)?;
    }
    let option_of = |place: usize| given.iter().find(|(other, _)| *other == place).map(|(_, option)| *option);
    let target = match target {
        Some(target) => target,
        None => TargetChoice::Label(named_target(labels, &option_of)?),
    };
    let role = |(place, label): (usize, &FoundLabel)| {
        role(label, option_of(place), target == TargetChoice::Label(place))
    };
    let roles: Vec<Role> = labels.iter().enumerate().map(role).collect();
    let mut structures: Vec<(u32, usize)> =
        roles.iter().enumerate().filter_map(|(place, role)| Some((rank(*role)?, place))).collect();
    structures.sort_unstable();
    let structures: Vec<usize> = structures.into_iter().map(|(_, place)| place).collect();
    names_differ(labels, &structures)?;
    Ok(Choice { target, roles, structures })
}

/// The label whose name tells the target.
fn named_target(
    labels: &[FoundLabel],
    option_of: &impl Fn(usize) -> Option<&'static str>,
) -> Result<usize, DraftError> {
    let tells = |label: &FoundLabel| {
        label.survey.is_some() && label.name.as_deref().map(meaning) == Some(Meaning::Target)
    };
    let named =
        labels.iter().enumerate().filter(|(place, label)| option_of(*place).is_none() && tells(label));
    let named: Vec<usize> = named.map(|(place, _)| place).collect();
    match named.as_slice() {
        [place] => Ok(*place),
        [] => Err(DraftError::NoTarget { labels: list(labels, 0..labels.len()) }),
        _ => Err(DraftError::SeveralTargets { names: list(labels, named.iter().copied()) }),
    }
}

fn role(label: &FoundLabel, option: Option<&'static str>, is_target: bool) -> Role {
    let told = label.name.as_deref().map_or(Meaning::Unknown, meaning);
    match (option, told) {
        _ if is_target => Role::Target,
        _ if label.survey.is_none() => Role::Empty,
        (Some(IGNORE), _) => Role::Ignored,
        (_, Meaning::Structure(kind)) => Role::Structure(kind),
        (Some(_), _) => Role::Structure(&OTHER),
        // a mask of its own is given to be spared
        (None, _) if is_mask(label) => Role::Structure(&OTHER),
        // another label is the target by the user's word: this one is told
        (None, Meaning::Target) => Role::Left(Meaning::Unknown),
        (None, other) => Role::Left(other),
    }
}

/// Whether a label is a file of its own.
fn is_mask(label: &FoundLabel) -> bool {
    matches!(label.of, LabelRef::File { label: None, .. })
}

fn rank(role: Role) -> Option<u32> {
    if let Role::Structure(kind) = role { Some(kind.rank) } else { None }
}

/// The place of the label that an option names: as it is written, by its number, or but for case, accents and separators.
fn find(labels: &[FoundLabel], option: &'static str, name: &str) -> Result<usize, DraftError> {
    let by = |is: &dyn Fn(&FoundLabel) -> bool| {
        labels.iter().enumerate().filter(|(_, label)| is(label)).map(|(place, _)| place).collect::<Vec<_>>()
    };
    let number: Option<u16> = name.parse().ok();
    let found = [
        by(&|label| label.name.as_deref() == Some(name)),
        by(&|label| number == Some(label.number)),
        by(&|label| label.name.as_deref().is_some_and(|own| same_name(own, name))),
    ];
    let found = found.into_iter().find(|places| !places.is_empty()).unwrap_or_default();
    match found.as_slice() {
        [place] if labels.get(*place).is_some_and(|label| label.survey.is_none()) => {
            Err(DraftError::Empty { option, name: described(labels, *place) })
        }
        [place] => Ok(*place),
        [] => {
            let known = labels.iter().filter_map(|label| label.name.as_deref());
            let nearest = nearest(name, known).map(str::to_owned);
            Err(DraftError::NoSuchLabel {
                option,
                name: name.into(),
                nearest,
                labels: list(labels, 0..labels.len()),
            })
        }
        several => Err(DraftError::SeveralLabels {
            option,
            name: name.into(),
            names: list(labels, several.iter().copied()),
        }),
    }
}

/// Refuses two structures of one name.
fn names_differ(labels: &[FoundLabel], structures: &[usize]) -> Result<(), DraftError> {
    let mut taken: Vec<(String, usize)> = Vec::new();
    for place in structures {
        let Some(name) = labels.get(*place).map(structure_name) else { continue };
        if let Some((_, first)) = taken.iter().find(|(other, _)| *other == name) {
            let (first, second) = (described(labels, *first), described(labels, *place));
            return Err(DraftError::NameTwice { name, first, second });
        }
        taken.push((name, *place));
    }
    Ok(())
}

/// The name of a structure in results: its label's, without what no name may hold.
pub(super) fn structure_name(label: &FoundLabel) -> String {
    let allowed = |c: char| if c.is_control() || matches!(c, ',' | '"' | '\'') { ' ' } else { c };
    let name: String = label.name.as_deref().unwrap_or_default().chars().map(allowed).collect();
    if name.trim().is_empty() { format!("label_{}", label.number) } else { name.trim().to_owned() }
}

/// Labels with their numbers and names.
fn list(labels: &[FoundLabel], places: impl Iterator<Item = usize>) -> String {
    let all: Vec<String> = places.map(|place| described(labels, place)).collect();
    if all.is_empty() { "none".into() } else { all.join(", ") }
}

/// A label in a message.
fn described(labels: &[FoundLabel], place: usize) -> String {
    labels.get(place).map(FoundLabel::described).unwrap_or_default()
}
