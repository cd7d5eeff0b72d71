from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol.device_role import Answer, DeviceSession
from firmware_protocol.identity import DeviceInfo
from firmware_protocol.messages import (
    NUMBERS,
    Ack,
    ClearFault,
    Command,
    Event,
    EventKind,
    Fault,
    Frame,
    Hello,
    Hold,
    Info,
    KeepAlive,
    Message,
    Nak,
    NakCode,
    Ping,
    Pong,
    Position,
    Release,
    Sample,
    State,
    Status,
    Stop,
    Stream,
    decode,
    encode,
    frame_id,
)

IDENTITY = DeviceInfo("0.1.0", "00000000000000ff", (16384, 16384, 16384), rate_max_hz=4000, rate_default_hz=100)

# Written out from the description of the states, on purpose not taken from the table under test.
EXPECTED = {
    (State.IDLE, "hold"): State.HOLDING,
    (State.IDLE, "stop"): State.IDLE,
    (State.HOLDING, "hold"): State.HOLDING,
    (State.HOLDING, "stream"): State.STREAMING,
    (State.HOLDING, "stop"): State.HOLDING,
    (State.STREAMING, "release"): State.RELEASED,
    (State.STREAMING, "stop"): State.HOLDING,
    (State.RELEASED, "stop"): State.IDLE,
    (State.FAULT, "stop"): State.FAULT,
    (State.FAULT, "clear_fault"): State.HOLDING,
}
COMMANDS: dict[str, Command] = {
    "hold": Hold(pose=2),
    "stream": Stream(rate_hz=1000),
    "release": Release(),
    "stop": Stop(),
    "clear_fault": ClearFault(),
}
ROUTES = {
    State.IDLE: (),
    State.HOLDING: ("hold",),
    State.STREAMING: ("hold", "stream"),
    State.RELEASED: ("hold", "stream", "release"),
}


class Driver:
    """Device session with a token counter, by default after the handshake."""

    def __init__(self, route: tuple[str, ...] = (), greet: bool = True):
        self.session = DeviceSession(IDENTITY)
        self.token = 0
        if greet:
            self.send(Hello())
        for name in route:
            self.command(name)

    def send(self, message: Message, now: float = 0.0) -> Answer:
        return self.session.receive(encode(message), now)

    def command(self, name: str, now: float = 0.0) -> Answer:
        self.token = (self.token + 1) % 256
        return self.send(replace(COMMANDS[name], token=self.token), now)


def reach(state: State) -> Driver:
    if state is State.FAULT:
        driver = Driver(ROUTES[State.HOLDING])
        driver.session.fault(Fault.ENCODER1, tick=7)
    else:
        driver = Driver(ROUTES[state])
    assert driver.session.state is state
    return driver


@pytest.mark.parametrize("state", State, ids=lambda state: state.name)
@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_in_every_state(state: State, name: str):
    driver = reach(state)
    latched = driver.session.latched
    answer = driver.command(name)
    (message,) = map(decode, answer.frames)
    number = NUMBERS[type(COMMANDS[name])]
    if (state, name) in EXPECTED:
        assert message == Ack(number, driver.token)
        assert driver.session.state is EXPECTED[state, name]
        assert answer.task == replace(COMMANDS[name], token=driver.token)
    else:
        refusal = NakCode.FAULTED if state is State.FAULT else NakCode.WRONG_STATE
        assert message == Nak(number, driver.token, refusal)
        assert (driver.session.state, driver.session.latched) == (state, latched)
        assert answer.task is None


@pytest.mark.parametrize("state", State, ids=lambda state: state.name)
def test_silence_stops_streaming_and_touches_nothing_else(state: State):
    driver = reach(state)
    latched = driver.session.latched
    assert driver.session.check_lease(now=0.499, tick=9) == Answer()
    answer = driver.session.check_lease(now=0.5, tick=(1 << 32) + 9)
    if state in (State.STREAMING, State.RELEASED):
        assert list(map(decode, answer.frames)) == [Event(EventKind.LEASE_LOST, 0, 9)]
        assert answer.task == Stop()
        assert driver.session.state is (State.HOLDING if latched else State.IDLE)
        assert driver.session.check_lease(now=9.0, tick=10) == Answer()
    else:
        assert answer == Answer()
        assert driver.session.state is state
    assert driver.session.latched == latched


