"""The table of faults with the real client: ``python fault_table.py NAME=PLAN… --runs N --out DIR [--only FAULT]``.

Every fault starts at a random row of each plan, the same for the same seed. The table says the worst of its runs.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import tempfile
from collections import Counter
from dataclasses import asdict
from pathlib import Path

from fault_run import LOCAL, START, Outcome, Piece, Run
from ur_faults import FAULTS

ALL = [*FAULTS, *START, *LOCAL]


def run_all(pieces: dict[str, Piece], faults: list[str], seeds: range, flags: list[str], out: Path) -> list[tuple[str, Outcome]]:
    found = []
    with (out / "runs.jsonl").open("a") as file:
        for fault in faults:
            for name, piece in pieces.items():
                for seed in seeds:
                    with tempfile.TemporaryDirectory() as work:
                        run = Run(piece, fault, seed, Path(work), flags)
                        try:
                            outcome = run.go()
                        finally:
                            run.finish()
                    found.append((name, outcome))
                    file.write(json.dumps({"plan": name, **asdict(outcome)}) + "\n")
                    file.flush()
                    print(name, fault, seed, f"row {outcome.row} along {outcome.along_mm:.3f} off {outcome.off_mm:.3f} mm", outcome.how, outcome.code, f"{outcome.exit_s:.2f} s", outcome.said[:160], outcome.notes, flush=True)
    return found


def table(found: list[tuple[str, Outcome]]) -> list[list[str]]:
    rows = [["fault", "plan", "runs", "along mm", "off mm", "exit code", "ended", "hung", "the user reads (most often)"]]
    for fault in dict.fromkeys(o.fault for _, o in found):
        for plan in dict.fromkeys(name for name, _ in found):
            runs = [o for name, o in found if name == plan and o.fault == fault and o.row >= 0]
            if not runs:
                continue
            said = Counter(o.said for o in runs).most_common(1)[0][0]
            codes = ", ".join(str(c) for c in sorted({o.code for o in runs}, key=str))
            how = ", ".join(sorted({o.how for o in runs}))
            rows.append([fault, plan, str(len(runs)), f"{max(o.along_mm for o in runs):.3f}", f"{max(o.off_mm for o in runs):.3f}", codes, how, str(sum(o.how == "hung" for o in runs)), said])
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("plans", nargs="+", metavar="NAME=PLAN")
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", action="append", choices=ALL)
    parser.add_argument("--flags", default="--yes --log LOG", help="of the stream command; LOG stands for a file")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    pieces = {name: Piece.load(Path(folder)) for name, folder in (p.split("=", 1) for p in asked.plans)}
    seeds = range(asked.first_seed, asked.first_seed + asked.runs)
    found = run_all(pieces, asked.only or ALL, seeds, asked.flags.split(), asked.out)
    rows = table(found)
    with (asked.out / "faults.csv").open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    markdown = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    markdown.insert(1, "|" + "---|" * len(rows[0]))
    (asked.out / "faults.md").write_text("\n".join(markdown) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
