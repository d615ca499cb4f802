//! Directories must be complete, either the old or the new one, whatever fails.

use std::process::Command;

use super::*;

/// Names in a folder, sorted.
fn names(dir: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Writes a plan with one table that contains `content`.
fn write_plan(root: &Path, out: &Path, content: &str) -> Result<PathBuf, PlanFileError> {
    let record = crate::record::tests::record(root);
    let staged = StagedDirectory::create(out, Replace::Plan)?;
    record.write(staged.path())?;
    fs::write(staged.path().join("waypoints.csv"), content)
        .map_err(PlanFileError::io("write", staged.path()))?;
    staged.commit()
}

fn content(out: &Path) -> String {
    fs::read_to_string(out.join("waypoints.csv")).unwrap()
}

#[test]
fn a_plan_appears_whole_and_is_replaced_whole() {
    let root = tempfile::tempdir().unwrap();
    let out = root.path().join("plan");
    assert_eq!(write_plan(root.path(), &out, "first").unwrap(), out.canonicalize().unwrap());
    assert_eq!(content(&out), "first");
    write_plan(root.path(), &out, "second").unwrap();
    assert_eq!(content(&out), "second");
    assert_eq!(names(root.path()), ["data", "plan"], "nothing is left over");
    assert_eq!(names(&out), ["plan.toml", "waypoints.csv"]);
}

#[test]
fn the_directory_is_as_open_as_any_other() {
    use std::os::unix::fs::PermissionsExt;
    let root = tempfile::tempdir().unwrap();
    let (out, other) = (root.path().join("plan"), root.path().join("other"));
    write_plan(root.path(), &out, "x").unwrap();
    fs::create_dir(&other).unwrap();
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&out), mode(&other));
}

#[test]
fn missing_parents_are_made_and_empty_folders_used() {
    let root = tempfile::tempdir().unwrap();
    let out = root.path().join("a/b/plan");
    write_plan(root.path(), &out, "x").unwrap();
    assert_eq!(content(&out), "x");
    let empty = root.path().join("empty");
    fs::create_dir(&empty).unwrap();
    write_plan(root.path(), &empty, "y").unwrap();
    assert_eq!(content(&empty), "y");
    assert_eq!(names(root.path()), ["a", "data", "empty"]);
}

#[test]
fn what_is_not_a_plan_is_never_touched() {
    let root = tempfile::tempdir().unwrap();
    let out = root.path().join("thesis");
    let refuse = |part: &str| {
        let e = write_plan(root.path(), &out, "x").unwrap_err();
        assert!(matches!(e, PlanFileError::Occupied { .. }), "{e}");
        assert!(e.to_string().contains("exists and is not a plan") && e.to_string().contains(part), "{e}");
    };
    fs::write(&out, "a file").unwrap();
    refuse("it is not a folder");
    assert_eq!(fs::read_to_string(&out).unwrap(), "a file");
    fs::remove_file(&out).unwrap();
    fs::create_dir(&out).unwrap();
    fs::write(out.join("chapter1"), "text").unwrap();
    refuse("it has no readable plan.toml");
    fs::write(out.join("plan.toml"), "version = \"me\"").unwrap();
    refuse("its plan.toml is not one of ours");
    assert_eq!(names(&out), ["chapter1", "plan.toml"]);
    assert!(!names(root.path()).iter().any(|n| n.starts_with('.')), "{:?}", names(root.path()));
}

#[test]
fn a_plan_with_notes_in_it_is_not_replaced() {
    let root = tempfile::tempdir().unwrap();
    let out = root.path().join("plan");
    write_plan(root.path(), &out, "first").unwrap();
    fs::write(out.join("notes.txt"), "mine").unwrap();
    let e = write_plan(root.path(), &out, "second").unwrap_err();
    assert!(e.to_string().contains("notes.txt, which would be lost"), "{e}");
    assert_eq!(content(&out), "first");
}

#[test]
fn nothing_replaces_only_nothing() {
    let root = tempfile::tempdir().unwrap();
    let out = root.path().join("plan");
    write_plan(root.path(), &out, "first").unwrap();
    let e = StagedDirectory::create(&out, Replace::Nothing).unwrap_err();
    assert!(e.to_string().contains("is not an empty folder"), "{e}");
}

#[test]
fn an_abandoned_directory_leaves_nothing() {
    let root = tempfile::tempdir().unwrap();
    let out = root.path().join("plan");
    write_plan(root.path(), &out, "first").unwrap();
    let staged = StagedDirectory::create(&out, Replace::Plan).unwrap();
    fs::write(staged.path().join("waypoints.csv"), "half").unwrap();
    drop(staged);
    assert_eq!(content(&out), "first");
    assert_eq!(names(root.path()), ["data", "plan"]);
}

