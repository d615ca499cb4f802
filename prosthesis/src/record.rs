//! `job.toml`: the resolved job, what it was made from, how the part lies in which block, and the figures.
//!
//! The job's own tables stand first, so that the file is a job again; all else is below `[result]`. Its last line is a digest of all lines above it. What was
//! asked for no file can tell again, such as a side load that was raised later: [`made_for`] stands in the program, too.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use crate::machining::Block;
use bonemill_case::prosthesis::{BlockSource, ProsthesisJob};
use bonemill_case::write::{list, rigid, text, vector};
use bonemill_case::{as_number, rotation_from_matrix};
use bonemill_geometry::{Block as BlockFrame, Part, Rigid};
use bonemill_planfile::{PROSTHESIS_HEADER, PlanFileError, Sha256, Value};
use nalgebra::{Matrix3, Vector3};
use toml::de::{DeTable, DeValue};

use crate::ProsthesisError;

/// The file's name.
pub const FILE_NAME: &str = "job.toml";

/// The contents of `job.toml`.
#[derive(Debug, Clone, PartialEq)]
pub struct JobRecord {
    /// The job, its paths relative to the folder.
    pub job: ProsthesisJob,
    /// Version of the program.
    pub version: String,
    /// Digest of the part's file.
    pub part_sha256: Sha256,
    /// Where the block's frame is in the part's.
    pub block_from_part: Rigid<BlockFrame, Part>,
    /// Number of the block.
    pub block_id: String,
    /// The block.
    pub block: Block,
    /// The boxes in which stock holds the part in the end: lowest and highest corner.
    pub tab_boxes_mm: Vec<[Vector3<f64>; 2]>,
    /// Figures by name.
    pub metrics: Vec<(String, Value)>,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Why the plan falls short.
    pub shortfalls: Vec<String>,
    /// Whether the file was written like this: its digest is that of its lines.
    pub is_as_written: bool,
}

/// What stands before the digest in the last line.
const DIGEST: &str = "\n[result.file]\nsha256 = ";

/// The file's text with its last line; any other such line is left out.
pub fn sealed(text: &str) -> String {
    let above = text.rsplit_once(DIGEST).map_or(text, |(above, _)| above);
    format!("{above}{DIGEST}\"{}\"\n", Sha256::of_text(above))
}

/// What a program is made for: job, block and `toolpath.csv`'s text by a digest of all that is asked for and driven. The paths of files are left out: they depend on
/// the folder, and the part has a digest of its own.
pub(crate) fn made_for(job: &ProsthesisJob, block_id: &str, version: &str, toolpath: &str) -> String {
    let mut job = job.clone();
    job.part.file = PathBuf::new();
    if let BlockSource::Catalogue(path) = &mut job.stock.source {
        *path = PathBuf::new();
    }
    let digest = Sha256::of_text(&format!("{}\n{block_id}\n{toolpath}", job.to_toml()));
    format!("bonemill {version}, job, block and tool path {digest}")
}

impl JobRecord {
    /// The file's text.
    ///
    /// # Errors
    /// [`PlanFileError::NotFinite`] for a figure that is not.
    pub fn to_toml(&self) -> Result<String, PlanFileError> {
        let mut out = format!("{PROSTHESIS_HEADER} The job is resolved: every default is spelled out.\n");
        out += &self.job.to_toml();
        let texts = |list: &[String]| list.iter().map(|w| format!("\n    {},", text(w))).collect::<String>();
        let at = &self.block_from_part;
        let _ = write!(
            out,
            "\n[result]\nversion = {}\nwarnings = [{}]\nshortfalls = [{}]\nblock_from_part = {}\n",
            text(&self.version),
            texts(&self.warnings),
            texts(&self.shortfalls),
            rigid(at.rotation.matrix(), &at.translation_mm),
        );
        let _ = write!(out, "\n[result.inputs]\npart = \"{}\"\n", self.part_sha256);
        let six = |[low, high]: &[Vector3<f64>; 2]| [low.as_slice(), high.as_slice()].concat();
        let boxes: Vec<String> = self.tab_boxes_mm.iter().map(|of| list(&six(of))).collect();
        let _ = write!(
            out,
            "\n[result.block]\nid = {}\nlow_mm = {}\nhigh_mm = {}\ngrip_mm = {:?}\ntab_boxes_mm = [{}]\n\n[result.metrics]\n",
            text(&self.block_id),
            vector(&self.block.low_mm),
            vector(&self.block.high_mm),
            self.block.grip_mm,
            boxes.join(", "),
        );
        for (name, value) in &self.metrics {
            let _ = writeln!(out, "{name} = {}", value.to_toml(name)?);
        }
        Ok(sealed(&out))
    }

