"""Quality gate of a finished capture: lost samples, a stuck encoder, the hanging position, the rest at the end."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.acquisition.capture import CaptureOptions, Progress, capture
from dpr_lab.acquisition.holding import HangReading
from dpr_lab.errors import SafetyStop
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import LOSS_CAUSES
from dpr_lab.storage.inspect import info
from dpr_lab.storage.reader import load_run

SHORT = CaptureOptions(duration=1.0, pose_timeout=60.0, rest_timeout=60.0)


def test_lost_samples_are_counted_and_degrade_the_run(paper: Rig, tmp_path: Path, bench, agree) -> None:
    with bench(lose_every=50) as (device, _):
        captured = capture(device, paper, "X1", SHORT, tmp_path, confirm=agree)
    run = load_run(captured.run_file)
    missing = round(float(run.t[-1] - run.t[0]) * 1000) + 1 - len(run.t)
    assert missing > 30
    assert captured.lost == run.lost == dict.fromkeys(LOSS_CAUSES, 0) | {"tick_gap": missing}
    assert [check.name for check in captured.quality.checks if not check.ok] == ["lost"]
    assert "tick_gap" in captured.quality.sentence
    assert run.complete


@pytest.mark.parametrize("joint", [1, 2])
def test_stuck_encoder_degrades_the_run(joint: int, paper: Rig, tmp_path: Path, bench, agree) -> None:
    with bench(fault=(f"stuck_encoder={joint}",)) as (device, _):
        captured = capture(device, paper, "X1", SHORT, tmp_path, confirm=agree)
    assert "moved" in [check.name for check in captured.quality.checks if not check.ok]
    assert f"encoder {joint} moved" in captured.quality.sentence
    assert load_run(captured.run_file).complete


@pytest.mark.slow
def test_the_hanging_rest_is_checked_before_the_rods_are_raised(paper: Rig, tmp_path: Path, bench, agree) -> None:
    seen: list[Progress] = []
    askew = tmp_path / "askew.toml"
    zero = round(0.1 / abs(paper.radians_per_count[1]))
    assert paper.path is not None
    text = paper.path.read_text().replace("[encoders]", f"[encoders]\nzero_counts = [0, {zero}, 0]", 1)
    askew.write_text(text)
    with bench() as (device, _):
        captured = capture(device, paper, "X1", SHORT, tmp_path / "runs", seen.append, agree)
        (hanging,) = (reading for reading in seen if isinstance(reading, HangReading))
        assert hanging.ok
        assert max(map(abs, hanging.error)) < 1e-3
        assert captured.quality.checks[0].name == "hanging_before"
        seen.clear()
        again = capture(device, paper, "X1", SHORT, tmp_path / "runs", seen.append, agree)
        assert not any(isinstance(reading, HangReading) for reading in seen)  # the rods still swing
        assert again.quality.ok
    with bench() as (device, _):
        seen.clear()
        options = CaptureOptions(duration=0.5, pose_timeout=2.0)
        with pytest.raises(SafetyStop, match="away, tolerance"):
            capture(device, load_rig(askew), "X1", options, tmp_path / "runs", seen.append, agree)
    (hanging,) = (reading for reading in seen if isinstance(reading, HangReading))
    assert not hanging.ok
    assert hanging.error == pytest.approx((-0.1, -0.1), abs=1e-3)


def test_samples_that_the_board_missed_are_counted_as_its_own_losses(paper: Rig, tmp_path: Path, bench, agree) -> None:
    with bench(fault=("overrun=0.02",)) as (device, _):
        captured = capture(device, paper, "X1", SHORT, tmp_path, confirm=agree)
    run = load_run(captured.run_file)
    missing = round(float(run.t[-1] - run.t[0]) * 1000) + 1 - len(run.t)
    assert missing > 10
    assert captured.lost["device_overrun"] >= missing
    assert captured.lost["tick_gap"] == 0


@pytest.mark.slow
def test_until_rest_ends_when_both_rods_are_still(paper: Rig, tmp_path: Path, bench, agree) -> None:
    options = CaptureOptions(rate_hz=250, until_rest=True, max_duration=600)
    with bench(plant="dry") as (device, _):
        captured = capture(device, paper, "X1", options, tmp_path, confirm=agree)
    run = load_run(captured.run_file)
    assert captured.quality.sentence == "ok"
    assert 5 < captured.duration < 590
    last = run.between(run.duration - 2, run.duration + 1).theta[:, 1:]
    assert np.ptp(last, axis=0).max() < 0.01
    before = run.between(run.duration - 6, run.duration - 4).theta[:, 1:]
    assert np.ptp(before, axis=0).max() > np.ptp(last, axis=0).max()


def test_rods_that_still_move_after_the_longest_duration_are_remarked_on(
    paper: Rig, tmp_path: Path, bench, agree
) -> None:
    with bench() as (device, _):
        options = CaptureOptions(until_rest=True, max_duration=3.0)
        captured = capture(device, paper, "X2", options, tmp_path, confirm=agree)
    result = "the rods were still moving at the end of the recording, 3 s after the release"
    assert captured.duration == 3.0
    assert captured.quality.ok
    assert captured.quality.sentence.startswith(f"ok; {result}")
    assert captured.quality.to_json()["notes"] == list(captured.quality.notes)
    assert result in info(captured.run_file).gate


def test_a_recording_of_a_set_length_is_not_expected_to_end_at_rest(paper: Rig, tmp_path: Path, bench, agree) -> None:
    with bench() as (device, _):
        captured = capture(device, paper, "X2", SHORT, tmp_path, confirm=agree)
    assert captured.quality.sentence == "ok"
