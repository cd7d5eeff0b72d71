"""Complete captures over every link, from the pose to the run file; a device that does not match the rig is refused."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from dpr_lab.acquisition.capture import Captured, CaptureOptions, Progress, Released, SwingReading, capture, new_path
from dpr_lab.acquisition.holding import PoseReading, RestReading
from dpr_lab.errors import ConfigError, LinkError
from dpr_lab.estimation.noise import noise_floor
from dpr_lab.estimation.velocity import smooth
from dpr_lab.rig import Rig, load_rig
from dpr_lab.storage.inspect import verify
from dpr_lab.storage.reader import load_run
from firmware_protocol.messages import NUMBERS, Hold, Sample, State
from tests.thinned import thinned

SHORT = CaptureOptions(duration=1.0, pose_timeout=60.0, rest_timeout=60.0)


@pytest.mark.parametrize("pose", thinned(["X2", "X1", "X3"], 3))
def test_capture_leads_from_pose_to_a_judged_complete_run(
    pose: str, paper: Rig, tmp_path: Path, bench, settled, agree
) -> None:
    seen: list[Progress] = []
    with bench() as (device, spy):
        captured = capture(device, paper, pose, SHORT, tmp_path, seen.append, agree)
        assert settled(device).state is State.IDLE
    assert captured.quality.ok, captured.quality.sentence
    kinds = (PoseReading, RestReading, Released, SwingReading)
    assert [kind for kind in kinds if not any(isinstance(s, kind) for s in seen)] == []
    assert len(spy.releases) == 1  # however often it was repeated
    run = load_run(captured.run_file, paper)
    assert run.complete
    assert (run.pose, run.rate_hz, captured.duration) == (pose, 1000, 1.0)
    assert run.t[-1] == 1.0
    assert run.t[0] < -0.9
    assert np.array_equal(np.round(np.diff(run.t) * 1000), np.ones(len(run.t) - 1))
    assert captured.pose_measured == pytest.approx(run.rest.mean(axis=0), abs=1e-6)
    assert captured.pose_measured == pytest.approx(paper.poses[pose].theta, abs=paper.poses[pose].tolerance)
    assert verify(captured.run_file).ok
    assert sum(captured.lost.values()) == sum(run.lost.values()) == 0


def test_live_speeds_are_near_the_smoothed_ones(paper: Rig, tmp_path: Path, bench, agree) -> None:
    seen: list[Progress] = []
    with bench() as (device, _):
        captured = capture(device, paper, "X1", replace(SHORT, duration=4.0), tmp_path, seen.append, agree)
    readings = [reading for reading in seen if isinstance(reading, SwingReading) and reading.t > 0.1]
    run = load_run(captured.run_file, paper)
    t, speeds = run.t[run.t >= 0], smooth(run, noise_floor(run, paper))[:, 2:]
    assert readings
    for reading in readings:
        # The filter lags by up to five samples: it takes every fifth.
        near = (t > reading.t - 0.006) & (t <= reading.t)
        low, high = speeds[near].min(axis=0) - 0.15, speeds[near].max(axis=0) + 0.15
        assert np.clip(reading.omega, low, high) == pytest.approx(reading.omega), reading.t


@pytest.mark.slow
def test_same_seed_gives_the_same_counts_over_every_link(paper: Rig, tmp_path: Path, bench, agree) -> None:
    swings: list[np.ndarray] = []
    for link in ("pty", "slcan", "tcp:0", "virtual:capture-test"):
        with bench(link=link) as (device, _):
            captured = capture(device, paper, "X2", SHORT, tmp_path / link[:3], confirm=agree)
        counts = load_run(captured.run_file).swing.counts
        assert counts is not None
        swings.append(counts)
    assert len(swings[0]) == 1001
    for other in swings[1:]:
        assert np.array_equal(other, swings[0])


def test_raw_bytes_in_the_file_decode_to_the_same_swing(paper: Rig, tmp_path: Path, bench, agree) -> None:
    from firmware_protocol.framing import FrameDecoder
    from firmware_protocol.messages import decode

    with bench() as (device, _):
        captured = capture(device, paper, "X1", SHORT, tmp_path, confirm=agree)
    with captured.run_file.open("rb") as file:
        raw = b"".join(message.data for _, _, message in make_reader(file).iter_messages("/raw", log_time_order=False))
    samples = [m for m in map(decode, FrameDecoder().feed(raw)) if isinstance(m, Sample)]
    low = np.array([(s.position0, s.position1, s.position2) for s in samples if s.tick >= captured.release_tick])
    counts = load_run(captured.run_file).swing.counts
    assert counts is not None
    assert np.array_equal(low[: len(counts)], counts & 0xFFFF)


def test_a_late_answer_of_the_operator_is_accepted(paper: Rig, tmp_path: Path, bench) -> None:
    answers = iter([None, None, None, True])
    with bench() as (device, _):
        captured = capture(device, paper, "X1", SHORT, tmp_path, confirm=lambda: next(answers))
    assert captured.quality.ok
    assert next(answers, "all were asked") == "all were asked"


@pytest.mark.parametrize("lost", [1, 3])
def test_the_release_is_reported_until_it_is_acknowledged(lost: int, paper: Rig, tmp_path: Path, bench, agree) -> None:
    with bench(fault=(f"lose_events={lost}",)) as (device, _):
        captured = capture(device, paper, "X1", SHORT, tmp_path, confirm=agree)
    assert captured.quality.ok, captured.quality.sentence
    assert load_run(captured.run_file).t[-1] == 1.0
    with captured.run_file.open("rb") as file:
        events = [json.loads(m.data) for _, _, m in make_reader(file).iter_messages("/events")]
    assert [event["kind"] for event in events] == ["RELEASED"]


def test_rate_the_link_cannot_carry_is_refused_before_anything_moves(paper: Rig, tmp_path: Path, bench, agree) -> None:
    with bench(baud=115_200) as (device, spy):
        with pytest.raises(LinkError, match="choose at most 658 Hz or 921600 baud"):
            capture(device, paper, "X1", SHORT, tmp_path, confirm=agree)
        assert NUMBERS[Hold] not in spy.sent
        options = CaptureOptions(rate_hz=500, duration=1.0)
        captured = capture(device, paper, "X1", options, tmp_path, confirm=agree)
    run = load_run(captured.run_file)
    assert (run.rate_hz, len(run.swing.t)) == (500, 501)


def test_unknown_pose_and_foreign_encoders_are_configuration_errors(paper: Rig, tmp_path: Path, bench, agree) -> None:
    coarse = paper.model_copy(update={"encoders": paper.encoders.model_copy(update={"counts_per_rev": (4096,) * 3})})
    with bench() as (device, spy):
        with pytest.raises(ConfigError, match=r"has no pose 'X9'; available: X1, X2, X3"):
            capture(device, paper, "X9", SHORT, tmp_path, confirm=agree)
        with pytest.raises(ConfigError, match=r"counts_per_rev = \[4096, 4096, 4096\], but the device .* \[16384"):
            capture(device, coarse, "X1", SHORT, tmp_path, confirm=agree)
        assert NUMBERS[Hold] not in spy.sent


@pytest.mark.parametrize(
    "wrong",
    [
        {"rate_hz": 0},
        {"rate_hz": -1000},
        {"rate_hz": 1000.5},
        {"duration": -1.0},
        {"duration": 0.0},
        {"duration": float("nan")},
        {"max_duration": float("inf")},
        {"pose_timeout": -1.0},
        {"rest_timeout": 0.0},
    ],
    ids=str,
)
def test_invalid_recording_requests_are_errors_of_the_caller(wrong: dict[str, Any]) -> None:
    (name,) = wrong
    with pytest.raises(ValueError, match=f"{name} = .*: must be a "):
        CaptureOptions(**wrong)


@pytest.mark.slow
def test_two_captures_in_a_row_make_two_files(paper: Rig, tmp_path: Path, bench, agree) -> None:
    options = CaptureOptions(duration=0.5)
    with bench() as (device, _):
        runs: list[Captured] = [
            capture(device, paper, pose, options, tmp_path, confirm=agree) for pose in ("X1", "X1", "X3")
        ]
    assert len(sorted(tmp_path.glob("*.mcap"))) == 3
    assert all(captured.quality.ok for captured in runs)
    first, second = (load_run(captured.run_file).swing.counts for captured in runs[:2])
    assert first is not None
    assert second is not None
    assert not np.array_equal(first, second)  # each release has its own hand and noise


def test_capture_takes_over_a_device_left_streaming(paper: Rig, tmp_path: Path, bench, agree) -> None:
    with bench() as (device, _):
        device.hold(1)
        device.stream(500)
        captured = capture(device, paper, "X1", CaptureOptions(duration=0.5), tmp_path, confirm=agree)
    assert captured.quality.ok, captured.quality.sentence


def test_file_names_are_safe_and_never_taken(tmp_path: Path) -> None:
    first = new_path(tmp_path, "held up/left", "00000000deadbeef")
    assert first.parent == tmp_path
    assert first.name.split("_", 1)[1] == "held-up-left_deadbeef.mcap"
    assert first.name[8] == "T"
    names: set[str] = set()
    for _ in range(4):
        path = new_path(tmp_path, "X1", "00000000deadbeef")
        path.touch()
        names.add(path.name)
    assert len(names) == 4


def test_rig_file_is_stored_as_written(tmp_path: Path, bench, agree) -> None:
    rig = load_rig("paper")
    with bench() as (device, _):
        options = CaptureOptions(duration=0.3, note="first light")
        captured = capture(device, rig, "X1", options, tmp_path, confirm=agree)
    assert load_run(captured.run_file, rig).rig_sha256 == rig.sha256
