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


def sitk_image(sitk: Any, array: np.ndarray, lps: np.ndarray) -> Any:
    spacing = np.linalg.norm(lps[:3, :3], axis=0)
    image = sitk.GetImageFromArray(np.ascontiguousarray(array.transpose(2, 1, 0)))
    image.SetSpacing(spacing.tolist())
    image.SetDirection((lps[:3, :3] / spacing).ravel().tolist())
    image.SetOrigin(lps[:3, 3].tolist())
    return image


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


def slices(pydicom: Any, images: SimpleNamespace) -> list[Any]:
    """The CT as CT Image Storage, with a patient in every header; numbers of slices say the opposite of their positions."""
    from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid

    series, study, frame = generate_uid(), generate_uid(), generate_uid()
    spacing = np.linalg.norm(images.lps[:3, :3], axis=0)
    along = images.lps[:3, :3] / spacing
    made = []
    for k in range(images.ct.shape[2]):
        ds = pydicom.Dataset()
        ds.file_meta = pydicom.dataset.FileMetaDataset()
        ds.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        ds.SOPClassUID, ds.SOPInstanceUID = CTImageStorage, generate_uid()
        ds.file_meta.MediaStorageSOPClassUID = ds.SOPClassUID
        ds.file_meta.MediaStorageSOPInstanceUID = ds.SOPInstanceUID
        ds.SeriesInstanceUID, ds.StudyInstanceUID, ds.FrameOfReferenceUID = series, study, frame
        ds.PatientName, ds.PatientID, ds.PatientBirthDate = "Doe^Jane", "PATIENT-7", "19701231"
        ds.PatientSex, ds.StudyDate, ds.StudyTime, ds.AccessionNumber = "F", "20260102", "030405", "ACC-9"
        ds.InstitutionName, ds.ReferringPhysicianName, ds.StudyID = "St. Elsewhere", "Who^Dr", "STUDY-3"
        ds.Modality, ds.ImageType = "CT", ["ORIGINAL", "PRIMARY", "AXIAL"]
        ds.SeriesNumber, ds.InstanceNumber = 1, images.ct.shape[2] - k
        ds.SliceLocation = -float(k)
        ds.ImagePositionPatient = [f"{v:.12g}" for v in images.lps[:3, 3] + k * images.lps[:3, 2]]
        ds.ImageOrientationPatient = [f"{v:.12g}" for v in [*along[:, 0], *along[:, 1]]]
        ds.PixelSpacing = [f"{spacing[1]:.12g}", f"{spacing[0]:.12g}"]
        ds.SliceThickness = f"{spacing[2]:.12g}"
        ds.Rows, ds.Columns = images.ct.shape[1], images.ct.shape[0]
        ds.SamplesPerPixel, ds.PhotometricInterpretation = 1, "MONOCHROME2"
        ds.BitsAllocated, ds.BitsStored, ds.HighBit, ds.PixelRepresentation = 16, 16, 15, 0
        ds.RescaleIntercept, ds.RescaleSlope = -2048 - k, 1
        stored = images.ct[:, :, k].T.astype(np.int32) + 2048 + k
        ds.PixelData = stored.astype(np.uint16).tobytes()
        made.append(ds)
    return made


def assert_near(plan: Path, other: Path) -> None:
    """The same rows, and numbers to a micrometre: decimal strings of DICOM have 16 characters."""
    for name in ("waypoints.csv", "trajectory.csv"):
        rows = [np.genfromtxt(p / name, delimiter=",", skip_header=1, dtype=float) for p in (plan, other)]
        assert rows[0].shape == rows[1].shape, name
        assert np.allclose(rows[0], rows[1], rtol=1e-3, atol=1e-3, equal_nan=True), name


# of the patient and the scan; pydicom's UIDs begin with the last but one, highdicom's with the last
SECRETS = ["Doe^", "Jane", "PATIENT-7", "19701231", "20260102", "030405", "ACC-9", "Elsewhere", "Who^", "STUDY-3"]
SECRETS += ["1.2.826.0.1", "2.25."]


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


def write_series(pydicom: Any, images: SimpleNamespace, folder: Path, compressed: str | None = None) -> None:
    """One file a slice, in names of another order than the positions."""
    folder.mkdir()
    for n, ds in enumerate(slices(pydicom, images)):
        if compressed == "RLELossless":
            ds.compress(pydicom.uid.RLELossless)
        elif compressed == "ExplicitVRBigEndian":
            ds.file_meta.TransferSyntaxUID = pydicom.uid.ExplicitVRBigEndian
            ds.PixelData = np.frombuffer(ds.PixelData, np.uint16).byteswap().tobytes()
            ds["PixelData"].VR = "OW"
        ds.save_as(folder / f"IM{(7 * n) % 1009:04d}", enforce_file_format=True)


@pytest.mark.parametrize("compressed", [None, "RLELossless", "ExplicitVRBigEndian"])
def test_a_dicom_series_is_the_same_plan_and_its_patient_stays_in_it(
    images: SimpleNamespace, command: Path, folder: Path, from_nifti: Path, compressed: str | None
) -> None:
    pydicom = pytest.importorskip("pydicom")
    write_series(pydicom, images, folder / "dicom", compressed)
    plan = planned(command, folder, named(images, "dicom"))
    assert_near(plan, from_nifti)
    assert_no_secret(plan)
    # no reader of the verification's own: it says so, with a digest that pydicom's voxels and places have, too
    assert digest_by_pydicom(pydicom, folder / "dicom") in " ".join(readers_shared_by_verify(command, plan))


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


