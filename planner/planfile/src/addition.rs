//! Adds to a finished plan's directory: single files, each written whole or not at all, and parts of the report.

use std::io::{ErrorKind, Write};
use std::path::Path;

use super::PlanFileError;

/// Name of the report page.
pub const REPORT: &str = "report.html";

/// The parts that commands add to the report.
#[derive(Debug, Clone, Copy)]
pub enum ReportPart {
    /// The part of `bonemill simulate`.
    Simulation,
    /// The part of `bonemill verify`.
    Verification,
}

impl ReportPart {
    /// The marks between which the part stands in the page.
    pub fn marks(self) -> [&'static str; 2] {
        match self {
            Self::Simulation => ["<!-- simulation -->", "<!-- end of simulation -->"],
            Self::Verification => ["<!-- verification -->", "<!-- end of verification -->"],
        }
    }
}

/// Inserts a part between its marks in the plan's report, or at the end of a page without marks. If there is no report, none
/// is made.
///
/// # Errors
/// [`PlanFileError::Io`]; the report is then unchanged.
pub fn add_to_report(dir: &Path, part: ReportPart, html: &str) -> Result<(), PlanFileError> {
    let report = dir.join(REPORT);
    match std::fs::read_to_string(&report) {
        Ok(page) => replace(dir, REPORT, with_part(&page, part.marks(), html).as_bytes()),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(()),
        Err(e) => Err(PlanFileError::io("read", &report)(e)),
    }
}

fn with_part(page: &str, [begin, end]: [&str; 2], part: &str) -> String {
    let (head, tail) = match (page.find(begin), page.find(end)) {
        (Some(from), Some(to)) if from < to => (&page[..from], &page[to + end.len()..]),
        _ => page.split_at(page.find("</main>").unwrap_or(page.len())),
    };
    format!("{head}{begin}{part}{end}{tail}")
}

/// Writes a file in one step. A replaced file keeps its permissions; a new one gets the user's default permissions.
///
/// # Errors
/// [`PlanFileError::Io`]; an existing file is then unchanged.
pub fn replace(dir: &Path, name: &str, bytes: &[u8]) -> Result<(), PlanFileError> {
    let path = dir.join(name);
    let prefix = format!(".{name}.partial-");
    let write = || -> std::io::Result<()> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix);
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let mut file = builder.tempfile_in(dir)?;
        if let Ok(there) = std::fs::metadata(&path) {
            file.as_file().set_permissions(there.permissions())?;
        }
        file.write_all(bytes)?;
        file.as_file().sync_all()?;
        file.persist(&path).map_err(|e| e.error)?;
        std::fs::File::open(dir)?.sync_all()
    };
    write().map_err(PlanFileError::io("write", &path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_goes_to_the_end_and_then_into_its_own_place() {
        let page = "<html><main><h1>x</h1></main></html>";
        let add = |page: &str, part: ReportPart, html| with_part(page, part.marks(), html);
        let once = add(page, ReportPart::Simulation, "A");
        assert_eq!(
            once,
            "<html><main><h1>x</h1><!-- simulation -->A<!-- end of simulation --></main></html>"
        );
        assert_eq!(add(&once, ReportPart::Simulation, "A"), once);
        let other = add(&once, ReportPart::Simulation, "B");
        assert!(other.contains("-->B<!--") && !other.contains("-->A<!--"));
        let both = add(&once, ReportPart::Verification, "V");
        assert!(both.contains("-->A<!--") && both.contains("-->V<!--") && both.ends_with("</main></html>"));
        assert!(add("no page", ReportPart::Simulation, "A").starts_with("no page<!--"));
    }

    #[test]
    fn a_file_replaces_the_one_before_and_leaves_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        replace(dir.path(), "a.toml", b"1").unwrap();
        replace(dir.path(), "a.toml", b"2").unwrap();
        assert_eq!(std::fs::read(dir.path().join("a.toml")).unwrap(), b"2");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        let error = replace(&dir.path().join("gone"), "a.toml", b"").unwrap_err();
        assert!(error.to_string().contains("a.toml"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn whoever_may_read_a_plan_may_read_what_is_added() {
        use std::os::unix::fs::PermissionsExt;
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("usual"), "").unwrap();
        replace(dir.path(), "added", b"1").unwrap();
        let mode = |name| std::fs::metadata(dir.path().join(name)).unwrap().permissions().mode();
        assert_eq!(mode("added"), mode("usual"));
    }
}
