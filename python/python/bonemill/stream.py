"""A plan's trajectory to a Universal Robots arm, row by row, through ``ur_rtde`` (the extra ``stream``).

What users of such systems complain of is refused before anything moves: an arm that is not at the plan's first position,
a speed slider below 100 % (it would stretch the plan's time silently), a registration that was only assumed, steps beyond
the plan's own limits. While it moves, the arm is stopped when it falls behind, leaves the track, goes into a protective
stop or when this program dies: the controller's watchdog then stops it, where it would otherwise run on.

Units here are the arm's: rad, s. Not here: moving to the first position, force control, registration.
"""

from __future__ import annotations

import operator
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ._errors import StreamError
from ._plan import Plan

Floats = NDArray[np.float64]

_NORMAL = 1
"""Safety mode NORMAL."""
_FULL_SPEED = 0.999
"""Speed fraction above which the slider counts as being at 100 %."""
_MOST_SPEED = 1.001
"""A slider ends at 100 %."""


@dataclass(frozen=True)
class Settings:
    """How the arm follows. The defaults lag by about 34 ms, 51 µm at 1.5 mm/s."""

    lookahead_s: float = 0.03
    """Smoothing of servoJ, 0.03 to 0.2 s."""
    gain: float = 2000.0
    """Stiffness of servoJ, 100 to 2000."""
    start_tolerance_rad: float = 0.002
    """How far the arm may be from the first row."""
    track_tolerance_rad: float = 0.01
    """How far it may be from what it was told within the last `track_s`."""
    track_s: float = 0.25
    """How long it may take to get where it was told to be."""
    late_s: float = 0.1
    """How far the clock may run behind."""
    watchdog_hz: float = 10.0
    """The controller stops the arm when it hears less often."""

    def __post_init__(self) -> None:
        for name, value, low, high in (
            ("lookahead_s", self.lookahead_s, 0.03, 0.2),
            ("gain", self.gain, 100.0, 2000.0),
            ("start_tolerance_rad", self.start_tolerance_rad, 0.0, 0.1),
            ("track_tolerance_rad", self.track_tolerance_rad, 0.0, 0.5),
            ("track_s", self.track_s, 0.0, 2.0),
            ("late_s", self.late_s, 0.0, 2.0),
            ("watchdog_hz", self.watchdog_hz, 1.0, 100.0),
        ):
            if not low <= value <= high:
                raise StreamError(f"{name} = {value}: expected {low} to {high}")


@dataclass(frozen=True)
class Rows:
    """What will be sent: one row a period."""

    period_s: float
    q: Floats
    """Shape (n, 6), rad."""


@dataclass(frozen=True)
class Report:
    """How it went."""

    rows: int
    seconds: float
    late_rows: int
    """Rows that were sent more than a period late."""
    latest_s: float
    """How late the latest was."""
    largest_error_rad: float
    """Largest distance of the arm from where it was told to be within `Settings.track_s`."""


class Link(Protocol):
    """An arm that takes joint positions. `UrLink` is the real one."""

    def actual_q(self) -> Floats: ...
    def speed_fraction(self) -> float: ...
    def safety_mode(self) -> int: ...
    def servo(self, q: Floats, period_s: float, settings: Settings) -> bool: ...
    def stop(self) -> None: ...


class UrLink:
    """An e-Series arm through ``ur_rtde``."""

    def __init__(self, host: str, rate_hz: float, settings: Settings) -> None:
        try:
            import rtde_control
            import rtde_receive
        except ImportError as error:
            raise StreamError("streaming needs ur_rtde: pip install 'bonemill[stream]'") from error
        try:
            self._receive: Any = rtde_receive.RTDEReceiveInterface(host, rate_hz)
            self._control: Any = rtde_control.RTDEControlInterface(host, rate_hz)
        except RuntimeError as error:
            raise StreamError(f"cannot connect to the arm at {host}\n  because: {error}") from error
        # every row that is sent counts as a sign of life
        self._control.setWatchdog(settings.watchdog_hz)

    def actual_q(self) -> Floats:
        return np.asarray(self._receive.getActualQ(), dtype=np.float64)

    def speed_fraction(self) -> float:
        return float(self._receive.getTargetSpeedFraction())

    def safety_mode(self) -> int:
        return int(self._receive.getSafetyMode())

    def servo(self, q: Floats, period_s: float, settings: Settings) -> bool:
        # speed and acceleration are not used by servoJ
        return bool(
            self._control.servoJ(q.tolist(), 0.5, 0.5, period_s, settings.lookahead_s, settings.gain)
        )

    def stop(self) -> None:
        try:
            self._control.servoStop()
        finally:
            self._control.stopScript()
            self._control.disconnect()
            self._receive.disconnect()