def segments(images: SimpleNamespace, overlap: bool) -> dict[str, np.ndarray]:
    """A mask for each label of the block, and another structure that shares voxels with the nerve."""
    names = json.loads((images.folder / "labels.json").read_text())
    masks = {name: images.labels == number for name, number in names.items()}
    masks = {name: mask for name, mask in masks.items() if mask.any()}
    if overlap:
        shared = np.zeros_like(images.labels, dtype=bool)
        nerve = np.argwhere(masks["facial_nerve"])
        shared[tuple(nerve[: len(nerve) // 2].T)] = True
        masks["Artery"] = shared
    return masks


MORE = '[[structure]]\nname = "artery"\nsegment = "Artery"\nclearance_mm = 1.0\n\n[approach]'


def with_segments(images: SimpleNamespace, labels: str) -> str:
    text = named(images, "ct.nii.gz", labels)
    assert 'name = "facial_nerve"\nlabel = 1' in text and "[approach]" in text
    text = text.replace('name = "facial_nerve"\nlabel = 1', 'name = "facial_nerve"\nsegment = "facial_nerve"')
    return text.replace("[approach]", MORE, 1)


def write_slicer(nrrd: Any, images: SimpleNamespace, masks: dict[str, np.ndarray], path: Path) -> None:
    """3D Slicer's segmentation with "Artery" on a layer of its own."""
    layers = np.zeros((2, *images.labels.shape), np.uint8)
    keys: dict[str, Any] = {}
    for n, (name, mask) in enumerate(masks.items()):
        layer = int(name == "Artery")
        value = 1 if layer else n + 1
        layers[layer][mask] = value
        keys |= {f"Segment{n}_ID": f"s{n}", f"Segment{n}_Name": name}
        keys |= {f"Segment{n}_LabelValue": str(value), f"Segment{n}_Layer": str(layer)}
    lps = images.labels_lps
    header = {
        "space": "left-posterior-superior",
        "space directions": np.vstack([[np.nan] * 3, lps[:3, :3].T]),
        "space origin": lps[:3, 3],
        "kinds": ["list", "domain", "domain", "domain"],
        "encoding": "gzip",
        **keys,
    }
    nrrd.write(str(path), layers, header, index_order="F")


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


def write_seg(hd: Any, images: SimpleNamespace, masks: dict[str, np.ndarray], path: Path) -> None:
    """DICOM SEG of the CT's slices, which gives it the same patient."""
    import pydicom
    from pydicom.sr.codedict import codes

    about = [
        hd.seg.SegmentDescription(
            segment_number=n + 1,
            segment_label=name,
            segmented_property_category=codes.SCT.Tissue,
            segmented_property_type=codes.SCT.Bone,
            algorithm_type=hd.seg.SegmentAlgorithmTypeValues.MANUAL,
        )
        for n, name in enumerate(masks)
    ]
    pixels = np.stack([mask.transpose(2, 1, 0) for mask in masks.values()], axis=-1).astype(np.uint8)
    assert np.allclose(images.lps, images.labels_lps), "the block's labels lie on the CT's grid"
    segmentation = hd.seg.Segmentation(
        source_images=slices(pydicom, images),
        pixel_array=pixels,
        segmentation_type=hd.seg.SegmentationTypeValues.BINARY,
        segment_descriptions=about,
        series_instance_uid=hd.UID(),
        series_number=2,
        sop_instance_uid=hd.UID(),
        instance_number=1,
        manufacturer="a",
        manufacturer_model_name="b",
        software_versions="c",
        device_serial_number="d",
    )
    segmentation.save_as(path)


def write_masks(masks: dict[str, np.ndarray], affine: np.ndarray, folder: Path) -> None:
    folder.mkdir()
    for name, mask in masks.items():
        nib.save(nib.Nifti1Image(mask.astype(np.uint8), affine), folder / f"{name}.nii.gz")


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
    write_series(pydicom, images, tmp_path / "dicom")
    write_seg(hd, images, segments(images, overlap=False), tmp_path / "seg.dcm")
    for source in (*(tmp_path / "dicom").iterdir(), tmp_path / "seg.dcm"):
        assert b"PATIENT-7" in source.read_bytes(), "the inputs have what must not get out"
    said = []

    def do(*words: str | Path) -> None:
        for more in ([], ["--json"]):
            done = run(command, *words, *more)
            assert done.returncode == 0, done.stdout + done.stderr
            said.append(done.stdout + done.stderr)

    case, plan, scene = (tmp_path / name for name in ("case.toml", "plan", "scene"))
    do("case", tmp_path / "dicom", tmp_path / "seg.dcm", "--out", case, "--force")
    case.write_text(case.read_text() + '\n[accuracy]\nlevel = "coarse"\n')
    do("plan", case, "--out", plan, "--pack")
    shutil.rmtree(plan)
    do("plan", case, "--out", plan)
    do("verify", plan)
    do("simulate", plan, "--step-mm", "0.5")
    do("export", plan, "--format", "slicer", "--out", scene)
    assert_no_secret(case, plan, scene, *said)
    # a refusal, too
    (tmp_path / "dicom" / "IM0000").unlink()
    refused = run(command, "plan", case, "--out", tmp_path / "no")
    assert refused.returncode == 2, refused.stdout
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
