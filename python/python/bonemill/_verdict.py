"""Whether a plan may be streamed: its files must be those that a passed verification checked."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

from . import _native
from ._console import drop_typed
from ._errors import PlanFileError, StreamError

RISKED = """\
{reason}

Without a passed verification nobody but the planner says that this motion keeps its clearances: a changed or mixed-up file
can drive the burr into a nerve or a vessel at full speed, and no check while it moves would find it, since it follows the
file. Only go on where nothing can be harmed, with the spindle off or the bone a dummy.
"""
SENTENCE = "move unverified"
"""The words that the user types to confirm."""


def verified(folder: str | os.PathLike[str]) -> dict[str, str]:
    """SHA-256 by name of the plan's files that its passed verification (``verification.toml``) holds for.

    Raises:
        PlanFileError: there is no verification, it failed, or a file is not the one that was verified: with the file, its
            digest and the verified one.
    """
    return dict(_native.verified(Path(folder)))


def require_verified(
    folder: str | os.PathLike[str], *, unverified: bool = False, ask: Callable[[str], str] = input
) -> dict[str, str]:
    """The result of `verified`, or an empty dict if ``unverified`` is set and the user confirms the stated risk with `SENTENCE`.

    Raises:
        StreamError: the plan is not verified and the user did not confirm.
    """
    try:
        return verified(folder)
    except PlanFileError as error:
        reason = str(error)
    if not unverified:
        raise StreamError(f"the plan is not verified\n  because: {reason}")
    print(RISKED.format(reason=reason), file=sys.stderr)
    drop_typed()
    try:
        answer = ask(f'Type "{SENTENCE}" to go on: ')
    except EOFError:
        answer = ""
    if answer.strip() != SENTENCE:
        raise StreamError("not confirmed: an unverified plan was not moved")
    return {}
