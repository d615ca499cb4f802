"""Two plans side by side."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

from . import _folders, _native
from ._plan import Plan

Texts = dict[str, tuple[str | None, str | None]]


class Comparison(NamedTuple):
    """What two plans have in common and where they differ; ``print(comparison)`` shows it as a table."""

    case: Texts
    """Keys of the cases whose values differ, with both values as a case file writes them; structures by name."""
    inputs: Texts
    """Images and arms that differ, with the digests of both."""
    figures: dict[str, dict[str, tuple[float | None, float | None]]]
    """By group (``path``, ``volumes``, ``times``, ``forces``, ``structure NAME``) and name: of the first and second plan."""
    between: dict[str, float]
    """``hausdorff_mm``, ``mean_distance_mm``, ``mean_angle_deg`` and ``largest_angle_deg`` between the cuts; where the planning
    grids agree also ``swept_by_both_mm3``, ``swept_by_first_alone_mm3``, ``swept_by_second_alone_mm3``."""
    table: str
    """All of it, for a terminal."""
    page: str
    """All of it as HTML: ``Path("page.html").write_text(comparison.page)``."""

    def __str__(self) -> str:
        return self.table


def compare(first: Plan | str | os.PathLike[str], second: Plan | str | os.PathLike[str]) -> Comparison:
    """Compares two plans by their own files; their images may be gone or changed.

    Args:
        first, second: plans, or folders of plans.

    Raises:
        PlanFileError: a folder holds no plan.
    """
    with _folders.temporary() as folder:
        homes = _home(first, Path(folder, "first")), _home(second, Path(folder, "second"))
        names = _name(first, "first"), _name(second, "second")
        case, inputs, groups, between, (table, page) = _native.compare(homes, names)
    figures = {title: {name: (a, b) for name, (a, b) in rows} for title, rows in groups}
    texts = [{key: (a, b) for key, (a, b) in rows} for rows in (case, inputs)]
    return Comparison(texts[0], texts[1], figures, dict(between), table, page)


def _home(plan: Plan | str | os.PathLike[str], temporary: Path) -> Path:
    if not isinstance(plan, Plan):
        return Path(plan)
    return plan._made.home() or plan.save(temporary)


def _name(plan: Plan | str | os.PathLike[str], word: str) -> str:
    home = plan._made.home() if isinstance(plan, Plan) else plan
    return word if home is None else os.fspath(home)
