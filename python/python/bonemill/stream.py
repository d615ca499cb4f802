"""A plan's trajectory to a Universal Robots arm through ``ur_rtde`` (the extra ``stream``), judged in millimetres.

All decisions are the Rust core's (``bonemill-stream``): what must hold before the first motion, the approach, when targets
are sent, when the arm is stopped, holds, the log. Here is what only Python can do: the arm's client. It runs in three processes
of its own, one that brings the arm's state, one that moves the arm and one that switches the spindle, because a client whose
controller is gone may block for ever with Python's lock in its hand. This process never waits for them: it kills one that hangs.

Units are mm, rad and s; the client's metres end in `UrLink`.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, Protocol

from . import _native
from ._console import CATCH_UP_S, SCREEN
from ._console import Console as Console
from ._errors import StreamError
from ._ur import control, receive

_HERE = Path(__file__).resolve().parent / "_ur"
_ORDERS = {"start": control.START, "target": control.TARGET, "stop": control.STOP, "spindle": control.SPINDLE, "end": control.END}
_WORDS = {number: word for word, number in _ORDERS.items()}
_ENDS_S = 1.0
"""The control process gets so long to end its program; then it is killed, and the controller's watchdog stops the arm."""
_DASHBOARD_S = 3.0
_DASHBOARD_PERIOD_S = 0.2
_TEACHES = 1 << 2
"""The status bit of a pressed freedrive button."""


@dataclass(frozen=True)
class Settings:
    """How the arm follows. The defaults lag by about 34 ms, 51 µm at 1.5 mm/s."""

    lookahead_s: float = 0.03
    """Smoothing of servoJ, 0.03 to 0.2 s."""
    gain: float = 2000.0
    """Stiffness of servoJ, 100 to 2000."""
    watchdog_hz: float = 10.0
    """The controller stops the arm when it hears less often."""
    spindle_output: int = 0
    """Standard digital output that switches the spindle."""

    def __post_init__(self) -> None:
        for name, value, low, high in (
            ("lookahead_s", self.lookahead_s, 0.03, 0.2),
            ("gain", self.gain, 100.0, 2000.0),
            ("watchdog_hz", self.watchdog_hz, 1.0, 100.0),
            ("spindle_output", self.spindle_output, 0, 7),
        ):
            if not low <= value <= high:
                raise StreamError(f"{name} = {value}: expected {low} to {high}")


@dataclass(frozen=True)
class Report:
    """How a run ended."""

    reason: str | None
    """Why it was stopped, or what was not seen at its end; none where it came to the plan's end at rest."""
    at_rest: bool
    """Whether the arm was seen at rest; if not, it may still move."""
    is_off: bool
    """Whether the spindle's output was seen off, or was never switched on; if not, it may still turn."""
    reached_row: float
    rows: int
    """Rows of the plan; the last is row ``rows - 1``."""
    seconds: float
    targets: int
    late_targets: int
    """Targets that were more than a period late."""
    latest_s: float
    farthest_off_mm: float
    """Farthest of the burr from its path at any step, on the way to its start too, mm."""


class Operator(Protocol):
    """Who is told and asked. No method may block; an answer comes when it is there, once."""

    def tell(self, text: str) -> None: ...
    def ask(self, text: str) -> None: ...
    def answer(self) -> bool | None: ...


class Link(Protocol):
    """An arm. No method may block; what is raised is the link's fault. States may come after one. A state's force is None for an arm without a
    sensor; None after a force is a sensor that has fallen silent, and stops the arm."""

    def state(self) -> tuple[Any, ...] | None: ...
    def fault(self) -> str | None: ...
    def order(self, what: str, values: list[float]) -> None: ...
    def identity(self) -> tuple[str, str, bool] | None: ...
    def waiting(self) -> int: ...
    def close(self) -> None: ...


