"""The case: one patient, one tool, one robot."""

from __future__ import annotations

import json
import os
import re
import shutil
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import _folders, _images, _native
from ._errors import ArrayError, BonemillError, CaseError

if TYPE_CHECKING:
    from tempfile import TemporaryDirectory


class Case:
    """A validated case file. Make one with `Case.load`; it does not change afterwards.

    Two cases are equal when they say the same about the same file. Cases can be pickled: one with images in memory
    takes them along.
    """

    _native: _native.Case
    _text: str
    _path: Path
    _folder: TemporaryDirectory[str] | None
    _origin: Path

    def __init__(self) -> None:
        raise TypeError("use Case.load(path)")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Case:
        """Reads and checks a case file (TOML; its keys: docs/case.md). Images are looked at when it is planned.

        Raises:
            CaseError: every fault with its key, line and what was expected.
        """
        return cls._make(_read(Path(path)), Path(path), None)

    @classmethod
    def _make(
        cls, text: str, path: Path, folder: TemporaryDirectory[str] | None, origin: Path | None = None
    ) -> Case:
        case = object.__new__(cls)
        case._native = _native.Case(text, path)
        case._text, case._path, case._folder, case._origin = text, path, folder, origin or path
        return case

    @classmethod
    def from_images(
        cls,
        ct: _images.Image,
        labels: _images.Image,
        *,
        masks: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | Mapping[str, _images.Image] = (),
        label_names: Mapping[str, int] | None = None,
        ct_series: str | None = None,
        target: str | int | None = None,
        structures: Sequence[str | int] = (),
        ignored: Sequence[str | int] = (),
        robot: str = "bone-attached",
        approach: Sequence[float] | None = None,
        registration: str | os.PathLike[str] | None = None,
        fiducials: str | os.PathLike[str] | Sequence[Sequence[float]] | None = None,
    ) -> Case:
        """A case made of images, as ``bonemill case`` makes one: target and structures by their usual names, values to start from.

        Args:
            ct: Hounsfield units: a file or a folder that the command reads, too, an image of nibabel or SimpleITK, or
                (array [i, j, k], affine (4, 4) to RAS+ mm).
            labels: whole numbers, the same way; or a folder with one mask per structure.
            masks: further files of labels or masks, on any grid, target and structures among them: files, a folder, or
                images in memory by their names. A mask is named by its file.
            label_names: names of labels in memory and their values.
            ct_series: SeriesInstanceUID of the CT, where its folder has several series.
            target: the label to be removed, by name or number, where names do not tell it.
            structures: labels to be spared that their names do not tell.
            ignored: labels not to be spared, whatever their names tell.
            robot: ``"bone-attached"`` or a UR such as ``"ur5e"``.
            approach: (3,), out of the bone, in RAS+, any length; by default the planner chooses it.
            registration: 3D Slicer's transform (.h5, .tfm, .txt) under which the CT lies where the robot's base sees it.
            fiducials: at least three points that the arm will touch in this order: a file of 3D Slicer (.mrk.json, .fcsv),
                or (n, 3) in RAS+ mm. What it finds is to be entered in the case. Not beside a registration.

        What the user should know of it (a label that is not spared, a side that is not known) is given as warnings.

        Raises:
            ArrayError: no volume, no such type, an affine that is none, points that are none. ImageError: an image that
            cannot be trusted. CaseError: names do not tell the target, a label that is not there, a file of 3D Slicer that
            cannot be read.
        """
        if registration is not None and fiducials is not None:
            raise ArrayError("registration and fiducials: expected one of them")
        folder = _folders.temporary()
        home = Path(folder.name, "case.toml")
        paths = {name: _in_folder(Path(folder.name), name, image) for name, image in (("ct", ct), ("labels", labels))}
        if label_names is not None:
            if _images.is_path(labels):
                raise ArrayError("label_names are for labels in memory; a file has them in the labels.json beside it")
            text = json.dumps(dict(label_names), indent=2) + "\n"
            home.with_name("labels.json").write_text(text, encoding="utf-8")
        wanted = (
            None if target is None else str(target),
            [str(label) for label in structures],
            [str(label) for label in ignored],
            robot,
            None if approach is None else tuple(float(part) for part in approach),
        )
        all_paths = [*paths.values(), *_masks(home.parent, masks)]
        named = [(path, Path(path.name) if path.parent == home.parent else path) for path in all_paths]
        images = ((named[0], ct_series), named[1], named[2:])
        try:
            place = _place(registration, fiducials)
            text, notes = _native.draft_case(images, wanted, place, home)  # type: ignore[arg-type]
        except BonemillError as error:
            said = re.sub(rf"{re.escape(folder.name + os.sep)}([^/\\]+)\.nii", r"the image \1 in memory", str(error))
            raise type(error)(said) from None
        home.write_text(text, encoding="utf-8")
        for note in notes:
            warnings.warn(note, stacklevel=2)
        return cls._make(text, home, folder, Path("the case from images"))

    def with_images(
        self,
        *,
        ct: _images.Image | None = None,
        labels: _images.Image | None = None,
        label_names: Mapping[str, int] | None = None,
    ) -> Case:
        """The same case on other images.

        Args:
            ct: Hounsfield units: a file, an image of nibabel or SimpleITK, or (array [i, j, k], affine (4, 4) to RAS+ mm).
            labels: whole numbers, the same way.
            label_names: names that the case uses, and their values; default: those beside the case's own map.

        Arrays are copied now: what happens to them later has no effect. Affines are kept in single precision, as
        NIfTI-1 has it.

        Raises:
            ArrayError: no volume, no such type, an affine that is none.
        """
        if ct is None and labels is None:
            raise ArrayError("with_images needs ct, labels or both")
        folder = _folders.temporary()
        own_labels = self._path.parent / dict(self._native.files())["images.labels"]
        named: dict[str, str] = {}
        for name, image in (("ct", ct), ("labels", labels)):
            if _images.is_path(image):
                named[f"images.{name}"] = os.path.abspath(os.fspath(image))  # type: ignore[arg-type]
            elif image is not None:
                named[f"images.{name}"] = f"{name}.nii"
                _images.write(Path(folder.name, f"{name}.nii"), name, image)
        target = Path(folder.name, named.get("images.labels", own_labels)).with_name("labels.json")
        beside = own_labels.with_name("labels.json")
        if label_names is not None:
            if target.parent != Path(folder.name):
                raise ArrayError("label_names are for labels in memory; a file has them in the labels.json beside it")
            target.write_text(json.dumps(dict(label_names), indent=2) + "\n", encoding="utf-8")
        elif target.parent == Path(folder.name) and beside.exists():
            target.write_bytes(beside.read_bytes())
        return self._moved(named, folder)

    def with_values(self, values: Mapping[str, Any]) -> Case:
        """The same case with other values: for sweeps.

        Args:
            values: by full key, as in docs/case.md: ``{"path.step_mm": 0.2, "structure.facial_nerve.clearance_mm": 1.5}``; a
                structure's keys are ``structure.NAME.KEY``. Numbers, texts, booleans, lists and dicts, numpy's too; None
                takes a key out, so that its default holds. What follows from a key (e.g. the stepover from the burr's
                radius) follows from its new value, unless the case gives it. Paths are relative to this case.

        Raises:
            CaseError: an unknown key or structure, with the nearest that there is; a value that the case refuses.
        """
        return self._moved(values, _folders.temporary())

    def _moved(self, values: Mapping[str, Any], folder: TemporaryDirectory[str]) -> Case:
        """The case with these values, in a temporary folder; its own files stay where they are, those in memory go along."""
        if self._folder is not None:
            for entry in Path(self._folder.name).iterdir():
                if not Path(folder.name, entry.name).exists():
                    shutil.copyfile(entry, Path(folder.name, entry.name))
        given = [(str(key), None if value is None else _toml(str(key), value)) for key, value in values.items()]
        try:
            text = _native.with_values(self._text, self._path, given)
            # checked before paths change, so that messages have the paths that were given
            files = _native.Case(text, self._path).files()
        except CaseError as error:
            # nobody has the text whose lines these are
            place = rf"(?m)^{re.escape(str(self._path))}(:\d+)?: "
            raise CaseError(re.sub(place, lambda _: f"{self._origin} with these values: ", str(error))) from None
        away: list[tuple[str, str | None]] = [
            (key, json.dumps(os.path.abspath(self._path.parent / name), ensure_ascii=False))
            for key, name in files
            if not Path(folder.name, name).exists()
        ]
        home = Path(folder.name, "case.toml")
        text = _native.with_values(text, self._path, away)
        home.write_text(text, encoding="utf-8")
        return Case._make(text, home, folder, self._origin)

    @contextmanager
    def _naming(self) -> Iterator[None]:
        """What is refused is named as the caller knows it, not by this case's temporary files."""
        try:
            yield
        except BonemillError as error:
            if self._folder is None:
                raise
            raise type(error)(self._told(str(error))) from None

    def _told(self, text: str) -> str:
        """A message with the names that the caller knows in place of this case's temporary files."""
        folder = "" if self._folder is None else re.escape(self._folder.name + os.sep)
        text = re.sub(rf"{folder}case\.toml(:\d+)?", lambda _: f"{self._origin} as changed", text)
        text = re.sub(rf"{folder}([^/\\]+)\.nii", r"the image \1 in memory", text)
        return re.sub(rf"{folder}labels\.json", "label_names", text)

    @property
    def path(self) -> Path:
        """The case's file."""
        return self._path

    @property
    def text(self) -> str:
        """The case as it was read."""
        return self._text

    def to_toml(self) -> str:
        """The case as it is understood: every default spelled out."""
        return self._native.to_toml()

    def _unchanged(self) -> None:
        """A plan records the digest of its case file, so the file must still be the case."""
        if _read(self._path) != self._text:
            raise CaseError(f"{self._path} has changed since it was loaded: load it again")

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Case):
            return NotImplemented
        return self._text == other._text and os.path.abspath(self._path) == os.path.abspath(other._path)

    def __hash__(self) -> int:
        return hash(self._text)

    def __repr__(self) -> str:
        return f"<bonemill.Case {str(self._path)!r}>"

    def __reduce__(self) -> tuple[Any, ...]:
        if self._folder is None:
            return _restore, (self._text, os.path.abspath(self._path))
        files = {entry.name: entry.read_bytes() for entry in Path(self._folder.name).iterdir()}
        return _restore_files, (self._text, files, str(self._origin))


