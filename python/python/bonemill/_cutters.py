"""Drills, reamers and cutters from meshes: their edge elements and the forces on them."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _native
from ._errors import ModelError

Floats = NDArray[np.float64]

MOST_ELEMENTS = 100_000


def drill_force(
    *,
    R: float,
    eps_deg: float,
    theta_deg: float,
    psi_deg: float,
    w: float,
    Nc: int = 2,
    kc: float,
    kf: float,
    f: float,
    n_elements: int = 64,
    chisel: bool = False,
    chisel_dynamic_rake: bool = True,
) -> dict[str, Any]:
    """Thrust and torque of a twist drill, all of whose edges are in bone (Faieghi et al., equations 1 to 7, corrected).

    Args:
        R: radius of the drill, mm. eps_deg: half of the angle between the lips, 15 to 90 degrees. theta_deg: helix angle
            at the periphery, 0 to 60 degrees. psi_deg: angle of the chisel edge, degrees. w: half its width, mm: the lips'
            distance from the axis. Nc: lips.
        kc: specific cutting coefficient, N/mm². kf: friction coefficient on the rake face.
        f: feed, mm a revolution.
        n_elements: elements along a lip, and along the chisel edge from the axis to a lip.
        chisel: whether to add the chisel edge. chisel_dynamic_rake: whether its rake turns with the feed angle.

    Returns:
        ``lips`` (and ``chisel`` where asked for): ``Fz``, thrust, N; ``Mz``, moment about the shaft, N mm, negative;
        ``torque`` = -Mz; ``Fx_per_lip``, sum of the radial forces of one lip, N. ``total``: ``Fz`` and ``torque`` of both,
        where chisel was asked for. ``Rc``, radius where the lips start, mm. ``angles``: arrays along one lip, outwards, then
        along the chisel edge: ``r``, ``width`` (mm), ``epsilon``, ``beta``, ``mu``, ``lambda``, ``tau``, ``gamma_n`` (rad),
        ``feed_share``, ``kind`` and ``position`` (mm, shape (n, 3), tool frame: origin at the tip, z up the shaft).

    Raises:
        ArrayError, ModelError: what is wrong, and what was expected.
    """
    lips = _arrays.whole("Nc", Nc, 1, 12)
    drill = (*_numbers(R=R, eps_deg=eps_deg, theta_deg=theta_deg, psi_deg=psi_deg, w=w), lips)
    cut = _cut(f, kc, kf, n_elements)
    return _worded(_native.drill_force(drill, cut, bool(chisel), bool(chisel_dynamic_rake)))


def reamer_force(
    *,
    R: float,
    w: float,
    R_outer: float,
    alpha_deg: float,
    f: float,
    Nc: int = 5,
    kc: float,
    kf: float,
    n_elements: int = 128,
    beta_as_printed: bool = False,
) -> dict[str, Any]:
    """Thrust and torque of a glenoid reamer, all of whose edges are in bone (Faieghi et al., section III-B, corrected).

    Args:
        R: radius of an edge's arc, mm. w: distance of its centre from the axis, where the edge starts, mm. R_outer: radius
            of the rim, mm. alpha_deg: angle between edge and radius at the rim, degrees. Nc: edges.
        f, kc, kf, n_elements: as for `drill_force`.
        beta_as_printed: take asin(R sin(alpha)/r) for the web angle, as the source prints it, instead of R_outer.

    Returns:
        ``Fz``, ``Mz``, ``torque``, ``Fx_per_lip`` and ``angles`` as `drill_force`.

    Raises:
        ArrayError, ModelError: what is wrong, and what was expected.
    """
    arc, offset, rim, alpha = _numbers(R=R, w=w, R_outer=R_outer, alpha_deg=alpha_deg)
    reamer = (arc, offset, rim, alpha, _arrays.whole("Nc", Nc, 1, 64), bool(beta_as_printed))
    return _worded(_native.reamer_force(reamer, _cut(f, kc, kf, n_elements)))


class Cutter:
    """A cutter from its surface: its edge elements, and the solid that it sweeps when it turns.

    Tool frame: z along the shaft to the handpiece, origin where the axis meets the lowest cutting edge. Edges turn
    counter-clockwise seen from the handpiece; with ``spin=-1`` everything is that of the mesh's mirror image.
    """

    def __init__(self, native: _native.Cutter, feed: float, n_elements: int) -> None:
        self._native = native
        self.feed = feed
        """Feed at which ``elements`` are, mm a revolution."""
        self.elements: dict[str, Any] = _worded(native.elements(feed, n_elements))
        """Arrays over the elements of all edges: as ``angles`` of `drill_force`."""
        self._n_elements = n_elements

    @classmethod
    def from_mesh(
        cls,
        path: str | PathLike[str],
        *,
        axis: ArrayLike,
        scale: float = 1.0,
        point: ArrayLike = (0.0, 0.0, 0.0),
        spin: int = 1,
        dihedral_deg: float = 60.0,
        edges: list[ArrayLike] | None = None,
        feed: float = 0.0,
        n_elements: int = 64,
    ) -> Cutter:
        """A closed mesh in an STL, OBJ or PLY file.

        Args:
            path: the file. scale: mm of one unit of its coordinates.
            axis: direction of the shaft in the file's axes, from the tip to the handpiece. point: a point of the axis, mm
                (after scaling). spin: 1 counter-clockwise seen from the handpiece, -1 clockwise.
            dihedral_deg: convex edges at which the surface turns by at least this are looked at.
            edges: instead, polylines on the mesh, each of shape (n, 3), mm (after scaling).
            feed: mm a revolution, for angles that depend on it. n_elements: elements along every edge.

        Raises:
            ArrayError, ModelError: an open or self-intersecting mesh, an edge that is not on it, no edge that cuts, a
                feed that outruns the lips, ...: what is wrong, where, and what was expected.
        """
        args = (
            _arrays.vector("axis", axis),
            _arrays.vector("point", point),
            _arrays.whole("spin", spin, -1, 1),
            float(np.radians(_arrays.number("dihedral_deg", dihedral_deg))),
        )
        lines = None if edges is None else [_polyline(n, line) for n, line in enumerate(edges)]
        native = _native.Cutter(Path(path), _arrays.positive("scale", scale), args, lines)
        return cls(native, _arrays.number("feed", feed), _arrays.whole("n_elements", n_elements, 1, MOST_ELEMENTS))

    def at_feed(self, feed: float) -> Cutter:
        """The same cutter with the elements' angles at another feed, mm a revolution."""
        return Cutter(self._native, _arrays.number("feed", feed), self._n_elements)

    def force(self, *, kc: float, kf: float) -> dict[str, Any]:
        """``Fz`` (N), ``torque`` (N mm), ``F`` (N) and ``M`` (N mm), tool frame, at ``feed`` with all edges in bone."""
        return self._native.force(_cut(self.feed, kc, kf, self._n_elements))

    @property
    def profile(self) -> Floats:
        """Points (z, r) of the solid that it sweeps when it turns, mm, shape (n, 2)."""
        return self._native.profile()

    @property
    def edges(self) -> list[Floats]:
        """Points of each cutting edge, mm, tool frame, shape (n, 3)."""
        return self._native.edges()


def _numbers(**given: float) -> tuple[float, ...]:
    return tuple(_arrays.number(name, value) for name, value in given.items())


def _cut(f: float, kc: float, kf: float, n_elements: int) -> tuple[float, float, float, int]:
    feed, k_c, k_f = _numbers(f=f, kc=kc, kf=kf)
    return feed, k_c, k_f, _arrays.whole("n_elements", n_elements, 1, MOST_ELEMENTS)


def _polyline(n: int, line: ArrayLike) -> list[tuple[float, float, float]]:
    points = _arrays.real(f"edges[{n}]", line)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ModelError(f"edges[{n}] has shape {points.shape}: expected (n, 3)")
    return [(float(x), float(y), float(z)) for x, y, z in points]


def _worded(found: dict[str, Any]) -> dict[str, Any]:
    """The same with words of ``kind`` as an array."""
    for part in (found, found.get("angles", {})):
        if "kind" in part:
            part["kind"] = np.array(part["kind"])
    return found
