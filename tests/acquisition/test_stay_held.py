"""Rods that are not at their pose, not at rest, or without a release command stay held."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.acquisition.batch import Batch
from dpr_lab.acquisition.capture import CaptureOptions, Progress, capture
from dpr_lab.acquisition.holding import HeldPose, PoseReading, RestWindow
from dpr_lab.acquisition.settings import CAPTURE_SETTINGS
from dpr_lab.errors import SafetyStop
from dpr_lab.rig import Rig
from firmware_protocol.messages import NUMBERS, Fault, Release, State, Status
from firmware_protocol.stream import Row

PLACED_S = 2.0
"""Time after which the rods are at rest, s. They move for half a second; a busy machine detects this later."""
SHORT = CaptureOptions(duration=1.0, pose_timeout=60.0, rest_timeout=60.0)


def test_rods_off_the_pose_are_never_released(paper: Rig, tmp_path: Path, bench, settled, agree) -> None:
    seen: list[Progress] = []
    options = CaptureOptions(pose_timeout=PLACED_S)
    with bench(hand_error=0.3) as (device, spy):
        with pytest.raises(SafetyStop, match=r"rod is \+0\.\d+ rad away, tolerance 0.05 rad; nothing was released"):
            capture(device, paper, "X1", options, tmp_path, seen.append, agree)
        status = settled(device)
    assert (status.state, status.latched) == (State.HOLDING, True)
    assert NUMBERS[Release] not in spy.sent
    assert sorted(tmp_path.glob("*.mcap")) == []
    readings = [reading for reading in seen if isinstance(reading, PoseReading)]
    assert readings
    assert not any(reading.ok for reading in readings)
    assert max(readings[-1].error) == pytest.approx(0.3, abs=0.06)


def test_without_a_go_ahead_nothing_is_released(paper: Rig, tmp_path: Path, bench, settled) -> None:
    with bench() as (device, spy):
        with pytest.raises(SafetyStop, match="the release was not permitted; nothing was released, the rods stay held"):
            capture(device, paper, "X1", SHORT, tmp_path)
        status = settled(device)
    assert (status.state, status.latched) == (State.HOLDING, True)
    assert NUMBERS[Release] not in spy.sent
    assert sorted(tmp_path.glob("*.mcap")) == []


class Script:
    """Substitute for a device: each poll returns the next second of samples, with an error of the outer rod."""

    url = "script://"
    status = Status(State.STREAMING, Fault.NONE, latched=True, overruns=0, dropped=0, sent=0)
    silence_s = 1.0

    def __init__(self, rig: Rig, pose: str, offsets: list[float], shaking: float = 0.0) -> None:
        self._batches: list[Batch] = []
        for second, offset in enumerate(offsets):
            theta = np.tile(rig.poses[pose].theta, (1000, 1))
            theta[:, 2] += offset + shaking * (-1) ** np.arange(1000)
            counts = np.round(rig.positions(theta)).astype(int).tolist()
            rows = tuple(Row(1000 * second + tick, tuple(row)) for tick, row in enumerate(counts))
            self._batches.append(Batch(float(second), b"", rows, ()))

    def poll(self, timeout: float) -> list[Batch]:
        batch = self._batches.pop(0) if len(self._batches) > 1 else self._batches[0]
        return [replace(batch, host_time=time.monotonic())]


def test_only_the_newest_second_of_the_wait_is_kept(paper: Rig) -> None:
    window = RestWindow(1000, window_s=1.0)
    script = Script(paper, "X1", [0.0] * 20)
    for _ in range(20):
        window.add(script.poll(0))
    assert [batch.rows[0].tick for batch in window.batches] == [18_000, 19_000]
    motion = window.motion(paper)
    assert motion is not None
    assert motion[0][-1] == 19.999


def test_losses_in_batches_that_arrive_together_are_counted_at_their_place() -> None:
    """A busy host reads several batches at once. Only losses within the window count for the recording."""
    window = RestWindow(1000, window_s=1.0)
    rows = [tuple(Row(tick, (0, 0, 0)) for tick in range(first, first + 1000)) for first in (0, 1000, 2000, 3000)]
    window.add(Batch(float(at), b"", row, (), {"torque": 5 * at}) for at, row in enumerate(rows))
    assert window.batches[0].rows[0].tick == 2000
    assert window.lost_before == {"torque": 10}


def test_rods_knocked_while_the_operator_thinks_are_not_released(paper: Rig) -> None:
    script = Script(paper, "X1", [0.0, 0.0, 0.2])
    held = HeldPose(script, paper, paper.poses["X1"], 1000, lambda reading: None, CAPTURE_SETTINGS)  # pyright: ignore[reportArgumentType]
    held.await_rest(1.0)
    answers = iter([None, True])
    with pytest.raises(SafetyStop, match=r"the release was permitted, but the rods (still moved|were .* away)"):
        held.await_go_ahead(lambda: next(answers))


def test_rods_that_do_not_come_to_rest_are_not_released(paper: Rig) -> None:
    script = Script(paper, "X1", [0.0, 0.0], shaking=0.01)
    held = HeldPose(script, paper, paper.poses["X1"], 1000, lambda reading: None, CAPTURE_SETTINGS)  # pyright: ignore[reportArgumentType]
    with pytest.raises(SafetyStop, match=r"after 0\.1 s the rods still moved.* stay held"):
        held.await_rest(0.1)