class _Child:
    """A process of the client with pipes that never block here."""

    def __init__(self, script: str, *arguments: object) -> None:
        self.script, self.data = script, b""
        self.waiting = 0
        """Orders that it has not answered."""
        self.failed: str | None = None
        """The first that was wrong with an order."""
        self._said = tempfile.TemporaryFile()
        call = [sys.executable, str(_HERE / f"{script}.py"), *map(str, arguments)]
        # a session of its own: Ctrl-C is for this process, which stops the arm in order
        self.process = subprocess.Popen(
            call, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._said, start_new_session=True
        )
        assert self.process.stdin is not None and self.process.stdout is not None
        self.into, self.out = self.process.stdin.fileno(), self.process.stdout.fileno()
        os.set_blocking(self.into, False)
        os.set_blocking(self.out, False)

    def read(self, size: int) -> list[bytes]:
        """Whole messages that came; an ended process is a fault."""
        ended = False
        while not ended:
            try:
                piece = os.read(self.out, 1 << 16)
            except BlockingIOError:
                break
            self.data, ended = self.data + piece, not piece
        whole = len(self.data) // size * size
        messages = [self.data[n : n + size] for n in range(0, whole, size)]
        self.data = self.data[whole:]
        if ended and not messages:
            raise RuntimeError(self.reason())
        return messages

    def reason(self) -> str:
        self._said.seek(0)
        lines = self._said.read().decode(errors="replace").splitlines()
        reasons = [line.removeprefix("reason: ") for line in lines if line.startswith("reason: ")]
        return (reasons or lines or [f"the client's process for {self.script} ended"])[-1]

    def order(self, what: str, values: list[float]) -> None:
        padded = (*values, *[0.0] * (6 - len(values)))
        try:
            os.write(self.into, control.ORDER.pack(_ORDERS[what], *padded))
            self.waiting += 1
        except BlockingIOError:
            # the process has not read for seconds
            self.failed = self.failed or what
        except BrokenPipeError:
            self.failed = self.failed or self.reason()

    def heed(self) -> str | None:
        """Takes the answers that came; what was wrong with the first order that failed."""
        try:
            messages = self.read(control.ANSWER.size)
        except RuntimeError as error:
            messages, self.failed = [], self.failed or str(error)
        for message in messages:
            what, status, why = control.ANSWER.unpack(message)
            said = why.rstrip(b"\0").decode(errors="replace")
            if what == control.CONNECTION:
                self.failed = self.failed or said
                continue
            self.waiting -= 1
            if status == 1 and what != control.END:
                self.failed = self.failed or ("watchdog" if what == control.START else _WORDS[what])
            if status == 2 and what == control.START:
                self.failed = self.failed or f"start: {said}"
            elif status == 2:
                self.failed = self.failed or f"the client could not hand on the order to {_WORDS[what]} ({said})"
        return self.failed

    def hang_up(self) -> None:
        """The end of its orders: it does what must be done should the last ones not have come, and ends."""
        if self.process.stdin is not None:
            self.process.stdin.close()

    def end(self, patience_s: float) -> None:
        try:
            self.process.wait(patience_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(patience_s)
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()
        self._said.close()


class UrLink:
    """An e-Series arm through ``ur_rtde``."""

    def __init__(self, host: str, period_s: float, settings: Settings) -> None:
        self._state: tuple[Any, ...] | None = None
        self._identity: tuple[str, str, bool] | None = None
        self._spindle_bit = 1 << settings.spindle_output
        self._closed = threading.Event()
        self._receive = _Child("receive", host, 1.0 / period_s)
        self._arm = _Child("control", "arm", host, period_s, settings.lookahead_s, settings.gain, settings.watchdog_hz)
        self._spindle = _Child("control", "spindle", host, settings.spindle_output)
        threading.Thread(target=self._ask_dashboard, args=(host,), daemon=True).start()

    def _ask_dashboard(self, host: str) -> None:
        """Model and serial number, as far as the controller has a dashboard; and whether it is in local control, again and again."""
        try:
            with socket.create_connection((host, 29999), _DASHBOARD_S) as dashboard:
                dashboard.settimeout(_DASHBOARD_S)
                lines = dashboard.makefile("rw", newline="\n")
                lines.readline()
                while not self._closed.is_set():
                    answers = []
                    for question in ("get robot model", "get serial number", "is in remote control"):
                        lines.write(question + "\n")
                        lines.flush()
                        answers.append(lines.readline().strip())
                    # an older controller does not know the last question
                    self._identity = (answers[0], answers[1], answers[2] == "false")
                    self._closed.wait(_DASHBOARD_PERIOD_S)
        except OSError:
            pass
        self._identity = self._identity or ("", "", False)

    def state(self) -> tuple[Any, ...] | None:
        if (messages := self._receive.read(receive.STATE.size)):
            self._state = receive.STATE.unpack(messages[-1])
        if self._state is None:
            return None
        received, clock_s, *values = self._state
        q, pose, force, modes = values[:6], values[6:12], values[12:18], values[18:22]
        robot_mode, status, outputs = values[22:]
        more = (robot_mode, bool(status & _TEACHES), bool(outputs & self._spindle_bit))
        place_mm = [1e3 * v for v in pose[:3]]
        # an arm without a sensor says zeros, and so does a sensor that has failed
        measured = force[:3] if any(force) else None
        return (time.monotonic() - received, clock_s, q, (place_mm, pose[3:]), measured, *modes, more)

    def fault(self) -> str | None:
        """What is wrong with an order or its process. Both processes are listened to, whatever one of them says."""
        arm, spindle = self._arm.heed(), self._spindle.heed()
        return arm or spindle

    def order(self, what: str, values: list[float]) -> None:
        if what != "spindle":
            self._arm.order(what, values)
        if what in ("start", "spindle", "end"):
            self._spindle.order(what, values)

    def waiting(self) -> int:
        """Orders that no process has answered."""
        return self._arm.waiting + self._spindle.waiting

    def identity(self) -> tuple[str, str, bool] | None:
        return self._identity

    def close(self) -> None:
        """Lets go of the arm; all processes have ended when it comes back. Once more does nothing."""
        self._closed.set()
        self._spindle.hang_up()
        self._arm.hang_up()
        self._spindle.end(_ENDS_S)
        self._arm.end(_ENDS_S)
        self._receive.process.kill()
        self._receive.end(_ENDS_S)


class _Heard:
    """An operator, and whether a signal came meanwhile."""

    def __init__(self, operator: Operator) -> None:
        self.tell, self.ask, self.answer = operator.tell, operator.ask, operator.answer
        self.signals: list[int] = []

    def interrupted(self) -> bool:
        return bool(self.signals)


@contextmanager
def _signals(heard: _Heard) -> Iterator[None]:
    """Ctrl-C, SIGTERM, SIGHUP and Ctrl-Z stop the arm in order: they are noted, and raise nothing in the middle of a call. A run that was
    suspended could not switch its spindle off, so a background job that reads the terminal gets no input instead."""

    def note(number: int, frame: FrameType | None) -> None:
        heard.signals.append(number)
        # answers whatever the run is waiting for; a handler may not use buffered files
        with suppress(OSError):
            why = " instead of the run being suspended, which would leave the spindle on" if number == signal.SIGTSTP else ""
            SCREEN.show(f"{signal.Signals(number).name}: the arm is being stopped{why}")

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    SCREEN.begin()
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGTSTP)
    before = {number: signal.signal(number, note) for number in numbers}
    before |= {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGTTIN, signal.SIGTTOU)}
    try:
        yield
    finally:
        for number, handler in before.items():
            # none: one that is not Python's
            if handler is not None:
                signal.signal(number, handler)
        SCREEN.catch_up(CATCH_UP_S)


