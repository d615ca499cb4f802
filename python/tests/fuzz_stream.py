"""Streaming against random answers: ``python fuzz_stream.py MINUTES [FIRST]`` from this folder, or some trials in the tests.

A trial is its number's. Rows, tolerances, the arm's lag, its clock and what is damaged are drawn; whether an answer may pass
is judged here by rules of their own. Whatever the arm says: no row is sent after an answer that may not pass, the arm is
stopped once, and nothing but a `StreamError` comes out; where all answers may pass, every row is sent.
"""

from __future__ import annotations

import math
import struct
import sys
import time
from typing import Any

import numpy as np

from bonemill import StreamError
from bonemill.stream import Report, Rows, Settings, follow


class Arm:
    """Follows with a lag, and answers something else now and then."""

    def __init__(self, random: np.random.Generator, rows: Rows, settings: Settings) -> None:
        self.random, self.rows, self.settings = random, rows, settings
        self.lag = int(random.integers(0, 4))
        # never, seldom, or from some answer on
        self.rate = float(random.choice([0.0, 0.0, 1e-3, 0.05]))
        self.broken_from = int(random.integers(0, 3 * len(rows.q))) if random.random() < 0.4 else 10**9
        self.answers, self.now, self.stops = 0, 0.0, 0
        self.told: list[np.ndarray] = []
        self.must_stop = ""

    def damaged(self) -> bool:
        self.answers += 1
        return self.answers > self.broken_from or self.random.random() < self.rate

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

    def lost(self) -> None:
        if self.random.random() < 0.1:
            self.must_stop = self.must_stop or "no answer"
            raise [RuntimeError, OSError, ValueError][int(self.random.integers(0, 3))]("gone")

    def safety_mode(self) -> Any:
        mode: Any = 1
        if self.damaged():
            self.lost()
            mode = self.number()
        if not (isinstance(mode, int) and mode == 1):
            self.must_stop = self.must_stop or f"mode {mode!r}"
        return mode

    def speed_fraction(self) -> Any:
        fraction: Any = 1.0
        if self.damaged():
            self.lost()
            fraction = self.number()
        try:
            is_full = 0.999 <= float(fraction) <= 1.001
        except (TypeError, ValueError, OverflowError):
            is_full = False
        if not is_full:
            self.must_stop = self.must_stop or f"fraction {fraction!r}"
        return fraction

    def actual_q(self) -> Any:
        at = len(self.told) - 1 - self.lag
        q: Any = self.told[max(at, 0)].copy() if self.told else self.rows.q[0].copy()
        if self.damaged():
            self.lost()
            kind = self.random.integers(0, 4)
            if kind == 0:
                q = [self.number() for _ in range(int(self.random.integers(0, 9)))]
            elif kind == 1:
                q = list(q)
                q[int(self.random.integers(0, 6))] = self.number()
            elif kind == 2:
                q = q + self.random.normal(scale=10.0 ** self.random.integers(-6, 1), size=6)
            else:
                q = self.number()
        self.must_stop = self.must_stop or self.strayed(q)
        return q

    def strayed(self, q: Any) -> str:
        """Why the arm may not be at `q`; empty where it may."""
        try:
            values = [float(v) for v in q] if not isinstance(q, (str, bytes, dict)) else []
        except (TypeError, ValueError, OverflowError):
            values = []
        if len(values) != 6 or not all(map(math.isfinite, values)):
            return f"joints {q!r}"
        if not self.told:
            told, most = self.rows.q[:1], self.settings.start_tolerance_rad
        elif len(self.told) > len(self.rows.q):
            told, most = self.rows.q[-1:], self.settings.track_tolerance_rad
        else:
            window = max(1, round(self.settings.track_s / self.rows.period_s))
            told, most = np.array(self.told[-window - 1 :]), self.settings.track_tolerance_rad
        far = max(max(lo - v, v - hi) for v, lo, hi in zip(values, told.min(axis=0), told.max(axis=0)))
        return f"{far} rad off" if far > most else ""

    def servo(self, q: np.ndarray, period_s: float, settings: Settings) -> bool:
        assert not self.must_stop, f"a row was sent after {self.must_stop}"
        assert not self.stops
        self.told.append(q)
        self.now += float(self.random.exponential(1e-4))
        if self.broken_from < 10**9 and self.random.random() < 1e-3:
            self.must_stop = "a row that was not taken"
            return False
        return True

    def stop(self) -> None:
        self.stops += 1

    def wait(self, seconds: float) -> None:
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
        late_s=2.0,
    )
    arm = Arm(random, rows, settings)
    try:
        report = follow(arm, rows, settings, clock=lambda: arm.now, sleep=arm.wait)
    except StreamError as error:
        assert str(error) and arm.must_stop, f"stopped without a reason: {error}"
        done = False
    else:
        assert isinstance(report, Report) and report.rows == count and not arm.must_stop, arm.must_stop
        done = True
    assert arm.stops == 1
    return done


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
