//! A drawn prosthesis as the files of a job.

use std::path::{Path, PathBuf};

use bonemill_imaging::part::phantom::Operculum;
use bonemill_imaging::part::stl_bytes;
use bonemill_planfile::PlanFileError;

/// Facets of a drawn part: edges of about 0.4 mm.
pub const FACETS: usize = 40_000;
/// The job's file among a phantom's.
pub const JOB_FILE: &str = "job.toml";
/// The part's file among them.
const PART_FILE: &str = "implant.stl";

/// Writes the part and a job into an existing folder; where the job stands.
///
/// # Errors
/// [`PlanFileError::Io`].
pub fn write(dir: &Path, shape: &Operculum, facets: usize) -> Result<PathBuf, PlanFileError> {
    let write = |name: &str, bytes: &[u8]| {
        let path = dir.join(name);
        std::fs::write(&path, bytes).map_err(PlanFileError::io("write", &path)).map(|()| path)
    };
    write(PART_FILE, &stl_bytes(&shape.mesh(facets)))?;
    let job = "# A drawn prosthesis; docs/prosthesis.md lists every key.\n[part]\nstl = \"implant.stl\"\nunit = \"mm\"\n";
    write(JOB_FILE, job.as_bytes())
}