def rows_of(plan: Plan) -> Rows:
    """The rows to send, checked against the plan's own limits.

    Raises:
        StreamError: an arm that is no UR, an assumed registration, a rate that the controller does not have, steps or
            positions beyond the limits: with the row, joint and by how much.
    """
    joints = plan.arm.joints
    if len(joints) != 6 or any(j.kind != "revolute" for j in joints):
        kinds = ", ".join(j.kind for j in joints)
        raise StreamError(f"the plan is for an arm with joints {kinds}: streaming needs a UR arm, six revolute joints")
    if plan.registration_assumed:
        raise StreamError(
            "the case has no registration, so where the arm stands was assumed: give robot.base_from_ct and plan again"
        )
    time_s, q = plan.trajectory["time_s"], np.ascontiguousarray(plan.q)
    if len(time_s) < 2:
        raise StreamError(f"the trajectory has {len(time_s)} rows: expected at least 2")
    period_s = float(time_s[-1]) / (len(time_s) - 1)
    if not 0.002 - 1e-9 <= period_s <= 0.01 + 1e-9:
        raise StreamError(f"the trajectory has a row every {period_s} s: the controller takes one every 0.002 to 0.01 s")
    off = np.abs(time_s - period_s * np.arange(len(time_s)))
    if off.max() > 1e-6:
        row = int(off.argmax())
        raise StreamError(f"row {row} is at {time_s[row]} s: expected even steps of {period_s} s")
    speed = np.abs(np.diff(q, axis=0)) / period_s
    for n, joint in enumerate(joints):
        beyond = np.maximum(joint.lower - q[:, n], q[:, n] - joint.upper)
        if beyond.max() > 0:
            row = int(beyond.argmax())
            raise StreamError(f"row {row}: joint {joint.name} is {beyond[row]:.4f} rad beyond its limit")
        fastest = int(speed[:, n].argmax())
        if speed[fastest, n] > joint.velocity_limit * (1 + 1e-6):
            raise StreamError(
                f"row {fastest}: joint {joint.name} at {speed[fastest, n]:.4f} rad/s, limit {joint.velocity_limit} rad/s"
            )
    return Rows(period_s, q)


def stream(
    plan: Plan,
    host: str,
    *,
    settings: Settings | None = None,
    dry_run: bool = False,
    progress: Callable[[int, int], object] | None = None,
) -> Report:
    """Moves a UR arm along a plan's trajectory.

    Args:
        plan: for a UR arm, with a registration.
        host: the controller's address; it must be in remote control, at the plan's first position, slider at 100 %.
        settings: how it follows.
        dry_run: check all that can be checked without an arm; nothing is connected to.
        progress: told ``(rows sent, rows)`` about twice a second.

    Raises:
        StreamError: what is wrong, where; the arm has then been stopped. KeyboardInterrupt (Ctrl-C) stops it, too.
    """
    chosen = settings or Settings()
    rows = rows_of(plan)
    if dry_run:
        return Report(len(rows.q), rows.period_s * (len(rows.q) - 1), 0, 0.0, 0.0)
    return follow(UrLink(host, 1.0 / rows.period_s, chosen), rows, chosen, progress=progress)


