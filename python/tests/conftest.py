"""One small phantom and its plan for all tests."""

import os
import shutil
from pathlib import Path

import pytest

import bonemill

ROOT = Path(__file__).resolve().parents[2]
REFERENCE = ROOT / "planner/tests/data"
POCKET = "box = { min_mm = [-1.0, -4.0, -4.0], max_mm = [7.0, 4.0, 0.0] }\nleast_share = 0.8 # "


@pytest.fixture(scope="session")
def block(tmp_path_factory: pytest.TempPathFactory) -> bonemill.Case:
    """The foam block with a small pocket beside the nerve, planned in a second or two; not to be written to."""
    case = bonemill.phantom("block", tmp_path_factory.mktemp("case") / "block")
    text = case.text.replace("label = 20 ", POCKET)
    assert text != case.text
    case.path.write_text(text, encoding="utf-8")
    return bonemill.Case.load(case.path)


@pytest.fixture
def own_block(block: bonemill.Case, tmp_path: Path) -> bonemill.Case:
    """A copy of the block's files, to change."""
    shutil.copytree(block.path.parent, tmp_path / "block")
    return bonemill.Case.load(tmp_path / "block" / "case.toml")


@pytest.fixture(scope="session")
def planned(block: bonemill.Case) -> bonemill.Plan:
    """The block's plan."""
    return bonemill.plan(block)


@pytest.fixture(scope="session")
def command() -> Path:
    """The command of the same sources."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    built = [p for p in (target / "debug/bonemill", target / "release/bonemill") if p.exists()]
    if not built:
        pytest.skip("the command is not built: cargo build")
    return max(built, key=lambda p: p.stat().st_mtime)


ROBOT = """
[robot]
model = "ur5e"
flange_from_burr = { translation_mm = [0.0, 0.0, 180.0], rpy_rad = [3.141592653589793, 0.0, 0.0] }
base_from_ct = { rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], translation_mm = [450.0, 50.0, 150.0] }

"""


def for_ur5e(block: bonemill.Case, text: str, name: str) -> Path:
    """The case's text with a UR5e on a table, beside the block's images."""
    head, found, tail = text.partition("[robot]")
    assert found
    _, next_table, rest = tail.partition("\n[")
    path = block.path.with_name(name)
    path.write_text(head + ROBOT + (next_table + rest).lstrip("\n"), encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def ur_planned(block: bonemill.Case) -> bonemill.Plan:
    """The same pocket for a UR5e on a table."""
    return bonemill.plan(for_ur5e(block, block.text, "case_ur5e.toml"))


def pocket(block: bonemill.Case) -> str:
    """A case of a shallow pocket, milled in some ten seconds."""
    text = block.text.replace("[-1.0, -4.0, -4.0], max_mm = [7.0, 4.0, 0.0]", "[0.0, -2.5, -1.2], max_mm = [6.0, 2.5, 0.0]")
    text = text.replace("least_share = 0.8", "least_share = 0.5").replace('mode = "least_force"', 'mode = "constant"')
    text = text.replace("nominal_mm_s = 1.5", "nominal_mm_s = 4.0").replace("stepover_mm = 1.667", "stepover_mm = 1.2")
    return text


@pytest.fixture(scope="session")
def ur_pocket(block: bonemill.Case) -> bonemill.Plan:
    """A shallow pocket for the same arm: for what runs in real time."""
    return bonemill.plan(for_ur5e(block, pocket(block), "case_pocket.toml"))


@pytest.fixture(scope="session")
def judged(ur_pocket: bonemill.Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pocket's folder with a passed verification; not to be written to."""
    folder = ur_pocket.save(tmp_path_factory.mktemp("streamed") / "plan", pack=True)
    assert bonemill.verify(bonemill.Plan.load(folder), save=True).passed
    return folder


@pytest.fixture(scope="session")
def held(block: bonemill.Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A deeper one, with a hold some seconds after its start."""
    text = pocket(block).replace("[0.0, -2.5, -1.2], max_mm = [6.0, 2.5, 0.0]", "[1.5, -2.6, -5.6], max_mm = [7.5, 2.6, 0.0]")
    text += '\n[[hold]]\nstructure = "facial_nerve"\ndistance_mm = 8.0\n'
    folder = bonemill.plan(for_ur5e(block, text, "case_held.toml")).save(tmp_path_factory.mktemp("held") / "plan", pack=True)
    assert bonemill.verify(bonemill.Plan.load(folder), save=True).passed
    return folder