@pytest.mark.parametrize("state", State, ids=lambda state: state.name)
@pytest.mark.parametrize("fault", [fault for fault in Fault if fault], ids=lambda fault: fault.name)
def test_a_fault_stops_in_any_state_and_leaves_the_latch(state: State, fault: Fault):
    driver = reach(state)
    latched = driver.session.latched
    answer = driver.session.fault(fault, tick=3)
    assert list(map(decode, answer.frames)) == [Event(EventKind.FAULT, fault, 3)]
    assert answer.task == Stop()
    assert decode(driver.session.status(0, 0, 0)) == Status(State.FAULT, fault, latched, 0, 0, 0)
    driver.command("stop")
    assert decode(driver.session.status(0, 0, 0)) == Status(State.FAULT, fault, latched, 0, 0, 0)
    driver.command("clear_fault")
    cleared = State.HOLDING if latched else State.IDLE
    assert decode(driver.session.status(0, 0, 0)) == Status(cleared, Fault.NONE, latched, 0, 0, 0)


def test_a_report_without_a_fault_is_not_a_fault():
    with pytest.raises(ValueError, match="no fault"):
        Driver().session.fault(Fault.NONE, 0)


happenings = st.one_of(
    st.sampled_from(sorted(COMMANDS)),
    st.sampled_from(["silence", "hello", "keepalive", "ping", "bad release", "repeat"]),
    st.sampled_from([fault for fault in Fault if fault]),
    st.builds(Frame, st.integers(64, 127), st.binary(max_size=8)).filter(
        lambda frame: frame.number != NUMBERS[Release] or frame.data[1:] != b"\xb1\xd0"
    ),
)


@given(st.lists(happenings, max_size=60))
def test_only_a_release_opens_the_latch(sequence: list[str | Fault | Frame]):
    driver, now, last = Driver(ROUTES[State.STREAMING]), 0.0, encode(KeepAlive())
    session = driver.session
    for happening in sequence:
        before = session.latched
        if isinstance(happening, Fault):
            session.fault(happening, 0)
        elif happening == "silence":
            now += 1.0
            session.check_lease(now, 0)
        else:
            last = frame_of(happening, driver, last)
            session.receive(last, now)
        if before and not session.latched:
            assert happening == "release" or (happening == "repeat" and last.number == NUMBERS[Release])
        assert session.latched is {
            State.HOLDING: True,
            State.STREAMING: True,
            State.IDLE: False,
            State.RELEASED: False,
        }.get(session.state, before)


def frame_of(happening: str | Frame, driver: Driver, last: Frame) -> Frame:
    driver.token = (driver.token + 1) % 256
    if isinstance(happening, Frame):
        return happening
    if happening in COMMANDS:
        return encode(replace(COMMANDS[happening], token=driver.token))
    return {
        "hello": encode(Hello(driver.token)),
        "keepalive": encode(KeepAlive()),
        "ping": encode(Ping(driver.token)),
        "bad release": Frame(frame_id(1, NUMBERS[Release]), bytes([driver.token, 0xB1, 0xD1])),
        "repeat": last,
    }[happening]


@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "clear_fault"])
def test_a_repeated_token_acts_once_and_is_answered_again(name: str):
    start = {"hold": State.IDLE, "stream": State.HOLDING, "release": State.STREAMING, "stop": State.RELEASED}[name]
    driver = reach(start)
    first = driver.command(name)
    state = driver.session.state
    assert first.task
    again = driver.send(replace(COMMANDS[name], token=driver.token))
    assert again == Answer(first.frames)
    assert driver.session.state is state
    driver.token += 1
    other = driver.send(replace(COMMANDS[name], token=driver.token))
    assert other.frames != first.frames


def test_a_refusal_is_repeated_too():
    driver = reach(State.IDLE)
    refused = driver.command("release")
    driver.command("hold")
    assert driver.session.receive(encode(Release(driver.token - 1)), 0.0) == refused


def test_a_new_conversation_may_use_the_old_tokens():
    driver = reach(State.IDLE)
    driver.send(Hold(40))
    driver.send(Stop(41))
    driver.send(Hello(1))
    driver.send(Stream(42, 1000))
    driver.send(Stop(43))
    assert driver.send(Hold(40)).task == Hold(40)


def test_tokens_wrap_around():
    driver = Driver()
    for _ in range(600):
        assert driver.command("hold").task == Hold(driver.token, 2)


