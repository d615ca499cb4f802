"""Simulation of a plan, its verification by separate code, and calibration with measured forces."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, TypedDict

import numpy as np
from numpy.typing import NDArray

from . import _arrays, _fields, _folders, _native
from ._errors import ArrayError, BonemillError
from ._plan import Plan, Progress, _as_plan, _fixed

LOG_COLUMNS = ("time_s", "x_mm", "y_mm", "z_mm", "axis_x", "axis_y", "axis_z", "fx_n", "fy_n", "fz_n")
"""Columns of a force log, ct frame: clock, burr centre, shaft from the burr to the handpiece, mean force on the burr."""


class Simulation(NamedTuple):
    """The result of simulating a plan."""

    rows: NDArray[np.void]
    """The columns of ``simulation.csv`` by name, shape (n,), ct frame, read-only; a number is NaN and a text "" where
    its cell is empty."""
    figures: dict[str, Any]
    """The figures of ``bonemill simulate --json``: ``simulated_peak_force_n`` and ``simulated_mean_force_n`` (while something is
    removed), ``spindle_energy_j``, ``simulated_removed`` (``mm3`` and ``mg`` by kind), ``stopped_steps`` (in which the shank touched bone),
    ``compliant`` (whether the arm yielded), …; names end in units."""


class Check(NamedTuple):
    """One check and its result."""

    name: str
    subject: str
    """The structure, joint or file that was checked; "" if the check concerns the whole plan."""
    passed: bool
    value: float
    """The worst value found, in `unit`."""
    limit: float
    sense: str
    """``at_most`` or ``at_least`` the limit."""
    margin: float
    """Distance from the value to the limit; negative if the limit is broken."""
    unit: str
    place: str
    """Where the worst value was found; "" if it has no place."""
    note: str


class Errors(TypedDict, total=False):
    """Standard deviations of the random errors; every key has the default of the command. The defaults are assumptions."""

    registration_mm: float
    """Registration along each axis, mm; default 0.3."""
    registration_deg: float
    """Registration about each axis through the middle of the path, degrees; default 0.3."""
    boundary_mm: float
    """Boundary of each structure, mm; default 0.15."""
    density_share: float
    """Density, as a share; default 0.1."""
    k_share: float
    """Cutting coefficients, as a share; default 0.25."""
    keep: float
    """Probability with which every structure must stay untouched; default 0.95."""
    draw_seed: int
    """Seed of the random numbers; default 1."""


class StructureRisk(NamedTuple):
    """What drawn errors do to one structure."""

    name: str
    touched: float
    """Probability that the burr touches it: ``hits / samples``."""
    interval_95: tuple[float, float]
    """95 % interval of that probability."""
    hits: int
    samples: int
    kept_mm: tuple[float, float, float]
    """5 %, 50 % and 95 % quantile of the burr surface's least distance, mm; below 0 the structure is cut."""
    clearance_mm: float
    """The clearance with which it would stay untouched with probability `keep`, mm."""


class ForceSpread(NamedTuple):
    """A force and its spread under random errors."""

    name: str
    planned_n: float
    spread_n: tuple[float, float, float]
    """In 5 %, 50 % and 95 % of the samples, N."""


class Risk(NamedTuple):
    """A plan under drawn errors."""

    structures: tuple[StructureRisk, ...]
    forces: tuple[ForceSpread, ...]
    keep: float
    """The probability with which every structure is to be kept."""

    @property
    def exceeded(self) -> tuple[StructureRisk, ...]:
        """The structures that are touched more often than `keep` allows, shown by their interval's lower end."""
        return tuple(s for s in self.structures if s.interval_95[0] > 1.0 - self.keep)


class Verification(NamedTuple):
    """The verdict on a plan."""

    passed: bool
    """Whether no check failed; what errors would do has no part in it."""
    checks: tuple[Check, ...]
    risk: Risk | None = None
    """What errors would do, where samples were asked for."""

    @property
    def failed(self) -> tuple[Check, ...]:
        """The checks that failed."""
        return tuple(c for c in self.checks if not c.passed)


class Estimate(NamedTuple):
    """A fitted coefficient."""

    value: float
    half_width: float
    """Half the width of its 95 % interval."""
    unit: str