    /// What the program says that it was made for.
    pub(crate) fn made_for(&self, toolpath: &str) -> String {
        made_for(&self.job, &self.block_id, &self.version, toolpath)
    }

    /// Reads `dir/job.toml`; its inputs are not looked at.
    ///
    /// # Errors
    /// [`ProsthesisError::Files`], [`ProsthesisError::Job`], [`ProsthesisError::Folder`] for a key that is missing or wrong.
    pub fn read(dir: &Path) -> Result<Self, ProsthesisError> {
        let path = dir.join(FILE_NAME);
        let text = std::fs::read_to_string(&path).map_err(PlanFileError::io("read", &path))?;
        let job = ProsthesisJob::parse(&text, &path)?;
        let fault = |problem: String| ProsthesisError::Folder { path: path.clone(), problem };
        let table = DeTable::parse(&text).map_err(|e| fault(e.to_string()))?;
        let result = table.get_ref().get("result").and_then(|v| v.get_ref().as_table());
        let result =
            result.ok_or_else(|| fault("no [result]; expected the file of a finished prosthesis".into()))?;
        let is_as_written = text.rsplit_once(DIGEST).is_some_and(|(above, digest)| {
            digest.trim().trim_matches('"').parse() == Ok(Sha256::of_text(above))
        });
        read(result, job, is_as_written)
            .map_err(|key| fault(format!("`result.{key}` is missing or not what is written there")))
    }

    /// A figure by its name, where it is a number.
    pub fn number(&self, name: &str) -> Option<f64> {
        match self.metrics.iter().find(|(key, _)| key == name)?.1 {
            Value::Number(number) => Some(number),
            Value::Integer(count) => Some(count as f64),
            _ => None,
        }
    }

    /// The block that the plan in `dir` took out of a catalogue and keeps, where that is the catalogue of `job`, whose file is `job_path`.
    pub fn holds(&self, dir: &Path, job: &ProsthesisJob, job_path: &Path) -> Option<&str> {
        let (BlockSource::Catalogue(own), BlockSource::Catalogue(other)) =
            (&self.job.stock.source, &job.stock.source)
        else {
            return None;
        };
        let folder = job_path.parent().unwrap_or(Path::new(""));
        let [own, other] = [dir.join(own), folder.join(other)].map(|path| path.canonicalize().ok());
        (own.is_some() && own == other && self.shortfalls.is_empty()).then_some(self.block_id.as_str())
    }

    /// The part's file, seen from the folder.
    pub fn part_path(&self, dir: &Path) -> PathBuf {
        dir.join(&self.job.part.file)
    }
}

/// The record of a `[result]`; `Err` names the key.
fn read(result: &DeTable<'_>, job: ProsthesisJob, is_as_written: bool) -> Result<JobRecord, &'static str> {
    let table = |name: &'static str| result.get(name).and_then(|v| v.get_ref().as_table()).ok_or(name);
    let string = |table: &DeTable<'_>, name: &'static str| {
        table.get(name).and_then(|v| v.get_ref().as_str()).map(str::to_owned).ok_or(name)
    };
    let number = |table: &DeTable<'_>, name: &'static str| {
        table.get(name).and_then(|v| as_number(v.get_ref())).filter(|v| v.is_finite()).ok_or(name)
    };
    let point = |table: &DeTable<'_>, name: &'static str| {
        table.get(name).and_then(|v| numbers::<3>(v.get_ref())).map(Vector3::from).ok_or(name)
    };
    let texts = |name: &'static str| {
        let items = result.get(name).and_then(|v| v.get_ref().as_array()).ok_or(name)?;
        items
            .iter()
            .map(|v| v.get_ref().as_str().map(str::to_owned).ok_or(name))
            .collect::<Result<Vec<_>, _>>()
    };
    let (block, inputs) = (table("block")?, table("inputs")?);
    Ok(JobRecord {
        job,
        version: string(result, "version")?,
        part_sha256: string(inputs, "part")?.parse().map_err(|_| "inputs.part")?,
        block_from_part: placed(table("block_from_part")?).ok_or("block_from_part")?,
        block_id: string(block, "id")?,
        block: Block {
            low_mm: point(block, "low_mm")?,
            high_mm: point(block, "high_mm")?,
            grip_mm: number(block, "grip_mm")?,
        },
        tab_boxes_mm: boxes(block).ok_or("tab_boxes_mm")?,
        metrics: Value::entries_of(table("metrics")?).ok_or("metrics")?,
        warnings: texts("warnings")?,
        shortfalls: texts("shortfalls")?,
        is_as_written,
    })
}

