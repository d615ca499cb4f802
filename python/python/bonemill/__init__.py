"""Plans how a robot mills bone: path, burr angle, speed, forces and joint trajectory from CT.

    import bonemill
    case = bonemill.Case.load("case.toml")
    plan = bonemill.plan(case)
    plan.waypoints["force_toward_n"].max(), plan.metrics["total_time_s"]
    plan.save("plan/")

Units are mm, s, N, N/mm², rad, g/cm³, mg; names end in theirs. Arrays are indexed [i, j, k]. Research software: not a
medical device.
"""

from typing import TYPE_CHECKING, Any

from ._arm import Arm, Joint
from ._case import Case, phantom
from ._compare import Comparison, compare
from ._cutters import Cutter, drill_force, reamer_force
from ._errors import (
    ArrayError,
    BonemillError,
    CalibrationError,
    CaseError,
    ImageError,
    InfeasibleError,
    ModelError,
    PlanError,
    PlanFileError,
    RobotError,
    StreamError,
)
from ._fields import Disc, Material, Tool, ball_volumes, burr_force, distance_transform, engagement_metrics
from ._judge import (
    LOG_COLUMNS,
    Calibration,
    Check,
    Errors,
    Estimate,
    ForceSpread,
    Risk,
    Simulation,
    StructureRisk,
    Verification,
    calibrate,
    simulate,
    verify,
)
from ._native import __version__
from ._plan import Frames, Plan, Segments, Structure, plan
from ._prosthesis import ProsthesisPlan, prosthesis
from ._verdict import verified
from ._view import view

if TYPE_CHECKING:
    from . import cohort, stream

__all__ = [
    "__version__",
    "Arm",
    "ArrayError",
    "ball_volumes",
    "BonemillError",
    "burr_force",
    "calibrate",
    "Calibration",
    "CalibrationError",
    "Case",
    "CaseError",
    "Check",
    "cohort",
    "compare",
    "Comparison",
    "Cutter",
    "Disc",
    "distance_transform",
    "drill_force",
    "engagement_metrics",
    "Errors",
    "Estimate",
    "ForceSpread",
    "Frames",
    "ImageError",
    "InfeasibleError",
    "Joint",
    "LOG_COLUMNS",
    "Material",
    "ModelError",
    "phantom",
    "Plan",
    "plan",
    "PlanError",
    "PlanFileError",
    "prosthesis",
    "ProsthesisPlan",
    "reamer_force",
    "Risk",
    "RobotError",
    "Segments",
    "simulate",
    "Simulation",
    "stream",
    "StreamError",
    "Structure",
    "StructureRisk",
    "Tool",
    "Verification",
    "verified",
    "verify",
    "view",
]


def __getattr__(name: str) -> Any:
    """``bonemill.cohort`` and ``bonemill.stream``, imported when first used: they bring much that planning does without."""
    if name in ("cohort", "stream"):
        from importlib import import_module

        return import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
