"""What comes in wrong is refused with the command's words, as an exception of ours; nothing is left behind."""

import subprocess
import sys
import tomllib
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bonemill

GOOD = (np.zeros((4, 4, 4), np.int16), np.eye(4))


def changed(case: bonemill.Case, before: str, after: str) -> Path:
    text = case.path.read_text()
    assert before in text
    case.path.write_text(text.replace(before, after, 1))
    return case.path


@pytest.mark.parametrize(
    ("before", "after", "error"),
    [
        ("radius_mm = 2.5", "radius_mm = -1", bonemill.CaseError),
        ("radius_mm = 2.5", "radius_cm = 0.25", bonemill.CaseError),
        ("[grid]", "[gird]", bonemill.CaseError),
        ("[images]", "[images", bonemill.CaseError),
        ('"ct.nii.gz"', '"case.toml"', bonemill.ImageError),
        ('"ct.nii.gz"', '"labels.nii.gz"', bonemill.ImageError),
        ('"facial_nerve"\nlabel = 1', '"facial_nerve"\nlabel = 99', bonemill.ImageError),
        ('"facial_nerve"\nlabel = 1', '"facial_nerve"\nlabel = "nerv"', bonemill.CaseError),
        ("max_mm = [7.0, 4.0, 0.0]", "max_mm = [-0.9, -3.9, -3.9]", bonemill.BonemillError),
    ],
)
def test_a_bad_case_is_refused_in_the_commands_words(
    own_block: bonemill.Case, command: Path, tmp_path: Path, before: str, after: str, error: type[Exception]
) -> None:
    path = changed(own_block, before, after)
    with pytest.raises(error) as caught:
        bonemill.plan(path)
    run = subprocess.run(
        [command, "plan", path, "--out", tmp_path / "p", "--quiet"], capture_output=True, text=True, check=False
    )
    assert run.returncode in (1, 2)
    said = [line.removeprefix("error: ").strip() for line in run.stderr.splitlines()]
    assert [line.strip() for line in str(caught.value).splitlines()] == said


def test_an_image_that_is_not_there_is_refused(own_block: bonemill.Case) -> None:
    path = changed(own_block, '"ct.nii.gz"', '"no.nii.gz"')
    with pytest.raises(bonemill.ImageError, match=r"case.toml:8: `images.ct`: .*no.nii.gz: .*No such file"):
        bonemill.plan(path)


