"""Modes of joints 0 and 1 given for the runs of one session."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from dpr_lab.cli.app import app
from dpr_lab.errors import ConfigError
from dpr_lab.rig import load_rig, parse_rig
from dpr_lab.storage.reader import load_run
from dpr_lab.workflows.checks import with_options


@pytest.mark.slow
def test_a_driven_arm_is_recorded_as_prescribed_on_request(tmp_path: Path) -> None:
    link, poses = "sim://?plant=furuta&clock=fast", ["--pose", "X1", "--duration", "1", "--yes"]
    args = ["capture", "--rig", "furuta", "--link", link, *poses, "--arm", "prescribed", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, args)
    assert done.exit_code == 0, done.output
    (file,) = tmp_path.glob("*.mcap")
    run = load_run(file)
    assert (run.arm_mode, run.arm_input) == ("prescribed", None)
    assert run.arm is not None
    assert abs(run.arm.omega).max() > 0.1


def test_modes_that_a_rig_cannot_have_say_what_is_missing() -> None:
    paper, furuta = load_rig("paper"), load_rig("furuta")
    assert with_options(paper) is paper
    assert with_options(paper, rods="both", arm="clamped") is paper
    assert with_options(paper, inner="prescribed").joints.inner == "prescribed"
    assert with_options(with_options(paper, rods="inner"), rods="both", inner="prescribed").rods.number == 2
    with pytest.raises(ConfigError, match=r"--arm driven: a driven arm needs \[motor\]"):
        with_options(paper, arm="driven")
    with pytest.raises(ConfigError, match="--inner prescribed: a prescribed inner rod needs an outer rod"):
        with_options(furuta, inner="prescribed")
    with pytest.raises(ConfigError, match="--rods inner: a prescribed inner rod needs an outer rod"):
        with_options(with_options(paper, inner="prescribed"), rods="inner")
    with pytest.raises(ConfigError, match=r"--rods inner: a single rod \(mounted = inner\) .*: set elbow = free"):
        with_options(paper.with_rods(elbow="clamped"), rods="inner")
    text = "\n".join(line for line in paper.path.read_text().splitlines() if not line.startswith("L0"))
    with pytest.raises(ConfigError, match="--rods both --arm free: a free arm needs its length L0"):
        with_options(parse_rig(text).with_rods("inner"), rods="both", arm="free")
