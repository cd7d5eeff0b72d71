import os
import pty
import re
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest

from dpr_lab.acquisition.batch import Batch
from dpr_lab.acquisition.device import Device
from dpr_lab.acquisition.device_errors import translated
from dpr_lab.acquisition.settings import DeviceTiming
from dpr_lab.errors import DeviceFault, DeviceLost, LinkError, LinkTimeout, MismatchError
from dpr_lab.run import LOSS_CAUSES
from dpr_lab.transports import open_transport
from dpr_lab.transports.transport import Capacity, Received
from firmware_protocol.device_role import DeviceSession
from firmware_protocol.errors import CommandUnanswered
from firmware_protocol.identity import DeviceInfo
from firmware_protocol.messages import NUMBERS, Ack, Frame, Info, Position, State, Status, Stream, encode

LINKS = ("pty", "slcan", "tcp:0", "virtual:device-test")


INFO = DeviceInfo("1.2.3", "00000000deadbeef", (16384, 16384, 16384), rate_max_hz=2000, rate_default_hz=1000)


class Loop:
    """Transport to a protocol session without clock and rods."""

    url = "loop://"

    def __init__(self, info: DeviceInfo = INFO) -> None:
        self.errors = {"crc": 0, "framing": 0}
        self.capacities: tuple[Capacity, ...] = ()
        self.mute = False
        self.broken: Exception | None = None
        self.session = DeviceSession(info)
        self._waiting: list[Frame] = []
        self._arrived = threading.Condition()

    def send(self, frame: Frame) -> None:
        self.push(self.session.receive(frame, time.monotonic()).frames)

    def push(self, frames: list[Frame]) -> None:
        with self._arrived:
            self._waiting += [] if self.mute else frames
            self._arrived.notify()

    def receive(self, timeout: float) -> Received:
        if self.broken:
            raise self.broken
        with self._arrived:
            self._arrived.wait_for(lambda: self._waiting, timeout)
            frames, self._waiting = tuple(self._waiting), []
        return Received(time.monotonic(), frames, b"x" * len(frames))

    def close(self) -> None:
        pass


def collect(device: Device, enough: Callable[[list[Batch]], bool], timeout: float = 60.0) -> list[Batch]:
    batches: list[Batch] = []
    deadline = time.monotonic() + timeout
    while not enough(batches):
        assert time.monotonic() < deadline
        batches += device.poll(0.05)
    return batches


def poll_on(device: Device, ticks: list[int] | None = None) -> None:
    """Poll until an exception is raised, and add the received ticks to `ticks`. The time limit of the test applies."""
    while True:
        result = ticks_of(device.poll(0.1))
        if ticks is not None:
            ticks += result


def ticks_of(batches: list[Batch]) -> list[int]:
    return [row.tick for batch in batches for row in batch.rows]


def at_least(n: int) -> Callable[[list[Batch]], bool]:
    return lambda batches: len(ticks_of(batches)) >= n


@pytest.mark.parametrize("link", LINKS)
def test_whole_dialogue_over_every_link_loses_nothing(link: str, simulated) -> None:
    with Device(open_transport(simulated(link=link).url)) as device:
        info = device.connect()
        assert (info.counts_per_rev, info.simulated_time) == ((16384, 16384, 16384), True)
        device.hold(1)
        device.stream(500)
        batches = collect(device, at_least(1000))
        device.release()
        batches += collect(device, at_least(1000))
        device.stop()
        batches += device.poll(0.2)
        ticks = ticks_of(batches)
        assert ticks == list(range(len(ticks)))
        assert device.losses == dict.fromkeys(LOSS_CAUSES, 0)
        messages = [message for batch in batches for message in batch.messages]
        assert {Status, Position} <= {type(message) for message in messages}
        assert all(batch.raw for batch in batches)


def test_a_device_can_be_disconnected_and_connected_again(simulated) -> None:
    url = simulated().url
    for _ in range(2):
        with Device(open_transport(url)) as device:
            device.connect()
            device.hold()
            device.stream(1000)
            assert ticks_of(collect(device, at_least(100)))[0] == 0
            device.stop()


def test_second_stream_counts_from_zero_again(simulated) -> None:
    with Device(open_transport(simulated().url)) as device:
        device.connect()
        device.hold()
        for _ in range(3):
            device.stream(1000)
            ticks = ticks_of(collect(device, at_least(300)))
            assert ticks == list(range(len(ticks)))
            device.stop()
            device.poll(0)
        assert device.losses["tick_gap"] == 0


@pytest.fixture
def silent_port() -> Iterator[str]:
    master, slave = pty.openpty()
    tty.setraw(slave)
    yield f"serial://{os.ttyname(slave)}?baud=115200"
    os.close(master)
    os.close(slave)


