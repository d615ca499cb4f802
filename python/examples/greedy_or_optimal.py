"""The paper's greedy angles against those chosen over the whole sequence, on one body.

    python greedy_or_optimal.py --out out/
"""

import argparse
from pathlib import Path

import numpy as np

import bonemill


def with_mode(case: bonemill.Case, mode: str) -> bonemill.Case:
    """A copy of the case file with another orientation mode, beside it."""
    text = "".join(
        f'mode = "{mode}"\n' if line.startswith('mode = "optimal"') else line + "\n"
        for line in case.to_toml().splitlines()
    )
    path = case.path.with_name(f"case_{mode}.toml")
    path.write_text(text, encoding="utf-8")
    return bonemill.Case.load(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()

    case = bonemill.phantom("block", asked.out / "block", seed=asked.seed)
    print(f"{'mode':10}{'mean F toward':>16}{'peak F toward':>16}{'mean |F|':>12}{'turning':>12}{'time':>10}")
    for mode in ("greedy", "optimal"):
        plan = bonemill.plan(with_mode(case, mode))
        plan.save(asked.out / mode)
        w = plan.waypoints
        span = np.diff(w["time_s"], prepend=0.0)
        cutting = w["mass_mg"] > 0
        toward = w["force_toward_n"]
        axis = np.stack([w["axis_x"], w["axis_y"], w["axis_z"]], axis=-1)
        turned = np.arccos(np.clip((axis[1:] * axis[:-1]).sum(axis=-1), -1, 1)).sum()
        mean = (toward * span)[cutting].sum() / span[cutting].sum()
        print(
            f"{mode:10}{mean:14.3f} N{toward.max():14.3f} N{plan.metrics['mean_force_n']:10.3f} N"
            f"{turned:8.1f} rad{plan.metrics['total_time_s']:8.0f} s"
        )


if __name__ == "__main__":
    main()
