"""What becomes of a plan: replayed through the bone, and checked by code that did not make it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _arrays, _folders, _native
from ._plan import Plan, Progress


class Simulation(NamedTuple):
    """A plan, replayed."""

    rows: NDArray[np.void]
    """The columns of ``simulation.csv`` by name, shape (n,); a number is NaN and a text "" where its cell is empty."""
    figures: dict[str, Any]
    """``peak_force_n``, ``mean_force_n`` (while something is removed), ``energy_j``, ``stopped`` (steps that the shank
    stopped), ``compliant`` (whether the arm yielded)."""


class Check(NamedTuple):
    """One thing that was checked."""

    name: str
    subject: str
    """Of what, where there are several: a structure, a joint, a file; else ""."""
    passed: bool
    value: float
    limit: float
    sense: str
    """``at_most`` or ``at_least`` the limit."""
    margin: float
    """How far the value is on the right side."""
    unit: str
    place: str
    """Where the worst is; "" where that makes no sense."""
    note: str


class Verification(NamedTuple):
    """The verdict on a plan."""

    passed: bool
    checks: tuple[Check, ...]

    @property
    def failed(self) -> tuple[Check, ...]:
        """The checks that failed."""
        return tuple(c for c in self.checks if not c.passed)


def simulate(
    plan: Plan, *, model: str = "fluted", step_mm: float = 0.1, progress: Progress | None = None
) -> Simulation:
    """Replays a plan's trajectory through the bone: forces, power, removal and deflection on the way.

    Args:
        plan: the plan; its images must still be there and the same. A plan that was read gets its ``simulation.csv``, as
            by the command.
        model: ``fluted`` (Dillon et al. 2016, blade by blade), ``lumped`` or ``lumped-as-printed`` (Yang and Chen).
        step_mm: how far the burr goes at most between two rows.

    Raises:
        PlanError, ModelError: why it cannot be replayed. Ctrl-C stops it.
    """
    step = _arrays.positive("step_mm", step_mm)
    with _on_disk(plan) as (folder, keep):
        columns, structures, figures = _native.simulate(folder, model, step, keep, progress)
    names = np.array([s.name for s in plan.structures] + [""])
    by_name: dict[str, NDArray[Any]] = {}
    for name, values in columns:
        if name == "distance_mm":
            by_name["structure"] = names[structures]
        by_name[name] = values
    rows = np.empty(len(structures), dtype=[(name, values.dtype) for name, values in by_name.items()])
    for name, values in by_name.items():
        rows[name] = values
    return Simulation(rows, figures)


def verify(plan: Plan, *, progress: Progress | None = None) -> Verification:
    """Checks a plan by code that did not make it: clearances, shank, limits, coverage, every figure.

    Args:
        plan: the plan; its images must still be there and the same. A plan that was read gets its
            ``verification.toml``, as by the command.

    Raises:
        PlanError: there is nothing to verify. A plan that fails is no error. Ctrl-C stops it.
    """
    import tomllib

    with _on_disk(plan) as (folder, keep):
        verdict = tomllib.loads(_native.verify(folder, keep, progress))
    checks = []
    for found in verdict.get("check", []):
        sense = "at_most" if "at_most" in found else "at_least"
        texts = {key: str(found.get(key, "")) for key in ("subject", "unit", "place", "note")}
        numbers = {key: float(found[key]) for key in ("value", "margin")}
        checks.append(
            Check(name=found["name"], passed=found["passed"], limit=float(found[sense]), sense=sense, **texts, **numbers)
        )
    return Verification(bool(verdict["passed"]), tuple(checks))


@contextmanager
def _on_disk(plan: Plan) -> Iterator[tuple[Path, bool]]:
    """The plan's folder: its own, or a temporary one; and whether results are kept there."""
    own = plan._made.folder()
    if own is not None:
        yield own, plan._folder is None
        return
    with _folders.temporary() as folder:
        yield plan.save(Path(folder, "plan")), False
