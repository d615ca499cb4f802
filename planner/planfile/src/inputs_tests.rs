//! Plans that were moved, sent, or packed, with inputs that are missing, elsewhere, or changed.

use super::super::record::tests::written;
use super::*;

/// A plan's folder that was moved to another place.
fn moved() -> (tempfile::TempDir, PathBuf, PlanRecord) {
    let (root, plan, record) = written();
    let away = root.path().join("away");
    fs::create_dir(&away).unwrap();
    fs::rename(plan, away.join("plan")).unwrap();
    (root, away.join("plan"), record)
}

fn find(dir: &Path, record: &PlanRecord, folder: Option<&Path>) -> Result<FoundInputs, PlanFileError> {
    FoundInputs::search(dir, record, folder, Need::All)
}

#[test]
fn inputs_that_changed_are_refused_by_name_and_missing_ones_listed() {
    for file in ["case.toml", "images/ct.nii.gz", "labels.nii.gz"] {
        let (root, plan, record) = written();
        assert_eq!(find(&plan, &record, None).unwrap().found.len(), 3);
        let path = root.path().join("data").join(file);
        let bytes = fs::read(&path).unwrap();
        fs::write(&path, [bytes.as_slice(), b" "].concat()).unwrap();
        for need in [Need::All, Need::Unchanged] {
            let e = FoundInputs::search(&plan, &record, None, need).unwrap_err();
            assert!(matches!(e, PlanFileError::InputChanged { .. }) && e.to_string().contains(file), "{e}");
        }
        assert!(FoundInputs::search(&plan, &record, None, Need::Nothing).unwrap().found.is_empty());
        fs::remove_file(&path).unwrap();
        assert_eq!(FoundInputs::search(&plan, &record, None, Need::Unchanged).unwrap().missing().len(), 1);
        let e = find(&plan, &record, None).unwrap_err().to_string();
        let digest = record.inputs.iter().find(|i| i.path == Path::new(file)).unwrap().sha256.to_string();
        let size = bytes.len().to_string() + " bytes";
        for part in [file, &digest[..10], &size, "--inputs DIR", "beside the plan's folder", "--pack"] {
            assert!(e.contains(part), "{part} is not in {e}");
        }
    }
}

#[test]
fn a_moved_plan_finds_its_case_in_itself_and_its_images_beside_it_or_in_it() {
    let (root, plan, record) = moved();
    let data = root.path().join("data");
    let missing =
        |plan: &Path| FoundInputs::search(plan, &record, None, Need::Unchanged).unwrap().missing.len();
    assert_eq!(missing(&plan), 3);
    fs::copy(data.join("case.toml"), plan.join(CASE_COPY)).unwrap();
    assert_eq!(missing(&plan), 2);
    fs::copy(data.join("images/ct.nii.gz"), plan.with_file_name("ct.nii.gz")).unwrap();
    assert_eq!(missing(&plan), 1);
    // another file of this name is not accepted
    fs::write(plan.with_file_name("labels.nii.gz"), "others").unwrap();
    assert_eq!(missing(&plan), 1);
    fs::create_dir(plan.join(KEPT)).unwrap();
    fs::copy(data.join("labels.nii.gz"), plan.join(KEPT).join("labels.nii.gz")).unwrap();
    let found = find(&plan, &record, None).unwrap();
    assert_eq!(found.path(Path::new("labels.nii.gz")), Some(plan.join("inputs/labels.nii.gz").as_path()));
    assert_eq!(found.path(Path::new("case.toml")), Some(plan.join("case.toml").as_path()));
}

