//! From text to a [`Case`]: every key by itself, defaults included. Relations between keys are judged afterwards.

use std::path::{Path, PathBuf};

use bonemill_imaging::DensityTable;
use nalgebra::Vector3;
use toml::de::DeTable;

use super::error::{CaseError, CaseFault, Located};
use super::hold::read_holds;
use super::keys::{self as k, Fallback, Number, Other, name_of};
use super::parse_channel::read_channel;
use super::parse_label::{LABEL_KEYS, read_segment};
use super::parse_robot::read_robot;
use super::parse_tool::{read_edge_material, read_tool};
use super::relations;
use super::room::read_obstacles;
use super::walker::{Log, Walk, line_at};
use super::{
    Accuracy, Burr, Case, CostSpec, Density, DistanceCurve, Entry, Given, GridSpec, Images, Job, LabelRef,
    Level, MaterialSpec, Measure, OrientationMode, OrientationSpec, PathSpec, Pattern, RegistrationSpec,
    ShankSegment, SpeedCaps, SpeedSpec, Structure, Target, TargetRegion,
};
use crate::{EdgeMaterial, Sheets};

/// HU and g/cm³ of the default calibration curve. Assumed.
const DEFAULT_TABLE: ([f64; 7], [f64; 7]) = (
    [-1000.0, -400.0, -150.0, 100.0, 300.0, 2000.0, 4927.0],
    [0.01, 0.602, 0.924, 1.075, 1.145, 1.856, 3.379],
);

/// Length and radius of the default shank's cylinders, mm. Assumed.
const DEFAULT_SHANK: [[f64; 2]; 2] = [[25.0, 1.1], [60.0, 6.0]];

/// D IV: peak force of the third trial.
const DEFAULT_FORCE_CAP_N: f64 = 1.7;
/// D IV: peak force toward the nerve within 2 mm in the third trial; the rise beyond is assumed.
const DEFAULT_TOWARD_CAP_N: [[f64; 2]; 2] = [[2.0, 0.8], [6.0, 1.7]];
/// The arm with one tilt.
pub(super) const BONE_ATTACHED: &str = "bone-attached";

impl Case {
    /// The case in `text`; `source` names the file in messages. No file is touched.
    ///
    /// # Errors
    /// [`CaseError`] with every fault: not TOML, unknown or missing keys, wrong types and units, numbers that are not
    /// finite or not plausible, and, if there is none of these, keys that contradict each other.
    pub fn parse(text: &str, source: &Path) -> Result<Self, CaseError> {
        let fail = |faults| CaseError { file: source.to_path_buf(), faults };
        let table = DeTable::parse(text).map_err(|e| fail(vec![syntax(text, &e)]))?;
        Self::from_table(text, table.get_ref(), "").map_err(fail)
    }

    /// The case in a table of a larger file, e.g. `[case]` of a plan; `path` is the table's.
    pub fn from_table(text: &str, table: &DeTable<'_>, path: &str) -> Result<Self, Vec<Located>> {
        let log = Log::new(text);
        let mut case = read(&log, table, path);
        case.given = log.given().into_iter().collect();
        if log.is_clean() {
            relations::judge(&case, &|fault, key| log.note(line_of(text, table, key), fault), &|key| {
                line_of(text, table, key).is_none()
            });
        }
        if log.is_clean() { Ok(case) } else { Err(log.into_faults()) }
    }

    /// Line, from 1, of a key such as `structure[2].label` in a case's text, for faults that only the images show.
    pub fn line_of(text: &str, key: &str) -> Option<usize> {
        line_of(text, DeTable::parse(text).ok()?.get_ref(), key)
    }
}

/// What is wrong with a text that is no TOML, and on which line.
pub fn syntax(text: &str, error: &toml::de::Error) -> Located {
    let line = error.span().map(|span| line_at(text, span.start));
    Located { line, fault: CaseFault::Syntax { message: error.message().replace('\n', "; ") } }
}

fn line_of(text: &str, table: &DeTable<'_>, key: &str) -> Option<usize> {
    let mut table = Some(table);
    let mut line = None;
    for part in key.split('.') {
        let (name, index) = match part.split_once('[') {
            Some((name, rest)) => (name, rest.trim_end_matches(']').parse::<usize>().ok()),
            None => (part, None),
        };
        let (key, value) = table?.get_key_value(name)?;
        line = Some(line_at(text, key.span().start));
        let value = match index {
            Some(index) => {
                let item = value.get_ref().as_array()?.get(index)?;
                line = Some(line_at(text, item.span().start));
                item
            }
            None => value,
        };
        table = value.get_ref().as_table();
    }
    line
}

