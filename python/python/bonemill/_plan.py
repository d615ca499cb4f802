"""The plan: what a case becomes."""

from __future__ import annotations

import json
import os
import re
import warnings
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from . import _arrays, _folders, _native
from ._arm import Arm
from ._case import Case
from ._errors import ArrayError, PlanFileError

if TYPE_CHECKING:
    from tempfile import TemporaryDirectory

_Kind = TypeVar("_Kind", bound=np.generic)

Progress = Callable[[str, int, int], object]
"""``progress(stage, done, of)``: the stage that runs, and how much of the whole work is done, by the time that its stages typically
take, in thousandths: `of` is 1000. `done` never falls. What it raises stops the work."""


class Structure(NamedTuple):
    """A structure of the case."""

    name: str
    clearance_mm: float
    priority: int


class Segments(NamedTuple):
    """What a plan removes and leaves of a CT."""

    labels: NDArray[np.uint8]
    """[i, j, k] on the CT's grid; 0 is none of them."""
    affine: NDArray[np.float64]
    """From voxels to ct, 4 × 4, mm."""
    names: dict[int, str]
    """What each label is: the cavity, bone removed outside the target, bone that remains, the rest of the target by cause, structures."""


class Frames(NamedTuple):
    """Where a plan's frames are: 4 × 4 matrices, mm; ``a_from_b`` takes coordinates of b to coordinates of a.

    ct is the scan's RAS+ mm world, in which waypoints are; neighbours match in a product:
    ``base_from_ct @ ct_from_work``.
    """

    ct_from_work: NDArray[np.float64]
    """work: origin at the planning grid's first voxel centre, z the approach; ``theta_rad`` and ``phi_rad`` are its angles."""
    ct_from_grid: NDArray[np.float64]
    """The planning grid: work turned about z, so that voxel [i, j, k] has its centre at ``grid_spacing_mm`` · (i, j, k)."""
    base_from_ct: NDArray[np.float64]
    """The registration that was used."""
    flange_from_burr: NDArray[np.float64]
    """The tool on the arm's flange: origin the burr's centre, z to the handpiece."""
    grid_shape: tuple[int, int, int]
    """Voxels of the planning grid."""
    grid_spacing_mm: float
    """Their side."""


