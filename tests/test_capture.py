import json
import os
import resource
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from dpr_lab.capture import Captured, CaptureOptions, Progress, Recorded, Released, capture, new_path
from dpr_lab.device import Batch, Device
from dpr_lab.errors import ConfigError, DeviceFault, DeviceLost, DprError, LinkError, RunError, SafetyStop
from dpr_lab.holding import HangReading, Held, PoseReading, RestReading, RestWindow, raise_faults
from dpr_lab.interrupts import unbroken
from dpr_lab.rig import Rig, load_rig
from dpr_lab.storage.inspect import recover, verify
from dpr_lab.storage.reader import load_run
from dpr_lab.storage.writer import RunWriter
from dpr_lab.transports import open_transport
from dpr_lab.transports.transport import Capacity, Received, Transport
from firmware_protocol.messages import (
    NUMBERS,
    Event,
    EventKind,
    Fault,
    Frame,
    Hold,
    Message,
    Release,
    Sample,
    State,
    Status,
)
from firmware_protocol.stream import Row
from sim_device.assemble import Options, assemble
from sim_device.serve import serve

SHORT = CaptureOptions(duration=2.0, pose_timeout=3.0, rest_timeout=3.0)


class Spy:
    """A transport that notes the numbers of what was sent, and can lose samples on the way in."""

    def __init__(self, inner: Transport, lose_every: int = 0) -> None:
        self.inner = inner
        self.sent: list[int] = []
        self.releases: set[bytes] = set()
        self.lost = 0
        self._lose_every = lose_every
        self._samples = 0

    @property
    def url(self) -> str:
        return self.inner.url

    @property
    def errors(self) -> dict[str, int]:
        return self.inner.errors

    @property
    def capacities(self) -> tuple[Capacity, ...]:
        return self.inner.capacities

    def send(self, frame: Frame) -> None:
        self.sent.append(frame.number)
        if frame.number == NUMBERS[Release]:
            self.releases.add(frame.data)
        self.inner.send(frame)

    def receive(self, timeout: float) -> Received:
        received = self.inner.receive(timeout)
        return Received(received.host_time, tuple(filter(self._arrives, received.frames)), received.raw)

    def close(self) -> None:
        self.inner.close()

    def _arrives(self, frame: Frame) -> bool:
        if frame.number != NUMBERS[Sample] or not self._lose_every:
            return True
        self._samples += 1
        lost = self._samples % self._lose_every == 0
        self.lost += lost
        return not lost


@contextmanager
def bench(lose_every: int = 0, **options: Any) -> Iterator[tuple[Device, Spy]]:
    """A simulated device in a thread, connected, with a spy on its link."""
    board, link, faults = assemble(Options(**{"clock": "fast", "seed": 1, **options}))
    stop = threading.Event()
    thread = threading.Thread(target=serve, args=(board, link, faults, stop.is_set))
    thread.start()
    try:
        spy = Spy(open_transport(link.line.url), lose_every)
        with Device(spy) as device:
            device.connect()
            yield device, spy
    finally:
        stop.set()
        thread.join()


def settled(device: Device) -> Status:
    """The device's status once it no longer streams."""
    deadline = time.monotonic() + 5
    while time.monotonic() < deadline:
        statuses = [m for batch in device.poll(0.3) for m in batch.messages if isinstance(m, Status)]
        if statuses and statuses[-1].state in (State.HOLDING, State.IDLE):
            return statuses[-1]
    raise AssertionError("the device did not settle")


def agree() -> bool:
    return True


def run_files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.mcap"))