class Calibration(NamedTuple):
    """Coefficients of the burr's force model, from a log."""

    coefficients: dict[str, Estimate]
    """By their key in a case file: ``k_t``, ``k_r``, ``k_a`` (N/mm²), ``k_te``, ``k_re``, ``k_ae`` (N/mm)."""
    residual_n: float
    """Root mean square of what the model leaves of a force component, N."""
    rows: int
    """Rows of the log in which the burr cut."""


def simulate(
    plan: Plan | str | os.PathLike[str],
    *,
    model: str = "fluted",
    step_mm: float = 0.1,
    rate_hz: float | None = None,
    save: bool = False,
    progress: Progress | None = None,
) -> Simulation:
    """Replays a plan's trajectory through the bone: forces, power, removal and deflection on the way.

    The numbers are those of ``bonemill simulate``.

    Args:
        plan: the plan, or its folder; its images must still be there and the same.
        model: ``fluted`` (Dillon et al. 2016, blade by blade), ``lumped`` or ``lumped-as-printed`` (Yang and Chen).
        step_mm: how far the burr goes at most between two rows.
        rate_hz: so many rows a second instead.
        save: also write ``simulation.csv`` and its part of ``report.html`` into the plan's folder, as the command does;
            for a plan that was loaded.
        progress: told ``(stage, done, of)``; what it raises stops the work, and so does Ctrl-C.

    Raises:
        ArrayError: a step or rate that is none. ModelError: no such model.
        PlanFileError, ImageError, PlanError: why the plan cannot be replayed.
    """
    step = _arrays.positive("step_mm", step_mm)
    rate = None if rate_hz is None else _arrays.positive("rate_hz", rate_hz)
    plan = _as_plan(plan)
    with _on_disk(plan, save) as saved:
        columns, structures, figures = _native.simulate(plan._made, saved, model, step, rate, save, progress)
    return Simulation(_fixed(_arrays.table(columns, plan._names()[structures])), figures)


def verify(
    plan: Plan | str | os.PathLike[str],
    *,
    samples: int | None = None,
    errors: Errors | None = None,
    save: bool = False,
    progress: Progress | None = None,
) -> Verification:
    """Checks a plan by code that did not make it: clearances, shank, limits, coverage, every column and figure.

    The numbers are those of ``bonemill verify``.

    Args:
        plan: the plan, or its folder; its images must still be there and the same.
        samples: also repeat the plan so often, 1 to 1000000, under drawn errors of registration, boundaries, density and
            coefficients: how likely it touches each structure, how far forces are off.
        errors: how large they are; with ``samples``.
        save: also write ``verification.toml`` and its part of ``report.html`` into the plan's folder, as the command does;
            for a plan that was loaded. What drawn errors do stands in the report alone.
        progress: told ``(stage, done, of)``; what it raises stops the work, and so does Ctrl-C.

    Raises:
        ArrayError: a number of samples or an error that is none. ModelError: an unknown key in ``errors``.
        PlanFileError, ImageError, PlanError: there is nothing to verify. A plan that fails is no error.
    """
    import tomllib

    if samples is None and errors is not None:
        raise ArrayError("errors are given without samples: expected how often to draw them")
    count = None if samples is None else _arrays.whole("samples", samples, 1, 1_000_000)
    sigmas, keep, seed = _errors_of(errors if errors is not None else {})
    plan = _as_plan(plan)
    with _on_disk(plan, save) as saved:
        text, found = _native.verify(plan._made, saved, save, count, (sigmas, keep, seed), progress)
    verdict = tomllib.loads(text)
    risk = None if found is None else _risk(*found, keep)
    return Verification(verdict["passed"], tuple(_check(one) for one in verdict["check"]), risk)


def _errors_of(given: Errors) -> tuple[tuple[float, float, float, float, float], float, int]:
    _fields._checked("errors", given, (), Errors.__optional_keys__)

    def sigma(key: str, default: float) -> float:
        return _arrays.number(f"errors['{key}']", given.get(key, default))

    sigmas = (
        sigma("registration_mm", 0.3),
        sigma("registration_deg", 0.3),
        sigma("boundary_mm", 0.15),
        sigma("density_share", 0.1),
        sigma("k_share", 0.25),
    )
    seed = given.get("draw_seed", 1)
    if not isinstance(seed, int) or not 0 <= seed < 2**64:
        raise ArrayError(f"errors['draw_seed'] = {seed!r}: expected a whole number from 0 to 2**64 - 1")
    return sigmas, sigma("keep", 0.95), seed


