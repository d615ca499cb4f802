"""A plan as a scene for 3D Slicer, read back with the readers that others use, and a reader of MRML written here."""

import json
import shutil
import urllib.parse
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bonemill

LPS = np.diag([-1.0, -1.0, 1.0])
BURR_MM = 2.5


@pytest.fixture(scope="module")
def scene(planned: bonemill.Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scene of the block's plan, which was not saved before."""
    out = tmp_path_factory.mktemp("slicer") / "scene"
    stages: list[str] = []
    assert planned.to_slicer(out, progress=lambda stage, done, of: stages.append(stage)) == out.resolve()
    assert "causes of the rest" in stages
    return out


def positions(plan: bonemill.Plan) -> NDArray[np.float64]:
    """The path in RAS+, mm, shape (n, 3)."""
    return np.stack([plan.waypoints[name] for name in ("x_mm", "y_mm", "z_mm")], axis=1)


def affine_of(head: Any) -> NDArray[np.float64]:
    """From voxels to RAS+, mm, of an NRRD header in LPS."""
    assert head["space"] == "left-posterior-superior"
    affine = np.eye(4)
    affine[:3, :3] = LPS @ np.asarray(head["space directions"], dtype=float).T
    affine[:3, 3] = LPS @ np.asarray(head["space origin"], dtype=float)
    return affine


def names(head: Any) -> dict[str, int]:
    """Labels by the names of the segments."""
    count = sum(key.endswith("_LabelValue") for key in head)
    return {head[f"Segment{n}_Name"]: int(head[f"Segment{n}_LabelValue"]) for n in range(count)}


def from_path(points: NDArray[np.float64], path: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance of each point from the path, mm."""
    nearest = np.full(len(points), np.inf)
    for a, b in zip(path[:-1], path[1:]):
        way, off = b - a, points - a
        square = way @ way
        share = np.clip(off @ way / square, 0.0, 1.0) if square > 0.0 else np.zeros(len(points))
        np.minimum(nearest, np.linalg.norm(off - share[:, None] * way, axis=1), out=nearest)
    return nearest


def test_segments_as_arrays_are_those_of_the_scene(planned: bonemill.Plan, scene: Path) -> None:
    nibabel = pytest.importorskip("nibabel")
    found, label_map = planned.segments(), nibabel.load(scene / "plan.nii.gz")
    assert found.labels.dtype == np.uint8
    np.testing.assert_array_equal(found.labels, np.asarray(label_map.dataobj))
    np.testing.assert_allclose(found.affine, label_map.affine, atol=1e-6)
    assert found.names == {int(n): name for n, name in json.loads((scene / "labels.json").read_text()).items()}


def test_segments_lie_on_the_ct_for_pynrrd_and_nibabel(planned: bonemill.Plan, scene: Path) -> None:
    nrrd, nibabel = pytest.importorskip("nrrd"), pytest.importorskip("nibabel")
    voxels, head = nrrd.read(str(scene / "plan.seg.nrrd"))
    folder = planned.case.path.parent
    ct, label_map = nibabel.load(folder / "ct.nii.gz"), nibabel.load(scene / "plan.nii.gz")
    assert voxels.shape == ct.shape == label_map.shape and voxels.dtype == np.uint8
    np.testing.assert_allclose(affine_of(head), ct.affine, atol=1e-6)
    np.testing.assert_allclose(label_map.affine, ct.affine, atol=1e-6)
    np.testing.assert_array_equal(np.asarray(label_map.dataobj), voxels)
    assert names(head) == {name: int(n) for n, name in json.loads((scene / "labels.json").read_text()).items()}

    # what the burr removes, found anew: the ball along the path, at the voxels' centres
    target = np.asarray(nibabel.load(folder / "labels.nii.gz").dataobj)
    hu = np.asarray(ct.dataobj)
    index = np.argwhere(np.ones(ct.shape, dtype=bool))
    points = index @ ct.affine[:3, :3].T + ct.affine[:3, 3]
    path = positions(planned)
    near = np.all((points > path.min(0) - 4.0) & (points < path.max(0) + 4.0), axis=1)
    index, points = index[near], points[near]
    off_mm, found = from_path(points, path), voxels[tuple(index.T)]
    # half the diagonal of a planning voxel, by which a border may be off
    sure = np.abs(off_mm - BURR_MM) > 0.5 * np.sqrt(3.0) * planned.frames.grid_spacing_mm
    removed, bone = off_mm < BURR_MM, hu[tuple(index.T)] >= 200.0
    label = names(head)
    cavity = label["cavity: target removed"]
    sweep = label["sweep outside the target: bone removed"]
    low, high = np.array([-1.0, -4.0, -4.0]), np.array([7.0, 4.0, 0.0])
    inside = np.all((points > low + 0.13) & (points < high - 0.13), axis=1)
    outside = np.any((points < low - 0.13) | (points > high + 0.13), axis=1)
    assert set(found[sure & removed & inside]) == {cavity}
    assert set(found[sure & removed & outside & bone]) <= {sweep} and set(found[sure & removed & outside & ~bone]) <= {0}
    assert cavity not in found[sure & ~removed] and sweep not in found[sure & ~removed]
    rest = {n for name, n in label.items() if name.startswith("not removed")}
    assert rest and set(found[sure & ~removed & inside]) <= rest
    np.testing.assert_array_equal(voxels == label["facial_nerve"], target == 1)
    cavity_mm3 = np.count_nonzero(voxels == cavity) * abs(np.linalg.det(ct.affine))
    assert cavity_mm3 == pytest.approx(planned.metrics["removed_mm3"], rel=0.01)
    for name, mm3 in planned.metrics["not_removed_mm3"].items():
        rest_mm3 = np.count_nonzero(voxels == label[f"not removed: {name}"]) * abs(np.linalg.det(ct.affine))
        assert rest_mm3 == pytest.approx(mm3, rel=0.1, abs=0.5), name


def test_simpleitk_reads_both_images_at_one_place(scene: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    nibabel = pytest.importorskip("nibabel")
    segments, label_map = sitk.ReadImage(str(scene / "plan.seg.nrrd")), sitk.ReadImage(str(scene / "plan.nii.gz"))
    np.testing.assert_array_equal(sitk.GetArrayFromImage(segments), sitk.GetArrayFromImage(label_map))
    for of in ("GetOrigin", "GetSpacing", "GetDirection"):
        np.testing.assert_allclose(getattr(segments, of)(), getattr(label_map, of)(), atol=1e-6)
    affine = nibabel.load(scene / "plan.nii.gz").affine
    for voxel in ((0, 0, 0), (7, 0, 0), (0, 11, 0), (3, 5, 13)):
        place = segments.TransformIndexToPhysicalPoint(voxel)
        np.testing.assert_allclose(place, LPS @ (affine @ (*voxel, 1))[:3], atol=1e-5)
    assert segments.GetMetaData("Segment0_ID") == "cavity"
    assert "272673000" in segments.GetMetaData("Segment2_Tags")


def test_vtk_reads_surfaces_and_forces_in_lps(planned: bonemill.Plan, scene: Path) -> None:
    vtk = pytest.importorskip("vtk")
    from vtk.util.numpy_support import vtk_to_numpy

    def surface(name: str) -> tuple[NDArray[np.float64], float]:
        assert b"SPACE=LPS" in (scene / name).read_bytes()[:80]
        reader = vtk.vtkSTLReader()
        reader.SetFileName(str(scene / name))
        reader.Update()
        mass = vtk.vtkMassProperties()
        mass.SetInputData(reader.GetOutput())
        return vtk_to_numpy(reader.GetOutput().GetPoints().GetData()).astype(float), mass.GetVolume()

    # the pocket reaches from -1 to 7 mm along x: left stays left
    corners, volume_mm3 = surface("cavity.stl")
    np.testing.assert_allclose(corners.min(0), [-7.0, -4.0, -4.0], atol=0.13)
    np.testing.assert_allclose(corners.max(0), [1.0, 4.0, 0.0], atol=0.13)
    assert volume_mm3 == pytest.approx(planned.metrics["removed_mm3"], rel=0.02)
    # the tool stands where the motion begins
    first = planned.waypoints[0]
    start, axis = (LPS @ [first[f"{name}{end}"] for name in names] for names, end in ((("x", "y", "z"), "_mm"), (("axis_x", "axis_y", "axis_z"), "")))
    corners, _ = surface("tool.stl")
    along = (corners - start) @ axis
    aside = np.linalg.norm(corners - start - along[:, None] * axis, axis=1)
    assert along.min() == pytest.approx(-BURR_MM, abs=0.02) and along.max() > 60.0
    assert aside[along < 0.0].max() == pytest.approx(BURR_MM, abs=0.02)

    reader = vtk.vtkPolyDataReader()
    reader.SetFileName(str(scene / "forces.vtk"))
    reader.Update()
    lines = reader.GetOutput()
    assert "SPACE=LPS" in reader.GetHeader()
    np.testing.assert_array_equal(vtk_to_numpy(lines.GetPoints().GetData()), positions(planned) @ LPS)
    force = np.linalg.norm([planned.waypoints[name] for name in ("fx_n", "fy_n", "fz_n")], axis=0)
    toward = np.nan_to_num(planned.waypoints["force_toward_n"])
    columns = {"force_n": force, "force_toward_n": toward, "driven_mm_s": planned.waypoints["driven_mm_s"]}
    for name, values in columns.items():
        np.testing.assert_allclose(vtk_to_numpy(lines.GetPointData().GetArray(name)), values, rtol=1e-12)
    assert lines.GetPointData().GetScalars().GetName() == "force_n"
    assert lines.GetNumberOfLines() == lines.GetCellData().GetArray("is_cut").GetNumberOfTuples()


def test_markups_are_curves_with_speed_and_force(planned: bonemill.Plan, scene: Path) -> None:
    for name in ("path", "approach"):
        (markup,) = json.loads((scene / f"{name}.mrk.json").read_text())["markups"]
        assert (markup["type"], markup["coordinateSystem"], markup["coordinateUnits"]) == ("Curve", "LPS", "mm")
        points = np.array([point["position"] for point in markup["controlPoints"]])
        np.testing.assert_array_equal(points, positions(planned)[: len(points)] @ LPS)
        measured = {one["name"]: one for one in markup["measurements"]}
        speed = measured["driven speed"]
        assert speed["units"] == "mm/s"
        np.testing.assert_array_equal(speed["controlPointValues"], planned.waypoints["driven_mm_s"][: len(points)])
        assert len(measured["force"]["controlPointValues"]) == len(points)
    assert "cut" in planned.waypoints["kind"][len(points) - 1] and "cut" not in planned.waypoints["kind"][: len(points) - 1]
    assert not (scene / "holds.mrk.json").exists()


class Scene:
    """A reader of MRML: nodes by id, and the files that they refer to."""

    def __init__(self, path: Path) -> None:
        self.folder = path.parent
        root = ElementTree.parse(path).getroot()
        assert root.tag == "MRML" and root.get("version", "").startswith("Slicer")
        self.nodes = {node.get("id", ""): node for node in root}
        assert len(self.nodes) == len(root), "no id twice"

    def of(self, tag: str) -> list[ElementTree.Element]:
        return [node for node in self.nodes.values() if node.tag == tag]

    def referred(self, node: ElementTree.Element, role: str) -> ElementTree.Element:
        roles = dict(entry.split(":", 1) for entry in node.get("references", "").split(";") if entry)
        return self.nodes[roles[role]]

    def file(self, node: ElementTree.Element) -> Path:
        name = urllib.parse.unquote(self.referred(node, "storage").get("fileName", ""))
        return (self.folder / name).resolve()


def test_the_scene_shows_every_file_beside_the_ct(planned: bonemill.Plan, scene: Path) -> None:
    mrml = Scene(scene / "plan.mrml")
    (ct,) = mrml.of("Volume")
    assert mrml.file(ct) == (planned.case.path.parent / "ct.nii.gz").resolve()
    (segmentation,) = mrml.of("Segmentation")
    assert mrml.referred(segmentation, "referenceImageGeometryRef") is ct
    kinds = {"Segmentation", "LabelMapVolume", "Model", "MarkupsCurve", "MarkupsFiducial"}
    files = {mrml.file(node) for kind in kinds for node in mrml.of(kind)}
    assert files == {path.resolve() for path in scene.iterdir() if path.name not in ("plan.mrml", "labels.json")}
    for kind in kinds | {"Volume"}:
        for node in mrml.of(kind):
            display = mrml.referred(node, "display")
            assert display.get("id", "").startswith("vtkMRML") and "Display" in display.tag
    for kind in ("ModelStorage", "MarkupsJsonStorage"):
        assert mrml.of(kind) and all(node.get("coordinateSystem") == "LPS" for node in mrml.of(kind))
    # slices and camera, in RAS, look at the path
    path = positions(planned)[planned.waypoints["kind"] == "cut"]
    middle = 0.5 * (path.min(0) + path.max(0))
    assert {node.get("layoutName") for node in mrml.of("Slice")} == {"Red", "Yellow", "Green"}
    for node in mrml.of("Slice"):
        to_ras = np.array(node.get("sliceToRAS", "").split(), dtype=float).reshape(4, 4)
        np.testing.assert_allclose(to_ras[:3, 3], middle)
        axes = to_ras[:3, :3]
        np.testing.assert_array_equal(axes.T @ axes, np.eye(3))
    (camera,) = mrml.of("Camera")
    np.testing.assert_allclose([float(v) for v in camera.get("focalPoint", "").split()], middle)


def test_left_stays_left_whatever_the_order_of_the_voxels(own_block: bonemill.Case, tmp_path: Path) -> None:
    nrrd, nibabel = pytest.importorskip("nrrd"), pytest.importorskip("nibabel")
    path = own_block.path.parent / "ct.nii.gz"
    stored = nibabel.load(path)
    # the same CT in the order that DICOM has: to the left, to the back, upwards
    turned = stored.as_reoriented(np.array([[0, -1], [1, -1], [2, 1]]))
    assert nibabel.aff2axcodes(turned.affine) == ("L", "P", "S")
    nibabel.save(nibabel.Nifti1Image(np.asarray(turned.dataobj), turned.affine), path)
    plan = bonemill.plan(bonemill.Case.load(own_block.path))
    plan.to_slicer(tmp_path / "scene")
    voxels, head = nrrd.read(str(tmp_path / "scene/plan.seg.nrrd"))
    np.testing.assert_allclose(affine_of(head), turned.affine, atol=1e-6)
    cavity = np.argwhere(voxels == 1) @ turned.affine[:3, :3].T + turned.affine[:3, 3]
    # the middle of the pocket is 3 mm to the right of the body's
    np.testing.assert_allclose(0.5 * (cavity.min(0) + cavity.max(0)), [3.0, 0.0, -2.0], atol=0.2)


def test_what_would_be_lost_or_refers_to_nothing_is_refused(planned: bonemill.Plan, block: bonemill.Case, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/notes.txt").write_text("mine")
    with pytest.raises(bonemill.PlanFileError, match="mine"):
        planned.to_slicer(tmp_path / "mine")
    assert [path.name for path in tmp_path.rglob("*")] == ["mine", "notes.txt"]
    # a plan that lost its CT
    case = tmp_path / "block"
    shutil.copytree(block.path.parent, case)
    plan = bonemill.plan(bonemill.Case.load(case / block.path.name))
    saved = bonemill.Plan.load(plan.save(tmp_path / "plan"))
    (case / "ct.nii.gz").unlink()
    with pytest.raises(bonemill.PlanFileError, match=r"ct\.nii\.gz"):
        saved.to_slicer(tmp_path / "scene")
    assert not (tmp_path / "scene").exists()


def test_images_in_memory_are_refused_until_the_plan_is_saved(block: bonemill.Case, tmp_path: Path) -> None:
    nibabel = pytest.importorskip("nibabel")
    folder = block.path.parent
    case = block.with_images(ct=nibabel.load(folder / "ct.nii.gz"), labels=nibabel.load(folder / "labels.nii.gz"))
    plan = bonemill.plan(case)
    with pytest.raises(bonemill.PlanFileError, match="in memory"):
        plan.to_slicer(tmp_path / "scene")
    bonemill.Plan.load(plan.save(tmp_path / "plan")).to_slicer(tmp_path / "scene")
    mrml = Scene(tmp_path / "scene/plan.mrml")
    assert mrml.file(mrml.of("Volume")[0]).is_relative_to(tmp_path / "plan/inputs")