#[test]
fn a_named_folder_is_searched_by_name_and_by_content_and_settles_what_changed() {
    let (root, plan, record) = moved();
    let data = root.path().join("data");
    let folder = root.path().join("folder");
    fs::create_dir(&folder).unwrap();
    fs::copy(data.join("case.toml"), folder.join("renamed.txt")).unwrap();
    fs::copy(data.join("labels.nii.gz"), folder.join("labels.nii.gz")).unwrap();
    fs::copy(data.join("images/ct.nii.gz"), folder.join("scan 7.nii.gz")).unwrap();
    fs::write(folder.join("ct.nii.gz"), "xx").unwrap(); // of the same size
    let found = find(&plan, &record, Some(&folder)).unwrap();
    assert_eq!(found.path(Path::new("images/ct.nii.gz")), Some(folder.join("scan 7.nii.gz").as_path()));
    assert_eq!(found.path(Path::new("case.toml")), Some(folder.join("renamed.txt").as_path()));
    // a plan of an earlier version does not say how large they were
    let mut older = record.clone();
    older.inputs.iter_mut().for_each(|input| input.bytes = None);
    assert_eq!(find(&plan, &older, Some(&folder)).unwrap(), found);
    // another patient's case is at the recorded path: the folder that the user names is searched, but no other
    fs::create_dir(root.path().join("away/data")).unwrap();
    fs::write(root.path().join("away/data/case.toml"), "another").unwrap();
    fs::copy(data.join("case.toml"), plan.join(CASE_COPY)).unwrap();
    assert!(matches!(find(&plan, &record, None), Err(PlanFileError::InputChanged { .. })));
    assert_eq!(find(&plan, &record, Some(&folder)).unwrap(), found);
    let e = find(&plan, &record, Some(&root.path().join("nowhere"))).unwrap_err().to_string();
    assert!(e.contains("nowhere"), "{e}");
}

#[test]
fn a_packed_plan_holds_every_input_also_those_from_elsewhere() {
    let (root, _, mut record) = written();
    let outside = root.path().join("arms/arm.urdf");
    fs::create_dir(root.path().join("arms")).unwrap();
    fs::write(&outside, "arm").unwrap();
    let data = root.path().join("data");
    record.inputs.push(Input::now(&data, Path::new("../arms/arm.urdf")).unwrap());
    let out = root.path().join("packed");
    let staged = StagedDirectory::create(&out, super::super::Replace::Nothing).unwrap();
    let from: Vec<_> = record.inputs.iter().map(|i| (i.clone(), data.join(&i.path))).collect();
    let case = pack_inputs(&from, Path::new("../data/case.toml"), &staged).unwrap();
    record.case_file = staged.relative(&case).unwrap();
    assert_eq!(record.case_file, Path::new("inputs/case.toml"));
    record.write(staged.path()).unwrap();
    staged.commit().unwrap();
    // a packed plan can be moved, and its originals changed
    fs::write(&outside, "changed").unwrap();
    fs::remove_dir_all(&data).unwrap();
    fs::create_dir(root.path().join("elsewhere")).unwrap();
    let there = root.path().join("elsewhere/plan");
    fs::rename(out, &there).unwrap();
    let record = PlanRecord::read(&there).unwrap();
    let found = find(&there, &record, None).unwrap();
    assert_eq!(found.path(Path::new("../arms/arm.urdf")), Some(there.join("inputs/arms/arm.urdf").as_path()));
    // its own copies must not change either
    fs::write(there.join("inputs/arms/arm.urdf"), "changed").unwrap();
    assert!(matches!(find(&there, &record, None), Err(PlanFileError::InputChanged { .. })));
}

#[test]
fn what_changed_while_it_was_planned_is_not_packed() {
    let (root, _, record) = written();
    let data = root.path().join("data");
    fs::write(data.join("labels.nii.gz"), "changed").unwrap();
    let staged =
        StagedDirectory::create(&root.path().join("packed"), super::super::Replace::Nothing).unwrap();
    let from: Vec<_> = record.inputs.iter().map(|i| (i.clone(), data.join(&i.path))).collect();
    let e = pack_inputs(&from, Path::new("case.toml"), &staged).unwrap_err();
    assert!(
        matches!(e, PlanFileError::InputChanged { .. }) && e.to_string().contains("labels.nii.gz"),
        "{e}"
    );
}