def _in_folder(folder: Path, name: str, image: _images.Image) -> Path:
    """Where an image lies, absolute; one in memory is written into the folder."""
    if _images.is_path(image):
        return Path(os.path.abspath(os.fspath(image)))  # type: ignore[arg-type]
    path = folder / f"{name}.nii"
    _images.write(path, name, image)
    return path


def _masks(folder: Path, masks: Any) -> list[Path]:
    """Where further files of labels lie, absolute; masks in memory are written into the folder, by their names."""
    if isinstance(masks, Mapping):
        for name in masks:
            if name in ("ct", "labels") or not name.strip() or any(c in name for c in "/\\:"):
                raise ArrayError(f"masks: the name {name!r} is none for a file; expected a structure's name")
        return [_in_folder(folder, name, image) for name, image in masks.items()]
    files = [masks] if _images.is_path(masks) else list(masks)
    for file in files:
        if not _images.is_path(file):
            raise ArrayError(f"masks: {type(file).__name__}; expected files, or images in memory by their names")
    return [Path(os.path.abspath(os.fspath(file))) for file in files]


def _place(
    registration: Any, fiducials: Any
) -> tuple[Path | None, Path | None, list[tuple[float, float, float]] | None]:
    """Files of 3D Slicer, or the fiducials' places."""
    transform = None if registration is None else Path(registration)
    if fiducials is None or _images.is_path(fiducials):
        return transform, None if fiducials is None else Path(fiducials), None
    try:
        return transform, None, [(float(x), float(y), float(z)) for x, y, z in fiducials]
    except (TypeError, ValueError):
        raise ArrayError("fiducials: expected points (n, 3) in RAS+ mm, or a file of 3D Slicer") from None


