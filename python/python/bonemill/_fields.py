"""Distances, volumes, forces and engagement on arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _native
from ._errors import ArrayError, ModelError

Floats = NDArray[np.float64]


class Tool(TypedDict, total=False):
    """A ball-shaped burr. ``radius`` (mm) and ``blades`` are needed; the rest has defaults."""

    radius: float
    blades: int
    spin: int
    """Sign of the rotation about the axis from burr to handpiece: -1 (default, forward) or 1."""
    helix_deg: float
    """Helix angle of the blades, degrees; default 0."""
    kappa_min: float
    """Where the blades begin, polar angle from the tip, rad; default 0."""
    kappa_max: float
    """Where they end, rad; default pi."""


class Material(TypedDict, total=False):
    """Cutting coefficients. ``K`` and ``rho_ref`` are needed; the rest has defaults."""

    K: ArrayLike
    """(K_t, K_r, K_a), N/mm², at the density ``rho_ref``."""
    Ke: ArrayLike
    """(K_te, K_re, K_ae), N/mm: edge term; default 0."""
    rho_ref: float
    """g/cm³."""
    p: float
    """Exponent of density; default 1."""
    rho_min: float
    """Density up to which there is nothing to cut, g/cm³; default 0."""
    t0: float
    """Chip thickness at which the edge term saturates, mm; default 0: at once."""


class Disc(TypedDict, total=False):
    """How finely the burr's surface is summed; every key has a default."""

    n_gamma: int
    """Increments of rotation between two blades; default 16."""
    n_kappa: int
    """Elements from tip to shaft; default 64."""
    grid: Literal["kappa", "z"]
    """Elements uniform in polar angle (default) or height."""
    measure: Literal["db", "dz"]
    """Length of an element: along the blade (default) or its height."""
    sample_offset: float
    """How far outside the surface the density is read, mm; default 0."""