def _risk(structures: Sequence[_native._StructureRisk], forces: Sequence[_native._ForceSpread], keep: float) -> Risk:
    return Risk(
        tuple(
            StructureRisk(name, touched, (low, high), *counts, kept, clearance_mm)
            for name, counts, (touched, low, high), kept, clearance_mm in structures
        ),
        tuple(ForceSpread(name, planned_n, n) for name, planned_n, n in forces),
        keep,
    )


def _check(found: Mapping[str, Any]) -> Check:
    sense = "at_most" if "at_most" in found else "at_least"
    subject, unit, place, note = (found.get(key, "") for key in ("subject", "unit", "place", "note"))
    value, limit, margin = (found[key] for key in ("value", sense, "margin"))
    return Check(found["name"], subject, found["passed"], value, limit, sense, margin, unit, place, note)


def calibrate(
    plan: Plan | str | os.PathLike[str],
    log: str | os.PathLike[str] | NDArray[np.void] | Mapping[str, Any],
    *,
    coefficients: Sequence[str] = ("k_t", "k_r", "k_a"),
    progress: Progress | None = None,
) -> Calibration:
    """Fits the force model's coefficients to measured forces, by milling the plan's bone along the log's poses.

    Args:
        plan: the plan, or its folder; says bone, burr and spindle; the log need not follow its path. Bone that was milled before the log's first
            row must not matter: the log begins with the whole bone.
        log: a CSV file, or columns by name, shape (n,) each: `LOG_COLUMNS`. The clock rises; the force is the mean over
            the move that ends at the row.
        coefficients: which to fit; those left out are taken as 0.
        progress: told ``(stage, done, of)``; what it raises stops the work, and so does Ctrl-C.

    Raises:
        CalibrationError: the log cannot tell the coefficients, with the reason.
        ArrayError, ModelError, PlanFileError, ImageError, PlanError: a log, a key or a plan that is none.
    """
    rows = Path(log) if isinstance(log, (str, os.PathLike)) else _log(log)
    plan = _as_plan(plan)
    with _on_disk(plan, False) as saved:
        found, residual_n, used = _native.calibrate(plan._made, saved, rows, list(coefficients), progress)
    return Calibration({key: Estimate(value, half, unit) for key, value, half, unit in found}, residual_n, used)


def _log(log: NDArray[np.void] | Mapping[str, Any]) -> NDArray[np.float64]:
    names = log.dtype.names or () if isinstance(log, np.ndarray) else tuple(log)
    for name in LOG_COLUMNS:
        if name not in names:
            raise ArrayError(f"the log has no column {name!r}: expected {', '.join(LOG_COLUMNS)}")
    columns = [_arrays.real(f"the log's {name}", log[name]) for name in LOG_COLUMNS]
    for name, column in zip(LOG_COLUMNS, columns):
        if column.ndim != 1 or column.shape != columns[0].shape:
            raise ArrayError(f"the log's {name} has shape {column.shape}: expected {columns[0].shape[:1]}, as time_s")
    falls = np.flatnonzero(np.diff(columns[0]) <= 0)
    if len(falls):
        raise ArrayError(f"the log's time_s does not rise at row {int(falls[0]) + 1}: expected rows in order of time")
    return np.stack(columns, axis=-1)


@contextmanager
def _on_disk(plan: Plan, save: bool) -> Iterator[Path | None]:
    """Where a plan of this process lies meanwhile; None for one that has a folder of its own."""
    if plan._made.home() is not None:
        yield None
        return
    if save:
        raise ArrayError("save = True is for a plan with a folder: bonemill.Plan.load(plan.save(folder))")
    with _folders.temporary() as folder:
        home = plan.save(Path(folder, "plan"))
        try:
            with plan.case._naming():
                yield home
        except BonemillError as error:
            # the folder is gone when the message is read
            raise type(error)(str(error).replace(str(home), "the plan in memory")) from None