def _toml(key: str, value: Any) -> str:
    """A value as TOML on one line."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (bool, str)):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, os.PathLike):
        return json.dumps(os.fspath(value), ensure_ascii=False)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{json.dumps(str(k))} = {_toml(key, v)}" for k, v in value.items()) + " }"
    if isinstance(value, Sequence):
        return "[" + ", ".join(_toml(key, v) for v in value) + "]"
    raise CaseError(f"{key} = {value!r}: expected a number, text, boolean, list or dict")


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise CaseError(f"cannot read the case {path}\n  because: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise CaseError(f"cannot read the case {path}\n  because: it is not UTF-8 text") from error


def _restore(text: str, path: str) -> Case:
    return Case._make(text, Path(path), None)


def _restore_files(text: str, files: dict[str, bytes], origin: str) -> Case:
    folder = _folders.temporary()
    for name, content in files.items():
        Path(folder.name, name).write_bytes(content)
    return Case._make(text, Path(folder.name, "case.toml"), folder, Path(origin))


def phantom(kind: str, out: str | os.PathLike[str], *, seed: int = 1) -> Case:
    """Writes a test body into a new folder: CT, labels, names and a commented case file.

    Args:
        kind: ``"block"`` (the foam block of Dillon et al. 2016) or ``"temporal"`` (a procedural mastoid).
        out: the folder; must not exist, or be empty.
        seed: another seed, another body of the same kind.

    Raises:
        CaseError: no such kind. PlanFileError: the folder cannot be written.
    """
    if not 0 <= seed < 2**64:
        raise ArrayError(f"seed = {seed}: expected 0 to 2**64 - 1")
    return Case.load(_native.write_phantom(kind, seed, Path(out)) / "case.toml")