fn read(log: &Log<'_>, table: &DeTable<'_>, path: &str) -> Case {
    let root = Walk::root(log, table, path);
    let paper = root.choice(&k::PRESET, false);
    let burr = read_burr(root.table("burr"));
    let tool = read_tool(&root);
    let (material, edge_material) = read_material(root.table("material"), paper);
    let robot = read_robot(root.table("robot"));
    let accuracy = Accuracy::read(root.table("accuracy"));
    let radius_mm = burr.radius_mm;
    let (path, job) = read_path(root.table("path"), radius_mm, accuracy.level, paper);
    let (target, [also, less], least_share) = match &job {
        Job::Bone => read_target(root.table("target")),
        Job::Channel(_) => {
            refuse_bone_tables(&root);
            (Target::Swept, [vec![], vec![]], 1.0)
        }
    };
    let mut case = Case {
        paper,
        job,
        images: read_images(root.table("images")),
        density: read_density(log, root.table("density")),
        sheets: match target {
            Target::Swept => Sheets::Keep,
            _ => root.table("target").choice(&k::SHEETS, Sheets::Keep),
        },
        target,
        also,
        less,
        least_share,
        structures: read_structures(&root),
        obstacles: read_obstacles(&root),
        holds: read_holds(&root),
        approach: read_approach(root.table("approach")),
        shank: read_shank(root.table("shank")),
        material,
        edge_material,
        tool,
        path,
        cost: read_cost(root.table("cost"), paper),
        orientation: read_orientation(root.table("orientation"), paper, &robot.model),
        speed: read_speed(root.table("speed"), paper),
        robot,
        registration: read_registration_spec(root.table("registration")),
        grid: read_grid(root.table("grid"), accuracy.level, radius_mm),
        accuracy,
        burr,
        given: Given::default(),
    };
    if case.images.labels.as_os_str().is_empty() && !root.table("images").has("labels") {
        match first_file(&case) {
            Some(path) => case.images.labels = path,
            None => root.table("images").refuse_missing(&k::LABELS),
        }
    }
    root.finish();
    case
}

/// The file on whose grid a case without a label map is planned: the first, where every label is in one.
fn first_file(case: &Case) -> Option<PathBuf> {
    let in_map = |entry: &Entry| matches!(entry, Entry::Label(_));
    if case.job.channel().is_some_and(|channel| in_map(&channel.entry)) {
        return None;
    }
    let files: Option<Vec<_>> = case.labels().iter().map(|(_, label)| label.file()).collect();
    files?.first().map(|path| path.to_path_buf())
}

fn read_images(t: Walk<'_, '_>) -> Images {
    let images = Images {
        ct: PathBuf::from(t.required_text(&k::CT)),
        labels: PathBuf::from(t.text(&k::LABELS).unwrap_or_default()),
        ct_series: t.text(&k::CT_SERIES).map(|text| bonemill_imaging::series_name(&text)),
        ct_affine: t.choice(&k::CT_AFFINE, bonemill_imaging::AffineChoice::Auto),
        labels_affine: t.choice(&k::LABELS_AFFINE, bonemill_imaging::AffineChoice::Auto),
    };
    t.finish();
    images
}

fn read_density(log: &Log<'_>, t: Walk<'_, '_>) -> Density {
    let hu = t.list(&k::TABLE_HU);
    let g_cm3 = t.list(&k::TABLE_G_CM3);
    // one without the other is as wrong as a table of unequal lengths
    for (here, there) in [("hu", "g_cm3"), ("g_cm3", "hu")] {
        if t.has(here) && !t.has(there) {
            let expected = format!("as many numbers as `density.{here}` has");
            t.note(here, CaseFault::Missing { key: t.key(there), expected });
        }
    }
    let (hu, g_cm3) = match (hu, g_cm3) {
        (Some(hu), Some(g_cm3)) => (hu, g_cm3),
        _ => (DEFAULT_TABLE.0.to_vec(), DEFAULT_TABLE.1.to_vec()),
    };
    let table = DensityTable::new(&hu, &g_cm3).unwrap_or_else(|problem| {
        log.note(t.line("hu"), CaseFault::DensityTable { problem });
        harmless_table()
    });
    let density = Density { table, air_hu: t.number(&k::AIR_HU), bone_hu: t.number(&k::BONE_HU) };
    t.finish();
    density
}

