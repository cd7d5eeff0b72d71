"""An interrupted capture keeps the recorded data and stops the device if possible."""

import errno
import os
import signal
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dpr_lab.acquisition.batch import Batch
from dpr_lab.acquisition.capture import CaptureOptions, Progress, Released, capture
from dpr_lab.acquisition.holding import raise_faults
from dpr_lab.acquisition.interrupts import unbroken
from dpr_lab.acquisition.recording import Recording
from dpr_lab.acquisition.swing import Captured
from dpr_lab.errors import DeviceFault, DeviceLost, DprError, LeaseLost, LinkError, RunError
from dpr_lab.rig import Rig
from dpr_lab.storage.inspect import recover, verify
from dpr_lab.storage.layout import LIMITS
from dpr_lab.storage.metadata import RunMetadata
from dpr_lab.storage.reader import load_run
from dpr_lab.storage.spool import Spool, check_room
from dpr_lab.storage.writer import RunWriter
from dpr_lab.transports.transport import Received
from firmware_protocol.messages import (
    NUMBERS,
    Ack,
    Event,
    EventKind,
    Fault,
    Frame,
    Info,
    Message,
    Sample,
    State,
    Status,
    Stop,
    decode,
    encode,
)
from firmware_protocol.stream import LATE_IN_A_ROW, Row
from tests.full_disk import full_disk

SHORT = CaptureOptions(duration=1.0, pose_timeout=60.0, rest_timeout=60.0)
LARGEST_CHUNK = LIMITS.chunk_bytes // 5
"""Size of a chunk on the disk. Samples are compressed by a factor of seven."""


@pytest.mark.parametrize(
    ("message", "error", "sentence"),
    [
        (Event(EventKind.FAULT, Fault.LATCH, 5), DeviceFault, "latch did not reach"),
        (Event(EventKind.LEASE_LOST, 0, 5), LeaseLost, "heard nothing from the host"),
        (Status(State.FAULT, Fault.ENCODER1, True, 0, 0, 0), DeviceFault, "inner rod"),
    ],
)
def test_what_the_device_reports_ends_the_capture(message: Message, error: type[DprError], sentence: str) -> None:
    with pytest.raises(error, match=sentence):
        raise_faults("x://", [Batch(0.0, b"", (), (message,))])


@pytest.mark.slow
def test_pulled_cable_leaves_a_partial_run_that_can_be_recovered(paper: Rig, tmp_path: Path, bench, agree) -> None:
    with bench(fault=("cut_after_s=20",)) as (device, _):
        with pytest.raises(DeviceLost) as caught:
            capture(device, paper, "X1", CaptureOptions(duration=200), tmp_path, confirm=agree)
    (path,) = sorted(tmp_path.glob("*.mcap"))
    assert str(path) in str(caught.value)
    run = load_run(path, paper)
    assert not run.complete
    assert run.duration > 0.2
    assert not verify(path).ok
    kept = recover(path, tmp_path / "recovered.mcap")
    assert kept == len(run.t)
    assert np.array_equal(load_run(tmp_path / "recovered.mcap").theta, run.theta)


@pytest.mark.slow
def test_device_that_restarts_is_lost(paper: Rig, tmp_path: Path, bench, agree) -> None:
    with bench(fault=("reset_after_s=20",)) as (device, _):
        with pytest.raises(DeviceLost, match="may have restarted"):
            capture(device, paper, "X1", CaptureOptions(duration=200), tmp_path, confirm=agree)
    assert not load_run(sorted(tmp_path.glob("*.mcap"))[0]).complete


@pytest.mark.slow
def test_ctrl_c_finishes_the_file_stops_the_device_and_passes_on(
    paper: Rig, tmp_path: Path, bench, settled, agree
) -> None:
    def interrupt_soon(progress: Progress) -> None:
        if isinstance(progress, Released):
            threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()

    with bench(clock="realtime") as (device, _):
        with pytest.raises(KeyboardInterrupt):
            capture(device, paper, "X1", CaptureOptions(duration=30), tmp_path, interrupt_soon, agree)
        assert settled(device).state is State.IDLE
    run = load_run(sorted(tmp_path.glob("*.mcap"))[0], paper)
    assert not run.complete
    assert 0.2 < run.duration < 30
    assert any("stopped by the operator" in note for note in run.notes)


