"""Drills and reamers by the keys of their reference cases; cutters from meshes."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import REFERENCE

import bonemill

DRILL = dict(R=1.25, eps_deg=59.0, theta_deg=20.0, psi_deg=116.0, w=0.15, Nc=2, kc=150.0, kf=0.4, f=0.02)
REAMER = dict(R=16.22, w=6.43, R_outer=18.25, alpha_deg=9.46, f=0.3, Nc=5, kc=60.0, kf=0.5)


def flat(found: dict[str, Any], prefix: str = "") -> dict[str, float]:
    numbers = {}
    for key, value in found.items():
        if isinstance(value, dict):
            numbers.update(flat(value, f"{prefix}{key}."))
        else:
            numbers[prefix + key] = value
    return numbers


@pytest.mark.parametrize("path", sorted(REFERENCE.glob("d*.json")), ids=lambda p: p.stem)
def test_forces_agree_to_1e_10(path: Path) -> None:
    case = json.loads(path.read_text())
    force = {"drill": bonemill.drill_force, "reamer": bonemill.reamer_force}[case["cmd"]]
    found = force(**case["inputs"])
    angles = found.pop("angles")
    expected = flat(case["expected"]["discrete"])
    assert set(flat(found)) == set(expected)
    for key, value in expected.items():
        assert abs(flat(found)[key] - value) <= 1e-10 * max(abs(value), 1e-3), key
    for r, mu, lam, tau, gamma in case["expected"].get("angles_at", []):
        lip = angles["kind"] == "lip"
        fine = force(**{**case["inputs"], "n_elements": 4000})["angles"]
        lip = fine["kind"] == "lip"
        for name, value in (("mu", mu), ("lambda", lam), ("tau", tau), ("gamma_n", gamma)):
            assert abs(np.interp(r, fine["r"][lip], fine[name][lip]) - value) < 1e-6


def test_closed_limits() -> None:
    """Without web, helix and feed angle: torque k_c f R²/2, thrust k_f k_c f R sin(eps)."""
    found = bonemill.drill_force(**{**DRILL, "w": 0.0, "theta_deg": 0.0, "f": 1e-8, "n_elements": 500})["lips"]
    assert abs(found["torque"] / (150 * 1e-8 * 1.25**2 / 2) - 1) < 1e-5
    assert abs(found["Fz"] / (0.4 * 150 * 1e-8 * 1.25 * np.sin(np.radians(59))) - 1) < 1e-5
    assert bonemill.drill_force(**{**DRILL, "f": 0.0})["lips"]["Fz"] == 0.0


def test_the_options_of_the_cases_are_taken() -> None:
    dynamic = bonemill.drill_force(**DRILL, chisel=True)["chisel"]["Fz"]
    static = bonemill.drill_force(**DRILL, chisel=True, chisel_dynamic_rake=False)["chisel"]["Fz"]
    assert dynamic != static
    printed = bonemill.reamer_force(**REAMER, beta_as_printed=True)["angles"]["beta"][-1]
    right = bonemill.reamer_force(**REAMER)["angles"]["beta"][-1]
    assert np.degrees(printed) == pytest.approx(8.40, abs=0.05) and np.degrees(right) == pytest.approx(9.46, abs=0.05)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"eps_deg": 118.0}, "point angle"),
        ({"w": 1.2}, "leaves no lip"),
        ({"f": 5.0}, "outruns"),
        ({"R": -1.0}, "radius"),
        ({"kc": float("nan")}, "finite"),
        ({"Nc": 2.5}, "whole number"),
        ({"n_elements": 0}, "whole number"),
        ({"theta_deg": 80.0}, "helix"),
    ],
)
def test_drills_that_are_none_are_refused(change: dict[str, float], words: str) -> None:
    with pytest.raises(bonemill.BonemillError, match=words):
        bonemill.drill_force(**{**DRILL, **change})


def test_reamers_that_are_none_are_refused() -> None:
    for change, words in (({"R_outer": 40.0}, "arc"), ({"alpha_deg": 40.0}, "beside"), ({"f": 50.0}, "outruns")):
        with pytest.raises(bonemill.ModelError, match=words):
            bonemill.reamer_force(**{**REAMER, **change})


def spade(path: Path, thick: float = 0.4, scale: float = 1.0) -> Path:
    """A flat drill of radius 2 with a point of 60 degrees, 8 mm long."""
    up = 2.0 / np.tan(np.radians(60))
    outline = np.array([[0, 0], [2, up], [2, 8], [-2, 8], [-2, up]])
    n = len(outline)
    points = np.array([[x, y, z] for y in (-thick / 2, thick / 2) for x, z in outline]) / scale
    facets = [t for i in range(1, n - 1) for t in ((0, i, i + 1), (n, n + i + 1, n + i))]
    facets += [t for i in range(n) for j in [(i + 1) % n] for t in ((i, n + j, j), (i, n + i, n + j))]
    lines = ["solid spade"]
    for t in facets:
        corners = "".join(f"vertex {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in points[list(t)])
        lines.append(f"facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet")
    path.write_text("\n".join([*lines, "endsolid"]))
    return path


def test_a_mesh_is_a_cutter_with_elements(tmp_path: Path) -> None:
    cutter = bonemill.Cutter.from_mesh(spade(tmp_path / "a.stl"), axis=(0, 0, 1), feed=0.05)
    elements = cutter.elements
    lip = elements["kind"] == "lip"
    assert lip.sum() > 60 and elements["position"].shape == (len(lip), 3)
    assert np.allclose(np.degrees(elements["epsilon"][lip]), 60, atol=1e-3)
    assert np.allclose(elements["mu"], np.arctan(0.05 / (2 * np.pi * elements["r"])))
    assert set(elements["feed_share"]) == {0.5} and len(cutter.edges) >= 2
    assert abs(elements["width"][lip].sum() - 2 * (np.hypot(2, 0.2) - 0.2)) < 1e-5
    # torque of a lip without rake: k_c f R²/2 in the limit of a thin blade; here the web takes a few per cent
    torque = cutter.force(kc=100.0, kf=0.0)["torque"]
    assert 0.9 < torque / (100 * 0.05 * (4.04 - 0.04) / 2) < 1.1
    again = bonemill.Cutter.from_mesh(spade(tmp_path / "m.stl", scale=1000.0), axis=(0, 0, 5), scale=1000.0, feed=0.05)
    assert np.allclose(again.elements["gamma_n"], elements["gamma_n"], atol=1e-4)
    assert cutter.profile[:, 1].max() == pytest.approx(np.hypot(2, 0.2), abs=1e-5)


def test_meshes_that_are_no_cutter_are_refused(tmp_path: Path) -> None:
    good = spade(tmp_path / "good.stl")
    lines = good.read_text().split("facet normal")
    hole = tmp_path / "open.stl"
    hole.write_text("facet normal".join(lines[:-1]) + "endsolid")
    crossed = tmp_path / "crossed.stl"
    # two corners of the outline change places: the surface crosses itself
    crossed.write_text(good.read_text().replace("vertex 0 ", "vertex 2.5 "))
    off = [[[0, -0.2, 0], [0, 0, -3]]]
    for path, options, words in (
        (hole, {}, "open.stl"),
        (crossed, {}, "crossed.stl"),
        (tmp_path / "none.stl", {}, "none.stl"),
        (good, {"edges": off}, "off the mesh"),
        (good, {"edges": [[[0, 0, 0]]]}, "1 points"),
        (good, {"axis": (0, 0, 0)}, "axis"),
        (good, {"axis": (0, 0, -1)}, "no edge of the mesh cuts"),
        (good, {"feed": 50.0}, "outruns"),
        (good, {"scale": 0.0}, "scale"),
        (good, {"spin": 3}, "spin"),
    ):
        with pytest.raises(bonemill.BonemillError, match=words):
            bonemill.Cutter.from_mesh(path, **{"axis": (0, 0, 1), **options})
