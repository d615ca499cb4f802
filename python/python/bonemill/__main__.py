"""``python -m bonemill stream PLAN/ --host H``: what only Python can do; everything else is the command ``bonemill``.

Exit code 0: done; 1: stopped, with the reason; 2: bad input; 130: stopped by the user.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

from . import BonemillError, StreamError, __version__
from ._verdict import require_verified
from .stream import Console, Report, Settings, Streaming, UrLink

_BY_USER = "stopped by the user"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m bonemill", description="Streams plans to Universal Robots arms.")
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(dest="command", required=True)
    streaming = commands.add_parser("stream", help="move a UR arm along a plan's trajectory")
    streaming.add_argument("plan", metavar="PLAN", help="folder of a plan for a UR arm, with a registration")
    streaming.add_argument("--host", metavar="H", help="the controller's address")
    streaming.add_argument("--dry-run", action="store_true", help="check the plan, and say what a run would refuse; connect to nothing, move nothing")
    streaming.add_argument("--rehearse", action="store_true", help="run on a simulated arm, faster than real time")
    streaming.add_argument("--payload-kg", type=float, metavar="KG", help="mass on the flange that the controller must know")
    streaming.add_argument("--serial", metavar="N", help="serial number that the arm must have")
    streaming.add_argument("--slow", action="store_true", help="slow down where the bound is larger than the room, instead of refusing")
    streaming.add_argument("--yes", action="store_true", help="answer every question with yes, for automated runs")
    streaming.add_argument("--unverified", action="store_true", help="stream a plan without a passed verification: says what is risked, and asks")
    streaming.add_argument("--resume", metavar="LOG", help="go on where the run with this log was stopped")
    streaming.add_argument("--log", metavar="FILE", help="the run's log, a new file (default: PLAN's name and the time, here)")
    streaming.add_argument("--lookahead-s", type=float, default=Settings.lookahead_s, metavar="S")
    streaming.add_argument("--gain", type=float, default=Settings.gain, metavar="G")
    streaming.add_argument("--run-up-s", type=float, default=3.0, metavar="S", help="time that the spindle needs to run up")
    streaming.add_argument("--spindle-output", type=int, default=Settings.spindle_output, metavar="N")
    return parser


def _prepare() -> None:
    """Ctrl-C is heard although the command was started in the background, and what is opened later is none of the three streams."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)


def main(arguments: list[str] | None = None) -> int:
    _prepare()
    parser = _parser()
    asked = parser.parse_args(arguments)
    if asked.host is None and not asked.rehearse and not asked.dry_run:
        parser.error("--host is needed")
    if asked.payload_kg is None and asked.rehearse:
        parser.error("--rehearse needs --payload-kg, as the run will: no controller is there that says it")
    if asked.rehearse and asked.resume is not None:
        parser.error("--rehearse begins at the plan's start: it does not go with --resume")
    try:
        settings = Settings(asked.lookahead_s, asked.gain, spindle_output=asked.spindle_output)
        streaming = Streaming(
            asked.plan,
            slow=asked.slow,
            unverified=asked.unverified,
            payload_kg=asked.payload_kg,
            serial=asked.serial,
            run_up_s=asked.run_up_s,
            settings=settings,
        )
        if not asked.rehearse:
            streaming.for_a_ur()
        require_verified(asked.plan, unverified=asked.unverified)
        start_row = 0.0 if asked.resume is None else streaming.resume_row(asked.resume)
    except BonemillError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return _nothing_moved()
    print(f"{streaming.rows} rows, {streaming.duration_s:.1f} s; begins at row {start_row:.0f}")
    try:
        print("\n".join(streaming.bound_lines()), flush=True)
    except KeyboardInterrupt:
        return _nothing_moved()
    refused = streaming.refusal()
    if asked.dry_run and asked.payload_kg is None:
        refused = refused or "the mass on the flange is not stated: a run needs --payload-kg"
    if refused is not None:
        print(f"error: no run is begun: {refused}", file=sys.stderr)
        return 2
    if asked.dry_run:
        return 0
    log = asked.log or f"{Path(asked.plan).resolve().name}-{time.strftime('%Y%m%d-%H%M%S')}.run"
    try:
        if asked.rehearse:
            report = streaming.rehearse(log=log)
        else:
            console = Console(yes=asked.yes)
            tell_lateness(console.tell, streaming.period_s)
            report = streaming.run(UrLink(asked.host, streaming.period_s, settings), console, start_row=start_row, log=log)
    except StreamError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        # a run notes it and stops the arm in order: what is left is a rehearsal, and the time before the first order
        return _nothing_moved()
    return _tell(report, log)


def _nothing_moved() -> int:
    print(f"error: {_BY_USER}; nothing was moved", file=sys.stderr)
    return 130


def tell_lateness(tell: Callable[[str], None], period_s: float) -> None:
    """Measures how late this PC wakes up, and tells it where a run would suffer."""
    late_s = []
    due_s = time.monotonic()
    for _ in range(int(_MEASURED_S / period_s)):
        due_s += period_s
        time.sleep(max(0.0, due_s - time.monotonic()))
        late_s.append(time.monotonic() - due_s)
        due_s = max(due_s, time.monotonic() - period_s)
    if max(late_s) > _LATE_S:
        tell(
            f"warning: this PC woke up to {1e3 * max(late_s):.0f} ms late in {_MEASURED_S:g} s; a run waits while the arm's state is 20 ms old, and stops after 50 ms of it: "
            "see docs/realtime.md"
        )


_MEASURED_S = 0.5
_LATE_S = 0.01
"""Half of the age at which a run waits for a newer state."""


def _tell(report: Report, log: str) -> int:
    if not Path(log).exists():
        log += " (gone: renamed or deleted under way)"
    print(
        f"reached row {report.reached_row:.0f} of {report.rows - 1} in {report.seconds:.1f} s; late: {report.late_targets} of {report.targets} "
        f"targets, at most {1e3 * report.latest_s:.1f} ms; burr at most {report.farthest_off_mm:.3f} mm off its path; log: {log}"
    )
    if report.reason is None:
        return 0
    print(f"error: {report.reason}", file=sys.stderr)
    return 130 if _BY_USER in report.reason else 1


if __name__ == "__main__":
    sys.exit(main())
