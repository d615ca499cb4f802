//! `plan.toml`: the resolved case, the plan's inputs, its frames, its figures and what was modelled.
//!
//! It holds no time of day, no duration of the computation and no absolute path, so that equal plans have equal bytes.

use std::path::{Path, PathBuf};

use bonemill_case::write::{list, rigid, text, vector};
use bonemill_case::{Burr, Case, CaseError, as_number, line_at, rotation_from_matrix, syntax};
use bonemill_geometry::{Approach, Base, Ct, Rigid, Work};
use nalgebra::{Matrix3, Rotation3, Vector3};
use toml::de::{DeTable, DeValue};

use super::value::{in_order, key_text};
use super::{PlanFileError, Sha256, Value, is_prosthesis};

/// The file's name in a plan's directory.
pub(super) const FILE_NAME: &str = "plan.toml";

/// Largest number of voxels of a planning grid that is read.
const MOST_VOXELS: f64 = 1e8;

/// A file that the plan was made from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Input {
    /// Path relative to the case's folder, as in the case.
    pub path: PathBuf,
    /// Digest of its bytes when the plan was made.
    pub sha256: Sha256,
    /// Number of bytes; plans of earlier versions do not record it.
    pub bytes: Option<u64>,
}

impl Input {
    /// The input as it is now; `path` is relative to `case_dir`.
    ///
    /// # Errors
    /// [`PlanFileError::Io`] when it cannot be read.
    pub fn now(case_dir: &Path, path: &Path) -> Result<Self, PlanFileError> {
        let file = case_dir.join(path);
        let sha256 = Sha256::of_file(&file)?;
        let bytes = std::fs::metadata(&file).map_err(PlanFileError::io("read", file))?.len();
        Ok(Self { path: path.into(), sha256, bytes: Some(bytes) })
    }
}

/// The figures of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Metrics {
    /// Target removed, air cells included, mm³.
    pub removed_mm3: f64,
    /// Target that the ball can reach under the clearances, mm³.
    pub reachable_mm3: f64,
    /// The whole target, mm³.
    pub target_mm3: f64,
    /// The removed part above `air_hu`, mm³.
    pub removed_material_mm3: f64,
    /// The removed part above `bone_hu`, mm³.
    pub removed_bone_mm3: f64,
    /// Duration of the whole plan, s.
    pub total_time_s: f64,
    /// Further figures in the order of the file; names end in units.
    pub more: Vec<(String, Value)>,
}

impl Metrics {
    /// The number with this name in the file.
    pub fn number(&self, name: &str) -> Option<f64> {
        self.number_at(&[name])
    }

    /// The number with this name in a table within tables, each by its name.
    pub fn number_at(&self, keys: &[&str]) -> Option<f64> {
        let within = |value: Value, key: &&str| match value {
            Value::Table(entries) => {
                entries.into_iter().find(|(name, _)| name == key).map(|(_, value)| value)
            }
            _ => None,
        };
        match keys.iter().try_fold(Value::Table(self.entries()), within)? {
            Value::Number(v) => Some(v),
            Value::Integer(count) => Some(count as f64),
            _ => None,
        }
    }

    /// All figures by name, in the order of the file.
    pub fn entries(&self) -> Vec<(String, Value)> {
        let always = [
            self.removed_mm3,
            self.reachable_mm3,
            self.target_mm3,
            self.removed_material_mm3,
            self.removed_bone_mm3,
            self.total_time_s,
        ];
        let always = REQUIRED.iter().zip(always).map(|(name, v)| ((*name).to_owned(), v.into()));
        always.chain(self.more.iter().cloned()).collect()
    }
}

/// The planning grid; every volume in the file is a number of its voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanningGrid {
    /// Voxels along x, y and z.
    pub dims: [usize; 3],
    /// Rotation of x and y about z from those of [`PlanFrames::ct_from_approach`], rad.
    pub turn_rad: f64,
}

/// The frames of a plan, and where the arm and its tool stand.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanFrames {
    /// Approach direction in ct, unit, out of the bone: given in the case, or chosen.
    pub approach_direction: Vector3<f64>,
    /// The frame of θ and φ: origin at the planning grid's first voxel centre, z along the approach, x and y derived from z. In
    /// the file it is `ct_from_work`.
    pub ct_from_approach: Rigid<Ct, Approach>,
    /// The planning grid in that frame; its spacing is the case's.
    pub grid: PlanningGrid,
    /// The registration that was used.
    pub base_from_ct: Rigid<Base, Ct>,
    /// Whether the case gave no registration, so that one was assumed.
    pub registration_assumed: bool,
    /// Burr's centre (mm) and axes (fixed-axis roll, pitch, yaw, rad) in the flange.
    pub flange_from_burr: ([f64; 3], [f64; 3]),
}

