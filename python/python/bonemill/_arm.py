"""Arms: kinematics of one joint vector or of many at once."""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _native
from ._errors import ArrayError, RobotError

Floats = NDArray[np.float64]


class Joint(NamedTuple):
    """A moving joint; mm or rad by its kind."""

    name: str
    kind: str
    """``prismatic`` (mm) or ``revolute`` (rad)."""
    lower: float
    upper: float
    velocity_limit: float
    """mm/s or rad/s."""
    acceleration_limit: float
    """mm/s² or rad/s²."""


class Arm:
    """A serial arm. Make one with `Arm.load`."""

    def __init__(self, native: _native.Arm, joint_stiffness: ArrayLike | None = None) -> None:
        self._native = native
        self.joints = tuple(Joint(*row) for row in native.joints())
        self.joint_stiffness = None if joint_stiffness is None else self._stiffness(joint_stiffness)

    @classmethod
    def load(cls, model: str | os.PathLike[str], *, joint_stiffness: ArrayLike | None = None) -> Arm:
        """The arm ``"bone-attached"`` or a UR such as ``"ur5e"``, or the one that a URDF file describes.

        Args:
            model: name, or path of a URDF (from ``base_link``, else its root, to ``tool0``, else its only tip).
            joint_stiffness: for `compliance`, shape (dof,), N/mm (prismatic) or N mm/rad (revolute).

        Raises:
            RobotError: no such file, or no open chain with limits.
        """
        return cls(_native.Arm(os.fspath(model)), joint_stiffness)

    @property
    def dof(self) -> int:
        """Number of moving joints."""
        return len(self.joints)

    @property
    def urdf(self) -> str:
        """The URDF as it was read."""
        return self._native.urdf()

    def fk(self, q: ArrayLike) -> Floats:
        """Pose of the flange in base: homogeneous matrix, lengths in mm.

        Args:
            q: joint positions, mm or rad by joint, shape (..., dof).

        Returns:
            Shape (..., 4, 4).
        """
        rows, shape = self._rows(q)
        return self._native.fk(rows).reshape(*shape, 4, 4)

    def ik(self, pose: ArrayLike) -> Floats:
        """Every joint vector that brings the flange to a pose, shape (n, dof); n = 0 where the arm does not reach.

        A UR has up to 8, in closed form; an arm without a closed form is searched, and may have more than are found. An arm
        of fewer than six joints reaches only the pose's position and z axis. Joint limits are not checked.

        Args:
            pose: homogeneous matrix, mm, shape (4, 4), as `fk` gives it.

        Raises:
            ArrayError, RobotError: no such matrix, or its rotation is none.
        """
        found = _arrays.real("pose", pose)
        if found.shape != (4, 4) or not np.array_equal(found[3], [0, 0, 0, 1]):
            raise ArrayError(f"pose has shape {found.shape}: expected (4, 4) with the last row 0, 0, 0, 1")
        return self._native.ik(found[:3, :3].tolist(), found[:3, 3].tolist())

    def jacobian(self, q: ArrayLike) -> Floats:
        """Geometric Jacobian at the flange's origin, in base, shape (..., 6, dof).

        Rows 0 to 2: d(position)/dq, mm per mm or mm per rad. Rows 3 to 5: angular velocity per joint velocity.
        """
        rows, shape = self._rows(q)
        return self._native.jacobian(rows).reshape(*shape, 6, self.dof)

    def compliance(self, q: ArrayLike, joint_stiffness: ArrayLike | None = None) -> Floats:
        """Compliance at the flange, J diag(1/stiffness) Jᵀ, in base, mm/N, shape (..., 3, 3) (Dillon 2016, eq. 10).

        Args:
            q: joint positions, shape (..., dof).
            joint_stiffness: shape (dof,), N/mm or N mm/rad; default: that of `load`.

        Raises:
            RobotError: no stiffness, or one that is not above 0.
        """
        stiffness = self.joint_stiffness if joint_stiffness is None else self._stiffness(joint_stiffness)
        if stiffness is None:
            raise RobotError("the arm has no joint_stiffness: give one value per joint, N/mm or N mm/rad")
        rows, shape = self._rows(q)
        return self._native.compliance(rows, stiffness.tolist()).reshape(*shape, 3, 3)

    def __repr__(self) -> str:
        return f"<bonemill.Arm: {', '.join(f'{j.name} ({j.kind})' for j in self.joints)}>"

    def _rows(self, q: ArrayLike) -> tuple[Floats, tuple[int, ...]]:
        found = _arrays.real("q", q)
        if found.ndim < 1 or found.shape[-1] != self.dof:
            raise ArrayError(f"q has shape {found.shape}: expected (..., {self.dof}), one value a joint")
        return found.reshape(-1, self.dof), found.shape[:-1]

    def _stiffness(self, value: ArrayLike) -> Floats:
        found = _arrays.real("joint_stiffness", value)
        if found.shape != (self.dof,):
            raise ArrayError(f"joint_stiffness has shape {found.shape}: expected ({self.dof},)")
        return found
