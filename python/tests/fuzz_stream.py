"""Streaming against random answers: ``python fuzz_stream.py MINUTES [FIRST]``, or some trials in the tests.

A trial is its number's. Rows, tolerances, the arm's lag, its clock and what is damaged are drawn; whether an answer may pass
is judged here by rules of their own (a text that reads as a number counts as that number, except for the safety mode).
Whatever the arm says: its state is asked for once before every row and once in the end, no row is sent after an answer that
may not pass or too late, the arm is stopped once, and nothing but a `StreamError` comes out. Where all may pass, every row
arrives in its place, then the last one until the arm has had its time; and the report is that of what happened.
"""

from __future__ import annotations

import math
import struct
import sys
import time
from typing import Any

import numpy as np

from bonemill import StreamError
from bonemill.stream import Rows, Settings, follow

QUESTIONS = ("mode", "fraction", "joints")


class Arm:
    """Follows with a lag, and answers something else now and then."""

    def __init__(self, random: np.random.Generator, rows: Rows, settings: Settings) -> None:
        self.random, self.rows, self.settings = random, rows, settings
        self.window = max(1, round(settings.track_s / rows.period_s))
        self.lag = int(random.integers(0, 4))
        # never, seldom, or from some answer on
        self.rate = float(random.choice([0.0, 0.0, 1e-3, 0.05]))
        breaks = random.random()
        # before some row, at one of the last three questions, or not
        at_last = 3 * (len(rows.q) + 1)
        first, beyond = (0, at_last) if breaks < 0.4 else (at_last, at_last + 3)
        self.broken_from = int(random.integers(first, beyond)) if breaks < 0.55 else 10**9
        self.slow_s = float(random.choice([1e-4, 1e-4, 3e-3, 0.03]))
        self.stops_badly = random.random() < 0.02
        self.answers, self.now, self.stops = 0, 0.0, 0
        self.asked = dict.fromkeys(QUESTIONS, 0)
        self.told: list[np.ndarray] = []
        self.largest, self.late, self.latest = 0.0, 0, 0.0
        self.must_stop = ""

    def refuse(self, why: str) -> None:
        self.must_stop = self.must_stop or why

    def damaged(self, question: str) -> bool:
        """Whether this answer is; it may also not come."""
        self.answers += 1
        self.asked[question] += 1
        damaged = self.answers > self.broken_from or bool(self.random.random() < self.rate)
        if damaged and self.random.random() < 0.1:
            self.refuse("no answer")
            raise [RuntimeError, OSError, ValueError][int(self.random.integers(0, 3))]("gone")
        return damaged

    def number(self) -> Any:
        """Any double, likely ones, and what is none."""
        draw = self.random.integers(0, 8)
        if draw == 0:
            return struct.unpack("<d", self.random.bytes(8))[0]
        if draw == 1:
            return float(self.random.choice([math.nan, math.inf, -math.inf, 5e-324, 1.7e308, -0.0]))
        if draw == 2:
            return [None, "1", "one", [], {}, object(), 1j, b"1", True][int(self.random.integers(0, 9))]
        if draw == 3:
            return int(self.random.integers(-(2**40), 2**40))
        return float(self.random.normal(scale=10.0 ** self.random.integers(-6, 3)))

    def safety_mode(self) -> Any:
        mode: Any = self.number() if self.damaged("mode") else 1
        if not (isinstance(mode, int) and mode == 1):
            self.refuse(f"mode {mode!r}")
        return mode

    def speed_fraction(self) -> Any:
        fraction: Any = 1.0
        if self.damaged("fraction"):
            beside = float(self.random.choice([0.95, 0.9985, 0.9995, 1.0005, 1.0015, 1.2]))
            fraction = beside if self.random.random() < 0.5 else self.number()
        try:
            is_full = 0.999 <= float(fraction) <= 1.001
        except (TypeError, ValueError, OverflowError):
            is_full = False
        if not is_full:
            self.refuse(f"fraction {fraction!r}")
        return fraction

    def actual_q(self) -> Any:
        at = len(self.told) - 1 - self.lag
        q: Any = self.told[max(at, 0)].copy() if self.told else self.rows.q[0].copy()
        if self.damaged("joints"):
            joint = int(self.random.integers(0, 6))
            low, high, most = self.band()
            kind = self.random.integers(0, 7)
            if kind == 0:
                q = [self.number() for _ in range(int(self.random.integers(0, 9)))]
            elif kind == 1:
                q = list(q)
                q[joint] = self.number()
            elif kind == 2:
                q[joint] = self.random.choice([math.nan, math.inf, -math.inf])
            elif kind == 3:
                # beside what is allowed, on either side of it
                part = float(self.random.choice([0.98, 1.02]))
                q[joint] = high[joint] + part * most if self.random.random() < 0.5 else low[joint] - part * most
            elif kind == 4:
                # where it was, or was to be, at another time
                q = self.rows.q[int(self.random.integers(0, len(self.rows.q)))].copy()
            elif kind == 5:
                q = q + self.random.normal(scale=10.0 ** self.random.integers(-6, 1), size=6)
            else:
                q = self.number()
        self.judge(q)
        return q

    def band(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Least and largest joints of what the arm was told lately, and how far beside them it may be."""
        if not self.told:
            lately, most = self.rows.q[:1], self.settings.start_tolerance_rad
        else:
            rests = len(self.told) > len(self.rows.q)
            lately = self.rows.q[-1:] if rests else np.array(self.told[-self.window - 1 :])
            most = self.settings.track_tolerance_rad
        return lately.min(axis=0), lately.max(axis=0), most

    def judge(self, q: Any) -> None:
        try:
            values = [float(v) for v in q] if not isinstance(q, (str, bytes, dict)) else []
        except (TypeError, ValueError, OverflowError):
            values = []
        if len(values) != 6 or not all(map(math.isfinite, values)):
            self.refuse(f"joints {q!r}")
            return
        low, high, most = self.band()
        far = max(max(lo - v, v - hi) for v, lo, hi in zip(values, low, high))
        if far > most:
            self.refuse(f"{far} rad off")
        if self.told:
            self.largest = max(self.largest, far)

    def behind_s(self) -> float:
        """How late the next row is."""
        return self.now - len(self.told) * self.rows.period_s

    def servo(self, q: np.ndarray, period_s: float, settings: Settings) -> bool:
        assert not self.must_stop, f"a row was sent after {self.must_stop}"
        assert not self.stops
        row, count = len(self.told), len(self.rows.q)
        asked = 1 if row <= count else 0
        assert self.asked == dict.fromkeys(QUESTIONS, asked), f"row {row}: asked {self.asked}"
        self.asked = dict.fromkeys(QUESTIONS, 0)
        if row < count:
            behind = self.behind_s()
            assert -1e-12 < behind <= self.settings.late_s, f"row {row}: {behind} s late"
            # what lies within rounding of a period may count or not
            self.late += 0 if abs(behind - period_s) < 1e-12 else behind > period_s
            self.latest = max(self.latest, behind)
        self.told.append(q.copy())
        self.now += float(self.random.exponential(self.slow_s))
        if self.broken_from < 10**9 and self.random.random() < 5e-3:
            self.refuse("a row that was not taken")
            if self.random.random() < 0.5:
                raise [RuntimeError, OSError][int(self.random.integers(0, 2))]("gone")
            return False
        return True

    def stop(self) -> None:
        self.stops += 1
        if self.stops_badly:
            raise RuntimeError("no stop")

    def wait(self, seconds: float) -> None:
        assert seconds > 0
        self.now += seconds


def trial(number: int) -> bool:
    """Whether the arm got to the end; an AssertionError says what went wrong."""
    random = np.random.default_rng([20261122, number])
    count = int(random.integers(2, 60))
    t = np.arange(count) / count
    q = random.uniform(-3, 3, 6) + 0.02 * (1 - np.cos(2 * np.pi * t))[:, None] * random.uniform(-1, 1, 6)
    rows = Rows(float(random.choice([0.002, 0.004, 0.01])), q)
    settings = Settings(
        track_s=float(random.choice([0.02, 0.05, 0.25])),
        track_tolerance_rad=float(random.choice([1e-3, 0.01, 0.1])),
        start_tolerance_rad=float(random.choice([1e-4, 0.002])),
        late_s=float(random.choice([0.02, 0.1, 2.0])),
    )
    arm = Arm(random, rows, settings)
    report = None
    try:
        report = follow(arm, rows, settings, clock=lambda: arm.now, sleep=arm.wait)
    except StreamError as error:
        late = len(arm.told) < count and arm.behind_s() > settings.late_s
        assert str(error) and (arm.must_stop or late or arm.stops_badly), f"stopped without a reason: {error}"
        assert arm.stops_badly == ("could not be stopped" in str(error)), str(error)
    assert arm.stops == 1
    if report is None:
        return False
    assert not arm.must_stop, arm.must_stop
    assert arm.asked == dict.fromkeys(QUESTIONS, 1), f"in the end: asked {arm.asked}"
    np.testing.assert_array_equal(arm.told, np.vstack([q, np.broadcast_to(q[-1], (arm.window, 6))]))
    assert (report.rows, report.late_rows) == (count, arm.late)
    assert math.isclose(report.latest_s, arm.latest, abs_tol=1e-9)
    assert math.isclose(report.largest_error_rad, max(arm.largest, 0.0), abs_tol=1e-12)
    assert math.isclose(report.seconds, arm.now, abs_tol=1e-9)
    return True


def main(minutes: float, first: int) -> None:
    end, number, done = time.monotonic() + 60 * minutes, first, 0
    while time.monotonic() < end:
        try:
            done += trial(number)
        except BaseException:
            print(f"trial {number}", file=sys.stderr)
            raise
        number += 1
    print(f"{number - first} trials from {first}: {done} to the end, {number - first - done} stopped, all as they must")


if __name__ == "__main__":
    main(float(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0)