/// Stands in for a table that was refused, in a case that is thrown away.
fn harmless_table() -> DensityTable {
    #[expect(clippy::expect_used, reason = "two fixed rising points are a table")]
    DensityTable::new(&[-1000.0, 1000.0], &[0.0, 1.0]).expect("a table")
}

/// The target, what it takes in besides and what is taken away, and the least share of it.
fn read_target(t: Walk<'_, '_>) -> (Target, [Vec<TargetRegion>; 2], f64) {
    let least_share = t.number(&k::LEAST_SHARE);
    let regions = [&k::TARGET_ALSO, &k::TARGET_LESS].map(|of| read_regions(&t, of));
    t.accept(&["sheets"]);
    (read_place(t), regions, least_share)
}

fn read_regions(t: &Walk<'_, '_>, of: &Other) -> Vec<TargetRegion> {
    let tables = if t.has(name_of(of.path)) { t.tables(of) } else { None };
    let region = |t: Walk<'_, '_>| {
        let margin_mm = t.number(&k::REGION_MARGIN);
        TargetRegion { of: read_place(t), margin_mm }
    };
    tables.unwrap_or_default().into_iter().map(region).collect()
}

/// A label or a shape; the table's other keys were read before.
fn read_place(t: Walk<'_, '_>) -> Target {
    let options = vec!["label", "file", "box", "ball", "frustum"];
    let label = LABEL_KEYS.into_iter().find(|key| t.has(key));
    let shapes = ["box", "ball", "frustum"].into_iter().filter(|shape| t.has(shape));
    let found: Vec<_> = label.into_iter().chain(shapes).collect();
    let (label, r#box, ball, frustum) = (
        label.map(|_| read_segment(&t, &k::TARGET_LABEL)),
        t.table("box"),
        t.table("ball"),
        t.table("frustum"),
    );
    let target = match (label, found.as_slice()) {
        (Some(label), [_]) => Target::Label(label),
        (None, ["box"]) => Target::Box {
            min_mm: r#box.required_vector(&k::BOX_MIN),
            max_mm: r#box.required_vector(&k::BOX_MAX),
        },
        (None, ["ball"]) => Target::Ball {
            center_mm: ball.required_vector(&k::BALL_CENTER),
            radius_mm: ball.number(&k::BALL_RADIUS),
        },
        (None, ["frustum"]) => Target::Frustum {
            from_mm: frustum.required_vector(&k::FRUSTUM_FROM),
            to_mm: frustum.required_vector(&k::FRUSTUM_TO),
            from_radius_mm: frustum.number(&k::FRUSTUM_FROM_RADIUS),
            to_radius_mm: frustum.number(&k::FRUSTUM_TO_RADIUS),
        },
        _ => {
            // the parts of a choice that is refused as a whole are not judged
            t.note("", CaseFault::ExactlyOne { table: t.path().into(), found, options });
            t.accept(&LABEL_KEYS);
            t.finish();
            return Target::Label(LabelRef::Number(1));
        }
    };
    for part in [r#box, ball, frustum] {
        part.finish();
    }
    t.accept(&LABEL_KEYS);
    t.finish();
    target
}

fn read_structures(root: &Walk<'_, '_>) -> Vec<Structure> {
    let tables = root.tables(&k::STRUCTURE).unwrap_or_default();
    tables.into_iter().enumerate().map(|(n, t)| read_structure(t, n)).collect()
}

fn read_structure(t: Walk<'_, '_>, place: usize) -> Structure {
    let name = t.required_text(&k::STRUCTURE_NAME);
    if name.contains([',', '"', '\'']) || name.chars().any(char::is_control) {
        t.note("name", CaseFault::Name { key: t.key("name"), found: name.clone() });
    }
    let structure = Structure {
        name,
        label: read_segment(&t, &k::STRUCTURE_LABEL),
        clearance_mm: t.number(&k::CLEARANCE),
        priority: t.whole(&k::PRIORITY, u32::try_from(place + 1).unwrap_or(u32::MAX)),
        shank_clearance_mm: t.number(&k::SHANK_CLEARANCE),
    };
    t.finish();
    structure
}

