# toppra on the joint path of a folder: seconds, duration, worst ratio to velocity and acceleration limits at 10 kHz
import sys
import time
from pathlib import Path

import numpy as np
import toppra
import toppra.algorithm
import toppra.constraint

toppra.setup_logging("ERROR")
folder, runs = Path(sys.argv[1]), 3
velocity, acceleration = np.fromfile(folder / "limits").reshape(2, 4)
q = np.fromfile(folder / "q").reshape(-1, 4)
s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q[:, :3], axis=0), axis=1))])
limits = [
    toppra.constraint.JointVelocityConstraint(np.stack([-velocity, velocity], 1)),
    toppra.constraint.JointAccelerationConstraint(np.stack([-acceleration, acceleration], 1)),
]
least = float("inf")
for _ in range(runs):
    path = toppra.SplineInterpolator(s, q)
    since = time.perf_counter()
    solver = toppra.algorithm.TOPPRA(limits, path, gridpoints=s, solver_wrapper="seidel")
    law = solver.compute_trajectory()
    least = min(least, time.perf_counter() - since)
times = np.arange(0.0, law.duration, 1e-4)
worst = [(np.abs(law(times, order)) / limit).max() for order, limit in ((1, velocity), (2, acceleration))]
print(least, law.duration, *worst)