class Plan:
    """A plan: made by `plan`, or read with `Plan.load`. It does not change.

    Attributes that are arrays are made when first asked for, and read-only. Plans can be pickled: the files go along,
    the case's images stay where they are (unless they are in memory) and must still be there and the same.
    """

    _made: _native.Plan
    _case: Case | None
    _folder: TemporaryDirectory[str] | None
    _pack: bool
    _inputs: Path | None

    def __init__(self) -> None:
        raise TypeError("use bonemill.plan(case) or Plan.load(dir)")

    @classmethod
    def _make(
        cls,
        native: _native.Plan,
        case: Case | None,
        *,
        folder: TemporaryDirectory[str] | None = None,
        pack: bool = False,
        inputs: Path | None = None,
    ) -> Plan:
        plan = object.__new__(cls)
        plan._made, plan._case, plan._folder, plan._pack, plan._inputs = native, case, folder, pack, inputs
        return plan

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, inputs: str | os.PathLike[str] | None = None) -> Plan:
        """Reads a plan's folder.

        Args:
            path: the folder.
            inputs: a folder in which the plan's inputs (CT, labels, case …) are looked for as well, by name and by content:
                for a plan that was moved or sent. Without them it can be read and exported, not simulated or verified.

        Raises:
            PlanFileError: a file is missing or not one of ours, or an input has changed since the plan was made.
        """
        folder = None if inputs is None else Path(inputs)
        return cls._make(_native.Plan.load(Path(path), folder), None, inputs=folder)

    def save(self, path: str | os.PathLike[str], *, pack: bool = False, slices: bool = True) -> Path:
        """Writes ``plan.toml``, ``waypoints.csv``, ``forces.csv``, ``trajectory.csv``, ``robot.urdf``, ``report.html``, the case and
        notes.

        The folder appears whole or not at all; a plan that stands there is replaced, anything else is refused. The bytes
        are those that the command writes. Images in memory are kept in the plan, in ``inputs``.

        Args:
            path: the folder to write.
            pack: keep copies of all inputs in the plan, so that it can be moved or sent as it is; also done when the plan
                was made with ``pack=True`` or was read with such copies. DICOM files keep their header with the patient's name: a
                UserWarning says so.
            slices: whether ``report.html`` shows slices of the CT; False lets the page go where the scan may not. The page of
                a plan that was read is copied as it is.

        Returns:
            The folder, absolute.

        Raises:
            PlanFileError: the folder cannot be written, or holds something else; an input to be copied is missing.
        """
        in_memory = self._case is not None and self._case._folder is not None
        saved = self._made.save(Path(path), (pack or self._pack, in_memory), slices)
        headers = sum(_is_dicom(file) for file in (saved / "inputs").rglob("*") if file.is_file())
        if headers:
            warnings.warn(
                f"the plan keeps {headers} DICOM files with their headers, which hold the patient's name, number and dates: it may go"
                " only where the scan itself may",
                stacklevel=2,
            )
        return saved

    def to_slicer(self, path: str | os.PathLike[str], *, progress: Progress | None = None) -> Path:
        """Writes the plan as files for 3D Slicer; opening ``plan.mrml`` there shows them beside the case's CT.

        What ``bonemill export --format slicer`` writes: ``plan.seg.nrrd`` and ``plan.nii.gz`` (cavity, bone removed outside the
        target, bone that remains, rest of the target by cause, structures, uint8 [i, j, k] on the CT's grid), surfaces as STL, path, way in
        and holds as ``.mrk.json`` with speed (mm/s) and force (N) at each point, and ``forces.vtk``. Positions in the files are LPS, mm.

        Args:
            path: the folder to write, whole or not at all; an earlier scene is replaced, anything else is refused.
            progress: told ``(stage, done, of)``; what it raises stops the work.

        Returns:
            The folder, absolute.

        Raises:
            PlanFileError: the folder holds something else or cannot be written, an input is missing or changed, or the plan's images are in
                memory, so that the scene would refer to nothing.
            ImageError, PlanError: the images cannot be read or trusted.
        """
        from ._judge import _on_disk

        own = None if self._folder is None else Path(self._folder.name, "plan", "inputs")
        if (self._case is not None and self._case._folder is not None) or (own is not None and own.is_dir()):
            raise PlanFileError(
                "the plan's images are in memory, and a scene refers to the CT's file: use Plan.load(plan.save(folder)).to_slicer(…)"
            )
        with _on_disk(self, False) as saved:
            return _native.to_slicer(self._made, saved, Path(path), progress)

    def segments(self, *, progress: Progress | None = None) -> Segments:
        """What the plan removes and leaves, as a label map on the CT's grid: the voxels of ``to_slicer``'s ``plan.nii.gz``.

        Args:
            progress: told ``(stage, done, of)``; what it raises stops the work.

        Raises:
            PlanFileError: an input is missing or changed.
            ImageError, PlanError: the images cannot be read or trusted.
        """
        from ._judge import _on_disk

        with _on_disk(self, False) as saved:
            labels, affine, names = _native.segments(self._made, saved, progress)
        return Segments(labels, np.array(affine), dict(names))

    @property
    def missing_inputs(self) -> list[str]:
        """The inputs that were not found when the plan was read, each with its recorded place and digest."""
        return self._made.missing_inputs()

    @property
    def case(self) -> Case:
        """The case that was planned."""
        if self._case is None:
            self._case = Case.load(self._made.case_path())
        return self._case

    @cached_property
    def waypoints(self) -> NDArray[np.void]:
        """One row a waypoint, shape (n,): the columns of ``waypoints.csv`` by name, in its order, ct frame.

        ``kind`` and ``structure`` are text ("" for none); where the file's cell is empty, a number is NaN.
        """
        layers, kinds, structures = self._made.codes()
        columns: list[tuple[str, NDArray[Any]]] = [("index", np.arange(len(layers))), ("layer", layers)]
        columns += [("kind", np.array(self._made.kinds())[kinds]), *self._made.columns()]
        return _fixed(_arrays.table(columns, self._names()[structures]))

    @cached_property
    def forces(self) -> NDArray[np.void]:
        """Force toward every structure near each waypoint, shape (m,): the columns of ``forces.csv`` by name, ct frame.

        A waypoint has a row for each structure within its influence (its clearance from the burr's surface and 8 mm more) and for
        the one that ``waypoints`` names: ``f = plan.forces; f[f["structure"] == "facial_nerve"]["force_toward_n"].max()``.
        ``index`` is the waypoint, (``toward_x``, ``toward_y``, ``toward_z``) the unit direction from the burr's centre to the
        structure's nearest point, ``distance_mm`` the distance between them. ``deflection_toward_um`` is NaN without a stiffness.
        """
        waypoints, structures, columns = self._made.force_columns()
        rows: list[tuple[str, NDArray[Any]]] = [("index", waypoints), *columns]
        return _fixed(_arrays.table(rows, self._names()[structures]))

    def _names(self) -> NDArray[np.str_]:
        """Names of the structures by place; at −1: none."""
        return np.array([s.name for s in self.structures] + [""])

    @cached_property
    def trajectory(self) -> NDArray[np.void]:
        """One row a controller period, shape (n,): ``time_s, q1..qn, qd1..qdn``, as in ``trajectory.csv``.

        Revolute joints in rad and rad/s, prismatic ones in mm and mm/s. `q` and `qd` are views of it.
        """
        joints = range(1, self.arm.dof + 1)
        names = ["time_s", *(f"q{n}" for n in joints), *(f"qd{n}" for n in joints)]
        table = self._made.trajectory()
        return _fixed(table.view([(name, np.float64) for name in names])[:, 0])

    @property
    def q(self) -> NDArray[np.float64]:
        """Joint positions of the trajectory, shape (n, dof); a view."""
        return self._table()[:, 1 : 1 + self.arm.dof]

    @property
    def qd(self) -> NDArray[np.float64]:
        """Joint velocities of the trajectory, shape (n, dof); a view."""
        return self._table()[:, 1 + self.arm.dof :]

    def _table(self) -> NDArray[np.float64]:
        return self.trajectory.view(np.float64).reshape(len(self.trajectory), -1)

    @cached_property
    def metrics(self) -> dict[str, Any]:
        """The figures of ``plan.toml``: ``removed_mm3``, ``reachable_mm3``, ``total_time_s``, …; names end in units."""
        return self._made.metrics()

    @cached_property
    def modelled(self) -> dict[str, Any]:
        """What was modelled where."""
        return self._made.modelled()

    @property
    def shortfalls(self) -> list[str]:
        """Why the plan falls short of its case; empty when it does not."""
        return self._made.words()[0]

    @property
    def warnings(self) -> list[str]:
        """What one should know."""
        return self._made.words()[1]

    @property
    def seconds(self) -> dict[str, float]:
        """Wall-clock seconds by stage of planning; empty for a plan that was read."""
        found: dict[str, float] = {}
        for stage, seconds in self._made.seconds():
            found[stage] = found.get(stage, 0.0) + seconds
        return found

    @property
    def registration_assumed(self) -> bool:
        """Whether the case says nothing of where the arm stands, so that the trajectory is for no real set-up."""
        return self._made.registration_assumed()

    @cached_property
    def structures(self) -> tuple[Structure, ...]:
        """The case's structures."""
        return tuple(Structure(*row) for row in self._made.structure_rows())

    @cached_property
    def frames(self) -> Frames:
        """Where work, grid, base and burr are."""
        matrices = {name: _fixed(matrix) for name, matrix in self._made.frames()}
        (nx, ny, nz), spacing_mm = self._made.grid()
        return Frames(**matrices, grid_shape=(nx, ny, nz), grid_spacing_mm=spacing_mm)

    @cached_property
    def arm(self) -> Arm:
        """The arm, within the case's limits."""
        return Arm(self._made.robot())

    def __repr__(self) -> str:
        m = self.metrics
        return (
            f"<bonemill.Plan: {m['removed_mm3']:.1f} of {m['reachable_mm3']:.1f} mm³ in {m['total_time_s']:.0f} s"
            f"{', falls short' if self.shortfalls else ''}>"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        with _folders.temporary() as folder:
            saved = self.save(Path(folder, "plan"))
            files = {p.relative_to(saved).as_posix(): p.read_bytes() for p in saved.rglob("*") if p.is_file()}
        inputs = None if self._inputs is None else os.path.abspath(self._inputs)
        return _restore, (files, os.path.abspath(self._made.case_path()), inputs, self._pack)


def _as_plan(plan: Plan | str | os.PathLike[str]) -> Plan:
    """A plan, or the one in a folder."""
    if isinstance(plan, Plan):
        return plan
    if isinstance(plan, (str, os.PathLike)):
        return Plan.load(plan)
    hint = "; bonemill.plan(case) makes one" if isinstance(plan, Case) else ""
    raise ArrayError(f"plan is {type(plan).__name__}: expected a Plan or a plan's folder{hint}")


def _is_dicom(file: Path) -> bool:
    """Whether a file has DICOM's mark behind its preamble."""
    with file.open("rb") as opened:
        return opened.read(132)[128:] == b"DICM"


def _restore(files: dict[str, bytes], case_path: str, inputs: str | None, pack: bool) -> Plan:
    folder = _folders.temporary()
    home = Path(folder.name, "plan")
    for name, content in files.items():
        path = home / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    record = home / "plan.toml"
    if not any(name.startswith("inputs/") for name in files):
        # the case stayed where it is, seen from here
        away = json.dumps(os.path.relpath(case_path, os.path.realpath(home)))
        text = record.read_text(encoding="utf-8")
        record.write_text(
            re.sub(r"(?m)^case_file = .*$", lambda _: f"case_file = {away}", text, count=1), encoding="utf-8"
        )
    found = None if inputs is None else Path(inputs)
    return Plan._make(_native.Plan.load(home, found), None, folder=folder, pack=pack, inputs=found)


def _fixed(rows: NDArray[_Kind]) -> NDArray[_Kind]:
    rows.flags.writeable = False
    return rows


def plan(
    case: Case | str | os.PathLike[str],
    *,
    pack: bool = False,
    progress: Progress | None = None,
    threads: int | None = None,
) -> Plan:
    """Plans a case. The numbers are those of the command, whatever the number of threads.

    Args:
        case: a `Case`, or a case file.
        pack: `Plan.save` keeps copies of all inputs in the plan's folder, so that it can be moved or sent as it is.
        progress: told ``(stage, done, of)`` in the calling thread; what it raises stops the planning.
        threads: worker threads; default: one per core.

    Ctrl-C stops it within a fifth of a second. Other Python threads go on, and may plan, too.

    Raises:
        CaseError, ImageError, PlanFileError, PlanError, RobotError, ModelError: why there is no plan, in the command's
            words. A plan that falls short of its case is no error: see `Plan.shortfalls`.
    """
    asked = case if isinstance(case, Case) else Case.load(case)
    asked._unchanged()
    count = None if threads is None else _arrays.whole("threads", threads, 1, 1024)
    with asked._naming():
        return Plan._make(_native.plan(asked._native, progress, count), asked, pack=pack)