@pytest.mark.parametrize("pose", ["X1", "X2", "X3"])
def test_capture_leads_from_pose_to_a_judged_complete_run(pose: str, paper: Rig, tmp_path: Path) -> None:
    seen: list[Progress] = []
    with bench() as (device, spy):
        captured = capture(device, paper, pose, SHORT, tmp_path, seen.append, agree)
        assert settled(device).state is State.IDLE
    assert captured.verdict.ok, captured.verdict.sentence
    assert [
        kind for kind in (PoseReading, RestReading, Released, Recorded) if not any(isinstance(s, kind) for s in seen)
    ] == []
    assert len(spy.releases) == 1  # however often it was repeated
    run = load_run(captured.run_file, paper)
    assert run.complete
    assert (run.pose, run.rate_hz, captured.duration) == (pose, 1000, 2.0)
    assert run.t[-1] == 2.0
    assert run.t[0] < -0.9
    assert np.array_equal(np.round(np.diff(run.t) * 1000), np.ones(len(run.t) - 1))
    assert captured.pose_measured == pytest.approx(run.rest.mean(axis=0), abs=1e-6)
    assert captured.pose_measured == pytest.approx(paper.poses[pose].theta, abs=paper.poses[pose].tolerance)
    assert verify(captured.run_file).ok
    assert sum(captured.lost.values()) == sum(run.lost.values()) == 0


def test_same_seed_gives_the_same_counts_over_every_link(paper: Rig, tmp_path: Path) -> None:
    swings: list[np.ndarray] = []
    for link in ("pty", "slcan", "tcp:0", "virtual:capture-test"):
        with bench(link=link) as (device, _):
            captured = capture(device, paper, "X2", SHORT, tmp_path / link[:3], confirm=agree)
        counts = load_run(captured.run_file).swing.counts
        assert counts is not None
        swings.append(counts)
    assert len(swings[0]) == 2001
    for other in swings[1:]:
        assert np.array_equal(other, swings[0])


def test_raw_bytes_in_the_file_decode_to_the_same_swing(paper: Rig, tmp_path: Path) -> None:
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


def test_rods_off_the_pose_are_never_released(paper: Rig, tmp_path: Path) -> None:
    seen: list[Progress] = []
    options = CaptureOptions(pose_timeout=0.6)
    with bench(hand_error=0.3) as (device, spy):
        with pytest.raises(SafetyStop, match=r"rod is \+0\.\d+ rad off, tolerance 0.05 rad; nothing was released"):
            capture(device, paper, "X1", options, tmp_path, seen.append, agree)
        status = settled(device)
    assert (status.state, status.latched) == (State.HOLDING, True)
    assert NUMBERS[Release] not in spy.sent
    assert run_files(tmp_path) == []
    readings = [reading for reading in seen if isinstance(reading, PoseReading)]
    assert readings
    assert not any(reading.ok for reading in readings)
    assert max(readings[-1].error) == pytest.approx(0.3, abs=0.06)


def test_without_a_go_ahead_nothing_is_released(paper: Rig, tmp_path: Path) -> None:
    with bench() as (device, spy):
        with pytest.raises(SafetyStop, match="no go-ahead was given; nothing was released, the rods stay held"):
            capture(device, paper, "X1", SHORT, tmp_path)
        status = settled(device)
    assert (status.state, status.latched) == (State.HOLDING, True)
    assert NUMBERS[Release] not in spy.sent
    assert run_files(tmp_path) == []


def test_an_answer_may_take_its_time(paper: Rig, tmp_path: Path) -> None:
    answers = iter([None, None, None, True])
    with bench() as (device, _):
        captured = capture(device, paper, "X1", SHORT, tmp_path, confirm=lambda: next(answers))
    assert captured.verdict.ok
    assert next(answers, "all were asked") == "all were asked"


class Script:
    """Stands in for a device: a poll gives the next second of samples, the outer rod that far off the pose."""

    url = "script://"

    def __init__(self, rig: Rig, pose: str, offsets: list[float], shaking: float = 0.0) -> None:
        self.losses = {"tick_gap": 0}
        self._batches: list[Batch] = []
        for second, offset in enumerate(offsets):
            theta = np.tile(rig.poses[pose].theta, (1000, 1))
            theta[:, 2] += offset + shaking * (-1) ** np.arange(1000)
            counts = np.round(rig.positions(theta)).astype(int).tolist()
            rows = tuple(Row(1000 * second + tick, tuple(row)) for tick, row in enumerate(counts))
            self._batches.append(Batch(float(second), b"", rows, ()))

    def poll(self, timeout: float) -> list[Batch]:
        return [self._batches.pop(0) if len(self._batches) > 1 else self._batches[0]]


