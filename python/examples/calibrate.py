"""Cutting coefficients from a log of measured forces.

The force is linear in K_t, K_r and K_a, so they follow by least squares from forces along known poses, with intervals.
Without a log of yours, one is made as a sensor would give it: the simulated forces of a plan with known coefficients, and
noise, to show that the coefficients come back.

    python calibrate.py --out out/ [--plan PLAN/ --log LOG.csv]
"""

import argparse
from pathlib import Path

import numpy as np

import bonemill

NOISE_N = 0.05
RATE_HZ = 20.0
LASTS_S = 120.0


def sensor_log(plan: bonemill.Plan) -> dict[str, np.ndarray]:
    """Poses and noisy forces of the first two minutes of a plan."""
    rows = bonemill.simulate(plan, rate_hz=RATE_HZ).rows
    rows, w = rows[rows["time_s"] < LASTS_S], plan.waypoints
    log = {name: np.array(rows[name]) for name in ("time_s", "x_mm", "y_mm", "z_mm")}
    log |= {name: np.interp(rows["time_s"], w["time_s"], w[name]) for name in ("axis_x", "axis_y", "axis_z")}
    rng = np.random.default_rng(7)
    return log | {name: rows[name] + rng.normal(0, NOISE_N, len(rows)) for name in ("fx_n", "fy_n", "fz_n")}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--plan", type=Path, help="folder of a plan: its bone and burr; default: the block phantom")
    parser.add_argument("--log", type=Path, help=f"CSV with the columns {', '.join(bonemill.LOG_COLUMNS)}")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)

    if asked.plan:
        plan = bonemill.Plan.load(asked.plan)
    else:
        plan = bonemill.plan(bonemill.phantom("block", asked.out / "block"))
    fit = bonemill.calibrate(plan, asked.log or sensor_log(plan))
    lines = ["coefficient,value,half_width_95,unit"]
    for key, (value, half_width, unit) in fit.coefficients.items():
        print(f"{key}: {value:7.1f} ± {half_width:5.1f} {unit} (95 %)")
        lines.append(f"{key},{value},{half_width},{unit}")
    print(f"the model leaves {fit.residual_n:.3f} N of a force component, over {fit.rows} rows")
    (asked.out / "calibration.csv").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
