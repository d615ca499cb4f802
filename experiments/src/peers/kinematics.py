# pin on the URDF of a folder: worst differences of position (m), rotation, Jacobian (linear, angular), and seconds
import sys
import time
from pathlib import Path

import numpy as np
import pinocchio

folder = Path(sys.argv[1])
model = pinocchio.buildModelFromXML((folder / "arm.urdf").read_text())
data, n = model.createData(), model.nq
base, tip = model.getFrameId("base_link"), model.getFrameId((folder / "tip").read_text())
rows = np.fromfile(folder / "answers").reshape(-1, n + 12 + 6 * n)
worst = np.zeros(4)
for row in rows:
    q, at, turn, jacobian = row[:n], row[n : n + 3], row[n + 3 : n + 12].reshape(3, 3), row[n + 12 :].reshape(6, n)
    pinocchio.framesForwardKinematics(model, data, q)
    pose = data.oMf[base].inverse() * data.oMf[tip]
    theirs = pinocchio.computeFrameJacobian(model, data, q, tip, pinocchio.LOCAL_WORLD_ALIGNED)
    differences = pose.translation - at, pose.rotation - turn, theirs[:3] - jacobian[:3], theirs[3:] - jacobian[3:]
    worst = np.maximum(worst, [np.abs(d).max() for d in differences])
since = time.perf_counter()
for row in rows:
    pinocchio.computeFrameJacobian(model, data, row[:n], tip, pinocchio.LOCAL_WORLD_ALIGNED)
print(*worst, time.perf_counter() - since)
