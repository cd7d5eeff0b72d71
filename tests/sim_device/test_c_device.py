"""The board with the firmware in C agrees with the board in Python, frame by frame and in a capture."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dpr_lab.acquisition.capture import CaptureOptions, capture
from dpr_lab.acquisition.device import Device
from dpr_lab.storage.reader import load_run
from dpr_lab.transports import open_transport
from firmware_protocol.identity import PAGES
from firmware_protocol.messages import (
    NUMBERS,
    ClearFault,
    Frame,
    Hello,
    Hold,
    KeepAlive,
    Ping,
    Release,
    Sample,
    Status,
    Stop,
    Stream,
    decode,
    encode,
)
from sim_device.assemble import assemble
from sim_device.options import Options
from tests.thinned import thinned

STEP_S = 1 / 64
"""Exact in seconds and, times 32, in milliseconds, so that both firmwares see the same lease."""


pytestmark = pytest.mark.usefixtures("library")

STREAMS = [Stream(rate_hz=rate_hz) for rate_hz in (7, 1000, 4000, 4001)]
COMMANDS = (Hold(pose=2), *STREAMS, Release(), Stop(), ClearFault())
happenings = st.one_of(
    st.tuples(st.sampled_from(COMMANDS), st.integers(0, 255)),
    st.sampled_from([Hello(1), Hello(2, major=9), Hello(3, schema_hash=1), KeepAlive(), Ping(5), "again"]),
    st.integers(1, 40),
    st.builds(Frame, st.integers(60, 130), st.binary(max_size=8)),
)
usual = [Hello(1), (Hold(pose=1), 2), 3, (Stream(rate_hz=1000), 3), 5, (Release(), 4), 20]


def both(**options):
    """Two boards that differ only in their firmware."""
    devices = []
    for firmware in ("python", "c"):
        device, link, _ = assemble(Options(link="tcp:0", seed=3, firmware=firmware, **options))
        link.close()
        devices.append(device)
    return devices


def frame_of(happening, last: Frame) -> Frame:
    if happening == "again":
        return last
    if isinstance(happening, tuple):
        command, token = happening
        return encode(replace(command, token=token))
    return happening if isinstance(happening, Frame) else encode(happening)


@pytest.mark.slow
@settings(max_examples=30, suppress_health_check=[HealthCheck.too_slow])
@given(st.booleans(), st.lists(happenings, max_size=25))
def test_both_firmwares_send_the_same_at_every_step(after_usual: bool, sequence: list):
    python, c = both()
    steps, last = 0, encode(KeepAlive())
    for happening in (usual if after_usual else []) + sequence:
        if isinstance(happening, int):
            steps += happening
        else:
            last = frame_of(happening, last)
            assert c.receive(last, 100 + steps * STEP_S) == python.receive(last, 100 + steps * STEP_S)
        steps += 1
        assert c.service(100 + steps * STEP_S) == python.service(100 + steps * STEP_S)
        assert c.streams == python.streams


@pytest.mark.slow
def test_two_swings_are_the_same_frame_by_frame(bench):
    result = []
    for firmware in ("python", "c"):
        host = bench.direct(seed=7, firmware=firmware, plant="dry")
        host.release(pose=2, swing=12_000)
        result.append(host.messages.copy())
        host.release(pose=3, rate_hz=300, swing=300)
        result[-1] += host.messages
    assert result[0] == result[1]


def test_a_restart_is_the_same(bench):
    python, c = both()
    for device in (python, c):
        for command in (Hello(1), Hold(2, pose=1), Stream(3, 1000)):
            device.receive(encode(command), 100.0)
        device.service(100.1)
        device.reset()
    assert c.service(100.2) == python.service(100.2) == []
    assert c.receive(encode(Hold(4)), 100.3) == python.receive(encode(Hold(4)), 100.3)


def test_ticks_missed_and_samples_without_room_are_counted_the_same(bench):
    result = []
    for firmware in ("python", "c"):
        host = bench.direct(seed=7, firmware=firmware, fault=("overrun=0.02",))
        device = host.end.device
        for command in (Hello(1), Hold(2, pose=1), Stream(3, 1000)):
            device.receive(encode(command), host.end.wall)
        frames = device.service(host.end.wall + 0.25)
        device.note_dropped([frame for frame in frames if frame.number == NUMBERS[Sample]][:10])
        host.messages.clear()
        host.session.hello(host.now())
        host.run_for(0.3)
        last = host.of(Status)[-1]
        result.append((last.dropped, last.sent, last.overruns, host.of(Sample)))
        assert last.overruns > 0
    assert result[0] == result[1]
    assert result[0][0] == 10


@pytest.mark.slow
@pytest.mark.parametrize("bus", thinned(["pty", "can"], 2))
def test_a_capture_with_the_real_driver_gives_the_same_counts(bus, paper, tmp_path):
    swings = []
    for firmware in ("python", "c"):
        with Device(open_transport(f"sim://?seed=5&clock=fast&bus={bus}&firmware={firmware}")) as device:
            device.connect()
            options = CaptureOptions(duration=2.0)
            captured = capture(device, paper, "X2", options, tmp_path / firmware, confirm=lambda: True)
        assert captured.quality.ok, captured.quality.sentence
        assert sum(captured.lost.values()) == 0
        swings.append(load_run(captured.run_file).swing.counts)
    assert len(swings[0]) == 2001
    assert np.array_equal(*swings)


@pytest.mark.parametrize("link", ["pty", "slcan", "tcp:0", "virtual:c-firmware"])
def test_it_serves_every_link(bench, link):
    host = bench.host(link=link, clock="fast", seed=7, firmware="c")
    tick = host.release(pose=2, rest=150, swing=500)
    assert (np.diff(host.counts()[:, 0]) == 1).all()
    assert tick >= 150


@pytest.mark.parametrize(
    "hello", [Hello(1), Hello(1, major=9), Hello(1, schema_hash=1), Hello(1, major=9, schema_hash=1)], ids=str
)
@pytest.mark.parametrize("fault", [("major=9",), ("schema=1",), ("major=9", "schema=1")], ids=str)
def test_what_is_built_from_another_dbc_answers_the_same(fault: tuple[str, ...], hello: Hello):
    python, c = both(fault=fault)
    answers = c.receive(encode(hello), 100.0)
    assert answers == python.receive(encode(hello), 100.0)
    assert len(answers) == 1 + PAGES
    result = decode(answers[1])
    for name, value in (text.split("=") for text in fault):
        assert result.fields[{"major": "major", "schema": "schema_hash"}[name]] == int(value)
    assert c.receive(encode(Hold(2)), 100.1) == python.receive(encode(Hold(2)), 100.1)
