"""The table of faults with the real client: ``python fault_table.py NAME=PLAN… --runs N --out DIR [--only FAULT]``.

Every fault starts at a random row of each plan, the same for the same seed. The table says the worst of its runs.
"""

from __future__ import annotations

import argparse
import csv
import json
import re
import sys
import tempfile
from collections import Counter
from dataclasses import asdict
from pathlib import Path

from fault_run import LOCAL, REFUSED, START, Outcome, Piece, Run, prefer
from ur_faults import FAULTS

ALL = [*FAULTS, *START, *LOCAL, *REFUSED]


def run_all(pieces: dict[str, Piece], faults: list[str], seeds: range, flags: list[str], out: Path) -> None:
    with (out / "runs.jsonl").open("a") as file:
        for fault in faults:
            for name, piece in pieces.items():
                for seed in seeds:
                    with tempfile.TemporaryDirectory() as work:
                        run = Run(piece, fault, seed, Path(work), flags)
                        try:
                            outcome = run.go()
                        except (EOFError, OSError) as error:
                            print(name, fault, seed, f"the double itself failed: {error}", flush=True)
                            continue
                        finally:
                            run.finish()
                    file.write(json.dumps({"plan": name, **asdict(outcome)}) + "\n")
                    file.flush()
                    print(name, fault, seed, f"row {outcome.row} along {outcome.along_mm:.3f} off {outcome.off_mm:.3f} mm", outcome.how, outcome.code, f"{outcome.exit_s:.2f} s", outcome.said[:160], outcome.resumed, outcome.notes, flush=True)


def worst(runs: list[Outcome], name: str) -> str:
    return f"{max((getattr(o, name) for o in runs), default=0.0):.3f}"


def table(found: list[tuple[str, Outcome]]) -> list[list[str]]:
    """A row a fault: the worst of all runs in which it began, by plan, and what the user read most often."""
    plans = list(dict.fromkeys(name for name, _ in found))
    lengths = [f"{what} {plan} [mm]" for what in ("along", "off") for plan in plans]
    rows = [["fault", "runs", *lengths, "within the bound", "ended", "exit code", "resumed", "to the end", "left out [mm]", "volume other [%]", "the user reads"]]
    for fault in dict.fromkeys(o.fault for _, o in found):
        # what the machine stopped before its fault began tells nothing of the fault; a wrong start is refused before any row
        runs = [(name, o) for name, o in found if o.fault == fault and (o.row >= 0 or fault in START)]
        if not runs:
            continue
        outcomes = [o for _, o in runs]
        of = {plan: [o for name, o in runs if name == plan] for plan in plans}
        within = sum(o.within for o in outcomes)
        tried = [o for o in outcomes if o.resumed]
        swept = [o.swept for o in tried if o.swept]
        resumed = sum(o.resumed.startswith(("went on", "to the end")) for o in tried)
        rows.append(
            [
                fault,
                str(len(runs)),
                *[worst(of[plan], name) for name in ("along_mm", "off_mm") for plan in plans],
                f"{within} of {len(runs)}",
                ", ".join(f"{how} {n}" for how, n in Counter(o.how for o in outcomes).most_common()),
                ", ".join(sorted({str(o.code) for o in outcomes})),
                f"{resumed} of {len(tried)}" if tried else "-",
                str(len(swept)) if tried else "-",
                f"{max(s['left_mm'] for s in swept):.3f}" if swept else "-",
                f"{max(100 * s['other'] for s in swept):.2f}" if swept else "-",
                "(goes on)" if all(o.how == "went on" for o in outcomes) else plain(Counter(plain(o.said) for o in outcomes if o.how != "went on").most_common(1)[0][0]),
            ]
        )
    return rows


def plain(said: str) -> str:
    """Without the row, and without numbers that differ from run to run."""
    said = re.sub(r"^error: (row [\d.]+ of \d+: )?", "", said)
    return re.sub(r"\b\d+(\.\d+)? ms old", "N ms old", said)[:150]


def recorded(out: Path) -> list[tuple[str, Outcome]]:
    runs = [json.loads(line) for line in (out / "runs.jsonl").read_text().splitlines()]
    return [(run.pop("plan"), Outcome(**run)) for run in runs]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("plans", nargs="*", metavar="NAME=PLAN")
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", action="append", choices=ALL)
    parser.add_argument("--flags", default="--yes --slow --payload-kg 1 --run-up-s 0.2 --log LOG", help="of the stream command; LOG stands for a file")
    parser.add_argument("--resume-s", type=float, default=4.0, help="how long a resumed run is looked at")
    asked = parser.parse_args()
    prefer()
    Run.resume_s = asked.resume_s
    asked.out.mkdir(parents=True, exist_ok=True)
    pieces = {name: Piece.load(Path(folder)) for name, folder in (p.split("=", 1) for p in asked.plans)}
    seeds = range(asked.first_seed, asked.first_seed + asked.runs)
    run_all(pieces, asked.only or ALL, seeds, asked.flags.split(), asked.out)
    # runs of earlier calls with the same folder count, too
    rows = table(recorded(asked.out))
    with (asked.out / "faults.csv").open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    markdown = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    markdown.insert(1, "|" + "---|" * len(rows[0]))
    (asked.out / "faults.md").write_text("\n".join(markdown) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
