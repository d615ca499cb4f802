//! What a label's usual name tells: the target, a structure and its kind, or what needs no clearance of its own.
//!
//! Case, accents, `_`, `-`, spaces and plurals do not count, and a camel's humps part words. A name that fits nothing, or both target
//! and structure, is unknown: nothing is guessed.

/// What a label's name tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Meaning {
    /// The bone to be removed.
    Target,
    /// Something to be spared.
    Structure(&'static StructureKind),
    /// Bone: kept wherever it is not target.
    Bone,
    /// Air: nothing to cut.
    Air,
    /// Soft tissue that is moved aside.
    SoftTissue,
    /// Nothing that is known.
    Unknown,
}

/// A kind of structure with the values that a case begins with.
#[derive(Debug, PartialEq, Eq)]
pub struct StructureKind {
    /// Its name.
    pub name: &'static str,
    /// Least distance of the burr's surface, µm.
    clearance_um: u32,
    /// Its place among the kinds by importance, 1 first.
    pub rank: u32,
    /// Sequences of words by which it is known, parted by `|`; `=`: the whole name.
    words: &'static str,
}

impl StructureKind {
    /// Least distance of the burr's surface, mm.
    pub fn clearance_mm(&self) -> f64 {
        f64::from(self.clearance_um) / 1000.0
    }
}

/// A structure whose kind is not known. The clearance is the key's default.
pub static OTHER: StructureKind =
    StructureKind { name: "structure", clearance_um: 1000, rank: 16, words: "" };

/// Kinds in the order in which names are compared: those of several words before those of one. Clearances and ranks of the facial
/// nerve, labyrinth, sigmoid sinus, dura and ear canal are those of the temporal phantom; of the rest assumed: the key's default of
/// 1 mm, or 0.5 mm for what lies in or at the cavity by its nature.
static KINDS: [StructureKind; 15] = [
    kind(
        "facial nerve",
        1000,
        1,
        "facial nerve|facial canal|fallopian canal|nerve vii|vii nerve|cn vii|cn7|=facial|=facialis|=fn|=n7",
    ),
    kind("chorda tympani", 500, 9, "chorda"),
    kind("internal auditory canal", 1000, 3, "internal auditory|internal acoustic|iac|iam"),
    kind(
        "vestibulocochlear nerve",
        1000,
        3,
        "vestibular nerve|cochlear nerve|vestibulocochlear nerve|auditory nerve|nerve viii|cn viii|cn8",
    ),
    kind(
        "labyrinth",
        1000,
        2,
        "labyrinth|inner ear|cochlea|vestibule|semicircular|otic capsule|vestibular aqueduct|cochlear aqueduct|endolymphatic|=scc|=lscc|=pscc|=sscc",
    ),
    kind("sigmoid sinus", 500, 5, "sigmoid|transverse sinus|lateral sinus|venous sinus|dural sinus"),
    kind("dura", 500, 7, "dura|meninges|sinus and dura"),
    kind("tegmen", 500, 7, "tegmen"),
    kind("carotid", 1000, 4, "carotid|ica"),
    kind("jugular", 500, 6, "jugular"),
    kind("ossicles", 500, 10, "ossicle|ossicular|malleus|incus|stapes"),
    kind(
        "ear canal",
        500,
        11,
        "ear canal|auditory canal|auditory meatus|acoustic meatus|acoustic canal|eac|eam|tympanic membrane|eardrum|ear drum",
    ),
    kind("brain", 1000, 8, "brain|brainstem|cerebellum|cerebrum|temporal lobe|spinal cord"),
    kind("eye", 1000, 12, "eye|eyeball|globe|orbit|optic"),
    kind("nerve or vessel", 1000, 13, "nerve|artery|vein|vessel|aorta"),
];

const fn kind(name: &'static str, clearance_um: u32, rank: u32, words: &'static str) -> StructureKind {
    StructureKind { name, clearance_um, rank, words }
}

/// The target. A cavity by itself may be the nose's or a joint's, so that its other words must say more.
const TARGETS: &str = "target|resection|mastoidectomy|drill|drilled|drilling|to remove|to be removed|removal|milling|milled|=cavity|surgical cavity|planned cavity|mastoid cavity|bone cavity|cavity plan";
/// Words beside those of a target that turn its meaning.
const REFUSALS: &str = "no|not|non|keep|avoid|spare|outside|without";
/// Bone, by the names of TotalSegmentator and others.
const BONES: &str = "bone|bony|skull|cranium|calvaria|mandible|maxilla|=mastoid|tooth|teeth|vertebra|vertebrae|vertebral column|rib|clavicle|clavicula|scapula|humerus|sternum|sacrum|hip|pelvis|femur|tibia|fibula|patella|=foam";
/// Air.
const AIRS: &str = "air|mastoid cell|airway|nasal cavity|oral cavity|tympanic cavity|middle ear|maxillary sinus|sinus maxillary|frontal sinus|sinus frontal|sphenoid sinus|ethmoid|paranasal|trachea";
/// Soft tissue, and what holds a whole body part.
const SOFT: &str = "soft tissue|skin|face|fat|muscle|mucosa|=head|=body|=background|=tissue";