def test_the_message_without_a_device_lists_what_to_check(silent_port: str) -> None:
    with Device(open_transport(silent_port)) as device, pytest.raises(LinkTimeout) as caught:
        device.connect(timeout=0.3)
    assert "opened, but no DPR device answered within 0.3 s" in str(caught.value)
    assert "is set to 115200 baud" in str(caught.value)


def test_a_wrong_baud_rate_is_distinguished_from_silence(simulated) -> None:
    with Device(open_transport(simulated(baud=115_200).url.replace("115200", "921600"))) as device:
        for timeout in (0.5, 5.0, 50.0):  # on a loaded machine the first bytes take longer
            with pytest.raises(LinkTimeout) as caught:
                device.connect(timeout)
            if "bytes arrived" in str(caught.value):
                break
    assert re.search(r"\d+ bytes arrived, but no valid frame: 921600 baud is probably wrong", str(caught.value))


@pytest.mark.parametrize(
    ("info", "sentence"),
    [
        (replace(INFO, major=9), "upgrade"),
        (replace(INFO, schema_hash=INFO.schema_hash ^ 1), "same dpr.dbc"),
    ],
)
def test_device_of_another_protocol_is_refused(info: DeviceInfo, sentence: str) -> None:
    with Device(Loop(info)) as device, pytest.raises(MismatchError, match=sentence):
        device.connect()


def test_rate_beyond_the_link_is_refused_before_anything_is_sent(simulated, spy_on) -> None:
    spy = spy_on(open_transport(simulated(baud=115_200).url))
    with Device(spy) as device:
        device.connect()
        device.hold()
        with pytest.raises(LinkError, match=r"1000 Hz needs 140,000 bit/s, 122 % of 115200 baud.* at most 658 Hz"):
            device.stream(1000)
        assert NUMBERS[Stream] not in spy.sent
        device.stream(500)
        collect(device, at_least(10))


def test_rate_beyond_the_device_is_refused() -> None:
    with Device(Loop()) as device:
        device.connect()
        with pytest.raises(DeviceFault, match="choose at most 2000 Hz"):
            device.check_rate(2001)
        device.check_rate(2000)


def test_refused_command_carries_text_and_remedy() -> None:
    with Device(Loop()) as device:
        device.connect()
        with pytest.raises(DeviceFault, match=r"refused RELEASE: The device cannot do this.* Send STOP"):
            device.release()
        device.hold()


def test_reading_the_device_information_before_connecting_is_an_error_of_the_caller() -> None:
    with Device(Loop()) as device, pytest.raises(ValueError, match="connect first"):
        _ = device.info


def test_commands_survive_a_lossy_link(simulated) -> None:
    with Device(open_transport(simulated(fault=("drop=0.07",)).url)) as device:
        device.connect(timeout=10)
        for _ in range(10):
            device.hold()
            device.stream(1000)
            device.stop()
        assert device.status is not None


def test_damage_is_counted_and_loses_only_the_damaged_frames(simulated) -> None:
    with Device(open_transport(simulated(fault=("flip=0.0005",)).url)) as device:
        device.connect()
        device.hold()
        device.stream(1000)
        ticks = ticks_of(collect(device, at_least(2000)))
        device.stop()
        missing = ticks[-1] - ticks[0] + 1 - len(ticks)
        lost = device.losses
        assert missing > 0
        assert lost["tick_gap"] >= missing
        assert lost["crc"] + lost["framing"] >= missing / 2  # a struck delimiter joins two frames into one bad one
        assert ticks == sorted(set(ticks))


def test_a_busy_caller_loses_neither_the_lease_nor_samples(simulated) -> None:
    with Device(open_transport(simulated(clock="realtime").url)) as device:
        device.connect()
        device.hold()
        device.stream(1000)
        time.sleep(0.8)
        ticks = ticks_of(collect(device, at_least(900)))
        assert ticks == list(range(len(ticks)))
        assert device.losses == dict.fromkeys(LOSS_CAUSES, 0)
        device.stop()


def test_samples_received_before_the_cable_was_pulled_are_delivered_first(simulated) -> None:
    with Device(open_transport(simulated(fault=("cut_after_s=10",)).url)) as device:  # half a second of real time
        device.connect()
        device.hold()
        device.stream(1000)
        device._reader.join()
        ticks: list[int] = []
        with pytest.raises(DeviceLost, match="the port is lost"):
            poll_on(device, ticks)
        assert len(ticks) > 300
        with pytest.raises(DeviceLost):
            device.stop()


@contextmanager
def streaming(loop: Loop) -> Iterator[Device]:
    """Provide a device that streams at 1 kHz and has reported its complete counts, all zero."""
    with Device(loop) as device:
        device.connect()
        device.hold()
        device.stream(1000)
        loop.push(list(loop.session.positions(0, (0, 0, 0))))
        yield device


