"""Recorder process: its reaction to commands, and its end if the screen is lost."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import TypeVar

import numpy as np
import pytest

from dpr_lab.acquisition.capture import CaptureOptions, SwingReading
from dpr_lab.acquisition.device import Device
from dpr_lab.storage.inspect import recover, verify
from dpr_lab.storage.reader import load_run
from dpr_lab.transports import open_transport
from dpr_lab.tui.recorder.guided_capture import _GuidedCapture
from dpr_lab.tui.recorder.messages import (
    AttemptFinished,
    AttemptSeen,
    CancelAttempt,
    CaptureAttempt,
    Connected,
    GoAhead,
    GoAheadAsked,
    RecorderFailed,
    RecorderReport,
)
from dpr_lab.tui.recorder.process import _IdleWatch
from dpr_lab.tui.recorder.recorder import Recorder
from firmware_protocol.messages import Position, State

PATIENCE_S = 60.0
CHUNK_S = 0.25

Kind = TypeVar("Kind")


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[Callable[..., Recorder]]:
    made: list[Recorder] = []

    def make(url: str, rig: str = "paper") -> Recorder:
        made.append(Recorder(url, rig, tmp_path / "runs", tmp_path / "recorder.log"))
        return made[-1]

    yield make
    for each in made:
        each.close()


def await_report(recorder: Recorder, kind: type[Kind], suits: Callable[[Kind], bool] = lambda report: True) -> Kind:
    seen: list[RecorderReport] = []
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        for report in recorder.reports():
            seen.append(report)
            if isinstance(report, kind) and suits(report):
                return report
        time.sleep(0.01)
    raise AssertionError(f"no {kind.__name__}; the last reports were {seen[-3:]}")


def asked(recorder: Recorder, options: CaptureOptions) -> None:
    await_report(recorder, Connected)
    recorder.tell(CaptureAttempt(1, "X1", options))
    await_report(recorder, GoAheadAsked)


def state_of(url: str) -> tuple[State, bool]:
    with Device(open_transport(url)) as device:
        device.connect()
        while device.status is None:
            device.poll(0.1)
        return device.status.state, device.status.latched


def test_only_a_fresh_go_ahead_for_this_very_attempt_releases(recorder, tmp_path: Path, rig) -> None:
    process = recorder(rig(clock="fast"))
    await_report(process, Connected)
    process.tell(CaptureAttempt(1, "X1", CaptureOptions(duration=0.5)))
    process.tell(GoAhead(1, "X1", time.monotonic()))  # before it was asked for
    await_report(process, GoAheadAsked)
    process.tell(GoAhead(2, "X1", time.monotonic()))
    process.tell(GoAhead(1, "X2", time.monotonic()))
    process.tell(GoAhead(1, "X1", time.monotonic() - 60))
    for _ in range(5):
        await_report(process, AttemptSeen)
    assert list((tmp_path / "runs").glob("*.mcap")) == []
    process.tell(GoAhead(1, "X1", time.monotonic()))
    finished = await_report(process, AttemptFinished)
    assert finished.captured.quality.ok


def test_points_of_a_swing_that_found_no_room_are_sent_with_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    # A screen that was late drew a dot here and there in the place of a line.
    room, sent = [True, False, False, True], []

    def add(report: AttemptSeen) -> bool:
        sent.append(report.progress)
        return room[len(sent) - 1]

    device = SimpleNamespace(losses={}, status=None, heard_at=0.0)
    inbox = SimpleNamespace(why_to_end=lambda attempt: "")
    order = CaptureAttempt(1, "X1", CaptureOptions())
    guided = _GuidedCapture(order, device, inbox, SimpleNamespace(add_if_read=add))  # pyright: ignore[reportArgumentType]
    t = np.delete(np.arange(400) / 1000, [101])  # the second sample of a report was lost
    for piece in np.split(t, [100, 199, 299]):
        fresh = piece, np.zeros((len(piece), 3))
        guided.on_progress(SwingReading(piece[-1], (0, 0, 0), (0, 0), 0, fresh, inputs=2 * piece))
    assert [len(each.fresh[0]) for each in sent] == [10, 10, 20, 30]
    last = sent[-1].fresh[0]
    assert np.array_equal(sent[-1].inputs, 2 * last)
    assert last[0] == 0.1
    assert np.diff(last).max() < 0.012


@pytest.mark.slow
def test_a_driven_arm_is_recorded_with_its_input(recorder, simulated) -> None:
    device = simulated(rig="furuta", plant="furuta", clock="realtime")
    process = recorder(device.url, "furuta")
    connected = await_report(process, Connected)
    assert (connected.rods, connected.problem) == (1, "")
    assert "70,000" not in connected.loads[0]  # a sample and both inputs: three frames
    process.tell(CaptureAttempt(1, "X1", CaptureOptions(duration=1.0)))
    await_report(process, GoAheadAsked)
    process.tell(GoAhead(1, "X1", time.monotonic()))
    swing = await_report(process, AttemptSeen, lambda report: isinstance(report.progress, SwingReading)).progress
    assert isinstance(swing, SwingReading)
    assert swing.inputs is not None
    assert len(swing.inputs) == len(swing.fresh[0])
    assert await_report(process, AttemptFinished).captured.quality.ok


def test_rods_at_rest_are_reported_twice_a_second_without_their_noise(paper) -> None:
    device = SimpleNamespace(status=SimpleNamespace(latched=False), heard_at=0.0)
    result: list = []
    watch = _IdleWatch(device, paper, SimpleNamespace(add_if_read=result.append))  # pyright: ignore[reportArgumentType]

    def hear(at: float, *counts: int) -> None:
        device.heard_at = at
        messages = tuple(Position(joint, 0, count) for joint, count in enumerate(counts))
        device.poll = lambda seconds: [SimpleNamespace(messages=messages)]
        watch.look()

    for number in range(10):
        hear(0.1 * number, 0, number % 3, -(number % 2))
    assert [report.at for report in result] == [0.0, 0.5]
    assert result[0].theta == result[1].theta
    hear(0.95, 0, 40, 0)
    assert result[-1].at == 0.95
    assert result[-1].theta[1] > result[0].theta[1]
    device.status.latched = True
    hear(0.99, 0, 40, 0)
    assert (result[-1].at, result[-1].latched) == (0.99, True)


@pytest.mark.slow
def test_a_cancelled_recording_is_kept_as_incomplete(recorder, tmp_path: Path, rig) -> None:
    process = recorder(rig())
    asked(process, CaptureOptions(duration=60.0))
    process.tell(GoAhead(1, "X1", time.monotonic()))
    seen = await_report(process, AttemptSeen, lambda report: isinstance(report.progress, SwingReading)).progress.samples
    process.tell(CancelAttempt(1))
    failed = await_report(process, RecorderFailed)
    assert "stopped by the operator; the data recorded so far are kept in" in failed.message
    assert failed.alive
    (partial,) = (tmp_path / "runs").glob("*.mcap")
    assert verify(partial).faults[0].startswith("the recording was not completed")
    assert recover(partial, tmp_path / "whole.mcap") >= seen


@pytest.mark.long
def test_a_screen_that_does_not_read_costs_no_sample(recorder, rig) -> None:
    process = recorder(rig())
    asked(process, CaptureOptions(duration=4.0))
    process.tell(GoAhead(1, "X1", time.monotonic()))
    time.sleep(5)  # the screen hangs; more comes than the pipe holds
    captured = await_report(process, AttemptFinished).captured
    assert sum(captured.lost.values()) == 0
    assert captured.duration == 4.0
    assert captured.quality.ok


@pytest.mark.slow
def test_without_a_screen_nothing_is_released(recorder, rig, tmp_path: Path) -> None:
    url = rig()
    process = recorder(url)
    asked(process, CaptureOptions(duration=1.0))
    process.tell(GoAhead(1, "X1", time.monotonic() - 60))
    process.close()
    assert state_of(url) == (State.HOLDING, True)
    assert list((tmp_path / "runs").glob("*.mcap")) == []


BENCH = """
import asyncio, sys, time
from pathlib import Path
from multiprocessing import active_children
from dpr_lab.acquisition.capture import CaptureOptions
from dpr_lab.tui.app import DprApp
from dpr_lab.tui.workspace import Workspace
from dpr_lab.tui.recorder.attempt import Phase
from dpr_lab.tui.steps.capture import CaptureStep
from dpr_lab.tui.widgets.countdown import Countdown

