"""The case: one patient, one tool, one robot."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import _folders, _images, _native
from ._errors import ArrayError, CaseError

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
    def _make(cls, text: str, path: Path, folder: TemporaryDirectory[str] | None) -> Case:
        case = object.__new__(cls)
        case._native = _native.Case(text, path)
        case._text, case._path, case._folder = text, path, folder
        return case

    def with_images(
        self,
        *,
        ct: _images.Image | None = None,
        labels: _images.Image | None = None,
        label_names: Mapping[str, int] | None = None,
    ) -> Case:
        """The same case on other images.

        Args:
            ct: Hounsfield units: a file, a nibabel image, or (array [i, j, k], affine (4, 4) to RAS+ mm).
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
        own = dict(zip(("ct", "labels"), self._image_paths()))
        named: dict[str, str] = {}
        for name, image in (("ct", ct), ("labels", labels)):
            if image is None:
                named[name] = os.path.abspath(own[name])
            elif _images.is_path(image):
                named[name] = os.path.abspath(os.fspath(image))  # type: ignore[arg-type]
            else:
                named[name] = f"{name}.nii"
                _images.write(Path(folder.name, named[name]), name, image)
        beside = own["labels"].with_name("labels.json")
        target = Path(folder.name, named["labels"]).with_name("labels.json")
        if label_names is not None:
            if target.parent != Path(folder.name):
                raise ArrayError("label_names are for labels in memory; a file has them in the labels.json beside it")
            target.write_text(json.dumps(dict(label_names), indent=2) + "\n", encoding="utf-8")
        elif target.parent == Path(folder.name) and beside.exists():
            target.write_bytes(beside.read_bytes())
        text = self.to_toml()
        for name, file in named.items():
            entry = f"{name} = {json.dumps(file)}"
            text = re.sub(rf"(?m)^{name} = .*$", lambda _, entry=entry: entry, text, count=1)  # type: ignore[misc]
        for name in ("calibration", "model"):
            # an arm's own files stay where they are
            text = re.sub(rf'(?m)^{name} = "(.+\.\w+)"$', lambda m, n=name: f"{n} = {json.dumps(self._beside(m[1]))}", text)  # type: ignore[misc]
        home = Path(folder.name, "case.toml")
        home.write_text(text, encoding="utf-8")
        return Case._make(text, home, folder)

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

    def _image_paths(self) -> tuple[Path, Path]:
        ct, labels = self._native.images()
        return self._path.parent / ct, self._path.parent / labels

    def _beside(self, name: str) -> str:
        return os.path.abspath(self._path.parent / name)

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
        return _restore_files, (self._text, files)


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise CaseError(f"cannot read the case {path}\n  because: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise CaseError(f"cannot read the case {path}\n  because: it is not UTF-8 text") from error


def _restore(text: str, path: str) -> Case:
    return Case._make(text, Path(path), None)


def _restore_files(text: str, files: dict[str, bytes]) -> Case:
    folder = _folders.temporary()
    for name, content in files.items():
        Path(folder.name, name).write_bytes(content)
    return Case._make(text, Path(folder.name, "case.toml"), folder)


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