/// The contents of `plan.toml`.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanRecord {
    /// Version of the program that made the plan.
    pub version: String,
    /// The resolved case.
    pub case: Case,
    /// The case's file, relative to the plan's directory.
    pub case_file: PathBuf,
    /// Every file that the plan was made from, the case included.
    pub inputs: Vec<Input>,
    /// The frames of the plan.
    pub frames: PlanFrames,
    /// The plan's figures.
    pub metrics: Metrics,
    /// What was modelled, and the error of each approximation.
    pub modelled: Vec<(String, Value)>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
    /// Reasons why the plan falls short; empty when it does not.
    pub shortfalls: Vec<String>,
}

impl PlanFrames {
    /// The planning grid's frame in ct.
    pub fn ct_from_grid(&self) -> Rigid<Ct, Work> {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), self.grid.turn_rad);
        self.ct_from_approach * Rigid::new(turn, Vector3::zeros())
    }
}

impl PlanRecord {
    /// Writes `plan.toml` into `dir`.
    ///
    /// # Errors
    /// [`PlanFileError::NotFinite`] for a figure that is not finite, [`PlanFileError::Io`].
    pub fn write(&self, dir: &Path) -> Result<(), PlanFileError> {
        let path = dir.join(FILE_NAME);
        std::fs::write(&path, self.to_toml()?).map_err(PlanFileError::io("write", path))
    }

    /// Reads `dir/plan.toml`; its inputs are not read.
    ///
    /// # Errors
    /// [`PlanFileError::InputNotListed`] where an image or the case is not among its inputs, and other variants for faults of
    /// the file itself.
    pub fn read(dir: &Path) -> Result<Self, PlanFileError> {
        let path = dir.join(FILE_NAME);
        if !path.exists() && is_prosthesis(dir).is_ok() {
            return Err(PlanFileError::Prosthesis { path: dir.to_owned() });
        }
        let text = std::fs::read_to_string(&path).map_err(PlanFileError::io("read", &path))?;
        let record = Self::parse(&text, &path)?;
        let images = [&record.case.images.ct, &record.case.images.labels].map(PathBuf::as_path);
        for needed in images.into_iter().chain(record.case_input()) {
            // an image may be a folder, of which the files are listed
            if !record.inputs.iter().any(|input| input.path.starts_with(needed)) {
                return Err(PlanFileError::InputNotListed { path, missing: needed.display().to_string() });
            }
        }
        Ok(record)
    }

    /// A value of what was modelled, by its name.
    pub fn modelled(&self, name: &str) -> Option<&Value> {
        self.modelled.iter().find(|(key, _)| key == name).map(|(_, value)| value)
    }

    /// The burr as the plan turns it: the case's, with the spin that was chosen where the case leaves it open. Plans without a
    /// statement of it turn as their case says.
    pub fn burr(&self) -> Burr {
        let spin = match self.modelled("spin") {
            Some(Value::Integer(spin @ (-1 | 1))) => *spin as i8,
            _ => self.case.burr.spin,
        };
        Burr { spin, ..self.case.burr }
    }

    /// The path of the case's file among the inputs.
    pub fn case_input(&self) -> Option<&Path> {
        self.case_file.file_name().map(Path::new)
    }

    fn to_toml(&self) -> Result<String, PlanFileError> {
        let texts = |list: &[String]| list.iter().map(|w| format!("\n    {},", text(w))).collect::<String>();
        let given: Vec<String> = self.case.given.keys().map(text).collect();
        let frames = &self.frames;
        let (mount_mm, mount_rad) = &frames.flange_from_burr;
        let mut out = format!(
            "# A plan by bonemill. The case below is resolved: every default is spelled out; case_given are the keys that its file gives.\n\
             version = {}\ncase_file = {}\ncase_given = [{}]\nwarnings = [{}]\nshortfalls = [{}]\n\n\
             [frames]\napproach_direction = {}\nct_from_work = {}\n\
             grid = {{ dims = {}, turn_rad = {:?} }}\nbase_from_ct = {}\nregistration = \"{}\"\n\
             flange_from_burr = {{ translation_mm = {}, rpy_rad = {} }}\n\n[inputs]\n",
            text(&self.version),
            text(&slashes(&self.case_file)),
            given.join(", "),
            texts(&self.warnings),
            texts(&self.shortfalls),
            vector(&frames.approach_direction),
            rigid(frames.ct_from_approach.rotation.matrix(), &frames.ct_from_approach.translation_mm),
            format_args!("{:?}", frames.grid.dims),
            frames.grid.turn_rad,
            rigid(frames.base_from_ct.rotation.matrix(), &frames.base_from_ct.translation_mm),
            if frames.registration_assumed { "assumed" } else { "case" },
            list(mount_mm),
            list(mount_rad),
        );
        for input in &self.inputs {
            out += &format!("{} = \"{}\"\n", text(&slashes(&input.path)), input.sha256);
        }
        out += "\n[input_bytes]\n";
        for (input, bytes) in self.inputs.iter().filter_map(|input| Some((input, input.bytes?))) {
            out += &format!("{} = {bytes}\n", text(&slashes(&input.path)));
        }
        out += "\n[metrics]\n";
        push_values(&mut out, &self.metrics.entries())?;
        out += "\n[modelled]\n";
        push_values(&mut out, &self.modelled)?;
        out.push('\n');
        Ok(out + &self.case.to_toml_under("case"))
    }