class Watched:
    multiplexer = ""
    async def seen(self, patience_s):
        return 0.0

async def operate(pilot):
    async def until(condition):
        while not condition():
            await pilot.pause(0.02)
    app, step = pilot.app, pilot.app.query_one(CaptureStep)
    await app.services.connect()
    await until(lambda: app.device.connected)
    await pilot.press("3")
    step.options = CaptureOptions(duration=600.0, pose_timeout=600.0, rest_timeout=60.0)
    await pilot.press("s")
    await until(lambda: step.attempt.phase is Phase.READY)
    await pilot.press("r")
    await until(lambda: step.attempt.recorded is not None)
    print("recorder", active_children()[0].pid, file=sys.__stdout__, flush=True)
    while True:
        print(step.attempt.recorded.t, file=sys.__stdout__, flush=True)
        await pilot.pause(0.05)

if __name__ == "__main__":
    Countdown.SECOND_S = 0.05
    folder = Path(sys.argv[1])
    app = DprApp(Workspace(link=sys.argv[2], out=folder / "bench"), folder / "state", sight=Watched())
    app.run(headless=True, size=(80, 24), auto_pilot=operate)
"""


@pytest.fixture
def bench(tmp_path: Path, cable) -> Iterator[tuple[subprocess.Popen[str], int, Path]]:
    """Screen in a separate process that records at 1 kHz: the process, its recorder and the folder of runs."""
    script = tmp_path / "bench_screen.py"
    script.write_text(BENCH)
    process = subprocess.Popen(
        [sys.executable, script, tmp_path, cable().url], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    word, _, pid = process.stdout.readline().partition(" ")
    assert word == "recorder", process.communicate()[1][-2000:]
    yield process, int(pid), tmp_path / "bench" / "runs"
    process.kill()
    process.communicate()


def recorded_until(process: subprocess.Popen[str], t: float) -> float:
    """Read the screen until its recording has a given duration, and return the displayed time."""
    assert process.stdout is not None
    while (shown := float(process.stdout.readline())) < t:
        pass
    return shown


def gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"


def ends(pid: int) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not gone(pid):
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="reads /proc")
@pytest.mark.slow
def test_a_killed_screen_leaves_a_finished_file_and_a_free_port(bench, tmp_path: Path) -> None:
    process, pid, runs = bench
    shown = recorded_until(process, 1.0)
    process.kill()
    ends(pid)
    (file,) = runs.glob("*.mcap")
    run = load_run(file)
    assert not run.complete
    assert run.t[-1] >= shown
    assert any("the screen has ended" in fault for fault in verify(file).faults)
    state, _ = state_of(f"serial://{tmp_path / 'ttyRIG'}?baud=921600")
    assert state is State.IDLE


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="reads /proc")
@pytest.mark.long
def test_screen_and_recorder_killed_together_cost_one_chunk_at_most(bench, tmp_path: Path) -> None:
    process, pid, runs = bench
    shown = recorded_until(process, 1.0)
    os.kill(pid, signal.SIGKILL)
    process.kill()
    ends(pid)
    (file,) = runs.glob("*.mcap")
    assert not load_run(file).complete
    recover(file, tmp_path / "whole.mcap")
    assert load_run(tmp_path / "whole.mcap").t[-1] >= shown - CHUNK_S