fn numbers<const N: usize>(value: &DeValue<'_>) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> =
        value.as_array()?.iter().map(|v| as_number(v.get_ref()).filter(|n| n.is_finite())).collect();
    numbers?.try_into().ok()
}

fn boxes(block: &DeTable<'_>) -> Option<Vec<[Vector3<f64>; 2]>> {
    let listed = block.get("tab_boxes_mm")?.get_ref().as_array()?;
    let corners = |[a, b, c, d, e, f]: [f64; 6]| [Vector3::new(a, b, c), Vector3::new(d, e, f)];
    listed.iter().map(|of| numbers(of.get_ref()).map(corners)).collect()
}

fn placed(table: &DeTable<'_>) -> Option<Rigid<BlockFrame, Part>> {
    let rows = table.get("rotation")?.get_ref().as_array()?;
    let rows: Vec<[f64; 3]> = rows.iter().map(|row| numbers(row.get_ref())).collect::<Option<_>>()?;
    let [a, b, c] = <[[f64; 3]; 3]>::try_from(rows).ok()?;
    let rotation = rotation_from_matrix(&Matrix3::from_rows(&[a.into(), b.into(), c.into()])).ok()?;
    Some(Rigid::new(rotation, Vector3::from(numbers::<3>(table.get("translation_mm")?.get_ref())?)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    fn record() -> JobRecord {
        let job = "[part]\nstl = \"phantom/implant.stl\"\n[machine]\nmax_time_min = 60\n";
        let digest = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        JobRecord {
            job: ProsthesisJob::parse(job, Path::new("job.toml")).unwrap(),
            version: "0.1.0".into(),
            part_sha256: digest.parse().unwrap(),
            block_from_part: Rigid::new(
                Rotation3::new(Vector3::new(0.3, -0.2, 0.9)),
                Vector3::new(1.5, -70.25, 3.0),
            ),
            block_id: "B \"1\"".into(),
            block: Block {
                low_mm: Vector3::new(-20.0, -8.0, -33.0),
                high_mm: Vector3::new(20.0, 8.0, 22.0),
                grip_mm: 10.0,
            },
            tab_boxes_mm: vec![[Vector3::new(-1.0, -2.0, -3.0), Vector3::new(1.0, 2.0, 3.0)]; 2],
            metrics: vec![("facets".into(), 20_i64.into()), ("total_time_s".into(), 61.25.into())],
            warnings: vec!["the mesh was repaired".into()],
            shortfalls: Vec::new(),
            is_as_written: true,
        }
    }

    #[test]
    fn a_record_reads_back_equal_and_is_a_job_again() {
        let dir = tempfile::tempdir().unwrap();
        let text = record().to_toml().unwrap();
        std::fs::write(dir.path().join(FILE_NAME), &text).unwrap();
        let again = JobRecord::read(dir.path()).unwrap();
        let off = again.block_from_part.rotation.matrix() - record().block_from_part.rotation.matrix();
        assert!(off.amax() < 1e-15);
        assert_eq!(JobRecord { block_from_part: record().block_from_part, ..again }, record());
        assert_eq!(ProsthesisJob::parse(&text, Path::new("job.toml")).unwrap(), record().job);
        assert_eq!(bonemill_planfile::is_prosthesis(dir.path()), Ok(()));
    }

    #[test]
    fn a_figure_that_was_changed_by_hand_is_seen() {
        let dir = tempfile::tempdir().unwrap();
        let text = record().to_toml().unwrap();
        for (from, to) in [
            ("side_load = 0.6", "side_load = 0.7"),
            ("61.25", "61.5"),
            ("B \\\"1", "B \\\"2"),
            ("sha256 = \"", "sha256 = \"0"),
        ] {
            assert!(text.contains(from), "{from}");
            std::fs::write(dir.path().join(FILE_NAME), text.replacen(from, to, 1)).unwrap();
            assert!(!JobRecord::read(dir.path()).unwrap().is_as_written, "{from}");
        }
    }

    #[test]
    fn a_key_that_is_missing_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let text = record().to_toml().unwrap();
        for (from, to, expected) in [
            ("high_mm = [20.0, 8.0, 22.0]", "high_mm = [20.0, 8.0]", "`result.high_mm`"),
            ("ba7816bf", "ba78", "`result.inputs.part`"),
            ("[result.metrics]", "[result.figures]", "`result.metrics`"),
            ("[result]", "[results]", "unknown key `results`"),
        ] {
            std::fs::write(dir.path().join(FILE_NAME), text.replace(from, to)).unwrap();
            let said = JobRecord::read(dir.path()).unwrap_err();
            let said = format!(
                "{said} {}",
                std::error::Error::source(&said).map_or(String::new(), ToString::to_string)
            );
            assert!(said.contains(expected), "{said}");
        }
    }
}