#[test]
fn a_kill_between_the_two_renames_is_mended() {
    let root = tempfile::tempdir().unwrap();
    let out = root.path().join("plan");
    write_plan(root.path(), &out, "old").unwrap();
    let aside = root.path().join(".plan.replaced");
    fs::rename(&out, &aside).unwrap();
    drop(StagedDirectory::create(&out, Replace::Plan).unwrap());
    assert_eq!(content(&out), "old");
    assert!(!aside.exists());
    // killed after both renames: the old plan is still set aside, the new one is in place
    write_plan(root.path(), &aside, "old").unwrap();
    write_plan(root.path(), &out, "new").unwrap();
    assert_eq!(content(&out), "new");
    assert!(!aside.exists());
}

#[test]
fn a_link_to_a_plan_stays_a_link() {
    let root = tempfile::tempdir().unwrap();
    let (out, link) = (root.path().join("plan"), root.path().join("latest"));
    write_plan(root.path(), &out, "first").unwrap();
    if std::os::unix::fs::symlink(&out, &link).is_err() {
        bonemill_geometry::testkit::skipped("this file system has no links");
        return;
    }
    write_plan(root.path(), &link, "second").unwrap();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert_eq!(content(&out), "second");
}

#[test]
fn the_way_to_the_case_holds_when_the_directory_is_in_place() {
    let root = tempfile::tempdir().unwrap();
    let case = root.path().join("data/case.toml");
    fs::create_dir(root.path().join("data")).unwrap();
    fs::write(&case, "").unwrap();
    let staged = StagedDirectory::create(&root.path().join("results/today/plan"), Replace::Plan).unwrap();
    assert_eq!(staged.relative(&case).unwrap(), Path::new("../../../data/case.toml"));
    let inside = staged.path().join("phantom");
    fs::create_dir(&inside).unwrap();
    fs::write(inside.join("case.toml"), "").unwrap();
    assert_eq!(staged.relative(&inside.join("case.toml")).unwrap(), Path::new("phantom/case.toml"));
    assert!(staged.relative(&root.path().join("nowhere")).is_err());
    let out = staged.commit().unwrap();
    assert!(out.join("../../../data/case.toml").exists());
}

#[test]
fn a_plan_cannot_replace_its_own_inputs() {
    let root = tempfile::tempdir().unwrap();
    let out = root.path().join("plan");
    write_plan(root.path(), &out, "first").unwrap();
    fs::create_dir(out.join("phantom")).unwrap();
    fs::write(out.join("phantom/case.toml"), "").unwrap();
    let staged = StagedDirectory::create(&out, Replace::Plan).unwrap();
    let e = staged.relative(&out.join("phantom/case.toml")).unwrap_err();
    assert!(matches!(e, PlanFileError::WouldBeLost { .. }), "{e}");
}

#[test]
fn a_path_without_a_name_is_refused() {
    for path in ["/", "no/such/../folder"] {
        let e = StagedDirectory::create(Path::new(path), Replace::Plan).unwrap_err();
        assert!(matches!(e, PlanFileError::NoName { .. }), "{path}: {e}");
    }
}

#[test]
fn a_folder_that_cannot_be_written_is_an_error_and_changes_nothing() {
    // /proc is a folder in which not even root can make a folder
    let proc = Path::new("/proc/self");
    if !proc.exists() {
        bonemill_geometry::testkit::skipped("there is no /proc here");
        return;
    }
    let e = StagedDirectory::create(&proc.join("plan"), Replace::Plan).unwrap_err();
    assert!(matches!(e, PlanFileError::Io { doing: "write into", .. }), "{e}");
}

#[test]
fn a_full_disk_keeps_the_old_plan() {
    let root = tempfile::tempdir().unwrap();
    let disk = root.path().join("disk");
    fs::create_dir(&disk).unwrap();
    let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", "size=64k", "none"]).arg(&disk).output();
    if !mounted.is_ok_and(|o| o.status.success()) {
        bonemill_geometry::testkit::skipped("a small disk cannot be mounted here");
        return;
    }
    let out = disk.join("plan");
    let first = write_plan(root.path(), &out, "first");
    let second = write_plan(root.path(), &out, &"x".repeat(1 << 20));
    let (kept, left) = (content(&out), names(&disk));
    let unmounted = Command::new("umount").arg(&disk).status().unwrap();
    first.unwrap();
    let e = second.unwrap_err();
    assert!(matches!(e, PlanFileError::Io { doing: "write", .. }), "{e}");
    assert_eq!((kept.as_str(), left), ("first", vec!["plan".to_owned()]));
    assert!(unmounted.success());
}