fn read_approach(t: Walk<'_, '_>) -> Option<Vector3<f64>> {
    let direction = t.vector(&k::DIRECTION);
    let unit = direction.and_then(|d| {
        let norm = d.norm();
        if norm < 1e-9 {
            t.note("direction", CaseFault::ZeroDirection { key: t.key("direction") });
            return None;
        }
        // a unit vector stays as it is, so that a written case reads back bit for bit
        Some(if (norm - 1.0).abs() < 1e-14 { d } else { d / norm })
    });
    t.finish();
    unit
}

fn read_burr(t: Walk<'_, '_>) -> Burr {
    let spin = t.number(&k::SPIN);
    if spin.abs() != 1.0 {
        let found = format!("the number {spin}");
        t.note("spin", CaseFault::WrongType { key: t.key("spin"), found, expected: "-1 or 1".into() });
    }
    let burr = Burr {
        radius_mm: t.number(&k::RADIUS),
        flutes: t.whole(&k::FLUTES, whole_default(&k::FLUTES)),
        spindle_rpm: t.number(&k::RPM),
        spin: if spin > 0.0 { 1 } else { -1 },
        turns_both_ways: t.choice(&k::TURNS, false),
        neck_radius_mm: t.number(&k::NECK),
    };
    t.finish();
    burr
}

pub(super) fn whole_default(of: &Number) -> u32 {
    match of.default {
        Fallback::Value(v) => v as u32,
        _ => 0,
    }
}

fn read_shank(t: Walk<'_, '_>) -> Vec<ShankSegment> {
    let rows = t.rows::<2>(&k::SEGMENTS).unwrap_or_else(|| DEFAULT_SHANK.to_vec());
    if rows.is_empty() {
        let expected = "at least one [length_mm, radius_mm]".into();
        t.note("segments", CaseFault::Length { key: t.key("segments"), found: 0, expected });
    }
    t.finish();
    rows.into_iter().map(|[length_mm, radius_mm]| ShankSegment { length_mm, radius_mm }).collect()
}

/// The default coefficients hold for one length element; with the other they are scaled, see their source.
fn default_k_n_mm2(measure: Measure) -> [f64; 3] {
    match measure {
        Measure::Db => [1400.0, 840.0, 140.0],
        Measure::Dz => [2100.0, 1260.0, 210.0],
    }
}

fn read_material(t: Walk<'_, '_>, paper: bool) -> (MaterialSpec, EdgeMaterial) {
    let measure = t.choice(&k::MEASURE, if paper { Measure::Dz } else { Measure::Db });
    let [k_t, k_r, k_a] = default_k_n_mm2(measure);
    let material = MaterialSpec {
        k_n_mm2: [
            t.optional(&k::K_T).unwrap_or(k_t),
            t.optional(&k::K_R).unwrap_or(k_r),
            t.optional(&k::K_A).unwrap_or(k_a),
        ],
        k_edge_n_mm: [t.number(&k::K_TE), t.number(&k::K_RE), t.number(&k::K_AE)],
        rho_ref_g_cm3: t.number(&k::RHO_REF),
        exponent: t.number(&k::EXPONENT),
        measure,
        t0_mm: t.number(&k::T0),
    };
    let edges = read_edge_material(&t);
    t.finish();
    (material, edges)
}

/// How the path is laid, and for which kind of work.
fn read_path(t: Walk<'_, '_>, radius_mm: f64, level: Level, paper: bool) -> (PathSpec, Job) {
    let pattern = t.choice(&k::PATTERN, Pattern::Lawnmower);
    let step_mm = t.optional(&k::STEP).unwrap_or_else(|| level.within_mm(radius_mm)[1]);
    let is_bone = pattern == Pattern::Lawnmower;
    let number = |of: &Number| if is_bone { t.number(of) } else { default_of(of) };
    let path = PathSpec {
        layer_mm: number(&k::LAYER),
        stepover_mm: is_bone.then(|| t.optional(&k::STEPOVER)).flatten().unwrap_or(2.0 / 3.0 * radius_mm),
        step_mm,
        raster_rad: is_bone.then(|| t.optional(&k::RASTER)).flatten().map(f64::to_radians),
        sense: match (is_bone, paper) {
            (true, true) => t.choice(&k::SENSE, super::Sense::Both),
            (true, false) => t.choice(&k::SENSE, super::Sense::Auto),
            (false, _) => super::Sense::Auto,
        },
    };
    let job = if is_bone { Job::Bone } else { Job::Channel(read_channel(&t, pattern, step_mm)) };
    t.finish();
    (path, job)
}

