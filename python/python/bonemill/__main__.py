"""``python -m bonemill stream PLAN/ --host H``: what only Python can do; everything else is the command ``bonemill``.

Exit code 0: done; 1: stopped, with the reason; 2: bad input.
"""

from __future__ import annotations

import argparse
import sys

from . import BonemillError, Plan, StreamError, __version__
from ._verdict import require_verified
from .stream import Settings, rows_of, stream


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m bonemill", description="Streams plans to Universal Robots arms.")
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(dest="command", required=True)
    streaming = commands.add_parser("stream", help="move a UR arm along a plan's trajectory")
    streaming.add_argument("plan", metavar="PLAN", help="folder of a plan for a UR arm, with a registration")
    streaming.add_argument("--host", required=True, metavar="H", help="the controller's address")
    streaming.add_argument("--dry-run", action="store_true", help="check the plan; connect to nothing, move nothing")
    streaming.add_argument("--unverified", action="store_true", help="stream a plan without a passed verification: says what is risked, and asks")
    streaming.add_argument("--lookahead-s", type=float, default=Settings.lookahead_s, metavar="S")
    streaming.add_argument("--gain", type=float, default=Settings.gain, metavar="G")
    asked = parser.parse_args(arguments)

    try:
        settings = Settings(lookahead_s=asked.lookahead_s, gain=asked.gain)
        plan = Plan.load(asked.plan)
        rows_of(plan)
        require_verified(asked.plan, unverified=asked.unverified)
    except BonemillError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    for problem in (*plan.shortfalls, *plan.warnings):
        print(f"note: {problem}", file=sys.stderr)
    try:
        report = stream(plan, asked.host, settings=settings, dry_run=asked.dry_run, progress=_tell)
    except StreamError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("error: stopped by Ctrl-C", file=sys.stderr)
        return 1
    did = "would send" if asked.dry_run else "sent"
    print(f"{did} {report.rows} rows in {report.seconds:.1f} s")
    if not asked.dry_run:
        print(
            f"late: {report.late_rows} rows, at most {1e3 * report.latest_s:.1f} ms; "
            f"largest distance from the track {1e3 * report.largest_error_rad:.2f} mrad"
        )
    return 0


def _tell(done: int, of: int) -> None:
    print(f"\r{100 * done // of:3d} %", end="" if sys.stderr.isatty() else "\n", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
