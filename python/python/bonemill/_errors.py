"""The package's exceptions. Their words are those of the command ``bonemill``."""


class BonemillError(Exception):
    """Whatever this package refuses or cannot do."""


class ArrayError(BonemillError, ValueError):
    """An array or a number has the wrong shape, type or value."""


class CalibrationError(BonemillError):
    """A force log cannot tell the coefficients that were asked for."""


class CaseError(BonemillError, ValueError):
    """A case file is not valid: every fault with its key and line."""


class ImageError(BonemillError, ValueError):
    """An image cannot be read, trusted or planned on."""


class ModelError(BonemillError, ValueError):
    """A number that the force model cannot take."""


class RobotError(BonemillError, ValueError):
    """An arm's description, joint positions or limits are inconsistent."""


class PlanError(BonemillError):
    """No plan was found for the case."""


class InfeasibleError(PlanError):
    """The case is sound but cannot be fulfilled, e.g. the arm cannot reach a waypoint."""


class PlanFileError(BonemillError):
    """A plan's files cannot be read or written, or an input has changed since the plan was made."""


class StreamError(BonemillError):
    """A motion cannot be sent to an arm, or was stopped."""