/// A side of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// −x in RAS+.
    Left,
    /// +x.
    Right,
}

impl Side {
    /// `left` or `right`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }
}

/// What a name tells.
pub fn meaning(name: &str) -> Meaning {
    let words: Vec<String> = words(name).into_iter().filter(|word| side_of(word).is_none()).collect();
    let holds = |list: &str| list.split('|').any(|phrase| contains(&words, phrase));
    let is_target = holds(TARGETS);
    let structure = KINDS.iter().find(|kind| holds(kind.words));
    match (is_target, structure) {
        (true, Some(_)) => Meaning::Unknown,
        (true, None) if holds(REFUSALS) => Meaning::Unknown,
        (true, None) => Meaning::Target,
        (false, Some(_)) if holds("soft tissue") => Meaning::Unknown,
        (false, Some(kind)) => Meaning::Structure(kind),
        (false, None) if holds(AIRS) => Meaning::Air,
        (false, None) if holds(BONES) => Meaning::Bone,
        (false, None) if holds(SOFT) => Meaning::SoftTissue,
        (false, None) => Meaning::Unknown,
    }
}

/// The side that a name tells, if it tells one.
pub fn side_in(name: &str) -> Option<Side> {
    let mut sides = words(name).into_iter().filter_map(|word| side_of(&word));
    let first = sides.next()?;
    sides.all(|side| side == first).then_some(first)
}

/// Whether two names are the same but for case, accents, separators and plurals.
pub(super) fn same_name(a: &str, b: &str) -> bool {
    words(a) == words(b)
}

fn side_of(word: &str) -> Option<Side> {
    match word {
        "left" | "l" | "lt" => Some(Side::Left),
        "right" | "r" | "rt" => Some(Side::Right),
        _ => None,
    }
}

/// Whether a phrase stands among the words, also written as one word; `=`: whether it is all of them.
fn contains(words: &[String], phrase: &str) -> bool {
    let (whole, phrase) = phrase.strip_prefix('=').map_or((false, phrase), |phrase| (true, phrase));
    let wanted = self::words(phrase);
    let joined = wanted.concat();
    if whole {
        return words == wanted || words.concat() == joined;
    }
    words.windows(wanted.len()).any(|some| *some == *wanted) || (wanted.len() > 1 && words.contains(&joined))
}

/// A name's words: lower case, without accents and plurals, parted at whatever is no letter or digit, at a camel's humps, and where
/// digits follow letters of lower case.
fn words(name: &str) -> Vec<String> {
    let mut found = vec![String::new()];
    let mut before = ' ';
    for c in name.chars().map(plain) {
        let hump = c.is_uppercase() && before.is_lowercase();
        if (!c.is_alphanumeric() || hump) && found.last().is_some_and(|word| !word.is_empty()) {
            found.push(String::new());
        }
        if let Some(word) = found.last_mut().filter(|_| c.is_alphanumeric()) {
            word.extend(c.to_lowercase());
        }
        before = c;
    }
    found.retain(|word| !word.is_empty());
    found
        .iter_mut()
        .filter(|word| word.len() > 3 && word.ends_with('s'))
        .for_each(|word| word.truncate(word.len() - 1));
    found
}

