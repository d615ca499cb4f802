"""A whole plan by the real client at its full length: ``python whole_plan.py PLAN --out DIR``.

Streams PLAN to the double, goes on from the log where the machine stalls, and prints whether every row came, in which order, and
at which periods.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from fault_run import HERE, Floats, addresses, prefer
from ur_double import Double

from bonemill import Plan

MOST_RUNS = 20


def passed(q: Floats, sent: Floats) -> tuple[int, int]:
    """The farthest row of the plan that the targets come to in its order, in steps of a few rows, and how many of them are no rows: those of
    an approach."""
    step = np.abs(np.diff(q, axis=0)).max()
    place, reached, others = 0, 0, 0
    for target in sent:
        away = np.abs(q[place : place + 4] - target).max(axis=1)
        if away.min() <= step:
            place += int(away.argmin())
        else:
            # a resumed run begins a little before the place that was reached
            first = max(0, reached - 600)
            away = np.abs(q[first : reached + 1] - target).max(axis=1)
            others += int(away.min() > step)
            place = first + int(away.argmin()) if away.min() <= step else place
        reached = max(reached, place)
    return reached, others


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("plan", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    prefer()
    asked.out.mkdir(parents=True, exist_ok=True)
    q = Plan.load(asked.plan).q
    began, ends = time.monotonic(), []
    with Double(next(addresses), q[0]) as double:
        for run in range(MOST_RUNS):
            call = [sys.executable, str(HERE / "fault_client.py"), "0", "stream", str(asked.plan), "--host", double.host, "--yes", "--slow"]
            call += ["--payload-kg", "1", "--run-up-s", "0.2", "--log", str(asked.out / f"{run}.run")]
            done = subprocess.run(call + (["--resume", str(asked.out / f"{run - 1}.run")] if run else []), capture_output=True, text=True, check=False)
            ends.append((double.call("rows"), done.returncode, (done.stdout + done.stderr).strip().splitlines()[-1]))
            print(*ends[-1], flush=True)
            if done.returncode == 0:
                break
            double.call("cured")
        sent, came_s = np.array(double.get("sent")), np.array(double.call("times"))
    # the first target of a run comes after its approach, whose targets are no rows
    periods_ms = 1e3 * np.diff(came_s)
    periods_ms = periods_ms[periods_ms < 1e3]
    reached, others = passed(q, sent)
    quantiles = ", ".join(f"p{p:g} {np.percentile(periods_ms, p):.2f}" for p in (50, 99, 99.9))
    steps = np.abs(np.diff(sent, axis=0)).max() / np.abs(np.diff(q, axis=0)).max()
    print(f"row {reached} of {len(q) - 1} reached in order by {len(sent)} targets in {time.monotonic() - began:.0f} s, {len(ends)} runs")
    print(f"{others} targets of approaches; a step is at most {steps:.2f} of the plan's largest")
    print(f"period of the targets as they came: {quantiles}, max {periods_ms.max():.2f} ms")
    return ends[-1][1]


if __name__ == "__main__":
    sys.exit(main())