/// The default of a number that has a fixed one.
fn default_of(of: &Number) -> f64 {
    match of.default {
        Fallback::Value(v) => v,
        _ => of.min,
    }
}

/// Tables that say how bone is milled in layers.
fn refuse_bone_tables(root: &Walk<'_, '_>) {
    for name in ["target", "cost", "orientation"] {
        if root.has(name) {
            let why = "a channel (path.pattern = \"plunge\" or \"ream\") is determined by [path] alone: leave the table out";
            root.note(name, CaseFault::Contradiction { key: name.into(), why });
        }
    }
    root.accept(&["target"]);
}

fn read_cost(t: Walk<'_, '_>, paper: bool) -> CostSpec {
    let cost = CostSpec {
        kappa_per_mm: t.number(&k::KAPPA),
        alpha_max: t.optional(&k::ALPHA_MAX).unwrap_or(if paper { 0.5 } else { 0.8 }),
        force: t.choice(&k::COST_FORCE, super::ForceTerm::Cutting),
        objective: t
            .choice(&k::OBJECTIVE, if paper { super::Objective::Dillon } else { super::Objective::Levels }),
        structures: t.choice(&k::COST_STRUCTURES, super::SeveralStructures::Nearest),
    };
    t.finish();
    cost
}

fn read_orientation(t: Walk<'_, '_>, paper: bool, model: &str) -> OrientationSpec {
    let default = if paper { OrientationMode::Greedy } else { OrientationMode::Optimal };
    let orientation = OrientationSpec {
        mode: t.choice(&k::ORIENTATION, default),
        angles: t.whole(&k::ANGLES, if model == BONE_ATTACHED { 1 } else { 2 }),
        tilt_limit_rad: t.number(&k::TILT_LIMIT).to_radians(),
    };
    t.finish();
    orientation
}

fn read_speed(t: Walk<'_, '_>, paper: bool) -> SpeedSpec {
    let mode =
        t.choice(&k::SPEED_MODE, if paper { super::SpeedMode::Mass } else { super::SpeedMode::LeastForce });
    let speed = SpeedSpec {
        mode,
        min_mm_s: t.number(&k::MIN_SPEED),
        max_mm_s: t.number(&k::MAX_SPEED),
        nominal_mm_s: t.number(&k::NOMINAL_SPEED),
        link_mm_s: t.number(&k::LINK_SPEED),
        total_time_s: t.optional(&k::TOTAL_TIME),
        force_room: t.number(&k::FORCE_ROOM),
        caps: read_caps(&t, mode == super::SpeedMode::ForceLimited),
    };
    t.finish();
    speed
}

/// Caps on force, D's own where the mode needs some and the case has none.
fn read_caps(t: &Walk<'_, '_>, bind: bool) -> SpeedCaps {
    let curve = t.rows::<2>(&k::TOWARD_CAP).and_then(|points| {
        let curve = DistanceCurve::new(&points);
        if curve.is_none() {
            let expected = "[[mm, N], …] with rising distances and forces that do not fall".into();
            let key = t.key(k::name_of(k::TOWARD_CAP.path));
            t.note(k::name_of(k::TOWARD_CAP.path), CaseFault::Length { key, found: points.len(), expected });
        }
        curve
    });
    SpeedCaps {
        force_n: t.optional(&k::FORCE_CAP).or(bind.then_some(DEFAULT_FORCE_CAP_N)),
        force_toward_n: curve.or_else(|| DistanceCurve::new(&DEFAULT_TOWARD_CAP_N).filter(|_| bind)),
        deflection_um: t.optional(&k::DEFLECTION_CAP),
        power_w: t.optional(&k::POWER_CAP),
        acceleration_mm_s2: t.number(&k::SPEED_ACCELERATION),
    }
}

fn read_registration_spec(t: Walk<'_, '_>) -> RegistrationSpec {
    let registration = RegistrationSpec { max_fre_mm: t.number(&k::MAX_FRE) };
    t.finish();
    registration
}

fn read_grid(t: Walk<'_, '_>, level: Level, radius_mm: f64) -> GridSpec {
    let grid = GridSpec {
        spacing_mm: t.optional(&k::SPACING).unwrap_or_else(|| level.within_mm(radius_mm)[0]),
        margin_mm: t.number(&k::MARGIN),
    };
    t.finish();
    grid
}
