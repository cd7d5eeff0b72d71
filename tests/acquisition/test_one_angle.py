"""Captures of a single rod, and of rods with a clamped elbow: the operator sets only theta1."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.acquisition.capture import CaptureOptions, capture
from dpr_lab.errors import SafetyStop
from dpr_lab.rig import Rig, load_rig, parse_rig
from dpr_lab.storage.metadata import rig_toml
from dpr_lab.storage.reader import load_run
from firmware_protocol.messages import NUMBERS, Release
from tests.thinned import covered

OPTIONS = CaptureOptions(duration=2.0, pose_timeout=60.0, rest_timeout=60.0)
PLANTS = Path(__file__).parents[2] / "configs/plants"


def written(rig: Rig, tmp_path: Path) -> tuple[Rig, Path]:
    """Write a rig file for a simulated device."""
    file = tmp_path / "rig.toml"
    file.write_text(rig_toml(rig), encoding="utf-8")
    return load_rig(file), file


def with_encoder2(rig: Rig, kind: str) -> Rig:
    """Copy of the rig with another encoder of joint 2."""
    return parse_rig(rig_toml(rig).replace('joint2 = "relative"', f'joint2 = "{kind}"'))


def clamped_at(angle: float, tmp_path: Path) -> Path:
    """Plant whose elbow is clamped at an angle theta2 - theta1, rad."""
    file = tmp_path / "plant.toml"
    text = (PLANTS / "paper.toml").read_text()
    assert "[hand]" in text
    file.write_text(text.replace("[hand]", f"[hand]\nelbow = {angle}"))
    return file


@pytest.mark.parametrize(("kind", "mounted"), covered(("relative", "absolute"), ("inner", "outer")))
def test_a_single_rod_is_released_for_any_reading_of_encoder_2(
    paper: Rig, tmp_path: Path, bench, agree, mounted: str, kind: str
) -> None:
    rig, file = written(with_encoder2(paper.with_rods(mounted), kind), tmp_path)
    with bench(rig=file, fault=["constant_encoder2=3210"]) as (device, _):
        captured = capture(device, rig, "X2", OPTIONS, tmp_path, confirm=agree)
    assert captured.quality.ok, captured.quality.sentence
    assert {"hanging_before", "pose"} <= {check.name for check in captured.quality.checks}
    assert captured.pose_measured == pytest.approx((0.0, 0.1, 0.1), abs=0.05)
    run = load_run(captured.run_file, rig)
    assert run.counts is not None
    assert set(run.counts[:, 2]) == {3210}
    assert np.array_equal(run.theta[:, 1], run.theta[:, 2])


def test_the_message_of_a_single_rod_names_it(paper: Rig, tmp_path: Path, bench, agree) -> None:
    rig, file = written(paper.with_rods("outer"), tmp_path)
    with (
        bench(rig=file, hand_error=0.4, fault=["constant_encoder2=0"]) as (device, _),
        pytest.raises(SafetyStop, match=r"the outer rod is \+0\.\d+ rad away"),
    ):
        capture(device, rig, "X1", CaptureOptions(pose_timeout=2.0), tmp_path, confirm=agree)


def test_both_rods_swinging_although_one_is_given_are_reported(paper: Rig, tmp_path: Path, bench, agree) -> None:
    with bench() as (device, _):
        captured = capture(device, paper.with_rods("inner"), "X2", OPTIONS, tmp_path, confirm=agree)
    assert "joint 2 turned by" in captured.quality.sentence


def test_a_clamp_may_deviate_a_little_from_the_angle_of_a_pose(paper: Rig, tmp_path: Path, bench, agree) -> None:
    rig, file = written(paper.with_rods(elbow="clamped"), tmp_path)
    with bench(rig=file, plant=clamped_at(0.12, tmp_path)) as (device, _):
        captured = capture(device, rig, "X2", OPTIONS, tmp_path, confirm=agree)
    assert captured.quality.ok, captured.quality.sentence
    run = load_run(captured.run_file, rig)
    assert run.elbow == pytest.approx(0.12, abs=0.01)


def test_a_clamp_far_from_the_pose_is_refused_at_once(paper: Rig, tmp_path: Path, bench, agree) -> None:
    rig, file = written(paper.with_rods(elbow="clamped"), tmp_path)
    with (
        bench(rig=file, plant=clamped_at(0.0, tmp_path)) as (device, spy),
        pytest.raises(SafetyStop, match=r"clamped at theta2 - theta1 = -?0\.\d+ rad, but the pose needs -3\.04 rad"),
    ):
        capture(device, rig, "X1", CaptureOptions(pose_timeout=60.0), tmp_path, confirm=agree)
    assert NUMBERS[Release] not in spy.sent
