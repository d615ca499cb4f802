"""What a larger clearance costs, over a cohort: the removed share, the time and the force toward the nerve.

    python clearance_sweep.py --out out/ [--seeds 2] [--clearances 1.0 1.3]
"""

import argparse
from pathlib import Path

import bonemill
from bonemill.cohort import plan_cohort


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--clearances", type=float, nargs="+", default=[1.0, 1.3], metavar="MM")
    asked = parser.parse_args()

    cases = {}
    for seed in range(1, asked.seeds + 1):
        case = bonemill.phantom("block", asked.out / f"block{seed}", seed=seed)
        for clearance in asked.clearances:
            path = case.path.with_name(f"case_{clearance}.toml")
            path.write_text(case.text.replace("clearance_mm = 1.0", f"clearance_mm = {clearance}"))
            cases[f"block{seed}_{clearance}mm"] = path

    rows = plan_cohort(cases, asked.out / "plans", progress=lambda name, done, of: print(f"{done}/{of} {name}"))
    print(f"{'case':20}{'outcome':>12}{'removed':>10}{'time':>9}{'peak F toward the nerve':>26}")
    for row in rows:
        if row["outcome"] == "error":
            print(f"{row['name']:20}{row['outcome']:>12} {row['why']}")
            continue
        share = row["removed_mm3"] / row["target_mm3"]
        toward = row["structures.facial_nerve.peak_force_toward_n"]
        print(f"{row['name']:20}{row['outcome']:>12}{share:10.1%}{row['total_time_s']:7.0f} s{toward:24.3f} N")


if __name__ == "__main__":
    main()
