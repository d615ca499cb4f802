"""A prosthesis: from its job file to a proven milling program."""

from __future__ import annotations

import os
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._plan import Progress

_MOVE = np.dtype(
    [
        ("side", "U1"),
        ("kind", "U7"),
        ("x_mm", "f8"),
        ("y_mm", "f8"),
        ("z_mm", "f8"),
        ("a_rad", "f8"),
        ("feed_mm_min", "f8"),
        ("time_s", "f8"),
    ]
)


class ProsthesisPlan:
    """A planned prosthesis, made by `prosthesis`. It does not change.

    A block that was taken out of a catalogue goes back unless the plan is saved.
    """

    _made: _native.ProsthesisPlan

    def __init__(self) -> None:
        raise TypeError("use bonemill.prosthesis(job)")

    @classmethod
    def _make(cls, native: _native.ProsthesisPlan) -> ProsthesisPlan:
        plan = cls.__new__(cls)
        plan._made = native
        return plan

    @cached_property
    def metrics(self) -> dict[str, Any]:
        """Figures by name; names end in units."""
        return self._made.metrics

    @property
    def warnings(self) -> list[str]:
        """What the user should know."""
        return self._made.warnings

    @property
    def shortfalls(self) -> list[str]:
        """Why the plan falls short; empty when it does not."""
        return self._made.shortfalls

    @property
    def block(self) -> tuple[str, list[float]]:
        """Number of the block, and its sides along x, y and z, mm."""
        return self._made.block

    @property
    def program(self) -> str:
        """The G-code."""
        return self._made.program

    @cached_property
    def moves(self) -> NDArray[np.void]:
        """Moves of the cutter's tip as a structured array, columns as in ``toolpath.csv``; shape (moves,)."""
        sides, kinds, numbers = self._made.moves()
        rows = np.empty(len(sides), dtype=_MOVE)
        rows["side"], rows["kind"] = sides, kinds
        for column, name in enumerate(_MOVE.names[2:] if _MOVE.names else ()):
            rows[name] = numbers[:, column]
        rows.flags.writeable = False
        return rows

    @cached_property
    def deviations(self) -> NDArray[np.float64]:
        """Points of the part's surface (block's frame, mm) and the stock left there, below 0 cut into it; shape (points, 4)."""
        rows = self._made.deviations()
        rows.flags.writeable = False
        return rows

    def save(self, out: str | os.PathLike[str]) -> Path:
        """Writes the folder, as ``bonemill prosthesis`` does; gives its path."""
        return Path(self._made.save(Path(out)))


def prosthesis(
    job: str | os.PathLike[str], *, progress: Progress | None = None, threads: int | None = None
) -> ProsthesisPlan:
    """Plans the job file of a prosthesis: part, orientation, block, toolpath, program and its proof.

    Raises CaseError for a job, PlanError for a part, block or toolpath that cannot be, PlanFileError for files.
    """
    return ProsthesisPlan._make(_native.prosthesis(Path(job), progress, threads))