def test_before_the_handshake_only_the_handshake_is_answered():
    driver = Driver(greet=False)
    for name in COMMANDS:
        answer = driver.command(name)
        assert list(map(decode, answer.frames)) == [
            Nak(NUMBERS[type(COMMANDS[name])], driver.token, NakCode.NOT_GREETED)
        ]
        assert answer.task is None
    assert driver.send(KeepAlive()) == Answer()
    assert driver.send(Ping(5)).task == Ping(5)
    assert not driver.session.greeted
    acknowledged, *pages = map(decode, driver.send(Hello(9)).frames)
    assert acknowledged == Ack(NUMBERS[Hello], 9)
    assert [page.page for page in pages if isinstance(page, Info)] == list(range(8))
    assert driver.session.greeted


def test_rates_are_refused_by_the_device_s_own_limit():
    driver = reach(State.HOLDING)
    assert list(map(decode, driver.send(Stream(90, 4001)).frames)) == [Nak(35, 90, NakCode.RATE_TOO_HIGH)]
    assert driver.session.state is State.HOLDING
    assert driver.send(Stream(91, 4000)).task == Stream(91, 4000)


@pytest.mark.parametrize(
    ("number", "data", "code"),
    [
        (NUMBERS[Stream], b"\x07\x00\x00", NakCode.BAD_VALUE),
        (NUMBERS[Release], b"\x07\xb1\xd1", NakCode.BAD_VALUE),
        (NUMBERS[Hold], b"\x07", NakCode.BAD_VALUE),
        (40, b"\x07", NakCode.UNKNOWN_COMMAND),
        (63, b"", NakCode.UNKNOWN_COMMAND),
    ],
)
def test_an_invalid_command_is_refused_and_does_not_renew_the_lease(number: int, data: bytes, code: NakCode):
    driver = reach(State.STREAMING)
    answer = driver.session.receive(Frame(frame_id(1, number), data), now=0.4)
    assert list(map(decode, answer.frames)) == [Nak(number, data[0] if data else 0, code)]
    assert driver.session.state is State.STREAMING
    assert driver.session.check_lease(now=0.5, tick=0).task == Stop()


def test_frames_of_others_do_nothing():
    driver = reach(State.STREAMING)
    for frame in (
        encode(Stop(99), node=2),
        encode(Ack(34, 1)),
        encode(Sample(0, 0, 0, 0)),
        Frame(frame_id(1, 39), b""),
    ):
        assert driver.session.receive(frame, now=0.4) == Answer()
    assert driver.session.check_lease(now=0.5, tick=0).task == Stop()


@pytest.mark.parametrize("message", [KeepAlive(), Ping(1), Hello(200)], ids=lambda m: type(m).__name__)
def test_any_good_frame_renews_the_lease(message: Message):
    driver = reach(State.STREAMING)
    driver.send(message, now=0.4)
    assert driver.session.check_lease(now=0.89, tick=0) == Answer()
    assert driver.session.check_lease(now=0.9, tick=0).task == Stop()


def test_the_release_is_repeated_in_every_report_while_the_rods_swing():
    driver = reach(State.STREAMING)
    session = driver.session
    assert [type(m) for m in map(decode, session.report(3, (1, 2, 3), 0, 0, 9))] == [*[Position] * 3, Status]
    driver.command("release")
    result = session.released((1 << 32) + 7)
    for _ in range(2):
        *others, again = session.report(12, (1, 2, 3), 4, 5, 6)
        assert again == result
        assert decode(others[3]) == Status(State.RELEASED, Fault.NONE, False, 4, 5, 6)
    driver.command("stop")
    assert len(session.report(13, (1, 2, 3), 0, 0, 0)) == 4


def test_counters_are_cut_to_what_the_wire_carries():
    session = Driver().session
    assert decode(session.sample(65537, (-1, 65536, 1 << 40))) == Sample(1, 65535, 0, 0)
    assert list(map(decode, session.positions(65536 + 3, (-5, 1 << 31, -(1 << 31) - 1)))) == [
        Position(0, 3, -5),
        Position(1, 3, -(1 << 31)),
        Position(2, 3, (1 << 31) - 1),
    ]
    assert decode(session.status(65536, 65537, 131071)) == Status(State.IDLE, Fault.NONE, False, 0, 1, 65535)
    assert decode(session.event(EventKind.INDEX, (1 << 32) + 1, 2)) == Event(EventKind.INDEX, 2, 1)
    assert decode(session.pong(Ping(3), 1 << 32, 0.5)) == Pong(3, 0, 32768)
    assert decode(session.pong(Ping(3), 0, 0.99999999)) == Pong(3, 0, 65535)


def test_another_node_answers_as_itself():
    session = DeviceSession(IDENTITY, node=5)
    assert session.receive(encode(Hello(1)), 0.0) == Answer()
    assert {frame.node for frame in session.receive(encode(Hello(1), node=5), 0.0).frames} == {5}
