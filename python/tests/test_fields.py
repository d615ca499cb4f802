"""Distances and volumes on arrays, against brute force, in every memory layout; and what is refused."""

import threading
import time
from typing import Any

import numpy as np
import pytest

import bonemill


def brute(mask: np.ndarray, spacing: Any) -> np.ndarray:
    places = np.argwhere(np.ones_like(mask)) * np.broadcast_to(spacing, 3)
    sites = np.argwhere(mask) * np.broadcast_to(spacing, 3)
    return np.linalg.norm(places[:, None] - sites, axis=-1).min(axis=1).reshape(mask.shape)


@pytest.mark.parametrize("spacing", [0.3, (0.3, 0.7, 1.1)])
def test_distances_are_exact_and_the_nearest_is_as_far(spacing: Any) -> None:
    mask = np.random.default_rng(1).random((9, 11, 7)) < 0.03
    distance, nearest = bonemill.distance_transform(mask, spacing)
    np.testing.assert_allclose(distance, brute(mask, spacing), atol=1e-6)
    assert mask.ravel()[nearest].all()
    to = np.stack(np.unravel_index(nearest, mask.shape), axis=-1)
    away = (to - np.stack(np.indices(mask.shape), axis=-1)) * np.broadcast_to(spacing, 3)
    np.testing.assert_allclose(np.linalg.norm(away, axis=-1), distance, atol=1e-6)


def layouts(array: np.ndarray) -> dict[str, np.ndarray]:
    """The same values in memory in other ways."""
    padded = np.zeros(tuple(2 * n for n in array.shape), array.dtype)
    padded[::2, ::2, ::2] = array
    found = {
        "C": np.ascontiguousarray(array),
        "Fortran": np.asfortranarray(array),
        "strided": padded[::2, ::2, ::2],
        "negative": np.ascontiguousarray(array[::-1, :, ::-1])[::-1, :, ::-1],
        "transposed": np.ascontiguousarray(array.transpose(1, 2, 0)).transpose(2, 0, 1),
        "read-only": array.copy(),
    }
    found["read-only"].flags.writeable = False
    return found


def test_strides_do_not_matter() -> None:
    rng = np.random.default_rng(2)
    mask, density = rng.random((8, 9, 10)) < 0.1, rng.random((8, 9, 10))
    ball = dict(spacing=0.5, center=(2.0, 2.1, 2.2), axis=(0, 0, 1))
    tool, material = {"radius": 1.5, "blades": 6}, {"K": (1, 1, 1), "rho_ref": 1.0}
    base = bonemill.distance_transform(mask, 0.5)
    force = bonemill.burr_force(density, **ball, velocity=(1, 0, 0), rpm=2e4, tool=tool, material=material)
    for name, array in layouts(mask).items():
        for found, expected in zip(bonemill.distance_transform(array, 0.5), base):
            np.testing.assert_array_equal(found, expected, name)
    for name, array in layouts(density).items():
        found = bonemill.burr_force(array, **ball, velocity=(1, 0, 0), rpm=2e4, tool=tool, material=material)
        np.testing.assert_array_equal(found["F"], force["F"], name)
        metrics = bonemill.engagement_metrics(array, **ball, radius=1.5)
        assert metrics == bonemill.engagement_metrics(density, **ball, radius=1.5), name


def test_an_array_is_copied_before_others_may_change_it() -> None:
    """Another thread clears the mask as long as the call lasts: the call has its own, all set or all cleared."""
    mask = np.zeros((150, 150, 150), bool)
    mask[75, 75, 75] = True
    expected, _ = bonemill.distance_transform(mask, 0.5)
    begun, done = threading.Event(), threading.Event()

    def clear() -> None:
        begun.set()
        # the call holds Python until it has its copy, so this begins before or after that
        while not done.is_set():
            mask[75, 75, 75] = not mask[75, 75, 75]
            time.sleep(0)

    thread = threading.Thread(target=clear)
    thread.start()
    begun.wait()
    try:
        for _ in range(8):
            try:
                found, _ = bonemill.distance_transform(mask, 0.5)
            except bonemill.ArrayError as error:
                assert "no True voxel" in str(error)
            else:
                np.testing.assert_array_equal(found, expected)
    finally:
        done.set()
        thread.join()


def test_only_what_the_ball_sees_matters() -> None:
    """The part of a large array that is looked at gives what the whole gives."""
    rng = np.random.default_rng(3)
    small = rng.random((30, 30, 30))
    large = np.pad(small, 25, constant_values=np.nan)
    at = dict(spacing=0.25, axis=(0.2, 0, 1), center=(3.7, 3.6, 3.5))
    a = bonemill.engagement_metrics(small, **at, radius=2.0)
    b = bonemill.engagement_metrics(large, **at, origin=(-6.25, -6.25, -6.25), radius=2.0)
    for key in a:
        assert abs(a[key] - b[key]) <= 1e-12 * abs(a[key])