class Streaming:
    """A plan that is ready to be streamed or rehearsed.

    Raises:
        StreamError, PlanFileError: what of it no arm can follow, with row and joint; an assumed registration.
    """

    def __init__(
        self,
        plan: str | os.PathLike[str],
        *,
        slow: bool = False,
        unverified: bool = False,
        payload_kg: float | None = None,
        serial: str | None = None,
        run_up_s: float = 3.0,
        settings: Settings | None = None,
    ) -> None:
        self.settings = settings or Settings()
        """How the arm follows: its lag is in the bound."""
        self._native = _native.StreamPlan.load(
            Path(plan),
            slow=slow,
            unverified=unverified,
            payload_kg=payload_kg,
            serial=serial,
            run_up_s=run_up_s,
            lookahead_s=self.settings.lookahead_s,
            gain=self.settings.gain,
        )
        self.rows = self._native.rows()
        self.period_s = self._native.period_s()

    def for_a_ur(self) -> None:
        """That a UR arm can follow it; others can be rehearsed.

        Raises:
            StreamError: with the kinds of the plan's joints.
        """
        self._native.for_a_ur()

    def refusal(self) -> str | None:
        """Why no run of it is begun, whatever arm is there."""
        return self._native.refusal()

    @property
    def duration_s(self) -> float:
        """At the speeds that are allowed."""
        return self._native.duration_s()

    def bound_lines(self) -> list[str]:
        """What the burr can travel after each kind of failure, for people."""
        bounds = self._native.bounds()
        along, off = max(b[1] for b in bounds), max(b[2] for b in bounds)
        gap_mm, gap_row = self._native.least_gap()
        rate, row = self._native.slowest()
        lines = [
            f"bound after any failure: {along[0]:.3f} mm along the path (row {along[1]}), {off[0]:.3f} mm off it (row {off[1]}); "
            f"least room to a structure {gap_mm:.2f} mm (row {gap_row})"
        ]
        lines += [f"  {name}: {a[0]:.3f} mm along (row {a[1]}), {o[0]:.3f} mm off (row {o[1]})" for name, a, o in bounds]
        if rate < 1.0:
            lines.append(f"slowed where the bound is larger than the room: to {100 * rate:.0f} % at row {row}")
        return lines

    def resume_row(self, log: str | os.PathLike[str]) -> float:
        """Where a run with this log goes on."""
        return self._native.resume_row(Path(log))

    def joints(self, row: float) -> list[float]:
        """Joint positions of a row, rad or mm; 0 beyond the arm's."""
        return self._native.joints(row)

    def run(
        self, link: Link, operator: Operator, *, start_row: float = 0.0, log: str | os.PathLike[str] | None = None
    ) -> Report:
        """Runs it over a link; whatever happens, the arm is stopped and let go of."""
        try:
            heard = _Heard(operator)
            with _signals(heard):
                ended = self._native.run(start_row, link, heard, None if log is None else Path(log))
                link.close()
                return Report(*ended)
        finally:
            link.close()

    def rehearse(self, *, seed: int = 1, log: str | os.PathLike[str] | None = None) -> Report:
        """Runs it on a simulated arm, faster than real time."""
        return Report(*self._native.rehearse(seed, None if log is None else Path(log)))