def test_an_uninterruptible_block_ends_before_the_interrupt() -> None:
    done: list[str] = []
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        _interrupted_block(done)
    assert done == ["all of it"]
    assert signal.getsignal(signal.SIGINT) is before
    thread = threading.Thread(target=lambda: _quiet_block(done))
    thread.start()
    thread.join()
    assert done == ["all of it", "elsewhere"]


def test_an_interrupt_during_a_failing_uninterruptible_block_is_not_lost() -> None:
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        _interrupted_failure()
    assert signal.getsignal(signal.SIGINT) is before


def _interrupted_failure() -> None:
    with unbroken():
        signal.raise_signal(signal.SIGINT)
        raise DeviceLost("the port is lost")


def _interrupted_block(done: list[str]) -> None:
    with unbroken():
        signal.raise_signal(signal.SIGINT)
        done.append("all of it")


def _quiet_block(done: list[str]) -> None:
    with unbroken():
        done.append("elsewhere")


@pytest.mark.slow
def test_full_disk_is_a_run_error_and_stops_the_device(
    paper: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bench, settled, agree
) -> None:
    disk = full_disk(monkeypatch)

    def fill_disk(progress: Progress) -> None:
        if isinstance(progress, Released):
            disk.room = sum(path.stat().st_size for path in tmp_path.iterdir()) + 2 * LARGEST_CHUNK

    with bench(clock="fast") as (device, _):
        with pytest.raises(RunError, match=r"cannot be written: No space left.* the file is kept"):
            capture(device, paper, "X1", CaptureOptions(duration=200), tmp_path, fill_disk, agree)
        assert settled(device).state is State.IDLE
    assert len(load_run(sorted(tmp_path.glob("*.mcap"))[0]).t) > 500


@pytest.mark.parametrize("ignored", [6, 1000])
def test_a_complete_recording_is_kept_although_the_device_ignores_stop(
    ignored: int, paper: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bench, agree
) -> None:
    """STOP does not reach the device, so the device continues to sample until a later STOP reaches it."""
    with bench(clock="fast") as (device, link):
        stops, forward = list[Frame](), link.send

        def send(frame: Frame) -> None:
            if frame.number == NUMBERS[Stop]:
                stops.append(frame)
            if frame.number != NUMBERS[Stop] or len(stops) > ignored:
                forward(frame)

        def ignore_stop(progress: Progress) -> None:
            if isinstance(progress, Released):
                monkeypatch.setattr(link, "send", send)

        captured = capture(device, paper, "X1", SHORT, tmp_path, ignore_stop, agree)
        device.poll(0)
        streams = any(batch.rows for _ in range(9) for batch in device.poll(1.0))
    assert len({frame.data for frame in stops}) == 2
    assert streams == (ignored > 6)
    assert ("the device may still be sampling" in captured.quality.sentence) == streams
    assert "the recording is complete, but " in captured.quality.sentence
    assert "STOP was sent 6 times and the device did not answer" in captured.quality.sentence
    assert_complete(captured)


def test_a_complete_recording_is_kept_although_the_port_is_lost_after_stop(
    paper: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bench, agree
) -> None:
    with bench(clock="fast") as (device, link):
        stopped, read = list[Message](), link.receive

        def receive(timeout: float) -> Received:
            if stopped:
                raise DeviceLost("the port is lost (unplugged)")
            received = read(timeout)
            messages = [decode(frame) for frame in received.frames if frame.number == NUMBERS[Ack]]
            stopped.extend(m for m in messages if isinstance(m, Ack) and m.command == NUMBERS[Stop])
            return received

        def pull_after_stop(progress: Progress) -> None:
            if isinstance(progress, Released):
                monkeypatch.setattr(link, "receive", receive)

        captured = capture(device, paper, "X1", SHORT, tmp_path, pull_after_stop, agree)
        with pytest.raises(DeviceLost):
            device.stop()
    assert "the recording is complete, but the port is lost (unplugged)" in captured.quality.sentence
    assert_complete(captured)