def follow(
    link: Link,
    rows: Rows,
    settings: Settings,
    *,
    progress: Callable[[int, int], object] | None = None,
    clock: Callable[[], float] = time.perf_counter,
    sleep: Callable[[float], None] = time.sleep,
) -> Report:
    """Sends rows to an arm on time, and stops it whatever happens."""
    with _stopped_in_the_end(link):
        _check_start(link, rows, settings)
        window = max(1, round(settings.track_s / rows.period_s))
        late, latest, largest = 0, 0.0, 0.0
        began = clock()
        for row, q in enumerate(rows.q):
            behind = clock() - began - row * rows.period_s
            if behind < 0:
                sleep(-behind)
                behind = 0.0
            late, latest = late + (behind > rows.period_s), max(latest, behind)
            if behind > settings.late_s:
                raise StreamError(f"row {row} of {len(rows.q)}: {behind:.3f} s late, at most {settings.late_s} s")
            _send(link, q, f"row {row} of {len(rows.q)}", rows.period_s, settings)
            told = rows.q[max(0, row - window) : row + 1]
            largest = max(largest, _watch(link, row, told, settings))
            if progress is not None and row % max(1, round(0.5 / rows.period_s)) == 0:
                progress(row, len(rows.q))
        for _ in range(window):
            # the last row is rest: the arm gets there, and the watchdog hears of us meanwhile
            sleep(rows.period_s)
            _send(link, rows.q[-1], "at rest in the end", rows.period_s, settings)
        largest = max(largest, _watch(link, len(rows.q) - 1, rows.q[-1:], settings))
        return Report(len(rows.q), clock() - began, late, latest, largest)


def _check_start(link: Link, rows: Rows, settings: Settings) -> None:
    mode, fraction, actual = _state(link, "at the start")
    if mode != _NORMAL:
        raise StreamError(f"the arm's safety mode is {mode}: expected {_NORMAL} (normal)")
    if fraction < _FULL_SPEED:
        raise StreamError(f"the speed slider is at {100 * fraction:.0f} %: the plan's times hold at 100 % only")
    off = np.abs(actual - rows.q[0])
    if off.max() > settings.start_tolerance_rad:
        joint = int(off.argmax())
        raise StreamError(
            f"the arm is not at the plan's first position: joint {joint + 1} is {off[joint]:.4f} rad off, at most "
            f"{settings.start_tolerance_rad} rad; move it to {np.round(rows.q[0], 5).tolist()} rad"
        )


def _send(link: Link, q: Floats, what: str, period_s: float, settings: Settings) -> None:
    try:
        taken = link.servo(q, period_s, settings)
    except (RuntimeError, OSError) as error:
        raise StreamError(f"{what}: cannot be sent\n  because: {error}") from error
    if not taken:
        raise StreamError(f"{what}: the arm did not take it")


def _state(link: Link, when: str) -> tuple[int, float, Floats]:
    """Safety mode, speed fraction and joints, rad, as the arm says them; nonsense is refused: NaN is below no limit."""
    try:
        # a mode is a whole number: 1.9 is not normal
        mode, fraction = operator.index(link.safety_mode()), float(link.speed_fraction())
        actual = np.asarray(link.actual_q(), dtype=np.float64)
    except (RuntimeError, TypeError, ValueError, OverflowError, OSError) as error:
        raise StreamError(f"{when}: the arm's state cannot be read\n  because: {error}") from error
    if not (np.isfinite(fraction) and 0.0 <= fraction <= _MOST_SPEED):
        raise StreamError(f"{when}: the arm gives {fraction} as its speed fraction: expected 0 to {_MOST_SPEED:g}")
    if actual.shape != (6,) or not np.isfinite(actual).all():
        raise StreamError(f"{when}: the arm gives {actual.tolist()} as its joints: expected six finite numbers, rad")
    return mode, fraction, actual


def _watch(link: Link, row: int, told: Floats, settings: Settings) -> float:
    """How far the arm is from all that it was told lately, rad."""
    mode, fraction, actual = _state(link, f"row {row}")
    if mode != _NORMAL:
        raise StreamError(f"row {row}: the arm stopped itself, safety mode {mode}")
    if fraction < _FULL_SPEED:
        raise StreamError(f"row {row}: the speed slider was moved to {100 * fraction:.0f} %")
    off = np.maximum(told.min(axis=0) - actual, actual - told.max(axis=0)).max()
    if off > settings.track_tolerance_rad:
        raise StreamError(f"row {row}: the arm is {off:.4f} rad off its track, at most {settings.track_tolerance_rad}")
    return max(float(off), 0.0)


@contextmanager
def _stopped_in_the_end(link: Link) -> Iterator[None]:
    before = ""
    try:
        yield
    except StreamError as error:
        before = f"\n  before that: {error}"
        raise
    finally:
        try:
            link.stop()
        except (RuntimeError, OSError) as error:
            raise StreamError(f"the arm may still move: it could not be stopped\n  because: {error}{before}") from error
