"""`dpr-lab plan`: tables, JSON, files and refusals."""

from pathlib import Path

import pytest

from dpr_lab.rig import load_rig
from tests.schemas import validator

LIMITS = """
[recording]
shortest_s = 5.0
longest_s = 5.0

[drive]
torque_Nm = [0.2, 0.1]
speed_rad_s = [15.0, 20.0]
rate_hz = 100
"""


def test_from_the_rig_file_alone(cli, tmp_path: Path) -> None:
    limits = tmp_path / "limits.toml"
    limits.write_text(LIMITS)
    out = tmp_path / "plan"
    done = cli("plan", "--rig", "paper", "--limits", limits, "--budget", "4min", "--out", out, "--json")
    assert done.code == 0, done.err
    validator("plan").validate(done.json)
    assert done.json["state"] == "first"
    assert done.json["minutes"] <= 4.0
    assert done.json["files"]["plan"] == str(out / "plan.json")
    written = load_rig(out / "rig.toml")
    for one in done.json["releases"]:
        assert written.poses[one["pose"]].theta1 == pytest.approx(one["theta1_rad"], abs=1e-4)
        assert one["pose"] not in load_rig("paper").poses
    signals = [one for one in done.json["releases"] if one["signal"]]
    assert signals
    rows = Path(signals[0]["input"]).read_text().splitlines()
    assert rows[0] == "t_s,tau1_Nm,tau2_Nm"
    assert len(rows) == 501


def test_the_tables_name_what_to_record(cli, tmp_path: Path) -> None:
    limits = tmp_path / "limits.toml"
    limits.write_text("[recording]\nshortest_s = 5.0\nlongest_s = 5.0")
    done = cli("plan", "--rig", "paper", "--limits", limits, "--budget", "36s")
    assert done.code == 0, done.err
    assert "Before any recording: 1 release " in done.out
    assert "theta1 = " in done.out
    assert "minutes at the rig" in done.out


def test_refusals_say_what_to_do(cli, tmp_path: Path) -> None:
    for words, message in (
        (("--budget", "soon"), "give a time such as 10min"),
        (("--budget", "10s"), "is too small: one release takes"),
        (("--limits", tmp_path / "none.toml"), "none.toml: cannot be read"),
        ((tmp_path / "none.mcap",), "none.mcap"),
    ):
        done = cli("plan", *words, "--rig", "paper")
        assert done.code == 3, done.err
        assert message in done.err
        assert "Traceback" not in done.err
