"""One run of ``python -m bonemill stream`` against the double with one fault, and what the burr did.

The burr's true travel comes from the double's joints by forward kinematics of its own (UR's published DH parameters), so
that nothing here trusts what is tested. Lengths mm, angles rad, times s.
"""

from __future__ import annotations

import itertools
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from ur_arm import PAUSED, PLAYING, POWER_OFF, burr_mm
from ur_double import Double
from ur_faults import OFFSET, OFFSET_RAD

Floats = NDArray[np.float64]
HERE = Path(__file__).resolve().parent
ENDS_S = 5.0
"""A client that has not ended so long after Ctrl-C hangs; closing the client's sockets alone takes two seconds."""
WATCH_S = 3.0
"""A run that goes on is looked at for so long, then stopped by Ctrl-C."""
START_S = 30.0
addresses: Iterator[str] = (f"127.0.{n // 200 + 1}.{n % 200 + 1}" for n in itertools.count(os.getpid() % 20000))


@dataclass(frozen=True)
class Piece:
    """A plan that is streamed, with its burr's path."""

    folder: Path
    q: Floats
    path_mm: Floats
    along_mm: Floats

    @classmethod
    def load(cls, folder: Path) -> Piece:
        rows = np.loadtxt(folder / "trajectory.csv", delimiter=",", skiprows=1)
        path = burr_mm(rows[:, 1:7])
        way = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))]
        return cls(folder, rows[:, 1:7], path, way)

    def places(self, burr: Floats, row: int) -> Floats:
        """Where along the path a burr is, and how far off it, mm, shape (n, 2), for places in the order of time; `row`: of as many
        targets as had come. It moves on by a few rows from place to place, so that a path that comes by again is no other place."""
        found = np.zeros((len(burr), 2))
        first, last = max(0, row - 600), row + 100
        for n, place in enumerate(burr):
            along, off, at = self._place(place, first, last)
            found[n] = along, off
            first, last = max(0, at - 200), at + 300
        return found

    def _place(self, burr: Floats, first: int, last: int) -> tuple[float, float, int]:
        path = self.path_mm[first:last]
        nearest = int(((path - burr) ** 2).sum(axis=1).argmin())
        best = (float("inf"), 0.0)
        for n in range(max(0, nearest - 1), min(len(path) - 1, nearest + 1)):
            step = path[n + 1] - path[n]
            size = float(step @ step)
            share = min(1.0, max(0.0, float((burr - path[n]) @ step) / size)) if size > 0 else 0.0
            off = float(np.linalg.norm(burr - path[n] - share * step))
            best = min(best, (off, float(self.along_mm[first + n]) + share * size**0.5))
        return best[1], best[0], first + nearest


def thinned(way: Floats, apart_mm: float = 0.02) -> Floats:
    """Places of a way that are at least so far from the one kept before."""
    kept = [way[0]]
    for place in way[1:]:
        if float(np.linalg.norm(place - kept[-1])) >= apart_mm:
            kept.append(place)
    return np.array([*kept, way[-1]])