@pytest.mark.parametrize(
    ("event", "sentence"),
    [
        (Event(EventKind.FAULT, Fault.LATCH, 5), "latch did not reach"),
        (Event(EventKind.LEASE_LOST, 0, 5), "heard nothing from the host"),
    ],
)
def test_a_complete_recording_is_kept_although_the_device_reports_a_fault_after_stop(
    event: Event, sentence: str, paper: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bench, agree
) -> None:
    with bench(clock="fast") as (device, _):
        stop, poll = device.stop, device.poll
        fault = Batch(0.0, b"", (), (event,))

        def stop_with_a_fault() -> None:
            stop()
            monkeypatch.setattr(device, "poll", lambda timeout: [*poll(timeout), fault])

        def arm(progress: Progress) -> None:
            if isinstance(progress, Released):
                monkeypatch.setattr(device, "stop", stop_with_a_fault)

        captured = capture(device, paper, "X1", SHORT, tmp_path, arm, agree)
    assert "the recording is complete, but " in captured.quality.sentence
    assert sentence in captured.quality.sentence
    assert_complete(captured)


@pytest.mark.parametrize(
    ("last", "sentence"),
    [
        ([encode(Info(2, {"uid_low": 7}))], "two devices answer"),
        ([encode(Sample(3, 0, 0, 0))] * LATE_IN_A_ROW, "ticks of the device decreased"),
    ],
)
def test_a_recording_whose_samples_are_in_doubt_after_stop_is_not_complete(
    last: list[Frame], sentence: str, paper: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bench, agree
) -> None:
    with bench(clock="fast") as (device, link):
        read = link.receive

        def receive(timeout: float) -> Received:
            received = read(timeout)
            stopped = any(isinstance(m, Ack) and m.command == NUMBERS[Stop] for m in map(decode, received.frames))
            return replace(received, frames=(*received.frames, *last)) if stopped else received

        def doubt_after_stop(progress: Progress) -> None:
            if isinstance(progress, Released):
                monkeypatch.setattr(link, "receive", receive)

        with pytest.raises(LinkError, match=rf"{sentence}.* the data recorded so far are kept in"):
            capture(device, paper, "X1", SHORT, tmp_path, doubt_after_stop, agree)
    (path,) = tmp_path.glob("*.mcap")
    assert not load_run(path).complete


def assert_complete(captured: Captured) -> None:
    assert captured.quality.ok, captured.quality.sentence
    run = load_run(captured.run_file)
    assert run.complete
    assert len(run.swing.t) == 1001


def test_a_full_disk_of_the_temporary_file_names_the_run_file_and_its_recovery(
    paper: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Spool, "extend", full)
    batch = Batch(0.0, b"", tuple(Row(tick, (0, 0, 0)) for tick in range(3)), ())
    with (
        RunWriter(tmp_path / "a.mcap", RunMetadata(paper, "X1", 1000)) as writer,
        Recording(writer, {}, 1.0) as recording,
        pytest.raises(RunError, match=r"a\.mcap: cannot be written: No space.* 3 samples .*run recover .*a\.mcap"),
    ):
        recording.add([batch])


def test_a_folder_for_runs_that_cannot_be_made_is_reported_with_its_remedy(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RunError, match=r"file.runs: cannot be written: Not a directory: choose another folder"):
        check_room(tmp_path / "file" / "runs", 10)


@pytest.mark.slow
def test_slow_disk_loses_nothing(paper: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bench, agree) -> None:
    write = RunWriter.samples

    def slow(writer: RunWriter, *arguments: Any) -> None:
        time.sleep(0.15)
        write(writer, *arguments)

    monkeypatch.setattr(RunWriter, "samples", slow)
    with bench(clock="realtime") as (device, _):
        captured = capture(device, paper, "X1", CaptureOptions(duration=1.0), tmp_path, confirm=agree)
    assert captured.quality.ok, captured.quality.sentence
    assert len(load_run(captured.run_file).swing.t) == 1001