    fn parse(text: &str, path: &Path) -> Result<Self, PlanFileError> {
        let fail = |faults| CaseError { file: path.into(), faults };
        let root = DeTable::parse(text).map_err(|e| fail(vec![syntax(text, &e)]))?;
        let reader = Reader { path, text, root: root.get_ref() };
        let case_table = reader.table("case")?;
        let mut case = Case::from_table(text, case_table, "case").map_err(fail)?;
        // the resolved case holds every key; a separate list tells which of them the case file gave
        case.given = reader.texts("case_given")?.into_iter().collect();
        let entries = |name| -> Result<Vec<(String, Value)>, PlanFileError> {
            let values = in_order(reader.table(name)?).map(|(key, v)| Value::from_toml(v).map(|v| (key, v)));
            values
                .collect::<Option<_>>()
                .ok_or_else(|| reader.refuse(name, "finite numbers, texts, lists, tables"))
        };
        Ok(Self {
            version: reader.text("version")?,
            case,
            case_file: PathBuf::from(reader.text("case_file")?),
            inputs: reader.inputs()?,
            frames: reader.frames()?,
            metrics: reader.metrics(entries("metrics")?)?,
            modelled: entries("modelled")?,
            warnings: reader.texts("warnings")?,
            shortfalls: reader.texts("shortfalls")?,
        })
    }
}

/// Checks that `dir` holds a `plan.toml` of this program; `Err` says why not.
pub(super) fn is_plan(dir: &Path) -> Result<(), String> {
    let path = dir.join(FILE_NAME);
    let Ok(text) = std::fs::read_to_string(&path) else {
        return Err(format!("it has no readable {FILE_NAME}"));
    };
    PlanRecord::parse(&text, &path).map(drop).map_err(|_| format!("its {FILE_NAME} is not one of ours"))
}

/// Names of the figures that every plan has, in the order of the file.
const REQUIRED: [&str; 6] = [
    "removed_mm3",
    "reachable_mm3",
    "target_mm3",
    "removed_material_mm3",
    "removed_bone_mm3",
    "total_time_s",
];

fn push_values(out: &mut String, values: &[(String, Value)]) -> Result<(), PlanFileError> {
    for (key, value) in values {
        *out += &format!("{} = {}\n", key_text(key), value.to_toml(key)?);
    }
    Ok(())
}

/// A path with forward slashes, so that the file is the same on every system.
fn slashes(path: &Path) -> String {
    path.to_string_lossy().replace(std::path::MAIN_SEPARATOR, "/")
}

/// Typed access to the parsed file.
struct Reader<'a, 'i> {
    path: &'a Path,
    text: &'a str,
    root: &'a DeTable<'i>,
}

impl<'a, 'i> Reader<'a, 'i> {
    fn get(&self, key: &str) -> Option<&'a DeValue<'i>> {
        let mut table = Some(self.root);
        let mut value = None;
        for part in key.split('.') {
            value = table?.get(part).map(|v| v.get_ref());
            table = value.and_then(DeValue::as_table);
        }
        value
    }

    fn refuse(&self, key: &str, expected: &'static str) -> PlanFileError {
        let top = key.split('.').next().unwrap_or(key);
        let line = self.root.get_key_value(top).map(|(k, _)| line_at(self.text, k.span().start));
        PlanFileError::Record { path: self.path.into(), line, key: key.into(), expected }
    }

    fn table(&self, key: &str) -> Result<&'a DeTable<'i>, PlanFileError> {
        self.get(key).and_then(DeValue::as_table).ok_or_else(|| self.refuse(key, "a table"))
    }

    fn frames(&self) -> Result<PlanFrames, PlanFileError> {
        Ok(PlanFrames {
            approach_direction: Vector3::from(self.three("frames.approach_direction")?),
            ct_from_approach: self.rigid("frames.ct_from_work")?,
            grid: self.grid()?,
            base_from_ct: self.rigid("frames.base_from_ct")?,
            registration_assumed: match self.text("frames.registration")?.as_str() {
                "assumed" => true,
                "case" => false,
                _ => return Err(self.refuse("frames.registration", "\"assumed\" or \"case\"")),
            },
            flange_from_burr: (
                self.three("frames.flange_from_burr.translation_mm")?,
                self.three("frames.flange_from_burr.rpy_rad")?,
            ),
        })
    }

