"""Plan one CT and plot forces, speed and distances along the path.

    python plan_and_plot.py --out out/ [CASE.toml]

Without a case, the foam block of Dillon et al. 2016 is planned.
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import bonemill


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", nargs="?", help="case file; default: the block phantom")
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)

    case = bonemill.Case.load(asked.case) if asked.case else bonemill.phantom("block", asked.out / "block")
    plan = bonemill.plan(case, progress=lambda stage, done, of: print(stage) if done == 0 else None)
    plan.save(asked.out / "plan")

    w = plan.waypoints
    force = np.sqrt(w["fx_n"] ** 2 + w["fy_n"] ** 2 + w["fz_n"] ** 2)
    figure, (forces, speeds, distances) = plt.subplots(3, sharex=True, figsize=(10, 7), layout="constrained")
    forces.plot(w["time_s"], np.nan_to_num(force), lw=0.6, label="magnitude")
    forces.plot(w["time_s"], w["force_toward_n"], lw=0.6, label="toward the nearest structure")
    forces.set(ylabel="force [N]")
    forces.legend(loc="upper right")
    speeds.plot(w["time_s"], w["speed_mm_s"], lw=0.6)
    speeds.set(ylabel="speed [mm/s]", ylim=(0, 5))
    for structure in plan.structures:
        near = w["structure"] == structure.name
        distances.plot(w["time_s"][near], w["distance_mm"][near], ".", ms=1, label=structure.name)
    distances.set(ylabel="burr centre to structure [mm]", xlabel="time [s]")
    distances.legend(loc="upper right", markerscale=8)
    figure.savefig(asked.out / "forces.png", dpi=120)

    m = plan.metrics
    print(f"removed {m['removed_mm3']:.1f} of {m['reachable_mm3']:.1f} mm³ in {m['total_time_s']:.0f} s")
    print(f"peak force {m['peak_force_n']:.2f} N, mean while cutting {m['mean_force_n']:.2f} N")
    for name, found in m["structures"].items():
        print(f"{name}: at least {found.get('least_surface_distance_mm', np.nan):.2f} mm from the burr's surface")


if __name__ == "__main__":
    main()