def distance_transform(mask: ArrayLike, spacing: ArrayLike) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Exact Euclidean distance from every voxel's centre to the nearest True voxel's centre.

    Args:
        mask: booleans [i, j, k], shape (ni, nj, nk), at least one True. Any strides.
        spacing: voxel size along i, j, k, mm; one number for cubes.

    Returns:
        distance_mm: float32, shape of the mask, 0 where it is True.
        nearest_index: uint32, shape of the mask: the nearest True voxel, as numpy counts:
            ``mask.ravel()[nearest_index]`` is True everywhere and
            ``np.unravel_index(nearest_index, mask.shape)`` gives i, j, k.

    Raises:
        ArrayError: not booleans, not a volume, no True voxel, a spacing that is none.
    """
    found = _arrays.mask(mask)
    solved = _native.distance_transform(found, _arrays.spacing(spacing))
    if solved is None:
        raise ArrayError("mask has no True voxel: there is nothing to be distant from")
    return solved


def ball_volumes(centers: ArrayLike, ball_center: ArrayLike, radius: float, spacing: ArrayLike) -> Floats:
    """Exact volume of voxels inside a ball.

    Args:
        centers: voxel centres, mm, shape (..., 3).
        ball_center: mm, shape (3,).
        radius: mm, above 0.
        spacing: voxel size, mm: one number or three.

    Returns:
        mm³, shape (...): between 0 and a voxel's volume, exact to 4e-15 radius³.

    Raises:
        ArrayError: wrong shapes, numbers that are not finite, a radius or spacing that is not above 0.
    """
    found = _arrays.real("centers", centers)
    if found.ndim < 1 or found.shape[-1] != 3:
        raise ArrayError(f"centers has shape {found.shape}: expected (..., 3)")
    volumes = _native.ball_volumes(
        found.reshape(-1, 3),
        _arrays.vector("ball_center", ball_center),
        _arrays.positive("radius", radius),
        _arrays.spacing(spacing),
    )
    return volumes.reshape(found.shape[:-1])


def burr_force(
    density: ArrayLike | float | Callable[[Floats], Floats],
    *,
    spacing: ArrayLike = 1.0,
    origin: ArrayLike = (0.0, 0.0, 0.0),
    center: ArrayLike,
    axis: ArrayLike,
    velocity: ArrayLike,
    rpm: float,
    tool: Tool,
    material: Material,
    disc: Disc | None = None,
) -> dict[str, Any]:
    """Mean force of bone on a ball-shaped burr over a turn (Dillon et al. 2016, equations 3 and 4).

    Args:
        density: g/cm³: an array [i, j, k] (trilinear between voxel centres, 0 beyond the array), one number for
            bone everywhere, or a function of points (mm, shape (n, 3)) that gives shape (n,).
        spacing: voxel size of an array, mm.
        origin: centre of voxel (0, 0, 0) of an array, mm.
        center: the burr's centre, mm.
        axis: shaft axis, from the burr to the handpiece; need not be a unit vector.
        velocity: of the burr's centre relative to the bone, mm/s; 0 gives 0 for everything.
        rpm: spindle speed, above 0.
        tool, material, disc: see `Tool`, `Material`, `Disc`.

    Returns:
        ``F`` (N), ``M`` (N mm), on the burr, in the array's frame, shape (3,); ``F_tool``, ``M_tool`` in the tool's
        frame; ``torque`` (N mm), ``power_spindle``, ``power_feed`` (mW), ``mrr``, ``mrr_w`` (mm³/s: all, and weighted by
        density), ``contact_area`` (mm²), ``t_max`` (mm), ``F_peak`` (N); ``basis_cut`` (mm²) and ``basis_edge`` (mm),
        shape (3, 3): ``F_tool == K @ basis_cut + Ke @ basis_edge``.

    Raises:
        ArrayError, ModelError: what is wrong, and what was expected.
    """
    tool_args, material_args, disc_args = _tool(tool), _material(material), _disc(disc or {})
    at = _arrays.vector("center", center)
    motion = (at, _arrays.vector("axis", axis), _arrays.vector("velocity", velocity), _arrays.number("rpm", rpm))
    cell, start = _arrays.spacing(spacing), _arrays.vector("origin", origin)
    field: Any
    if callable(density):
        field = _sampler(density)
    elif np.ndim(density) == 0:
        everywhere = _arrays.number("density", density)
        field = lambda points: np.full(len(points), everywhere)  # noqa: E731
    else:
        reach = tool_args[0] + abs(disc_args[4])
        field, start = _near(_arrays.volume("density", density), cell, start, at, reach)
    return _native.burr_force(field, cell, start, motion, tool_args, material_args, disc_args)


def engagement_metrics(
    density: ArrayLike,
    *,
    spacing: ArrayLike,
    origin: ArrayLike = (0.0, 0.0, 0.0),
    center: ArrayLike,
    axis: ArrayLike,
    radius: float,
) -> dict[str, Any]:
    """Mass and inertia of the bone in the burr's ball (Dillon et al. 2016, equations 1 and 2).

    Args:
        density: g/cm³, array [i, j, k]; what is already removed must be 0.
        spacing: voxel size, mm. origin: centre of voxel (0, 0, 0), mm.
        center: the burr's centre, mm. axis: shaft axis, any length. radius: mm.

    Returns:
        ``n_vox``; ``V`` (mm³ of the ball within the array); ``m`` (mg); ``I`` (mg mm²) and ``In`` = I/(m r²), with the
        squared distance as printed; ``I_true``, ``In_true`` with the true one; ``z2_mean`` (mm²). Without mass the In are 1.

    Raises:
        ArrayError, ModelError: what is wrong, and what was expected.
    """
    cell, start = _arrays.spacing(spacing), _arrays.vector("origin", origin)
    at, ball = _arrays.vector("center", center), _arrays.positive("radius", radius)
    near, start = _near(_arrays.volume("density", density), cell, start, at, ball)
    return _native.engagement_metrics(near, cell, start, at, _arrays.vector("axis", axis), ball)


def _near(
    density: NDArray[Any], cell: _arrays.Vector, origin: _arrays.Vector, center: _arrays.Vector, reach_mm: float
) -> tuple[Floats, _arrays.Vector]:
    """The part of the array that the ball can see, and its origin: nothing else is copied or looked at."""
    index = [(c - o) / h for c, o, h in zip(center, origin, cell)]
    half = [reach_mm / h + 2.0 for h in cell]
    lo = [int(np.clip(np.floor(i - r), 0, n - 1)) for i, r, n in zip(index, half, density.shape)]
    hi = [int(np.clip(np.ceil(i + r), 0, n - 1)) for i, r, n in zip(index, half, density.shape)]
    part = density[tuple(slice(a, b + 1) for a, b in zip(lo, hi))].astype(np.float64)
    if not np.isfinite(part).all():
        first = np.argwhere(~np.isfinite(part))[0] + lo
        raise ArrayError(f"density{[int(n) for n in first]} = {density[tuple(first)]}: expected finite g/cm³")
    x, y, z = (o + h * n for o, h, n in zip(origin, cell, lo))
    return part, (x, y, z)


def _sampler(density: Callable[[Floats], Floats]) -> Callable[[Floats], Floats]:
    def sample(points: Floats) -> Floats:
        found = np.asarray(density(points))
        if found.ndim != 1 or found.dtype.kind not in "iufb":
            raise ArrayError(f"density gave {found.dtype} of shape {found.shape}: expected real numbers, one a point")
        return found.astype(np.float64)

    return sample


def _checked(what: str, given: Mapping[str, Any], needed: tuple[str, ...], known: frozenset[str]) -> None:
    if not isinstance(given, Mapping):
        raise ModelError(f"{what} is {type(given).__name__}: expected a dictionary with the keys {sorted(known)}")
    for key in given:
        if key not in known:
            raise ModelError(f"unknown key {key!r} in {what}: expected {sorted(known)}")
    for key in needed:
        if key not in given:
            raise ModelError(f"{what} has no {key!r}: expected {sorted(needed)} at least")


def _tool(given: Tool) -> tuple[float, int, int, float, float, float]:
    _checked("tool", given, ("radius", "blades"), Tool.__optional_keys__)
    return (
        _arrays.number("tool['radius']", given["radius"]),
        _arrays.whole("tool['blades']", given["blades"], 1, 1000),
        _arrays.whole("tool['spin']", given.get("spin", -1), -1, 1),
        _arrays.number("tool['helix_deg']", given.get("helix_deg", 0.0)),
        _arrays.number("tool['kappa_min']", given.get("kappa_min", 0.0)),
        _arrays.number("tool['kappa_max']", given.get("kappa_max", np.pi)),
    )


def _material(given: Material) -> tuple[_arrays.Vector, _arrays.Vector, float, float, float, float]:
    _checked("material", given, ("K", "rho_ref"), Material.__optional_keys__)
    return (
        _arrays.vector("material['K']", given["K"]),
        _arrays.vector("material['Ke']", given.get("Ke", (0.0, 0.0, 0.0))),
        _arrays.number("material['rho_ref']", given["rho_ref"]),
        _arrays.number("material['p']", given.get("p", 1.0)),
        _arrays.number("material['rho_min']", given.get("rho_min", 0.0)),
        _arrays.number("material['t0']", given.get("t0", 0.0)),
    )


def _disc(given: Disc) -> tuple[int, int, str, str, float]:
    _checked("disc", given, (), Disc.__optional_keys__)
    grid, measure = given.get("grid", "kappa"), given.get("measure", "db")
    for key, word, words in (("grid", grid, ("kappa", "z")), ("measure", measure, ("db", "dz"))):
        if word not in words:
            raise ModelError(f"disc[{key!r}] = {word!r}: expected {words[0]!r} or {words[1]!r}")
    return (
        _arrays.whole("disc['n_gamma']", given.get("n_gamma", 16), 1, 100_000),
        _arrays.whole("disc['n_kappa']", given.get("n_kappa", 64), 1, 100_000),
        grid,
        measure,
        _arrays.number("disc['sample_offset']", given.get("sample_offset", 0.0)),
    )
