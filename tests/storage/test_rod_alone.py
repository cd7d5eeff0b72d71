"""One rod alone through rig file, import and run file."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import RunError
from dpr_lab.rig import Rig, load_rig
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.inspect import info
from dpr_lab.storage.reader import load_run

ONE_ROD = """
[rig]
name = "one"
L1 = 0.3
[rods]
mounted = "inner"
[parameters.l1]
nominal = 0.15
lower = 0.1
upper = 0.2
[parameters.m1]
nominal = 0.1
lower = 0.05
upper = 0.2
[parameters.c1]
nominal = 1e-4
lower = 1e-5
upper = 1e-3
[parameters.J1]
nominal = 1e-3
lower = 5e-4
upper = 2e-3
[poses.side]
theta1 = 1.5
"""


@pytest.fixture
def one(tmp_path: Path) -> Rig:
    file = tmp_path / "one.toml"
    file.write_text(ONE_ROD)
    return load_rig(file)


def table(folder: Path, header: str, *columns: np.ndarray) -> Path:
    file = folder / "swing.csv"
    np.savetxt(file, np.column_stack(columns), delimiter=",", header=header, comments="")
    return file


T = np.arange(0, 1, 0.01)
SWING = 1.2 * np.cos(6 * T)


def test_a_rig_of_one_rod_need_not_describe_another(one: Rig) -> None:
    assert one.parameters["l2"] == one.parameters["l1"]
    assert one.nominal[4] < 1e-5
    assert one.poses["side"].theta2 == 1.5


def test_a_table_of_one_rod_needs_no_second_column(one: Rig, tmp_path: Path) -> None:
    file = table(tmp_path, "t,theta1", T, SWING)
    run = import_csv(file, one, ImportOptions(zero="hanging"), tmp_path / "a.mcap")
    assert run.mounting == "inner"
    assert run.theta[:, 1] == pytest.approx(SWING + np.pi)
    assert (run.theta[:, 2] == run.theta[:, 1]).all()
    assert load_run(tmp_path / "a.mcap").setup == run.setup
    assert info(tmp_path / "a.mcap").mounted == "inner"


def test_raw_counts_of_one_rod(one: Rig, tmp_path: Path) -> None:
    file = table(tmp_path, "t,counts", T, np.round(SWING / (2 * np.pi) * 16384))
    run = import_csv(file, one, ImportOptions(unit="counts", columns={"theta1": "counts"}))
    assert run.theta[:, 1] == pytest.approx(SWING + np.pi, abs=3e-4)


@pytest.mark.parametrize("said", [{"mounted": "inner"}, {"elbow": "clamped"}], ids=str)
def test_a_table_in_which_both_rods_swing_contradicts_one(paper: Rig, tmp_path: Path, said: dict[str, str]) -> None:
    file = table(tmp_path, "t,theta1,theta2", T, SWING, np.cos(9 * T))
    with pytest.raises(RunError, match=r"joint 2 turns by .*: both rods swing"):
        import_csv(file, paper.with_rods(**said), ImportOptions(zero="hanging"), tmp_path / "b.mcap")
    assert not (tmp_path / "b.mcap").exists()


def test_a_clamped_elbow_keeps_its_angle(paper: Rig, tmp_path: Path) -> None:
    file = table(tmp_path, "t,theta1,theta2", T, SWING, SWING + 0.52)
    run = import_csv(file, paper.with_rods(elbow="clamped"), ImportOptions(zero="hanging"))
    assert (run.setup.mounting, run.setup.elbow) == ("clamped", 0.5)


def test_one_rod_has_no_elbow(paper: Rig) -> None:
    with pytest.raises(ValueError, match="no elbow to clamp"):
        paper.with_rods("inner", "clamped")
