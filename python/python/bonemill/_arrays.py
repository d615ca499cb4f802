"""Checks of arrays and numbers that come from outside; every refusal names what it got and what it expected."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._errors import ArrayError

Vector = tuple[float, float, float]


def table(columns: Iterable[tuple[str, NDArray[Any]]], structure: NDArray[np.str_]) -> NDArray[np.void]:
    """Columns as a structured array; ``structure`` comes before ``distance_mm``, as in the files."""
    named: list[tuple[str, NDArray[Any]]] = []
    for name, values in columns:
        if name == "distance_mm":
            named.append(("structure", structure))
        named.append((name, values))
    rows = np.empty(len(structure), dtype=[(name, values.dtype) for name, values in named])
    for name, values in named:
        rows[name] = values
    return rows


def number(name: str, value: Any) -> float:
    """A finite number."""
    try:
        found = float(value)
    except (TypeError, ValueError):
        raise ArrayError(f"{name} is {value!r}: expected a number") from None
    if not np.isfinite(found):
        raise ArrayError(f"{name} = {found}: expected a finite number")
    return found


def positive(name: str, value: Any) -> float:
    """A finite number above 0."""
    found = number(name, value)
    if not found > 0:
        raise ArrayError(f"{name} = {found}: expected above 0")
    return found


def whole(name: str, value: Any, least: int, most: int) -> int:
    """A whole number from ``least`` to ``most``."""
    found = number(name, value)
    if found != int(found) or not least <= found <= most:
        raise ArrayError(f"{name} = {value!r}: expected a whole number from {least} to {most}")
    return int(found)


def vector(name: str, value: ArrayLike) -> Vector:
    """Three finite numbers."""
    found = real(name, value)
    if found.shape != (3,):
        raise ArrayError(f"{name} has shape {found.shape}: expected (3,)")
    return float(found[0]), float(found[1]), float(found[2])


def spacing(value: ArrayLike) -> Vector:
    """One or three finite lengths above 0, mm."""
    found = real("spacing", value)
    if found.shape not in ((), (3,)) or not (found > 0).all():
        raise ArrayError(f"spacing = {value!r}: expected one or three lengths above 0, mm")
    x, y, z = np.broadcast_to(found, 3)
    return float(x), float(y), float(z)


def real(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Finite real numbers of any shape."""
    found = np.asarray(value)
    if found.dtype.kind not in "iuf":
        raise ArrayError(f"{name} has dtype {found.dtype}: expected real numbers")
    found = found.astype(np.float64, copy=False)
    if not np.isfinite(found).all():
        where = tuple(int(n) for n in np.argwhere(~np.isfinite(found))[0])
        raise ArrayError(f"{name}{list(where)} = {found[where]}: expected finite numbers")
    return found


def volume(name: str, value: ArrayLike) -> NDArray[Any]:
    """A volume [i, j, k] of real numbers, not looked into."""
    found = np.asarray(value)
    if found.ndim != 3 or found.size == 0:
        raise ArrayError(f"{name} has shape {found.shape}: expected a volume (ni, nj, nk)")
    if found.dtype.kind not in "iuf":
        raise ArrayError(f"{name} has dtype {found.dtype}: expected real numbers")
    return found


def mask(value: ArrayLike) -> NDArray[np.bool_]:
    """A volume [i, j, k] of booleans with at least one True."""
    found = np.asarray(value)
    if found.dtype != np.bool_:
        raise ArrayError(f"mask has dtype {found.dtype}: expected bool (e.g. labels == 7)")
    if found.ndim != 3 or found.size == 0:
        raise ArrayError(f"mask has shape {found.shape}: expected a volume (ni, nj, nk)")
    return found