@pytest.mark.parametrize("last", ["two devices", "port"])
def test_samples_of_the_last_read_are_delivered_before_the_error(last: str) -> None:
    loop = Loop()
    with streaming(loop) as device:
        frames = [loop.session.sample(tick, (0, 0, 0)) for tick in range(3)]
        other = encode(Info(2, {"uid_low": 7}))
        loop.push(frames + ([other] if last == "two devices" else []))
        ticks = ticks_of(collect(device, lambda batches: len(ticks_of(batches)) >= 2))
        loop.broken = DeviceLost("the port is lost")
        with pytest.raises(LinkError, match="two devices" if last == "two devices" else "port is lost"):
            poll_on(device, ticks)
    assert ticks == [0, 1, 2]


def test_device_that_falls_silent_is_lost() -> None:
    loop = Loop()
    with Device(loop, timing=DeviceTiming(silence_s=0.2)) as device:
        device.connect()
        loop.mute = True
        with pytest.raises(DeviceLost, match=r"neither sample nor status for 0\.2 s"):
            poll_on(device)


def test_device_that_answers_pings_alone_has_restarted_and_is_lost(simulated) -> None:
    with Device(open_transport(simulated(fault=("reset_after_s=0.5",)).url)) as device:
        device.connect()
        device.hold()
        device.stream(1000)
        with pytest.raises(DeviceLost, match="may have restarted"):
            poll_on(device)


def test_unanswered_command_is_a_timeout() -> None:
    loop = Loop()
    with Device(loop) as device:
        device.connect()
        loop.mute = True
        with pytest.raises(LinkTimeout, match="HOLD was sent 6 times"):
            device.hold()


def test_a_bug_in_the_reader_thread_reaches_the_caller() -> None:
    loop = Loop()
    with Device(loop) as device:
        device.connect()
        loop.broken = RuntimeError("a bug")
        with pytest.raises(RuntimeError, match="a bug"):
            poll_on(device)


def test_invalid_frames_are_counted_and_skipped() -> None:
    loop = Loop()
    with Device(loop) as device:
        device.connect()
        device.poll(0)
        loop.push([Frame(1 << 6 | 2, b"short"), Frame(5 << 6 | 2, b"another node's")])
        loop.push([loop.session.status(overruns=0, dropped=0, sent=0)])
        collect(device, lambda batches: any(batch.messages for batch in batches))
        assert device.losses["framing"] == 1


def test_overruns_are_counted_over_wraps_and_restarts() -> None:
    loop = Loop()
    with Device(loop) as device:
        device.connect()
        device.hold()
        device.stream(1000)
        for overruns, dropped in ((65_000, 0), (100, 3)):
            loop.push([loop.session.status(overruns=overruns, dropped=dropped, sent=0)])
        device.stop()
        device.stream(1000)
        loop.push([loop.session.status(overruns=7, dropped=0, sent=0)])
        device.stop()
        assert device.losses["device_overrun"] == 65_636 + 3 + 7


def test_a_repeated_answer_to_stream_does_not_count_overruns_twice() -> None:
    loop = Loop()
    with Device(loop) as device:
        device.connect()
        device.hold()
        device.stream(1000)
        status = loop.session.status(overruns=5, dropped=0, sent=0)
        loop.push([status, encode(Ack(NUMBERS[Stream], device._session._token), device._session.node), status])
        device.stop()
        assert device.losses["device_overrun"] == 5


@pytest.mark.slow
def test_clock_fit_finds_the_error_of_the_crystal(simulated) -> None:
    with Device(open_transport(simulated(clock="realtime", drift_ppm=3000.0).url)) as device:
        device.connect()
        device.hold()
        device.stream(1000)
        fit = None
        for _ in range(40):  # a loaded machine answers late, and is less sure of the rate
            collect(device, at_least(1500))
            fit, _ = device.clock()
            if fit is not None and fit.n >= 3 and fit.rate_ppm_std < 150:
                break
        device.stop()
    assert fit is not None
    assert fit.rate_ppm == pytest.approx(3000, abs=900)


def test_simulated_time_has_no_clock_fit(simulated) -> None:
    with Device(open_transport(simulated().url)) as device:
        device.connect()
        device.hold()
        device.stream(1000)
        collect(device, at_least(2000))
        assert device.clock() == (None, "")
        device.stop()


def test_status_mirrors_the_device(simulated) -> None:
    with Device(open_transport(simulated().url)) as device:
        device.connect()
        device.hold(2)
        device.poll(0)
        time.sleep(0.15)
        collect(device, lambda batches: any(isinstance(m, Status) for b in batches for m in b.messages))
        assert device.status is not None
        assert (device.status.state, device.status.latched) == (State.HOLDING, True)


def test_an_unanswered_command_has_a_remedy():
    error = translated(
        "serial:///dev/x", CommandUnanswered("STOP was sent 6 times and the device did not answer"), None
    )
    assert isinstance(error, LinkTimeout)
    assert str(error).endswith("did not answer: check its cable and power, then connect again")
