"""The reference cases, by the keys of their files."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import REFERENCE

import bonemill

FORCE = sorted(REFERENCE.glob("[av]*.json"))
VOXEL = sorted(REFERENCE.glob("v*.json"))


def read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text())


def noise(seed: int, count: int) -> np.ndarray:
    """splitmix64 of each voxel's own state."""
    z = np.uint64(seed) + (np.arange(1, count + 1, dtype=np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return ((z ^ (z >> np.uint64(31))) >> np.uint64(11)) * 2.0**-53


def voxels(spec: dict[str, Any]) -> np.ndarray:
    """rho <- rho + (L.rho - rho) occ for each layer, then noise; [i, j, k], in Fortran order."""
    shape, h, o = spec["shape"], spec["spacing"], spec["origin"]
    axes = [o[a] + h[a] * np.arange(shape[a]) for a in range(3)]
    p = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    rho = np.zeros(shape)
    for layer in spec["layers"]:
        match layer["shape"]:
            case "all":
                d = np.full(shape, np.inf)
            case "halfspace":
                d = -(p - layer["x0"]) @ (np.array(layer["n"]) / np.linalg.norm(layer["n"]))
            case "ball":
                d = layer["radius"] - np.linalg.norm(p - layer["center"], axis=-1)
            case "box":
                d = (np.array(layer["half"]) - abs(p - layer["center"])).min(axis=-1)
        ramp = layer.get("ramp", 0.0)
        occ = np.clip(0.5 + d / ramp, 0, 1) if ramp > 0 else (d >= 0).astype(float)
        rho += (layer["rho"] - rho) * occ
    if spec.get("noise"):
        u = noise(spec["noise"]["seed"], rho.size).reshape(shape, order="F")
        rho = np.maximum(rho * (1 + spec["noise"]["amp"] * (2 * u - 1)), 0)
    return np.asfortranarray(rho)


def density(spec: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """The field as `burr_force` takes it."""
    match spec["type"]:
        case "uniform":
            return spec["rho"], {}
        case "halfspace":
            n = np.array(spec["n"]) / np.linalg.norm(spec["n"])
            return lambda x: np.where(-(x - spec["x0"]) @ n >= 0, spec["rho_in"], 0.0), {}
        case _:
            return voxels(spec), {"spacing": spec["spacing"], "origin": spec["origin"]}


def close(found: Any, expected: Any, tolerance: float, scale: float) -> None:
    assert np.shape(found) == np.shape(expected)
    assert np.max(np.abs(np.subtract(found, expected))) <= tolerance * scale


@pytest.mark.parametrize("path", FORCE, ids=lambda p: p.stem)
def test_forces_agree_to_1e_10(path: Path) -> None:
    case = read(path)
    field, grid = density(case["field"])
    found = bonemill.burr_force(
        field, **grid, **case["motion"], tool=case["tool"], material=case["material"], disc=case["disc"]
    )
    expected = case["expected"]["discrete"]
    assert set(found) == set(expected)
    force, moment = np.linalg.norm(expected["F"]), np.linalg.norm(expected["M"])
    for key in expected:
        match key:
            case "F" | "F_tool" | "F_peak":
                scale = force
            case "M" | "M_tool":
                scale = moment
            case _:
                scale = np.max(np.abs(expected[key]))
        close(found[key], expected[key], 1e-10, scale)
    material = case["material"]
    rebuilt = np.array(material["K"]) @ found["basis_cut"] + np.array(material["Ke"]) @ found["basis_edge"]
    close(rebuilt, found["F_tool"], 1e-12, force)


@pytest.mark.parametrize("path", VOXEL, ids=lambda p: p.stem)
def test_metrics_agree_to_1e_11(path: Path) -> None:
    case = read(path)
    field, grid = density(case["field"])
    motion = case["motion"]
    found = bonemill.engagement_metrics(
        field, **grid, center=motion["center"], axis=motion["axis"], radius=case["tool"]["radius"]
    )
    expected = case["expected"]["metrics"]
    assert set(found) == set(expected)
    for key in set(expected) - {"n_vox"}:
        close(found[key], expected[key], 1e-11, abs(expected[key]))
    # the cases also count boxes beyond the ball whose volume is rounding
    assert 0 < found["n_vox"] <= expected["n_vox"]


def test_volumes_agree_to_4e_15() -> None:
    case = read(REFERENCE / "m01_volumes.json")
    for box, expected in zip(case["boxes"], case["expected"]["V"]):
        lo, hi = np.array(box[:3], float), np.array(box[3:], float)
        found = bonemill.ball_volumes((lo + hi) / 2, (0, 0, 0), case["radius"], hi - lo)
        assert found.shape == ()
        assert abs(found - expected) < 4e-15


def test_missing_keys_have_the_documented_defaults() -> None:
    motion = dict(center=(0, 0, 0), axis=(0, 0, 1), velocity=(1.5, 0, 0), rpm=20000)
    short = bonemill.burr_force(
        0.8, **motion, tool={"radius": 2.5, "blades": 8}, material={"K": (100, 60, 20), "rho_ref": 0.8}
    )
    full = bonemill.burr_force(
        np.full((30, 30, 30), 0.8),
        spacing=0.5,
        origin=(-7.25, -7.25, -7.25),
        **motion,
        tool=dict(radius=2.5, blades=8, spin=-1, helix_deg=0, kappa_min=0, kappa_max=np.pi),
        material=dict(K=(100, 60, 20), Ke=(0, 0, 0), rho_ref=0.8, p=1, rho_min=0, t0=0),
        disc=dict(n_gamma=16, n_kappa=64, grid="kappa", measure="db", sample_offset=0),
    )
    np.testing.assert_allclose(short["F"], full["F"], rtol=1e-12)
