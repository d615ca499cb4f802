"""Images as other programs write them: SimpleITK, pydicom, highdicom, pynrrd and nibabel.

`images` in their arguments has voxels `ct` and `labels` [i, j, k], the affines `lps` and `labels_lps` from index to LPS, mm, and
the `folder` of the NIfTI files.
"""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import nibabel as nib
import numpy as np


def sitk_image(sitk: Any, array: np.ndarray, lps: np.ndarray) -> Any:
    spacing = np.linalg.norm(lps[:3, :3], axis=0)
    image = sitk.GetImageFromArray(np.ascontiguousarray(array.transpose(2, 1, 0)))
    image.SetSpacing(spacing.tolist())
    image.SetDirection((lps[:3, :3] / spacing).ravel().tolist())
    image.SetOrigin(lps[:3, 3].tolist())
    return image


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


def compressed_pixels(pydicom: Any, sitk: Any, pixels: np.ndarray, compressor: str, path: Path) -> Any:
    """The pixels of a slice in a file that SimpleITK has compressed: with its lossless JPEG or JPEG 2000."""
    writer = sitk.ImageFileWriter()
    writer.SetFileName(str(path))
    writer.SetUseCompression(True)
    writer.SetCompressor(compressor)
    writer.Execute(sitk.GetImageFromArray(pixels[None]))
    return pydicom.dcmread(path)


def write_series(pydicom: Any, images: SimpleNamespace, folder: Path, compressed: str | None = None, sitk: Any = None) -> None:
    """One file a slice, in names of another order than the positions."""
    folder.mkdir()
    for n, ds in enumerate(slices(pydicom, images)):
        if compressed == "RLELossless":
            ds.compress(pydicom.uid.RLELossless)
        elif compressed == "ExplicitVRBigEndian":
            ds.file_meta.TransferSyntaxUID = pydicom.uid.ExplicitVRBigEndian
            ds.PixelData = np.frombuffer(ds.PixelData, np.uint16).byteswap().tobytes()
            ds["PixelData"].VR = "OW"
        elif compressed == "DeflatedExplicitVRLittleEndian":
            ds.file_meta.TransferSyntaxUID = pydicom.uid.DeflatedExplicitVRLittleEndian
        elif compressed == "ImplicitVRLittleEndian":
            ds.file_meta.TransferSyntaxUID = pydicom.uid.ImplicitVRLittleEndian
        elif compressed is not None:
            pixels = np.frombuffer(ds.PixelData, np.uint16).reshape(ds.Rows, ds.Columns)
            read = compressed_pixels(pydicom, sitk, pixels, compressed, folder / "one.dcm")
            ds.file_meta.TransferSyntaxUID = read.file_meta.TransferSyntaxUID
            ds.PixelData = read.PixelData
            ds["PixelData"].VR, ds["PixelData"].is_undefined_length = "OB", True
            (folder / "one.dcm").unlink()
        ds.save_as(folder / f"IM{(7 * n) % 1009:04d}", enforce_file_format=True)


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