/// A letter without its accent.
fn plain(c: char) -> char {
    match c {
        'á' | 'à' | 'â' | 'ä' | 'ã' | 'å' => 'a',
        'Á' | 'À' | 'Â' | 'Ä' | 'Ã' | 'Å' => 'A',
        'é' | 'è' | 'ê' | 'ë' => 'e',
        'É' | 'È' | 'Ê' | 'Ë' => 'E',
        'í' | 'ì' | 'î' | 'ï' => 'i',
        'ó' | 'ò' | 'ô' | 'ö' | 'õ' => 'o',
        'ú' | 'ù' | 'û' | 'ü' => 'u',
        'ç' => 'c',
        'ñ' => 'n',
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn usual_names_tell_their_kind() {
        for (name, expected) in [
            ("facial_nerve", "facial nerve"),
            ("Facial Nerve", "facial nerve"),
            ("FACIAL-NERVE", "facial nerve"),
            ("FacialNerve", "facial nerve"),
            ("facialnerve_left", "facial nerve"),
            ("Fácial nérve (L)", "facial nerve"),
            ("CN VII", "facial nerve"),
            ("facial", "facial nerve"),
            ("chorda_tympani", "chorda tympani"),
            ("Chorda", "chorda tympani"),
            ("sigmoid sinus right", "sigmoid sinus"),
            ("transverse_sinus", "sigmoid sinus"),
            ("dura mater", "dura"),
            ("sinus_and_dura", "dura"),
            ("tegmen tympani", "tegmen"),
            ("bony_labyrinth", "labyrinth"),
            ("Inner ear", "labyrinth"),
            ("inner_ear_left", "labyrinth"),
            ("cochlea", "labyrinth"),
            ("lateral semicircular canal", "labyrinth"),
            ("SemicircularCanals", "labyrinth"),
            ("vestibular_aqueduct", "labyrinth"),
            ("superior_vestibular_nerve", "vestibulocochlear nerve"),
            ("cochlear_nerve", "vestibulocochlear nerve"),
            ("iac", "internal auditory canal"),
            ("Internal auditory canal", "internal auditory canal"),
            ("external auditory canal", "ear canal"),
            ("external acoustic meatus", "ear canal"),
            ("auditory_canal_right", "ear canal"),
            ("EAC", "ear canal"),
            ("ear-canal", "ear canal"),
            ("malleus", "ossicles"),
            ("Incus", "ossicles"),
            ("stapes", "ossicles"),
            ("ossicles", "ossicles"),
            ("ossicular chain", "ossicles"),
            ("ICA", "carotid"),
            ("common_carotid_artery_left", "carotid"),
            ("internal_jugular_vein_right", "jugular"),
            ("jugular bulb", "jugular"),
            ("brain", "brain"),
            ("spinal_cord", "brain"),
            ("eye_left", "eye"),
            ("optic_nerve_right", "eye"),
            ("inferior alveolar nerve", "nerve or vessel"),
            ("vertebral_artery", "nerve or vessel"),
        ] {
            let Meaning::Structure(kind) = meaning(name) else { panic!("{name}: {:?}", meaning(name)) };
            assert_eq!(kind.name, expected, "{name}");
        }
    }

    #[test]
    fn a_target_is_known_and_nothing_that_only_sounds_like_one() {
        for name in [
            "target",
            "Target (right)",
            "cavity",
            "Mastoid cavity",
            "mastoidectomy_left",
            "resection",
            "drill",
            "DrillRegion",
            "bone to remove",
            "planned_cavity",
        ] {
            assert_eq!(meaning(name), Meaning::Target, "{name}");
        }
        for name in [
            "nasal_cavity_left",
            "oral cavity",
            "tympanic cavity",
            "glenoid cavity",
            "do not drill",
            "no drill zone",
            "target facial nerve",
            "Segment_1",
            "7",
            "",
            "cluster",
            "facial recess",
            "sinus",
        ] {
            assert_ne!(meaning(name), Meaning::Target, "{name}");
        }
        for name in
            ["do not drill", "target facial nerve", "Segment_1", "glenoid cavity", "tmj", "facial recess", ""]
        {
            assert_eq!(meaning(name), Meaning::Unknown, "{name}");
        }
    }

    #[test]
    fn bone_air_and_soft_tissue_need_no_clearance() {
        for (names, expected) in [
            (
                &[
                    "bone",
                    "Temporal bone",
                    "skull",
                    "mandible",
                    "vertebrae_C1",
                    "rib_left_4",
                    "lumbar vertebral column",
                    "femur_right",
                    "hip_left",
                    "mastoid",
                ][..],
                Meaning::Bone,
            ),
            (
                &["air_internal", "air_cells_derived", "sinus_maxillary", "nasal_cavity_right", "middle ear"],
                Meaning::Air,
            ),
            (&["soft_tissue", "face", "skin", "body"], Meaning::SoftTissue),
        ] {
            names.iter().for_each(|name| assert_eq!(meaning(name), expected, "{name}"));
        }
    }

    #[test]
    fn a_side_is_a_word_of_its_own() {
        for (name, side) in [
            ("facial_nerve_left", Some(Side::Left)),
            ("nerve_l", Some(Side::Left)),
            ("Left target", Some(Side::Left)),
            ("R sigmoid", Some(Side::Right)),
            ("targetRight", Some(Side::Right)),
            ("labyrinth", None),
            ("upright", None),
            ("left or right", None),
        ] {
            assert_eq!(side_in(name), side, "{name}");
        }
    }
}
