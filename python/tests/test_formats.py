"""Images that other programs write: one case from NIfTI, NRRD, MetaImage and DICOM is one plan.

The files are written by SimpleITK, pynrrd, pydicom and highdicom. What is not installed is skipped, visibly.
"""

import gzip
import hashlib
import json
import shutil
import subprocess
import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import bonemill

nib = pytest.importorskip("nibabel")

from image_files import segments, sitk_image, write_masks, write_seg, write_series, write_slicer  # noqa: E402 (needs nibabel)

LPS = np.diag([-1.0, -1.0, 1.0, 1.0])


@pytest.fixture(scope="session")
def images(block: bonemill.Case) -> SimpleNamespace:
    """The block's voxels and the affine from index to RAS and to LPS, mm."""
    folder = block.path.parent
    ct, labels = (nib.load(folder / name) for name in ("ct.nii.gz", "labels.nii.gz"))
    return SimpleNamespace(
        folder=folder,
        case=block.path.read_text(),
        ct=np.asarray(ct.dataobj).astype(np.int16),
        labels=np.asarray(labels.dataobj).astype(np.uint8),
        lps=LPS @ ct.affine,
        labels_lps=LPS @ labels.affine,
    )


def run(command: Path, *words: Any) -> subprocess.CompletedProcess:
    return subprocess.run([command, *map(str, words)], capture_output=True, text=True, check=False)


def planned(command: Path, folder: Path, text: str) -> Path:
    """The folder of a plan of a case with this text, whose images lie in `folder`."""
    (folder / "case.toml").write_text(text)
    out = folder / "plan"
    done = run(command, "plan", folder / "case.toml", "--out", out, "--quiet")
    assert done.returncode == 0, done.stdout + done.stderr
    return out


def named(images: SimpleNamespace, ct: str, labels: str = "labels.nii.gz") -> str:
    return images.case.replace('"ct.nii.gz"', f'"{ct}"').replace('"labels.nii.gz"', f'"{labels}"')