def test_only_the_newest_second_of_the_wait_is_kept(paper: Rig) -> None:
    window = RestWindow(1000)
    script = Script(paper, "X1", [0.0] * 20)
    for _ in range(20):
        window.add(script.poll(0), script.losses)
    assert [batch.rows[0].tick for batch in window.batches] == [18_000, 19_000]
    motion = window.motion(paper)
    assert motion is not None
    assert motion[0][-1] == 19.999


def test_rods_knocked_while_the_operator_thinks_are_not_released(paper: Rig) -> None:
    held = Held(Script(paper, "X1", [0.0, 0.0, 0.2]), paper, paper.poses["X1"], RestWindow(1000), lambda reading: None)
    held.await_rest(1.0)
    answers = iter([None, True])
    with pytest.raises(SafetyStop, match=r"at the go-ahead the rods (still moved|were .* off)"):
        held.await_go_ahead(lambda: next(answers))


def test_rods_that_do_not_come_to_rest_are_not_released(paper: Rig) -> None:
    script = Script(paper, "X1", [0.0, 0.0], shaking=0.01)
    held = Held(script, paper, paper.poses["X1"], RestWindow(1000), lambda reading: None)
    with pytest.raises(SafetyStop, match=r"after 0\.1 s the rods still moved.* stay held"):
        held.await_rest(0.1)


@pytest.mark.parametrize(
    ("message", "error", "sentence"),
    [
        (Event(EventKind.FAULT, Fault.LATCH, 5), DeviceFault, "latch did not reach"),
        (Event(EventKind.LEASE_LOST, 0, 5), LinkError, "heard nothing from the host"),
        (Status(State.FAULT, Fault.ENCODER1, True, 0, 0, 0), DeviceFault, "inner rod"),
    ],
)
def test_what_the_device_reports_ends_the_capture(message: Message, error: type[DprError], sentence: str) -> None:
    with pytest.raises(error, match=sentence):
        raise_faults("x://", [Batch(0.0, b"", (), (message,))])


def test_pulled_cable_leaves_a_partial_run_that_can_be_recovered(paper: Rig, tmp_path: Path) -> None:
    with bench(fault=("cut_after_s=20",)) as (device, _):
        with pytest.raises(DeviceLost) as caught:
            capture(device, paper, "X1", CaptureOptions(duration=60), tmp_path, confirm=agree)
    (path,) = run_files(tmp_path)
    assert str(path) in str(caught.value)
    run = load_run(path, paper)
    assert not run.complete
    assert run.duration > 0.2
    assert not verify(path).ok
    kept = recover(path, tmp_path / "recovered.mcap")
    assert kept == len(run.t)
    assert np.array_equal(load_run(tmp_path / "recovered.mcap").theta, run.theta)


def test_device_that_restarts_is_lost(paper: Rig, tmp_path: Path) -> None:
    with bench(fault=("reset_after_s=20",)) as (device, _):
        with pytest.raises(DeviceLost, match="may have restarted"):
            capture(device, paper, "X1", CaptureOptions(duration=60), tmp_path, confirm=agree)
    assert not load_run(run_files(tmp_path)[0]).complete


def test_ctrl_c_finishes_the_file_stops_the_device_and_passes_on(paper: Rig, tmp_path: Path) -> None:
    def interrupt_soon(progress: Progress) -> None:
        if isinstance(progress, Released):
            threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()

    with bench(clock="realtime") as (device, _):
        with pytest.raises(KeyboardInterrupt):
            capture(device, paper, "X1", CaptureOptions(duration=30), tmp_path, interrupt_soon, agree)
        assert settled(device).state is State.IDLE
    run = load_run(run_files(tmp_path)[0], paper)
    assert not run.complete
    assert 0.2 < run.duration < 1.0
    assert any("KeyboardInterrupt" in note for note in run.notes)


def test_unbroken_block_ends_before_the_interrupt() -> None:
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


def _interrupted_block(done: list[str]) -> None:
    with unbroken():
        signal.raise_signal(signal.SIGINT)
        done.append("all of it")


def _quiet_block(done: list[str]) -> None:
    with unbroken():
        done.append("elsewhere")


