"""A device that reports impossible values: RELEASE is not sent, and the samples do not enter a good run."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.acquisition.capture import CaptureOptions, capture
from dpr_lab.acquisition.device import Device
from dpr_lab.acquisition.settings import CAPTURE_SETTINGS
from dpr_lab.errors import DeviceFault, DeviceLost, LinkError, SafetyStop
from dpr_lab.rig import Rig
from dpr_lab.storage.inspect import info
from dpr_lab.storage.reader import load_run
from dpr_lab.transports import open_transport
from dpr_lab.transports.transport import Received, Transport
from firmware_protocol.messages import (
    NUMBERS,
    Event,
    EventKind,
    Frame,
    Message,
    Release,
    Sample,
    State,
    Status,
    decode,
    encode,
)

SHORT = CaptureOptions(duration=1.0, pose_timeout=60.0, rest_timeout=60.0)
Lie = Callable[[Message], list[Message]]


@dataclass
class Liar:
    """Link to a real device that replaces some messages by others."""

    inner: Transport
    lie: Lie
    released: bool = False

    def __getattr__(self, name: str):
        return getattr(self.inner, name)

    def send(self, frame: Frame) -> None:
        self.released |= frame.number == NUMBERS[Release]
        self.inner.send(frame)

    def receive(self, timeout: float) -> Received:
        came = self.inner.receive(timeout)
        result = [encode(entry, frame.node) for frame in came.frames for entry in self.lie(decode(frame))]
        return replace(came, frames=tuple(result))


@pytest.fixture
def lying(simulated):
    @contextmanager
    def connected(lie: Lie) -> Iterator[tuple[Device, Liar]]:
        liar = Liar(open_transport(simulated().url), lie)
        with Device(liar) as device:  # pyright: ignore[reportArgumentType]
            device.connect()
            yield device, liar

    return connected


def as_event(change: Callable[[Event], Event]) -> Lie:
    return lambda m: [change(m) if isinstance(m, Event) and m.kind is EventKind.RELEASED else m]


@pytest.mark.parametrize("tick", [0, 800])
def test_a_release_from_before_it_was_ordered_is_not_believed(lying, paper: Rig, tmp_path: Path, agree, tick) -> None:
    with lying(as_event(lambda event: replace(event, tick=tick))) as (device, _):
        with pytest.raises(DeviceFault, match=f"a release at tick {tick}, but RELEASE was sent after"):
            capture(device, paper, "X1", SHORT, tmp_path, confirm=agree)
    (kept,) = tmp_path.glob("*.mcap")
    assert kept.is_file()


def while_streaming(**reported: object) -> Lie:
    """Replace every STATUS of a device that streams and holds the rods."""
    return lambda m: [replace(m, **reported) if isinstance(m, Status) and m.state is State.STREAMING else m]


@pytest.mark.parametrize(
    ("lie", "error", "reported"),
    [
        (while_streaming(latched=False), DeviceFault, "reports an open latch"),
        (while_streaming(state=State.IDLE, latched=False), DeviceFault, "reports an open latch"),
        (while_streaming(state=State.HOLDING), SafetyStop, "reported HOLDING instead of streaming"),
    ],
)
def test_no_release_is_sent_if_the_device_reports_a_reason_against_it(
    lying, paper, tmp_path, agree, lie, error, reported
) -> None:
    with lying(lie) as (device, liar):
        with pytest.raises(error, match=reported):
            capture(device, paper, "X1", replace(SHORT, rest_timeout=1.5), tmp_path, confirm=agree)
        assert not liar.released


@pytest.mark.slow
def test_rods_whose_samples_ceased_while_the_operator_thinks_are_not_released(
    lying, paper: Rig, tmp_path: Path
) -> None:
    """The last second of samples shows rods at rest, but it is old: only reports still arrive."""
    thinking: list[float] = []

    def without_samples(m: Message) -> list[Message]:
        return [] if thinking and isinstance(m, Sample) else [m]

    def confirm() -> bool | None:
        thinking.append(time.monotonic())
        return True if time.monotonic() - thinking[0] > liar_device.silence_s + 0.3 else None

    with lying(without_samples) as (liar_device, liar):
        with pytest.raises(SafetyStop, match=r"permitted, but the device has sent no samples for \d"):
            capture(liar_device, paper, "X1", SHORT, tmp_path, confirm=confirm)
        assert not liar.released


def test_an_unknown_fault_is_reported_in_a_sentence(lying, paper: Rig, tmp_path: Path, agree) -> None:
    lie = as_event(lambda event: replace(event, kind=EventKind.FAULT, detail=200))
    with lying(lie) as (device, _):
        with pytest.raises(DeviceFault, match="fault 200, which is not in"):
            capture(device, paper, "X1", SHORT, tmp_path, confirm=agree)


def twice(m: Message) -> list[Message]:
    """Send every hundredth sample twice, the incorrect one first."""
    if not isinstance(m, Sample) or m.tick % 100:
        return [m]
    return [replace(m, position1=(m.position1 + 40) & 0xFFFF), m]


def test_of_two_samples_of_one_tick_neither_is_kept(lying, paper: Rig, tmp_path: Path, agree) -> None:
    with lying(twice) as (device, _):
        captured = capture(device, paper, "X1", SHORT, tmp_path, confirm=agree)
    run = load_run(captured.run_file)
    ticks = np.round(run.t * run.rate_hz).astype(int) + captured.release_tick
    assert not (ticks % 100 == 0).any()
    assert captured.lost["contradicted"] >= 20
    assert captured.lost["tick_gap"] == 0
    assert "degraded: lost samples: contradicted" in captured.quality.sentence


def back_by(ticks: int, after: int = 1500) -> Lie:
    """From some ticks after the release on, reduce the ticks of the samples by a constant."""
    first: list[int] = []

    def lie(m: Message) -> list[Message]:
        if isinstance(m, Event) and m.kind is EventKind.RELEASED and not first:
            first.append(m.tick + after)
        if not isinstance(m, Sample) or not first or m.tick < first[0]:
            return [m]
        return [replace(m, tick=(m.tick - ticks) & 0xFFFF)]

    return lie


@pytest.mark.parametrize("ticks", [50, 2000])
def test_ticks_that_go_back_end_the_recording(lying, paper: Rig, tmp_path: Path, agree, ticks: int) -> None:
    with lying(back_by(ticks)) as (device, _), pytest.raises(LinkError, match="ticks of the device decreased"):
        capture(device, paper, "X1", CaptureOptions(duration=4.0), tmp_path, confirm=agree)
    (kept,) = tmp_path.glob("*.mcap")
    result = info(kept)
    assert not result.complete
    assert "ticks of the device decreased" in result.stopped
    assert result.duration_s < 3.0


@pytest.mark.slow
def test_ticks_that_go_back_a_little_degrade_it(lying, paper: Rig, tmp_path: Path, agree) -> None:
    with lying(back_by(3)) as (device, _):
        captured = capture(device, paper, "X1", CaptureOptions(duration=4.0), tmp_path, confirm=agree)
    assert "degraded: lost samples: contradicted 3" in captured.quality.sentence


@pytest.mark.slow
def test_a_device_that_samples_far_too_slowly_does_not_block_the_operator(simulated, paper, tmp_path, agree) -> None:
    """With one sample per second, ten seconds of recording would take hours."""
    quick = replace(CAPTURE_SETTINGS, pace_window_s=2.0)
    base: list[int] = []
    seen = iter(range(1_000_000))

    def slow(m: Message) -> list[Message]:
        if isinstance(m, Event) and m.kind is EventKind.RELEASED and not base:
            base.append(m.tick)
        if not (isinstance(m, Sample) and base):
            return [m]
        every, rest = divmod(next(seen), 100)
        return [] if rest else [replace(m, tick=(base[0] + 20 + every) & 0xFFFF)]

    liar = Liar(open_transport(simulated(clock="realtime").url), slow)
    with Device(liar) as device:  # pyright: ignore[reportArgumentType]
        device.connect()
        options = CaptureOptions(duration=1000.0, pose_timeout=60.0, rest_timeout=30.0)
        with pytest.raises(DeviceLost, match="does not sample at 1000 Hz"):
            capture(device, paper, "X1", options, tmp_path, confirm=agree, settings=quick)