def nearest_mm(places: Floats, way: Floats) -> Floats:
    """The distance of each place from the nearest place of a way, mm."""
    parts = [((part[:, None] - way[None]) ** 2).sum(axis=2).min(axis=1) for part in np.array_split(places, len(places) // 200 + 1)]
    return np.sqrt(np.concatenate(parts))


@dataclass
class Swept:
    """What a ball of 2 mm sweeps on an executed way and on the planned one."""

    left_mm: float
    """The farthest of a planned place from the executed way."""
    beside_mm: float
    """The farthest of an executed place from the planned way."""
    other: float
    """Volume swept on one way only, in parts of what the planned way sweeps."""

    @classmethod
    def of(cls, planned: Floats, executed: Floats, ball_mm: float = 2.0, voxel_mm: float = 0.2) -> Swept:
        planned, executed = thinned(planned), thinned(executed)
        both = np.r_[planned, executed]
        axes = [np.arange(low, high, voxel_mm) for low, high in zip(both.min(axis=0) - ball_mm, both.max(axis=0) + ball_mm, strict=True)]
        voxels = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        a, b = (nearest_mm(voxels, way) <= ball_mm for way in (planned, executed))
        return cls(float(nearest_mm(planned, executed).max()), float(nearest_mm(executed, planned).max()), float((a != b).sum() / a.sum()))


@dataclass
class Outcome:
    """What came of a run."""

    fault: str
    seed: int
    row: int = -1
    """Rows that had arrived when the fault began; -1: it never did."""
    along_mm: float = 0.0
    """Along the path from the fault to where the burr came to rest."""
    off_mm: float = 0.0
    """The farthest off the path from the fault on."""
    own_mm: float = 0.0
    """How far the fault itself moves the burr from where the targets have it: no order can bound that, so it is added to the bound."""
    fastest_mm_s: float = 0.0
    """Of the burr, from the first row on."""
    rest_s: float = 0.0
    """From the fault until the burr rested."""
    code: int | None = None
    spindle_on: bool = False
    """What the output was after the end."""
    exit_s: float = 0.0
    """From the fault until the process had ended."""
    how: str = ""
    """`stopped`, `went on`, `waited`, or `hung`: the last three were ended by Ctrl-C, or not even by that."""
    ctrl_c_s: float | None = None
    """From Ctrl-C until the burr rested, where Ctrl-C ended it."""
    said: str = ""
    bound: str = ""
    resumed: str = ""
    swept: dict[str, float] | None = None
    """Of both runs together where the resumed one came to the end: `Swept`."""
    notes: list[str] = field(default_factory=list)

    @property
    def bounds_mm(self) -> tuple[float, float]:
        """The printed bound along and off the path; nothing where none was printed."""
        found = re.search(r"bound[^:]*: ([\d.]+) mm along[^,]*, ([\d.]+) mm off", self.bound)
        return (float(found[1]), float(found[2])) if found else (0.0, 0.0)

    @property
    def within(self) -> bool:
        """No farther along the path nor off it than the printed bound and the fault's own distance."""
        along_mm, off_mm = self.bounds_mm
        return self.along_mm <= along_mm + self.own_mm and self.off_mm <= off_mm + self.own_mm


Local = Callable[["Run"], None]


def _signal(number: int) -> Local:
    return lambda run: run.process.send_signal(number)


def _paused(run: Run) -> None:
    run.process.send_signal(signal.SIGSTOP)
    time.sleep(3.0)
    run.process.send_signal(signal.SIGCONT)


def _plan_changed(run: Run) -> None:
    path = run.folder / "trajectory.csv"
    lines = path.read_text().splitlines()
    lines[len(lines) // 2] = lines[len(lines) // 2].replace(".", ".02", 1)
    path.write_text("\n".join(lines) + "\n")


def _second_client(run: Run) -> None:
    second = run.start(run.arguments(run.work / "second.log"), "second")
    try:
        second.wait(15)
    except subprocess.TimeoutExpired:
        second.kill()
        run.outcome.notes.append("the second client did not end by itself")
    run.outcome.notes.append(f"second client: exit code {second.returncode}, {run.words('second')}")


LOCAL: dict[str, Local] = {
    "SIGINT": _signal(signal.SIGINT),
    "SIGTERM": _signal(signal.SIGTERM),
    "SIGHUP": _signal(signal.SIGHUP),
    "Ctrl-Z": _signal(signal.SIGTSTP),
    "SIGKILL": _signal(signal.SIGKILL),
    "SIGSTOP for 3 s": _paused,
    "wall clock jumps": _signal(signal.SIGUSR1),
    "monotonic clock jumps": _signal(signal.SIGUSR2),
    "plan changed under way": _plan_changed,
    "two clients": _second_client,
    "disk full": lambda run: None,
    "log's folder renamed": lambda run: run.log.parent.rename(run.log.parent.with_name("renamed")),
    "log's folder deleted": lambda run: shutil.rmtree(run.log.parent),
}
"""Faults on the user's own machine."""
START = {f"start {mm:g} mm off": mm for mm in (0.1, 0.5, 1.6, 5.0)}
"""The arm stands so far from the first row."""
AT_START: dict[str, tuple[str, Any]] = {
    "program paused at the start": ("runtime_state", PAUSED),
    "arm off at the start": ("robot_mode", POWER_OFF),
    "controller at 125 Hz": ("least_period_s", 0.008),
}
"""What a controller is when the client connects: nothing may move."""
ASKED: dict[str, tuple[str, Any]] = {
    "another program while asked": ("runtime_state", PLAYING),
    "tool centre point changed while asked": ("values", {"actual_TCP_pose": [0.0] * 6}),
    "payload changed while asked": ("values", {"payload": 2.0}),
    "spindle that does not switch": ("outputs_stuck", True),
}
"""What becomes of it while the user is asked, who says yes then: nothing may be fed."""
TYPED = "answers typed ahead"
"""Two lines of yes before the question: the client waits for an answer."""
REFUSED = (*AT_START, *ASKED, TYPED)


def prefer() -> None:
    """Real-time priority for this process and its children where the system allows it: other programs share the cores. They hear Ctrl-C,
    though this process was started in the background."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(20))
    except (PermissionError, AttributeError):
        pass


class Run:
    """A client, a double and a fault. Nothing of it outlives `finish`."""

    resume_s = 4.0
    """How long a resumed run is looked at; longer than the plan: to its end."""

    def __init__(self, piece: Piece, fault: str, seed: int, work: Path, flags: list[str]) -> None:
        self.piece, self.fault, self.work, self.flags = piece, fault, work, flags
        self.outcome = Outcome(fault, seed)
        self.dice = np.random.default_rng([seed, sum(map(ord, fault))])
        work.mkdir(parents=True, exist_ok=True)
        self.folder = piece.folder
        if fault == "plan changed under way":
            self.folder = work / "plan"
            shutil.copytree(piece.folder, self.folder, dirs_exist_ok=True)
        self.double = Double(next(addresses), self._start_q())
        self.log = work / "logs" / "run.log"
        self.log.parent.mkdir(exist_ok=True)
        self.asked_s: float | None = None

    def _start_q(self) -> Floats:
        """The first row, or joints at which the burr is some mm off it in a random direction."""
        off_mm = START.get(self.fault, 0.0)
        if not off_mm:
            return self.piece.q[0]
        direction = self.dice.normal(size=6)
        step = 1e-4 * direction / np.linalg.norm(direction)
        moved = burr_mm(np.stack([self.piece.q[0], self.piece.q[0] + step]))
        q = self.piece.q[0] + step * off_mm / float(np.linalg.norm(moved[1] - moved[0]))
        self.outcome.own_mm = float(np.linalg.norm(burr_mm(q[None])[0] - moved[0])) + 1e-6
        return q

    def arguments(self, log: Path, *more: str) -> list[str]:
        given = [a.replace("LOG", str(log)) for a in self.flags]
        return ["stream", str(self.folder), "--host", self.double.host, *given, *more]

    def start(self, arguments: list[str], name: str, user: int = subprocess.DEVNULL) -> subprocess.Popen[bytes]:
        most = 40_000 if self.fault == "disk full" and name == "run" else 0
        out = (self.work / f"{name}.out").open("wb")
        # a log that may not grow stands for a full disk
        call = [sys.executable, str(HERE / "fault_client.py"), str(most), *arguments]
        return subprocess.Popen(call, stdout=out, stderr=subprocess.STDOUT, stdin=user)

    def words(self, name: str) -> str:
        """The error that the user reads, else the last line."""
        text = (self.work / f"{name}.out").read_text(errors="replace").replace("\r", "\n")
        lines = [line.strip() for line in text.splitlines() if line.strip()]
        errors = [n for n, line in enumerate(lines) if line.startswith("error:")]
        return " ".join(lines[errors[0] : errors[0] + 3]) if errors else (lines[-1] if lines else "")

    def go(self, first: int = 400, last: int = 2500) -> Outcome:
        """Runs it; the fault begins when between `first` and `last` rows have arrived."""
        if self.fault in REFUSED:
            return self._refused()
        row = int(self.dice.integers(first, last))
        at_controller = self.fault not in LOCAL and self.fault not in START
        if at_controller:
            self.double.call("arrange", self.fault, row)
        self.process = self.start(self.arguments(self.log), "run")
        began = time.monotonic()
        while self.process.poll() is None and time.monotonic() - began < START_S + row * 0.002:
            if self.double.call("rows") >= (1 if self.fault in START else row):
                break
            time.sleep(0.01)
        if self.double.call("rows") >= (1 if self.fault in START else row):
            self.outcome.row = row
            if self.fault in LOCAL:
                self.double.call("mark")
                LOCAL[self.fault](self)
            elif self.fault in START:
                self.double.call("mark")
        if self.fault == "disk full":
            # the log says when it was full; what the burr went on then is counted from the last targets
            self.outcome.row = self.double.call("rows")
            self.double.call("mark")
        self._await_end()
        self._measure()
        if self.resumable:
            self._resume()
        return self.outcome

    def _refused(self) -> Outcome:
        """A run with a user who is asked; what is wrong is so from the start, or from the question on."""
        if self.fault in AT_START:
            self.double.set(*AT_START[self.fault])
        self.flags = [flag for flag in self.flags if flag != "--yes"]
        self.process = self.start(self.arguments(self.log), "run", subprocess.PIPE)
        assert self.process.stdin is not None
        if self.fault == TYPED:
            self.process.stdin.write(b"y\ny\n")
            self.process.stdin.flush()
        began = time.monotonic()
        while self.process.poll() is None and time.monotonic() - began < START_S:
            if "[y/N]" in (self.work / "run.out").read_text(errors="replace"):
                break
            time.sleep(0.01)
        self.outcome.row = 0
        self.double.call("mark")
        if self.fault in ASKED and self.process.poll() is None:
            self.double.set(*ASKED[self.fault])
            # every client hears of it
            time.sleep(float(self.dice.uniform(0.2, 0.8)))
            self.process.stdin.write(b"y\n")
            self.process.stdin.flush()
        self._await_end()
        self._measure()
        return self.outcome

    @property
    def resumable(self) -> bool:
        """A run that was stopped on its way and whose arm can be mended."""
        stopped = self.outcome.how == "stopped" and self.outcome.code not in (0, 2) and self.outcome.row >= 0
        return stopped and self.log.exists() and self.fault not in START and self.fault != "plan changed under way"

    def _resume(self) -> None:
        """Mends everything and goes on from the log, for a while or to the end."""
        out = self.outcome
        self.double.call("cured")
        time.sleep(0.1)
        before = self.double.call("rows")
        self.process = self.start(self.arguments(self.work / "resumed.log", "--resume", str(self.log)), "resumed")
        began = time.monotonic()
        while self.process.poll() is None and time.monotonic() - began < self.resume_s:
            time.sleep(0.02)
        went_on = self.process.poll() is None
        if went_on:
            self.process.send_signal(signal.SIGINT)
        try:
            code = self.process.wait(ENDS_S)
        except subprocess.TimeoutExpired:
            out.resumed = f"hung: {self.words('resumed')}"
            self.process.kill()
            return
        record, _ = self.double.call("rest")
        burr = burr_mm(record[record[:, 7] > before][:, 1:7]) if len(record) else []
        rows = self.double.call("rows") - before
        if code == 0:
            out.resumed = f"to the end, {rows} rows"
            out.swept = asdict(Swept.of(self.piece.path_mm, burr_mm(record[:, 1:7])))
        elif went_on and rows > 100 and len(burr):
            out.resumed = f"went on, {rows} rows until Ctrl-C"
        else:
            out.resumed = f"exit code {code}: {self.words('resumed')}"

    def _await_end(self) -> None:
        out, began = self.outcome, time.monotonic()
        while self.process.poll() is None and time.monotonic() - began < WATCH_S + 1.0:
            time.sleep(0.01)
        out.exit_s = time.monotonic() - began
        if (code := self.process.poll()) is not None:
            out.how, out.code = "stopped", code
            return
        before = self.double.call("rows")
        time.sleep(0.3)
        out.how = "went on" if self.double.call("rows") > before else "waited"
        self.asked_s = time.monotonic()
        for number, limit_s in ((signal.SIGINT, ENDS_S), (signal.SIGTERM, 2.0), (signal.SIGKILL, 5.0)):
            asked = time.monotonic()
            self.process.send_signal(number)
            try:
                out.code = self.process.wait(limit_s)
                out.notes.append(f"{signal.Signals(number).name} answered in {time.monotonic() - asked:.2f} s")
                return
            except subprocess.TimeoutExpired:
                out.how = "hung"
                out.notes.append(f"{signal.Signals(number).name} not answered in {limit_s} s")

    def _measure(self) -> None:
        out = self.outcome
        record, fault_s = self.double.call("rest")
        out.said = self.words("run")
        out.spindle_on = bool(self.double.get("digital_outputs"))
        text = (self.work / "run.out").read_text(errors="replace")
        out.bound = "; ".join(re.findall(r"[^\n]*bound[^\n]*", text)[:2])
        if not len(record) or out.row < 0:
            return
        burr = burr_mm(record[:, 1:7])
        gaps = np.diff(record[:, 0])
        if len(burr) > 1:
            out.fastest_mm_s = float((np.linalg.norm(np.diff(burr, axis=0), axis=1) / gaps).max())
        after = np.flatnonzero(record[:, 0] >= fault_s - 1e-4)
        if not len(after):
            return
        picked = np.unique(np.r_[after[::5], after[-1]])
        if self.fault == OFFSET:
            told = burr_mm(record[picked, 1:7] - OFFSET_RAD)
            out.own_mm = float(np.linalg.norm(burr[picked] - told, axis=1).max())
        places = self.piece.places(burr[picked], int(record[picked[0], 7]))
        out.off_mm = float(places[:, 1].max())
        if out.how != "went on":
            out.along_mm = float(places[:, 0].max() - places[0, 0])
        moving = np.flatnonzero(np.linalg.norm(np.diff(burr[after], axis=0), axis=1) > 1e-6)
        rest_s = float(record[after[moving[-1] + 1], 0]) if len(moving) else fault_s
        out.rest_s = rest_s - fault_s
        if self.asked_s is not None:
            out.ctrl_c_s = max(0.0, rest_s - self.asked_s)

    def finish(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self.double.__exit__()
