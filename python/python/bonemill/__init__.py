"""Plans how a robot mills bone: path, burr angle, speed, forces and joint trajectory from CT.

    import bonemill
    case = bonemill.Case.load("case.toml")
    plan = bonemill.plan(case)
    plan.waypoints["force_toward_n"].max(), plan.metrics["total_time_s"]
    plan.save("plan/")

Units are mm, s, N, N/mm², rad, g/cm³, mg; names end in theirs. Arrays are indexed [i, j, k]. Research software: not a
medical device.
"""

from ._arm import Arm, Joint
from ._case import Case, phantom
from ._errors import (
    ArrayError,
    BonemillError,
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
from ._native import __version__
from ._plan import Plan, Structure, plan
from ._view import view

__all__ = [
    "Arm",
    "ArrayError",
    "BonemillError",
    "Case",
    "CaseError",
    "Disc",
    "ImageError",
    "InfeasibleError",
    "Joint",
    "Material",
    "ModelError",
    "Plan",
    "PlanError",
    "PlanFileError",
    "RobotError",
    "StreamError",
    "Structure",
    "Tool",
    "__version__",
    "ball_volumes",
    "burr_force",
    "distance_transform",
    "engagement_metrics",
    "phantom",
    "plan",
    "view",
]
