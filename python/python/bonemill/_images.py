"""Images in memory to files that the planner reads: it plans on files, so that a plan can be bound to its inputs."""

from __future__ import annotations

import os
import struct
import sys
from pathlib import Path
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays
from ._errors import ArrayError

_CODES = {"u1": 2, "i2": 4, "i4": 8, "f4": 16, "f8": 64, "i1": 256, "u2": 512, "u4": 768, "i8": 1024, "u8": 1280}
"""NIfTI-1 ``datatype`` by numpy's kind and size."""
_SCANNER = 1
"""NIFTI_XFORM_SCANNER_ANAT."""
_MM = 2


@runtime_checkable
class SpatialImage(Protocol):
    """What nibabel gives: voxels and where they are."""

    @property
    def dataobj(self) -> Any: ...

    @property
    def affine(self) -> Any: ...


@runtime_checkable
class ItkImage(Protocol):
    """What SimpleITK gives: where the voxels are, in LPS; the voxels themselves come from its module."""

    def GetOrigin(self) -> Any: ...

    def GetSpacing(self) -> Any: ...

    def GetDirection(self) -> Any: ...


Image: TypeAlias = "str | os.PathLike[str] | SpatialImage | ItkImage | tuple[ArrayLike, ArrayLike]"
"""A file, an image of nibabel or SimpleITK, or an array [i, j, k] with its affine (4, 4), voxel index to RAS+ mm."""


def is_path(image: Any) -> bool:
    """Whether an image is a file's name."""
    return isinstance(image, (str, os.PathLike))


def write(path: Path, name: str, image: Image) -> None:
    """Writes an image in memory as NIfTI-1, values and type as they are; the planner's reader judges the affine."""
    array, affine = _parts(name, image)
    kind = f"{array.dtype.kind}{array.dtype.itemsize}"
    little = array.astype(array.dtype.newbyteorder("<"), copy=False)
    with open(path, "wb") as file:
        file.write(_header(name, array.shape, kind, affine))
        # x-fastest: a transposed array in C order; no copy where the array is in Fortran order already
        file.write(np.ascontiguousarray(little.T).data)


def _parts(name: str, image: Any) -> tuple[NDArray[Any], NDArray[np.float64]]:
    if isinstance(image, SpatialImage):
        values, place = np.asanyarray(image.dataobj), image.affine
    elif isinstance(image, ItkImage):
        values, place = _itk_parts(name, image)
    elif isinstance(image, tuple) and len(image) == 2:
        values, place = np.asarray(image[0]), image[1]
    else:
        raise ArrayError(
            f"{name} is {type(image).__name__}: expected a file's name, an image of nibabel or SimpleITK, or (array, affine)"
        )
    if values.dtype == np.bool_:
        values = values.astype(np.uint8)
    if values.dtype == np.float16:
        values = values.astype(np.float32)
    if f"{values.dtype.kind}{values.dtype.itemsize}" not in _CODES:
        raise ArrayError(f"{name} has dtype {values.dtype}: expected integers or floats of up to 64 bits")
    if values.ndim != 3 or values.size == 0:
        raise ArrayError(f"{name} has shape {values.shape}: expected a volume (ni, nj, nk)")
    affine = _arrays.real(f"{name}'s affine", place)
    if affine.shape != (4, 4) or not np.array_equal(affine[3], [0, 0, 0, 1]):
        raise ArrayError(f"{name}'s affine is {affine.tolist()}: expected (4, 4) with the last row 0, 0, 0, 1")
    return values, affine


def _itk_parts(name: str, image: ItkImage) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Voxels [i, j, k] and affine to RAS+; SimpleITK's arrays are [k, j, i], its places in LPS."""
    module = sys.modules.get(type(image).__module__.partition(".")[0])
    view = getattr(module, "GetArrayViewFromImage", None)
    if view is None:
        raise ArrayError(f"{name} is {type(image).__name__} without GetArrayViewFromImage: expected SimpleITK's Image")
    origin, spacing, direction = (np.array(of(), dtype=np.float64) for of in (image.GetOrigin, image.GetSpacing, image.GetDirection))
    if origin.shape != (3,) or spacing.shape != (3,) or direction.size != 9:
        raise ArrayError(f"{name} has {origin.size} dimensions: expected 3")
    affine = np.eye(4)
    affine[:3, :3] = direction.reshape(3, 3) * spacing
    affine[:3, 3] = origin
    affine[:2] *= -1
    return np.asarray(view(image)).T, affine


def _header(name: str, shape: tuple[int, ...], kind: str, affine: NDArray[np.float64]) -> bytes:
    if max(shape) > 32767:
        raise ArrayError(f"{name} has shape {shape}: NIfTI-1 holds at most 32767 voxels along an axis")
    pixdim = np.linalg.norm(affine[:3, :3], axis=0)
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 3, *shape, 1, 1, 1, 1)
    struct.pack_into("<hh", header, 70, _CODES[kind], 8 * int(kind[1:]))
    struct.pack_into("<8f", header, 76, 1, *pixdim, 1, 1, 1, 1)
    struct.pack_into("<ff", header, 108, 352, 1)  # vox_offset, scl_slope
    header[123] = _MM
    struct.pack_into("<hh", header, 252, 0, _SCANNER)  # qform_code, sform_code
    struct.pack_into("<12f", header, 280, *affine[:3].ravel())
    header[344:348] = b"n+1\0"
    return bytes(header)