def test_a_ball_beyond_the_array_meets_nothing() -> None:
    density = np.ones((5, 5, 5))
    at = dict(spacing=1.0, center=(500.0, 0, 0), axis=(0, 0, 1))
    assert bonemill.engagement_metrics(density, **at, radius=2.0)["m"] == 0
    tool, material = {"radius": 2.0, "blades": 6}, {"K": (1, 1, 1), "rho_ref": 1.0}
    force = bonemill.burr_force(density, **at, velocity=(1, 0, 0), rpm=2e4, tool=tool, material=material)
    assert not force["F"].any()


def test_ball_volumes_keep_shape_and_fill_the_ball() -> None:
    centers = np.stack(np.meshgrid(*3 * [np.arange(-10, 11) * 0.2], indexing="ij"), axis=-1)
    found = bonemill.ball_volumes(centers, (0.03, -0.02, 0.05), 1.7, 0.2)
    assert found.shape == (21, 21, 21)
    assert abs(found.sum() - 4 / 3 * np.pi * 1.7**3) < 1e-12
    assert found.min() == 0 and found.max() <= 0.2**3 * (1 + 1e-14)


GOOD = np.zeros((3, 3, 3), bool)


@pytest.mark.parametrize(
    ("mask", "spacing", "says"),
    [
        (GOOD, 1.0, "no True voxel"),
        (np.ones((3, 3), bool), 1.0, "shape (3, 3)"),
        (np.ones((0, 3, 3), bool), 1.0, "shape (0, 3, 3)"),
        (np.ones((3, 3, 3)), 1.0, "dtype float64"),
        (np.ones((3, 3, 3), np.uint8), 1.0, "dtype uint8"),
        ([[["x"]]], 1.0, "dtype"),
        (~GOOD, 0.0, "spacing"),
        (~GOOD, (1, 1), "spacing"),
        (~GOOD, (1, np.nan, 1), "finite"),
        (~GOOD, -0.5, "above 0"),
        (~GOOD, "mm", "dtype"),
    ],
)
def test_bad_masks_are_refused(mask: Any, spacing: Any, says: str) -> None:
    with pytest.raises(bonemill.ArrayError) as caught:
        bonemill.distance_transform(mask, spacing)
    assert says in str(caught.value)


def force(**changes: Any) -> Any:
    arguments: dict[str, Any] = dict(
        density=np.ones((9, 9, 9)),
        spacing=0.5,
        origin=(0, 0, 0),
        center=(2, 2, 2),
        axis=(0, 0, 1),
        velocity=(1, 0, 0),
        rpm=20000,
        tool={"radius": 1.0, "blades": 8},
        material={"K": (1, 1, 1), "rho_ref": 1.0},
    )
    return bonemill.burr_force(**(arguments | changes))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"density": np.ones((9, 9))}, "shape (9, 9)"),
        ({"density": np.ones((9, 9, 9), complex)}, "dtype complex128"),
        ({"density": np.full((9, 9, 9), np.nan)}, "density[0, 0, 0] = nan"),
        ({"density": float("inf")}, "finite"),
        ({"density": lambda p: p}, "shape"),
        ({"density": lambda p: np.ones(3)}, "3 values for"),
        ({"density": lambda p: np.full(len(p), np.nan)}, "NaN at point 0"),
        ({"axis": (0, 0, 0)}, "shaft axis"),
        ({"axis": (0, 0)}, "shape (2,)"),
        ({"center": (0, 0, np.nan)}, "center[2]"),
        ({"rpm": 0}, "spindle speed"),
        ({"rpm": "fast"}, "expected a number"),
        ({"tool": {"radius": 1.0}}, "no 'blades'"),
        ({"tool": {"radius": 1.0, "blades": 8, "raduis": 2}}, "'raduis'"),
        ({"tool": {"radius": -1.0, "blades": 8}}, "burr radius"),
        ({"tool": {"radius": 1.0, "blades": 2.5}}, "whole number"),
        ({"tool": {"radius": 1.0, "blades": 8, "spin": 0}}, "spin"),
        ({"tool": 3}, "dictionary"),
        ({"material": {"K": (1, 1), "rho_ref": 1.0}}, "shape (2,)"),
        ({"material": {"K": (1, 1, 1), "rho_ref": 0.0}}, "rho_ref"),
        ({"disc": {"grid": "phi"}}, "'kappa' or 'z'"),
        ({"disc": {"n_kappa": 10**9}}, "from 1 to 100000"),
    ],
)
def test_bad_forces_are_refused(changes: dict[str, Any], says: str) -> None:
    with pytest.raises((bonemill.ArrayError, bonemill.ModelError)) as caught:
        force(**changes)
    assert says in str(caught.value)


def test_what_a_density_function_raises_comes_through() -> None:
    def density(points: np.ndarray) -> np.ndarray:
        raise ZeroDivisionError("mine")

    with pytest.raises(ZeroDivisionError, match="mine"):
        force(density=density)
