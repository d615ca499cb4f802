# seconds of edt on the mask of a folder, and its largest difference from the folder's distances
import sys
import time
from pathlib import Path

import edt
import numpy as np

folder = Path(sys.argv[1])
n, voxel_mm, runs = 256, 0.25, 5
mask = np.fromfile(folder / "mask", np.uint8).reshape((n, n, n), order="F") != 0
outside = np.asfortranarray(~mask)
least = float("inf")
for _ in range(runs):
    since = time.perf_counter()
    distance = edt.edt(outside, anisotropy=(voxel_mm,) * 3, parallel=1)
    least = min(least, time.perf_counter() - since)
ours = np.fromfile(folder / "distance_mm", np.float32).reshape((n, n, n), order="F")
print(least, np.abs(distance - ours).max())