def test_full_disk_is_a_run_error_and_stops_the_device(paper: Rig, tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill_disk(progress: Progress) -> None:
        if isinstance(progress, Released):
            resource.setrlimit(resource.RLIMIT_FSIZE, (120_000, hard))

    with bench(clock="realtime") as (device, _):
        try:
            with pytest.raises(RunError, match=r"cannot be written: File too large.* the file is kept"):
                capture(device, paper, "X1", CaptureOptions(duration=60), tmp_path, fill_disk, agree)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert settled(device).state is State.IDLE
    assert len(load_run(run_files(tmp_path)[0]).t) > 500


def test_slow_disk_loses_nothing(paper: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write = RunWriter.samples

    def slow(writer: RunWriter, *arguments: Any) -> None:
        time.sleep(0.15)
        write(writer, *arguments)

    monkeypatch.setattr(RunWriter, "samples", slow)
    with bench(clock="realtime") as (device, _):
        captured = capture(device, paper, "X1", CaptureOptions(duration=1.0), tmp_path, confirm=agree)
    assert captured.verdict.ok, captured.verdict.sentence
    assert len(load_run(captured.run_file).swing.t) == 1001


def test_lost_samples_are_counted_and_degrade_the_run(paper: Rig, tmp_path: Path) -> None:
    with bench(lose_every=50) as (device, _):
        captured = capture(device, paper, "X1", SHORT, tmp_path, confirm=agree)
    run = load_run(captured.run_file)
    missing = round(float(run.t[-1] - run.t[0]) * 1000) + 1 - len(run.t)
    assert missing > 30
    assert captured.lost == run.lost == {"device_overrun": 0, "crc": 0, "framing": 0, "tick_gap": missing}
    assert [check.name for check in captured.verdict.checks if not check.ok] == ["lost"]
    assert "tick_gap" in captured.verdict.sentence
    assert run.complete


@pytest.mark.parametrize("joint", [1, 2])
def test_stuck_encoder_degrades_the_run(joint: int, paper: Rig, tmp_path: Path) -> None:
    with bench(fault=(f"stuck_encoder={joint}",)) as (device, _):
        captured = capture(device, paper, "X1", SHORT, tmp_path, confirm=agree)
    assert "moved" in [check.name for check in captured.verdict.checks if not check.ok]
    assert f"encoder {joint} moved" in captured.verdict.sentence
    assert load_run(captured.run_file).complete


def test_how_the_rods_hang_is_seen_before_they_are_raised(paper: Rig, tmp_path: Path) -> None:
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
        assert captured.verdict.checks[0].name == "hanging_before"
        seen.clear()
        again = capture(device, paper, "X1", SHORT, tmp_path / "runs", seen.append, agree)
        assert not any(isinstance(reading, HangReading) for reading in seen)  # the rods still swing
        assert again.verdict.ok
    with bench() as (device, _):
        seen.clear()
        options = CaptureOptions(duration=0.5, pose_timeout=1.0)
        with pytest.raises(SafetyStop, match="off, tolerance"):
            capture(device, load_rig(askew), "X1", options, tmp_path / "runs", seen.append, agree)
    (hanging,) = (reading for reading in seen if isinstance(reading, HangReading))
    assert not hanging.ok
    assert hanging.error == pytest.approx((-0.1, -0.1), abs=1e-3)


@pytest.mark.parametrize("lost", [1, 3])
def test_the_release_is_told_until_it_is_heard(lost: int, paper: Rig, tmp_path: Path) -> None:
    with bench(fault=(f"lose_events={lost}",)) as (device, _):
        captured = capture(device, paper, "X1", SHORT, tmp_path, confirm=agree)
    assert captured.verdict.ok, captured.verdict.sentence
    assert load_run(captured.run_file).t[-1] == 2.0
    with captured.run_file.open("rb") as file:
        events = [json.loads(m.data) for _, _, m in make_reader(file).iter_messages("/events")]
    assert [event["kind"] for event in events] == ["RELEASED"]


def test_samples_the_board_was_too_late_for_are_counted_as_its_own(paper: Rig, tmp_path: Path) -> None:
    with bench(fault=("overrun=0.02",)) as (device, _):
        captured = capture(device, paper, "X1", SHORT, tmp_path, confirm=agree)
    run = load_run(captured.run_file)
    missing = round(float(run.t[-1] - run.t[0]) * 1000) + 1 - len(run.t)
    assert missing > 10
    assert captured.lost["device_overrun"] >= missing
    assert captured.lost["tick_gap"] == 0


@pytest.mark.slow
def test_until_rest_ends_when_both_rods_are_still(paper: Rig, tmp_path: Path) -> None:
    options = CaptureOptions(until_rest=True, max_duration=600)
    with bench(plant="dry") as (device, _):
        captured = capture(device, paper, "X1", options, tmp_path, confirm=agree)
    run = load_run(captured.run_file)
    assert captured.verdict.ok, captured.verdict.sentence
    assert 5 < captured.duration < 590
    last = run.between(run.duration - 2, run.duration + 1).theta[:, 1:]
    assert np.ptp(last, axis=0).max() < 0.01
    before = run.between(run.duration - 6, run.duration - 4).theta[:, 1:]
    assert np.ptp(before, axis=0).max() > np.ptp(last, axis=0).max()


def test_until_rest_has_a_longest_duration(paper: Rig, tmp_path: Path) -> None:
    with bench() as (device, _):
        options = CaptureOptions(until_rest=True, max_duration=3.0)
        captured = capture(device, paper, "X2", options, tmp_path, confirm=agree)
    assert captured.duration == 3.0


def test_rate_the_link_cannot_carry_is_refused_before_anything_moves(paper: Rig, tmp_path: Path) -> None:
    with bench(baud=115_200) as (device, spy):
        with pytest.raises(LinkError, match="choose at most 658 Hz or 921600 baud"):
            capture(device, paper, "X1", SHORT, tmp_path, confirm=agree)
        assert NUMBERS[Hold] not in spy.sent
        options = CaptureOptions(rate_hz=500, duration=1.0)
        captured = capture(device, paper, "X1", options, tmp_path, confirm=agree)
    run = load_run(captured.run_file)
    assert (run.rate_hz, len(run.swing.t)) == (500, 501)


def test_unknown_pose_and_foreign_encoders_are_configuration_errors(paper: Rig, tmp_path: Path) -> None:
    coarse = paper.model_copy(update={"encoders": paper.encoders.model_copy(update={"counts_per_rev": (4096,) * 3})})
    with bench() as (device, spy):
        with pytest.raises(ConfigError, match=r"has no pose 'X9' \(there are: X1, X2, X3\)"):
            capture(device, paper, "X9", SHORT, tmp_path, confirm=agree)
        with pytest.raises(ConfigError, match=r"counts_per_rev = \[4096, 4096, 4096\], but the device .* \[16384"):
            capture(device, coarse, "X1", SHORT, tmp_path, confirm=agree)
        assert NUMBERS[Hold] not in spy.sent


def test_two_captures_in_a_row_make_two_files(paper: Rig, tmp_path: Path) -> None:
    options = CaptureOptions(duration=0.5)
    with bench() as (device, _):
        runs: list[Captured] = [
            capture(device, paper, pose, options, tmp_path, confirm=agree) for pose in ("X1", "X1", "X3")
        ]
    assert len(run_files(tmp_path)) == 3
    assert all(captured.verdict.ok for captured in runs)
    first, second = (load_run(captured.run_file).swing.counts for captured in runs[:2])
    assert first is not None
    assert second is not None
    assert not np.array_equal(first, second)  # each release has its own hand and noise


def test_capture_takes_over_a_device_left_streaming(paper: Rig, tmp_path: Path) -> None:
    with bench() as (device, _):
        device.hold(1)
        device.stream(500)
        captured = capture(device, paper, "X1", CaptureOptions(duration=0.5), tmp_path, confirm=agree)
    assert captured.verdict.ok, captured.verdict.sentence


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


def test_rig_file_is_stored_as_written(tmp_path: Path) -> None:
    rig = load_rig("paper")
    with bench() as (device, _):
        options = CaptureOptions(duration=0.3, note="first light")
        captured = capture(device, rig, "X1", options, tmp_path, confirm=agree)
    assert load_run(captured.run_file, rig).rig_sha256 == rig.sha256