def test_a_case_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(bonemill.CaseError, match="cannot read the case"):
        bonemill.Case.load(tmp_path / "no.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(bonemill.CaseError, match="not UTF-8"):
        bonemill.Case.load(tmp_path / "binary.toml")
    with pytest.raises(bonemill.CaseError, match="cannot read"):
        bonemill.plan(tmp_path)


@pytest.mark.parametrize(
    ("image", "says"),
    [
        (GOOD[0], "ndarray: expected a file's name"),
        (3, "int: expected a file's name"),
        ((GOOD[0], np.eye(3)), "(4, 4)"),
        ((GOOD[0], np.ones((4, 4))), "last row"),
        ((GOOD[0], np.full((4, 4), np.nan)), "finite"),
        ((GOOD[0].astype(complex), np.eye(4)), "complex128"),
        ((GOOD[0].astype("U3"), np.eye(4)), "<U3"),
        ((GOOD[0][0], np.eye(4)), "shape (4, 4)"),
        ((GOOD[0][..., None], np.eye(4)), "shape (4, 4, 4, 1)"),
        ((np.zeros((0, 4, 4)), np.eye(4)), "shape (0, 4, 4)"),
        ((np.zeros((40000, 1, 1), np.int8), np.eye(4)), "32767"),
    ],
)
def test_bad_images_are_refused(block: bonemill.Case, image: Any, says: str) -> None:
    with pytest.raises(bonemill.ArrayError) as caught:
        block.with_images(ct=image)
    assert says in str(caught.value)


def sheared() -> np.ndarray:
    affine = np.eye(4)
    affine[0, 1] = 0.2
    return affine


@pytest.mark.parametrize(
    ("ct", "says"),
    [
        ((GOOD[0], np.diag([0.0, 0, 0, 1])), "singular"),
        ((GOOD[0], sheared()), "shear"),
        ((np.full((4, 4, 4), np.nan), np.eye(4)), "not finite"),
        ((np.zeros((4, 4, 4)), np.diag([1e4, 1e4, 1e4, 1])), "wrong unit"),
    ],
)
def test_images_that_the_planner_cannot_trust_are_refused(block: bonemill.Case, ct: Any, says: str) -> None:
    with pytest.raises(bonemill.ImageError) as caught:
        bonemill.plan(block.with_images(ct=ct))
    assert says in str(caught.value)
    # the temporary files are gone when the message is read
    assert "the image ct in memory" in str(caught.value) and "/bonemill-" not in str(caught.value)
    assert f"{block.path} as changed" in str(caught.value)


def test_labels_that_are_none_are_refused(block: bonemill.Case) -> None:
    with pytest.raises(bonemill.ImageError, match="the image labels in memory.*no label"):
        bonemill.plan(block.with_images(labels=(np.full((9, 9, 9), 0.5), np.eye(4))))
    with pytest.raises(bonemill.ArrayError, match="ct, labels or both"):
        block.with_images()


def test_a_folder_with_something_else_is_not_replaced(planned: bonemill.Plan, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(bonemill.PlanFileError, match="is not a plan"):
        planned.save(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]
    with pytest.raises(bonemill.PlanFileError):
        planned.save(tmp_path / "thesis.tex")
    with pytest.raises(bonemill.PlanFileError):
        bonemill.Plan.load(tmp_path)
    with pytest.raises(bonemill.PlanFileError, match="not empty"):
        bonemill.phantom("block", tmp_path)


def test_what_is_no_plan_is_refused_and_a_folder_is_one(planned: bonemill.Plan, block: bonemill.Case, tmp_path: Path) -> None:
    folder = planned.save(tmp_path / "plan")
    jobs: list[Any] = [bonemill.verify, partial(bonemill.simulate, rate_hz=20)]
    for job in jobs:
        assert job(folder)[0] is not None and job(str(folder))[0] is not None
        with pytest.raises(bonemill.ArrayError, match="plan is int: expected a Plan or a plan's folder"):
            job(3)
        with pytest.raises(bonemill.ArrayError, match=r"plan is Case.*bonemill.plan\(case\) makes one"):
            job(block)
        with pytest.raises(bonemill.PlanFileError, match="nowhere"):
            job(tmp_path / "nowhere")
    # each reads the folder's own bytes
    found, same = (bonemill.simulate(plan, rate_hz=20).figures for plan in (folder, planned))
    assert found == same
    with pytest.raises(bonemill.PlanFileError, match="nowhere"):
        bonemill.calibrate(tmp_path / "nowhere", tmp_path / "log.csv")
    with pytest.raises(bonemill.PlanFileError, match="nowhere"):
        bonemill.view(tmp_path / "nowhere", save=tmp_path / "a.rrd")


def test_a_tool_that_no_arm_can_hold_is_the_cases_fault(block: bonemill.Case) -> None:
    mount = {"robot.model": "ur5e", "robot.flange_from_burr": {"translation_mm": [0, 0, 180], "rpy_rad": [0, 0, 0]}}
    with pytest.raises(bonemill.CaseError, match="the shank points away from the flange"):
        bonemill.plan(block.with_values(mount))


def test_every_extra_that_a_message_names_exists(monkeypatch: pytest.MonkeyPatch, planned: bonemill.Plan) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(bonemill.BonemillError, match=r"pip install rerun-sdk==0.36.3 \(the extra `view`\)"):
        bonemill.view(planned)
    root = Path(__file__).parents[1]
    extras = tomllib.loads((root / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert "rerun-sdk==0.36.3" in extras["view"]
    documents = (root.parent / "docs/own-ct.md").read_text() + (root / "README.md").read_text()
    for extra in extras:
        assert f"| `{extra}` |" in documents, extra


def test_bad_options_are_refused(block: bonemill.Case, tmp_path: Path) -> None:
    for threads in (0, -1, 1.5, "two", 10**6):
        with pytest.raises(bonemill.ArrayError, match="threads"):
            bonemill.plan(block, threads=threads)  # type: ignore[arg-type]
    with pytest.raises(bonemill.CaseError, match="'block', 'temporal', 'tibia' or 'glenoid'"):
        bonemill.phantom("skull", tmp_path / "skull")
    with pytest.raises(bonemill.ArrayError, match="seed"):
        bonemill.phantom("block", tmp_path / "p", seed=-1)
    with pytest.raises(TypeError):
        bonemill.plan(block, progress=3)  # type: ignore[arg-type]


def test_arms_refuse_what_is_no_joint_vector(tmp_path: Path) -> None:
    arm = bonemill.Arm.load("bone-attached")
    assert arm.dof == 4 and [j.kind for j in arm.joints] == 3 * ["prismatic"] + ["revolute"]
    assert arm.fk(np.zeros((2, 5, 4))).shape == (2, 5, 4, 4) and arm.jacobian(np.zeros(4)).shape == (6, 4)
    assert arm.fk(np.zeros((0, 4))).shape == (0, 4, 4)
    for q, says in [(np.zeros(3), "shape (3,)"), ([0, 0, 0, np.nan], "q[3] = nan"), ("up", "dtype")]:
        with pytest.raises(bonemill.ArrayError) as caught:
            arm.fk(q)
        assert says in str(caught.value)
    with pytest.raises(bonemill.RobotError, match="no joint_stiffness"):
        arm.compliance(np.zeros(4))
    with pytest.raises(bonemill.RobotError, match="joint_stiffness"):
        arm.compliance(np.zeros(4), [1, 1, 1, 0])
    soft = bonemill.Arm.load("bone-attached", joint_stiffness=[100, 200, 400, 1e5])
    j = soft.jacobian(np.zeros(4))[:3]
    np.testing.assert_allclose(soft.compliance(np.zeros(4)), j @ np.diag(1 / soft.joint_stiffness) @ j.T, atol=1e-15)
    with pytest.raises(bonemill.RobotError):
        bonemill.Arm.load("ur99")
    with pytest.raises(bonemill.RobotError, match="cannot read the URDF"):
        bonemill.Arm.load(tmp_path / "no.urdf")
    (tmp_path / "bad.urdf").write_text("<robot/>")
    with pytest.raises(bonemill.RobotError):
        bonemill.Arm.load(tmp_path / "bad.urdf")


@pytest.mark.parametrize("model", ["bone-attached", "ur3e", "ur5e", "ur10e"])
def test_fk_undoes_ik(model: str) -> None:
    arm = bonemill.Arm.load(model)
    rng = np.random.default_rng(5)
    for q in rng.uniform(-1.2, 1.2, (50, arm.dof)):
        pose = arm.fk(q)
        found = arm.ik(pose)
        assert 1 <= len(found) <= 8 and found.shape[1] == arm.dof
        np.testing.assert_allclose(arm.fk(found)[:, :3, 2:], np.broadcast_to(pose[:3, 2:], (len(found), 3, 2)), atol=1e-8)
        off = (found - q + np.pi) % (2 * np.pi) - np.pi if arm.dof == 6 else found - q
        assert abs(off).max(axis=1).min() < 1e-6
    far = np.eye(4)
    far[0, 3] = 5000.0
    assert model == "bone-attached" or arm.ik(far).shape == (0, 6)
    for bad in (np.eye(3), np.full((4, 4), np.nan), np.ones((4, 4))):
        with pytest.raises(bonemill.ArrayError):
            arm.ik(bad)
    with pytest.raises(bonemill.RobotError, match="not a rotation"):
        arm.ik(np.diag([1, 1, -1, 1]))


def test_the_jacobian_is_the_derivative() -> None:
    arm = bonemill.Arm.load("bone-attached")
    q, h = np.array([3.0, -2.0, 5.0, 0.4]), 1e-6
    steps = np.concatenate([q + h * np.eye(4), q - h * np.eye(4)])
    places = arm.fk(steps)[:, :3, 3]
    np.testing.assert_allclose(((places[:4] - places[4:]) / (2 * h)).T, arm.jacobian(q)[:3], atol=1e-7)