@pytest.fixture(scope="session")
def from_nifti(images: SimpleNamespace, command: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("nifti") / "case"
    shutil.copytree(images.folder, folder)
    return planned(command, folder, images.case)


@pytest.fixture
def folder(images: SimpleNamespace, tmp_path: Path) -> Path:
    """A folder with the block's labels and their names."""
    for name in ("labels.nii.gz", "labels.json"):
        if (images.folder / name).exists():
            shutil.copy(images.folder / name, tmp_path / name)
    return tmp_path


def assert_same(plan: Path, other: Path) -> None:
    for name in ("waypoints.csv", "forces.csv", "trajectory.csv"):
        assert (plan / name).read_bytes() == (other / name).read_bytes(), name


@pytest.mark.parametrize("name", ["ct.mha", "ct.mhd", "ct.nrrd", "ct.nhdr", "ct.hdr"])
@pytest.mark.parametrize("compressed", [False, True])
def test_what_simpleitk_writes_is_the_same_plan(
    images: SimpleNamespace, command: Path, folder: Path, from_nifti: Path, name: str, compressed: bool
) -> None:
    sitk = pytest.importorskip("SimpleITK")
    sitk.WriteImage(sitk_image(sitk, images.ct, images.lps), str(folder / name), useCompression=compressed)
    assert_same(planned(command, folder, named(images, name)), from_nifti)


@pytest.mark.parametrize("space", ["left-posterior-superior", "right-anterior-superior", "left-anterior-superior"])
@pytest.mark.parametrize("encoding", ["raw", "gzip", "ascii"])
def test_what_pynrrd_writes_is_the_same_plan(
    images: SimpleNamespace, command: Path, folder: Path, from_nifti: Path, space: str, encoding: str
) -> None:
    nrrd = pytest.importorskip("nrrd")
    if encoding == "ascii" and not space.startswith("right"):
        pytest.skip("one space is enough for text")
    signs = {"left-p": [1, 1, 1], "right-": [-1, -1, 1], "left-a": [1, -1, 1]}[space[:6]]
    affine = np.diag([*signs, 1.0]) @ images.lps
    header = {"space": space, "space directions": affine[:3, :3].T, "space origin": affine[:3, 3], "encoding": encoding}
    nrrd.write(str(folder / "ct.nrrd"), images.ct, header, index_order="F")
    assert_same(planned(command, folder, named(images, "ct.nrrd")), from_nifti)


@pytest.mark.parametrize("name", ["ct.nii", "ct.nii.gz", "ct.hdr"])
@pytest.mark.parametrize("endian", ["<", ">"])
def test_what_nibabel_writes_as_nifti_2_is_the_same_plan(
    images: SimpleNamespace, command: Path, folder: Path, from_nifti: Path, name: str, endian: str
) -> None:
    header = nib.Nifti2Header(endianness=endian)
    header.set_data_dtype(np.dtype(np.int16).newbyteorder(endian))
    header.set_xyzt_units("mm")
    kind = nib.Nifti2Pair if name == "ct.hdr" else nib.Nifti2Image
    image = kind(images.ct, LPS @ images.lps, header)
    image.set_qform(LPS @ images.lps, code=1)
    nib.save(image, folder / name)
    plan = planned(command, folder, named(images, name))
    assert_same(plan, from_nifti)
    # verify has a reader of its own for a single file
    verified = run(command, "verify", plan)
    assert verified.returncode == 0, verified.stdout + verified.stderr
    shared = tomllib.loads((plan / "verification.toml").read_text()).get("shared_readers", [])
    assert len(shared) == (name == "ct.hdr"), shared


def assert_near(plan: Path, other: Path) -> None:
    """The same rows, and every number to 0.001 of its unit, mm a micrometre: decimal strings of DICOM have 16 characters."""
    for name in ("waypoints.csv", "trajectory.csv"):
        rows = [np.genfromtxt(p / name, delimiter=",", skip_header=1, dtype=float) for p in (plan, other)]
        assert rows[0].shape == rows[1].shape, name
        assert np.allclose(rows[0], rows[1], rtol=0, atol=1e-3, equal_nan=True), name


# of the patient and the scan; UIDs of pydicom and highdicom begin with the last
SECRETS = ["Doe^", "Jane", "PATIENT-7", "19701231", "20260102", "ACC-9", "Elsewhere", "Who^", "STUDY-3", "1.2.826.0.1"]


def assert_no_secret(*places: Path | str) -> None:
    """No file, and no text that was printed, holds what only the headers may hold."""
    texts = [(place[:40], place.encode()) for place in places if isinstance(place, str)]
    for folder in (place for place in places if isinstance(place, Path)):
        files = [p for p in folder.rglob("*") if p.is_file()] if folder.is_dir() else [folder]
        assert files, folder
        texts += [(str(p), gzip.decompress(p.read_bytes()) if p.suffix == ".gz" else p.read_bytes()) for p in files]
    for name, text in texts:
        found = [secret for secret in SECRETS if secret.encode() in text]
        assert not found, f"{name}: {found}"


UNCOMPRESSED = [None, "ExplicitVRBigEndian", "ImplicitVRLittleEndian", "DeflatedExplicitVRLittleEndian"]


@pytest.mark.parametrize("compressed", [*UNCOMPRESSED, "RLELossless", "JPEG", "JPEG2000"])
def test_a_dicom_series_is_the_same_plan_and_its_patient_stays_in_it(
    images: SimpleNamespace, command: Path, folder: Path, from_nifti: Path, compressed: str | None
) -> None:
    pydicom = pytest.importorskip("pydicom")
    sitk = pytest.importorskip("SimpleITK") if compressed in ("JPEG", "JPEG2000") else None
    write_series(pydicom, images, folder / "dicom", compressed, sitk)
    plan = planned(command, folder, named(images, "dicom"))
    assert_near(plan, from_nifti)
    assert_no_secret(plan)
    # no reader of the verification's own: it says so, with a digest that pydicom's voxels and places have, too; of JPEG it unpacks none itself
    plain = folder / "dicom" if sitk is None else folder / "plain"
    if sitk is not None:
        write_series(pydicom, images, plain)
    assert digest_by_pydicom(pydicom, plain) in " ".join(readers_shared_by_verify(command, plan))


def digest_by_pydicom(pydicom: Any, folder: Path) -> str:
    """SHA-256 of sizes (u32), matrix and offset to RAS by rows in 0.0001 mm (i64), and HU, i fastest (f32); little endian."""
    found = [pydicom.dcmread(path) for path in folder.iterdir()]
    row, column = (np.array(found[0].ImageOrientationPatient, float)[n : n + 3] for n in (0, 3))
    found.sort(key=lambda ds: float(np.cross(row, column) @ np.array(ds.ImagePositionPatient, float)))
    first, last = (np.array(found[n].ImagePositionPatient, float) for n in (0, -1))
    down, right = (float(mm) for mm in found[0].PixelSpacing)
    columns = [row * right, column * down, (last - first) / (len(found) - 1), first]
    matrix = np.diag([-1.0, -1.0, 1.0]) @ np.stack(columns, axis=1)
    hu = [ds.pixel_array * float(ds.RescaleSlope) + float(ds.RescaleIntercept) for ds in found]
    digest = hashlib.sha256(np.array([*hu[0].shape[::-1], len(hu)], "<u4").tobytes())
    digest.update(np.rint(1e4 * matrix).astype("<i8").tobytes())
    digest.update(np.array(hu, "<f4").tobytes())
    return digest.hexdigest()


def readers_shared_by_verify(command: Path, plan: Path) -> list[str]:
    """Verifies a plan, which must pass; what its verdict says about images that the planner's reader has read again."""
    verified = run(command, "verify", plan)
    assert verified.returncode == 0, verified.stdout + verified.stderr
    return tomllib.loads((plan / "verification.toml").read_text())["shared_readers"]


MORE = '[[structure]]\nname = "artery"\nsegment = "Artery"\nclearance_mm = 1.0\n\n[approach]'


def with_segments(images: SimpleNamespace, labels: str) -> str:
    text = named(images, "ct.nii.gz", labels)
    assert 'name = "facial_nerve"\nlabel = 1' in text and "[approach]" in text
    text = text.replace('name = "facial_nerve"\nlabel = 1', 'name = "facial_nerve"\nsegment = "facial_nerve"')
    return text.replace("[approach]", MORE, 1)


def test_overlapping_segments_of_slicer_are_planned_and_verified(
    images: SimpleNamespace, command: Path, folder: Path
) -> None:
    nrrd = pytest.importorskip("nrrd")
    shutil.copy(images.folder / "ct.nii.gz", folder)
    masks = segments(images, overlap=True)
    write_slicer(nrrd, images, masks, folder / "a.seg.nrrd")
    plan = planned(command, folder, with_segments(images, "a.seg.nrrd"))
    assert "share" in (plan / "plan.toml").read_text()
    verified = run(command, "verify", plan)
    assert verified.returncode == 0, verified.stdout + verified.stderr
    # a name that differs by case
    text = with_segments(images, "a.seg.nrrd").replace('"Artery"', '"artery"')
    (folder / "case.toml").write_text(text)
    refused = run(command, "plan", folder / "case.toml", "--out", folder / "no")
    assert refused.returncode == 2 and 'did you mean "Artery"' in refused.stderr, refused.stderr


def test_a_dicom_segmentation_and_a_folder_of_masks_are_the_same_labels(
    images: SimpleNamespace, command: Path, folder: Path
) -> None:
    hd = pytest.importorskip("highdicom")
    shutil.copy(images.folder / "ct.nii.gz", folder)
    masks = segments(images, overlap=True)
    write_masks(masks, LPS @ images.labels_lps, folder / "masks")
    write_seg(hd, images, masks, folder / "seg.dcm")
    plans = []
    for labels in ("masks", "seg.dcm"):
        own = folder / f"of-{labels}"
        own.mkdir()
        shutil.copy(folder / "ct.nii.gz", own)
        source = folder / labels
        shutil.copytree(source, own / labels) if source.is_dir() else shutil.copy(source, own / labels)
        text = with_segments(images, labels)
        plans.append(planned(command, own, text))
        (said,) = readers_shared_by_verify(command, plans[-1])
        assert said.startswith("images.labels is "), said
    assert_near(*plans)


def test_nothing_of_the_patient_is_printed_or_written(images: SimpleNamespace, command: Path, tmp_path: Path) -> None:
    pydicom, hd = pytest.importorskip("pydicom"), pytest.importorskip("highdicom")
    (tmp_path / "dicom").mkdir()
    for series in ("a", "b"):
        write_series(pydicom, images, tmp_path / "dicom" / series)
    write_seg(hd, images, segments(images, overlap=False), tmp_path / "seg.dcm")
    for source in (*(tmp_path / "dicom").rglob("IM*"), tmp_path / "seg.dcm"):
        assert b"PATIENT-7" in source.read_bytes(), "the inputs have what must not get out"
    case, of_ur, packed, plan, ur, out = (tmp_path / n for n in ("case.toml", "ur.toml", "packed", "plan", "ur", "out"))
    make = ["case", tmp_path / "dicom", tmp_path / "seg.dcm", "--out"]
    # of several series, a list of names that are no UIDs
    refused = run(command, *make, case)
    uids = [pydicom.dcmread(tmp_path / "dicom" / series / "IM0350").SeriesInstanceUID for series in ("a", "b")]
    names = [hashlib.sha256(uid.encode()).hexdigest()[:12] for uid in uids]
    assert refused.returncode == 2 and all(f"{name} (CT, " in refused.stderr for name in names), refused.stderr
    said = [refused.stdout, refused.stderr]
    for words in (
        [*make, case, "--ct-series", names[0], "--json"],
        [*make, case, "--ct-series", uids[0], "--force"],
        [*make, of_ur, "--ct-series", uids[0], "--robot", "ur5e"],
        ["plan", case, "--out", packed, "--pack", "--json"],
        ["plan", case, "--out", plan],
        ["plan", case, "--out", tmp_path / "no-slices", "--no-slices"],
        ["plan", of_ur, "--out", ur, "--accuracy", "coarse"],
        ["verify", plan, "--json"],
        ["verify", plan, "--all"],
        ["simulate", plan, "--json"],
        ["export", plan, "--format", "slicer", "--out", out / "scene"],
        ["export", plan, "--format", "gcode", "--out", out, "--unverified"],
        ["export", ur, "--format", "ros", "--out", out, "--unverified"],
        ["export", ur, "--format", "urscript", "--out", out, "--unverified"],
    ):
        done = run(command, *words)
        assert done.returncode == 0, done.stdout + done.stderr
        said += [done.stdout, done.stderr]
    assert tomllib.loads(case.read_text())["images"]["ct_series"] == names[0]
    assert names[0] in (plan / "report.html").read_text(), "the page shows the case"
    # the packed inputs are the files that were named, and have their headers, which is told
    count = len(list((tmp_path / "dicom" / "a").iterdir())) + 1
    assert any(f"keeps {count} DICOM files with their headers" in text for text in said), said
    for kept in (p for p in packed.rglob("*") if p.is_file() and p.read_bytes()[128:132] == b"DICM"):
        kept.unlink()
    assert_no_secret(case, of_ur, packed, plan, tmp_path / "no-slices", ur, out, *said)
    # a refusal, too
    (tmp_path / "dicom" / "a" / "IM0350").unlink()
    refused = run(command, "plan", case, "--out", tmp_path / "no")
    assert refused.returncode == 2 and "missing" in refused.stderr, refused.stdout + refused.stderr
    assert_no_secret(refused.stdout, refused.stderr)


def cased(command: Path, folder: Path, ct: str, *labels: str) -> dict[str, Any]:
    """The case that `bonemill case` makes of images in `folder`."""
    out = folder / "made.toml"
    done = run(command, "case", folder / ct, *(folder / name for name in labels), "--out", out)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "target" in done.stdout and "facial nerve" in done.stdout, done.stdout
    return tomllib.loads(out.read_text())


@pytest.mark.parametrize("kind", ["dicom", "masks", "nrrd", "nifti2"])
def test_a_case_in_one_command_is_the_same_from_every_format(
    images: SimpleNamespace, command: Path, folder: Path, kind: str
) -> None:
    shutil.copy(images.folder / "ct.nii.gz", folder)
    of_nifti = cased(command, folder, "ct.nii.gz", "labels.nii.gz")
    own = folder / f"of-{kind}"
    own.mkdir()
    masks = segments(images, overlap=False)
    if kind == "dicom":
        pydicom, hd = pytest.importorskip("pydicom"), pytest.importorskip("highdicom")
        write_series(pydicom, images, own / "series")
        write_seg(hd, images, masks, own / "seg.dcm")
        made = cased(command, own, "series", "seg.dcm")
    elif kind == "masks":
        shutil.copy(images.folder / "ct.nii.gz", own)
        write_masks(masks, LPS @ images.labels_lps, own / "masks")
        made = cased(command, own, "ct.nii.gz", "masks")
    elif kind == "nifti2":
        for name in ("ct.nii.gz", "labels.nii.gz"):
            nib.save(nib.Nifti2Image.from_image(nib.load(images.folder / name)), own / name)
        shutil.copy(images.folder / "labels.json", own)
        made = cased(command, own, "ct.nii.gz", "labels.nii.gz")
    else:
        nrrd, sitk = pytest.importorskip("nrrd"), pytest.importorskip("SimpleITK")
        sitk.WriteImage(sitk_image(sitk, images.ct, images.lps), str(own / "ct.nhdr"))
        write_slicer(nrrd, images, masks, own / "a.seg.nrrd")
        made = cased(command, own, "ct.nhdr", "a.seg.nrrd")
    assert Path(made["images"]["ct"]).name == {"dicom": "series", "nrrd": "ct.nhdr"}.get(kind, "ct.nii.gz")
    assert made["target"] == of_nifti["target"]
    assert len(made["structure"]) == len(of_nifti["structure"]) > 0
    assert made["structure"] == of_nifti["structure"]
    differ = {key for key in made.keys() | of_nifti.keys() if made.get(key) != of_nifti.get(key)}
    assert differ <= {"images"}, differ


def test_a_case_from_images_in_memory_is_that_of_the_command(
    images: SimpleNamespace, command: Path, folder: Path
) -> None:
    shutil.copy(images.folder / "ct.nii.gz", folder)
    of_command = cased(command, folder, "ct.nii.gz", "labels.nii.gz")
    names = json.loads((images.folder / "labels.json").read_text())
    ct, labels = (nib.load(images.folder / name) for name in ("ct.nii.gz", "labels.nii.gz"))
    kinds: list[tuple[Any, Any]] = [(ct, labels), ((images.ct, ct.affine), (images.labels, labels.affine))]
    sitk = pytest.importorskip("SimpleITK")
    kinds.append((sitk_image(sitk, images.ct, images.lps), sitk_image(sitk, images.labels, images.labels_lps)))
    cases = []
    for of_ct, of_labels in kinds:
        case = bonemill.Case.from_images(of_ct, of_labels, label_names=names)
        made = tomllib.loads(case.text)
        assert made["images"] == {**of_command["images"], "ct": "ct.nii", "labels": "labels.nii"}
        made["images"] = of_command["images"]
        assert made == of_command
        assert bonemill.Case.load(case.path) == case
        cases.append(case)
    # left is left: SimpleITK's image lies where nibabel's does
    files = [nib.load(case.path.with_name("ct.nii")) for case in cases]
    for file in files:
        assert np.allclose(file.affine, ct.affine, atol=1e-4) and np.array_equal(np.asarray(file.dataobj), images.ct)
    with pytest.raises(bonemill.CaseError, match="no label's name tells the target"):
        bonemill.Case.from_images(ct, labels)
    with pytest.warns(UserWarning, match="not spared"):
        case = bonemill.Case.from_images(ct, labels, target=names["target"])
    assert tomllib.loads(case.text).get("structure", []) == []
    with pytest.raises(bonemill.ArrayError, match="SimpleITK"):
        bonemill.Case.from_images(3, labels)  # type: ignore[arg-type]


def test_a_case_from_images_takes_masks_and_places(images: SimpleNamespace, folder: Path) -> None:
    names = json.loads((images.folder / "labels.json").read_text())
    ct, labels = (nib.load(images.folder / name) for name in ("ct.nii.gz", "labels.nii.gz"))
    values = np.asarray(labels.dataobj)
    mask = {name: ((values == names[name]).astype(np.uint8), labels.affine) for name in ("target", "facial_nerve")}
    points = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.5], [-7.0, 8.0, 9.0]]
    nerve = {"facial_nerve": mask["facial_nerve"]}
    case = bonemill.Case.from_images(ct, mask["target"], masks=nerve, target=1, fiducials=points)
    made = tomllib.loads(case.text)
    assert made["target"]["file"] == "labels.nii"
    assert [structure["file"] for structure in made["structure"]] == ["facial_nerve.nii"]
    assert "ct_mm = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.5], [-7.0, 8.0, 9.0]]" in case.text
    # not beside the labels.json of other labels
    (folder / "masks").mkdir()
    files = [folder / "masks" / f"{name}.nii.gz" for name in mask]
    for file, (data, affine) in zip(files, mask.values()):
        nib.save(nib.Nifti1Image(data, affine), file)
    for masks in (files[1:], files[1]):
        of_files = tomllib.loads(bonemill.Case.from_images(ct, files[0], masks=masks).text)
        assert (of_files["target"]["file"], of_files["structure"][0]["file"]) == tuple(map(str, files))
    with pytest.raises(bonemill.ArrayError, match="expected points"):
        bonemill.Case.from_images(ct, files[0], fiducials=[[1.0]])