    fn text(&self, key: &str) -> Result<String, PlanFileError> {
        self.get(key).and_then(DeValue::as_str).map(Into::into).ok_or_else(|| self.refuse(key, "a text"))
    }

    fn texts(&self, key: &str) -> Result<Vec<String>, PlanFileError> {
        let texts = self.get(key).and_then(DeValue::as_array).and_then(|items| {
            items.iter().map(|v| v.get_ref().as_str().map(Into::into)).collect::<Option<Vec<String>>>()
        });
        texts.ok_or_else(|| self.refuse(key, "a list of texts"))
    }

    fn three(&self, key: &str) -> Result<[f64; 3], PlanFileError> {
        self.get(key).and_then(three).ok_or_else(|| self.refuse(key, "three finite numbers"))
    }

    fn rigid<A: bonemill_geometry::Frame, B: bonemill_geometry::Frame>(
        &self,
        key: &str,
    ) -> Result<Rigid<A, B>, PlanFileError> {
        let rotation = self.rotation(&format!("{key}.rotation"));
        let rotation = rotation.ok_or_else(|| self.refuse(key, "a rotation, by rows"))?;
        Ok(Rigid::new(rotation, Vector3::from(self.three(&format!("{key}.translation_mm"))?)))
    }

    fn grid(&self) -> Result<PlanningGrid, PlanFileError> {
        let dims = self.get("frames.grid.dims").and_then(three).filter(|dims| {
            dims.iter().all(|d| *d >= 1.0 && d.fract() == 0.0) && dims.iter().product::<f64>() <= MOST_VOXELS
        });
        let turn_rad = self.get("frames.grid.turn_rad").and_then(as_number).filter(|v| v.is_finite());
        Ok(PlanningGrid {
            dims: dims
                .ok_or_else(|| self.refuse("frames.grid.dims", "three whole numbers, at most 1e8 voxels"))?
                .map(|d| d as usize),
            turn_rad: turn_rad.ok_or_else(|| self.refuse("frames.grid.turn_rad", "a finite number"))?,
        })
    }

    fn rotation(&self, key: &str) -> Option<Rotation3<f64>> {
        let rows = self.get(key)?.as_array()?;
        let rows: Vec<[f64; 3]> = rows.iter().map(|row| three(row.get_ref())).collect::<Option<_>>()?;
        let [a, b, c] = <[[f64; 3]; 3]>::try_from(rows).ok()?;
        rotation_from_matrix(&Matrix3::from_rows(&[a.into(), b.into(), c.into()])).ok()
    }

    fn inputs(&self) -> Result<Vec<Input>, PlanFileError> {
        let sizes = self.get("input_bytes").and_then(DeValue::as_table);
        let input = |(path, digest): (String, &DeValue<'_>)| {
            let sha256 = digest.as_str().and_then(|text| text.parse().ok());
            let sha256 =
                sha256.ok_or_else(|| self.refuse("inputs", "64 hexadecimal digits for every path"))?;
            let bytes = sizes.and_then(|sizes| as_number(sizes.get(path.as_str())?.get_ref()));
            Ok(Input { path: path.into(), sha256, bytes: bytes.filter(|n| *n >= 0.0).map(|n| n as u64) })
        };
        in_order(self.table("inputs")?).map(input).collect()
    }

    fn metrics(&self, entries: Vec<(String, Value)>) -> Result<Metrics, PlanFileError> {
        let number = |key: &str| match entries.iter().find(|(k, _)| k == key) {
            Some((_, Value::Number(v))) => Ok(*v),
            _ => Err(self.refuse(&format!("metrics.{key}"), "a finite number")),
        };
        let [removed, reachable, target, material, bone, time] = REQUIRED;
        Ok(Metrics {
            removed_mm3: number(removed)?,
            reachable_mm3: number(reachable)?,
            target_mm3: number(target)?,
            removed_material_mm3: number(material)?,
            removed_bone_mm3: number(bone)?,
            total_time_s: number(time)?,
            more: entries.iter().filter(|(key, _)| !REQUIRED.contains(&key.as_str())).cloned().collect(),
        })
    }
}

fn three(value: &DeValue<'_>) -> Option<[f64; 3]> {
    let numbers = value.as_array()?.iter().map(|v| as_number(v.get_ref()).filter(|v| v.is_finite()));
    <[f64; 3]>::try_from(numbers.collect::<Option<Vec<_>>>()?).ok()
}

#[cfg(test)]
#[path = "record_tests.rs"]
pub(super) mod tests;
