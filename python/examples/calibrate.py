"""Cutting coefficients from a log of measured forces.

The force is linear in K = (K_t, K_r, K_a): F_tool = K @ basis_cut. So one pass of `burr_force` per logged pose with any
K gives the basis, and K follows by least squares, with its standard error. The log here is made with known coefficients
and noise, to show that they come back.

    python calibrate.py --out out/
"""

import argparse
from pathlib import Path

import numpy as np

import bonemill

TOOL: bonemill.Tool = {"radius": 2.5, "blades": 8}
RPM = 60_000.0
SPACING = 0.25


def foam(rng: np.random.Generator) -> np.ndarray:
    """A block with round cells, its upper half milled away, g/cm³."""
    place = np.stack(np.indices((48, 48, 48)), axis=-1) * SPACING
    density = np.full(place.shape[:3], 0.8)
    for cell in rng.uniform(0, 12, (40, 3)):
        density[np.linalg.norm(place - cell, axis=-1) < 0.9] = 0.0
    density[..., 26:] = 0.0
    return density


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(7)
    density = foam(rng)
    true, noise_n = np.array([1400.0, 840.0, 140.0]), 0.05

    rows = []
    for _ in range(200):
        tilt = rng.uniform(-0.6, 0.6)
        motion = dict(
            center=(*rng.uniform(4, 8, 2), rng.uniform(6.0, 8.0)),
            axis=(np.sin(tilt), 0.0, np.cos(tilt)),
            velocity=rng.uniform(0.5, 3.0) * np.append(rng.choice([-1, 1]) * np.array([1.0, 0.3]), 0.0),
        )
        basis = bonemill.burr_force(
            density, spacing=SPACING, **motion, rpm=RPM, tool=TOOL, material={"K": (1, 1, 1), "rho_ref": 0.8}
        )["basis_cut"]
        rows.append((basis, true @ basis + rng.normal(0, noise_n, 3)))

    design = np.concatenate([basis.T for basis, _ in rows])
    measured = np.concatenate([force for _, force in rows])
    found, residual, rank, _ = np.linalg.lstsq(design, measured, rcond=None)
    variance = residual[0] / (len(measured) - 3)
    error = np.sqrt(np.diag(variance * np.linalg.inv(design.T @ design)))
    lines = ["coefficient,true_n_mm2,found_n_mm2,standard_error_n_mm2"]
    for name, k, f, e in zip(("K_t", "K_r", "K_a"), true, found, error):
        print(f"{name}: {f:7.1f} ± {e:5.1f} N/mm² (made with {k:.0f})")
        lines.append(f"{name},{k},{f},{e}")
    (asked.out / "calibration.csv").write_text("\n".join(lines) + "\n")
    assert rank == 3 and (abs(found - true) < 5 * error).all(), "the coefficients did not come back"


if __name__ == "__main__":
    main()