def stream(
    plan: str | os.PathLike[str],
    host: str,
    *,
    payload_kg: float,
    serial: str | None = None,
    settings: Settings | None = None,
    slow: bool = False,
    unverified: bool = False,
    start_row: float = 0.0,
    log: str | os.PathLike[str] | None = None,
    operator: Operator | None = None,
    link: Callable[[str, float, Settings], Link] = UrLink,
) -> Report:
    """Moves a UR arm along the trajectory of a plan's folder.

    Args:
        plan: the folder: a UR arm, a registration, a passed verification.
        host: the controller's address; it must be in remote control.
        payload_kg: mass on the flange that the controller must know.
        serial: serial number that the arm must have; default: any, it is shown before the first motion.
        slow: slow down where the bound is larger than the room to a structure, instead of refusing.
        unverified: move a plan without a passed verification.
        start_row: where to begin: 0, or `Streaming.resume_row`.
        log: a new file.
        operator: who is told and asked; default: the terminal.

    Raises:
        StreamError: what of the plan is refused. Why a run was stopped stands in the report.
    """
    streaming = Streaming(plan, slow=slow, unverified=unverified, payload_kg=payload_kg, serial=serial, settings=settings)
    streaming.for_a_ur()
    return streaming.run(link(host, streaming.period_s, streaming.settings), operator or Console(), start_row=start_row, log=log)
