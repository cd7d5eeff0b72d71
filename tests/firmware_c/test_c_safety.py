"""The C core opens the latch on RELEASE only, for any frames and faults."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol.identity import DeviceInfo
from firmware_protocol.messages import (
    NUMBERS,
    ClearFault,
    Event,
    EventKind,
    Frame,
    Hello,
    Hold,
    KeepAlive,
    Ping,
    Release,
    State,
    Stop,
    Stream,
    decode,
    encode,
)
from sim_device.firmware.c_firmware import READINGS, Firmware

INFO = DeviceInfo("1.0.0", "00000000000000ff", (16384, 16384, 16384), rate_max_hz=4000, rate_default_hz=100)
START_UP = (Hello(1), Hold(2), Stream(3, 1000))

tokens = st.integers(0, 255)
good = st.one_of(
    st.builds(Hold, tokens, tokens),
    st.builds(Stream, tokens, st.integers(1, 5000)),
    *(st.builds(command, tokens) for command in (Hello, Release, Stop, ClearFault, Ping)),
    st.just(KeepAlive()),
).map(encode)
happenings = st.one_of(
    good,
    st.builds(Frame, st.integers(0, 0x7FF), st.binary(max_size=8)),
    st.tuples(st.just("wait"), st.integers(0, 2000)),
    st.tuples(st.just("fault"), st.integers(0, 6)),
    st.tuples(st.just("readings"), st.integers(1, 2 * READINGS)),
)


@given(st.lists(happenings, max_size=60), st.integers(0, 2**32 - 1))
def test_only_a_release_opens_the_latch(library, sequence: list, start_ms: int):
    firmware, now = Firmware(INFO, library=library), start_ms
    for message in START_UP:
        firmware.receive(encode(message), now, 0.0)
    for happening in sequence:
        before = firmware.latched
        firmware.hardware_actions()
        if isinstance(happening, Frame):
            firmware.receive(happening, now, 1.5)
        else:
            now += happening[1] if happening[0] == "wait" else 0
            handle(firmware, happening, now)
        actions = firmware.hardware_actions()
        asked = isinstance(happening, Frame) and happening.number == NUMBERS[Release]
        if actions.release or (before and not firmware.latched):
            assert asked
            assert happening.data[1:] == b"\xb1\xd0"
            assert not firmware.latched
        expected = {State.HOLDING: True, State.STREAMING: True, State.FAULT: before}.get(firmware.state, False)
        assert firmware.latched is expected


def handle(firmware: Firmware, happening: tuple[str, int], now: int) -> None:
    kind, number = happening
    if kind == "fault":
        firmware.set_fault(number)
    if kind == "readings":
        ticks = firmware.next_tick + np.arange(number)
        counts = np.random.default_rng(number).integers(-(2**31), 2**31, (number, 3))
        for frame in firmware.poll(now, np.column_stack([ticks, counts])):
            decode(frame)
    else:
        firmware.poll(now)


@pytest.mark.parametrize("now", [1000, 2**32 - 300], ids=["", "the clock wraps"])
def test_the_lease_ends_to_the_millisecond(library, now: int):
    firmware = Firmware(INFO, library=library)
    for message in START_UP:
        firmware.receive(encode(message), now, 0.0)
    assert firmware.poll(now + 499) == []
    assert firmware.state is State.STREAMING
    (lost,) = map(decode, firmware.poll(now + 500))
    assert lost == Event(EventKind.LEASE_LOST, 0, 0)
    assert (firmware.state, firmware.latched) == (State.HOLDING, True)


@pytest.mark.parametrize(("rate_hz", "state"), [(4000, State.STREAMING), (4001, State.HOLDING)])
def test_the_highest_rate_is_allowed_and_none_above_it(library, rate_hz: int, state: State):
    firmware = Firmware(INFO, library=library)
    for message in (Hello(1), Hold(2), Stream(3, rate_hz)):
        firmware.receive(encode(message), 0, 0.0)
    assert firmware.state is state


def test_a_fault_that_is_still_there_stops_the_device_again(library):
    firmware = Firmware(INFO, library=library)
    for message in START_UP:
        firmware.receive(encode(message), 0, 0.0)
    firmware.set_fault(4)
    firmware.poll(1)
    assert firmware.state is State.FAULT
    firmware.receive(encode(ClearFault(9)), 2, 0.0)
    assert firmware.state is State.HOLDING
    firmware.poll(3)
    assert (firmware.state, firmware.latched) == (State.FAULT, True)
