# writes a DICOM series into a folder if it holds none, and reads it with SimpleITK: seconds, resident MB gained at most, sum of all voxels
import resource
import sys
import time
from pathlib import Path

import numpy as np
import SimpleITK as sitk

series, runs, (nx, ny, nz) = Path(sys.argv[1]) / "series", 3, (512, 512, 600)
sitk.ProcessObject.SetGlobalDefaultNumberOfThreads(2)
if not series.exists():
    series.mkdir()
    writer = sitk.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    row, column = np.arange(nx), np.arange(ny)[:, None]
    for k in range(nz):
        values = ((row * 7 + column * 13 + k * 29) % 4096 - 1024).astype(np.int16)
        slice_ = sitk.GetImageFromArray(values[None])
        slice_.SetSpacing((0.4, 0.4, 0.3))
        slice_.SetOrigin((0.0, 0.0, 0.3 * k))
        for tag, value in {
            "0008|0060": "CT",
            "0008|0016": "1.2.840.10008.5.1.4.1.1.2",
            "0008|0018": f"1.2.826.0.1.3680043.2.1125.1.{k + 1}",
            "0020|000d": "1.2.826.0.1.3680043.2.1125.2",
            "0020|000e": "1.2.826.0.1.3680043.2.1125.3",
            "0020|0013": str(k + 1),
            "0020|0032": f"0\\0\\{0.3 * k:.4f}",
            "0020|0037": "1\\0\\0\\0\\1\\0",
            "0028|1052": "0",
            "0028|1053": "1",
        }.items():
            slice_.SetMetaData(tag, value)
        writer.SetFileName(str(series / f"{k:04d}.dcm"))
        writer.Execute(slice_)
before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
least, image = float("inf"), None
for _ in range(runs):
    image = None
    since = time.perf_counter()
    reader = sitk.ImageSeriesReader()
    reader.SetFileNames(reader.GetGDCMSeriesFileNames(str(series)))
    image = reader.Execute()
    least = min(least, time.perf_counter() - since)
gained_mb = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb) / 1024
print(least, gained_mb, np.sum(sitk.GetArrayViewFromImage(image), dtype=np.int64))