@pytest.mark.parametrize("name", ["labels.nrrd", "labels.mha", "labels.nii"])
def test_labels_beside_the_ct_are_refused_in_every_format(
    images: SimpleNamespace, command: Path, folder: Path, name: str
) -> None:
    sitk = pytest.importorskip("SimpleITK")
    moved = images.lps.copy()
    moved[0, 3] += 2.5 * np.linalg.norm(images.lps[:3, 0])
    write_series(pytest.importorskip("pydicom"), images, folder / "series")
    sitk.WriteImage(sitk_image(sitk, images.labels, moved), str(folder / name))
    (folder / "case.toml").write_text(named(images, "series", name))
    refused = run(command, "plan", folder / "case.toml", "--out", folder / "no")
    assert refused.returncode == 2 and "(2.5 voxels) beside the CT's" in refused.stderr, refused.stderr
    assert ("labels_affine" in refused.stderr) == (name == "labels.nii"), "a key that only NIfTI has"


def test_every_file_that_is_read_has_its_digest(images: SimpleNamespace, command: Path, folder: Path) -> None:
    write_series(pytest.importorskip("pydicom"), images, folder / "series")
    write_masks(segments(images, overlap=True), LPS @ images.labels_lps, folder / "masks")
    plan = planned(command, folder, with_segments(images, "masks").replace('"ct.nii.gz"', '"series"'))
    inputs = tomllib.loads((plan / "plan.toml").read_text())["inputs"]
    read = [p for name in ("series", "masks") for p in sorted((folder / name).iterdir())]
    found = {name: digest for name, digest in inputs.items() if "series/" in name or "masks/" in name}
    assert [Path(name).name for name in found] == [p.name for p in read], "all of them, in the order of their names"
    assert list(found.values()) == [hashlib.sha256(p.read_bytes()).hexdigest() for p in read]
