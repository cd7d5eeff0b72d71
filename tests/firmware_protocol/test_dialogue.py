"""Host and device session connected by links that lose, duplicate and reorder frames."""

import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import pytest

from firmware_protocol.device_role import Answer, DeviceSession
from firmware_protocol.errors import CommandRefused, CommandUnanswered, LocalProtocolError, RemoteProtocolError
from firmware_protocol.host_role import KEEPALIVE_S, RETRIES, RETRY_S, HostSession, Outcome
from firmware_protocol.identity import DeviceInfo
from firmware_protocol.messages import (
    NUMBERS,
    Ack,
    Command,
    Event,
    EventKind,
    Frame,
    Hello,
    Hold,
    KeepAlive,
    Message,
    Nak,
    NakCode,
    Release,
    State,
    Status,
    Stop,
    Stream,
    decode,
    encode,
    frame_id,
)

DEVICE = DeviceInfo("0.1.0", "00000000000000ff", (16384, 16384, 16384), 4000, 100)
STEP_S = 0.01


@dataclass
class Link:
    """One direction of a line. Each frame takes a step, and may be lost, duplicated or delayed for some steps."""

    chance: random.Random
    loss: float = 0.0
    double: float = 0.0
    delay: int = 0
    flying: list[tuple[int, Frame]] = field(default_factory=list)

    def send(self, frame: Frame, now: int) -> None:
        for _ in range(1 + (self.chance.random() < self.double)):
            if self.chance.random() >= self.loss:
                self.flying.append((now + 1 + self.chance.randint(0, self.delay), frame))

    def arrived(self, now: int) -> list[Frame]:
        here = [frame for when, frame in self.flying if when <= now]
        self.flying = [entry for entry in self.flying if entry[0] > now]
        return here


@dataclass
class Pair:
    """Host and device with a line between them, and the tasks that the device received."""

    down: Link
    up: Link
    host: HostSession = field(default_factory=HostSession)
    device: DeviceSession = field(default_factory=lambda: DeviceSession(DEVICE))
    done: list[str] = field(default_factory=list)
    heard: list[Message] = field(default_factory=list)
    step: int = 0

    @property
    def now(self) -> float:
        return self.step * STEP_S

    def run(self, steps: int) -> Iterator[int]:
        for _ in range(steps):
            self.step += 1
            self.carry_out(self.device.check_lease(self.now, self.step))
            for frame in self.down.arrived(self.step):
                self.carry_out(self.device.receive(frame, self.now))
            for frame in self.up.arrived(self.step):
                if message := self.host.receive(frame):
                    self.heard.append(message)
            for frame in self.host.due(self.now):
                self.down.send(frame, self.step)
            yield self.step

    def carry_out(self, answer: Answer) -> None:
        for frame in answer.frames:
            self.up.send(frame, self.step)
        if answer.task:
            self.done.append(type(answer.task).__name__)
        if isinstance(answer.task, Release):
            self.up.send(self.device.event(EventKind.RELEASED, self.step), self.step)

    def ask(self, command: Command) -> Outcome:
        frame = self.host.hello(self.now) if isinstance(command, Hello) else self.host.command(command, self.now)
        self.down.send(frame, self.step)
        for _ in self.run(100):
            if self.host.outcome:
                return self.host.outcome
        raise AssertionError("neither answered nor given up")


def pair(seed: int = 0, **faults: float) -> Pair:
    chance = random.Random(seed)
    return Pair(Link(chance, **faults), Link(chance, **faults))


DIALOGUE = (Hello(), Hold(pose=1), Stream(rate_hz=1000), Release(), Stop())


@pytest.mark.parametrize(
    "faults",
    [
        {},
        {"loss": 0.1},
        {"double": 0.5},
        {"delay": 4},
        {"loss": 0.1, "double": 0.3, "delay": 4},
    ],
    ids=str,
)
@pytest.mark.parametrize("seed", range(20))
def test_the_whole_dialogue_gets_through_and_acts_once(faults: dict[str, float], seed: int):
    line = pair(seed, **faults)
    for command in DIALOGUE:
        assert line.ask(command).error is None, command
    assert line.done == ["Hold", "Stream", "Release", "Stop"]
    assert line.device.state is State.IDLE
    assert line.host.info == DEVICE


def test_keepalives_keep_a_device_streaming_and_silence_stops_it_latched():
    line = pair()
    for command in DIALOGUE[:3]:
        line.ask(command)
    for _ in line.run(500):
        assert line.device.state is State.STREAMING
    line.down.loss = 1.0
    for _ in line.run(60):
        pass
    assert (line.device.state, line.device.latched) == (State.HOLDING, True)
    assert [m.kind for m in line.heard if isinstance(m, Event)] == [EventKind.LEASE_LOST]


def test_keepalives_come_at_their_period_and_only_once_greeted():
    host = HostSession()
    assert host.due(now=5.0) == []
    line = pair()
    line.ask(Hello())
    start = line.step
    beats = [step for step in line.run(100) if any(f.number == NUMBERS[KeepAlive] for _, f in line.down.flying)]
    gaps = {b - a for a, b in pairwise(beats)}
    assert gaps <= {round(KEEPALIVE_S / STEP_S), round(KEEPALIVE_S / STEP_S) + 1}
    assert beats[0] - start <= round(KEEPALIVE_S / STEP_S) + 1


def test_the_dialogue_with_an_absent_device_ends():
    line = pair(loss=1.0)
    outcome = line.ask(Hello())
    assert isinstance(outcome.error, CommandUnanswered)
    assert str(outcome.error) == "HELLO was sent 6 times and the device did not answer"
    assert line.now == pytest.approx(RETRY_S * (RETRIES + 1), abs=STEP_S * (RETRIES + 1))


def test_a_refusal_ends_the_command_with_text_and_remedy():
    line = pair()
    line.ask(Hello())
    error = line.ask(Release()).error
    assert isinstance(error, CommandRefused)
    assert error.code is NakCode.WRONG_STATE
    assert str(error) == (
        "the device refused RELEASE: The device cannot do this in the state it is in."
        " Send STOP and begin again with HOLD."
    )


def test_one_command_at_a_time_but_stop_always():
    host = HostSession()
    host.command(Stream(rate_hz=10), now=0.0)
    with pytest.raises(LocalProtocolError, match="HOLD must wait for the answer to STREAM"):
        host.command(Hold(), now=0.0)
    stop = decode(host.command(Stop(), now=0.0))
    assert host.pending == stop
    host.receive(encode(Ack(NUMBERS[Stream], 1)))
    assert host.outcome is None
    host.receive(encode(Ack(NUMBERS[Stop], 2)))
    assert host.outcome == Outcome(Stop(2))


def test_a_command_out_of_range_changes_nothing():
    host = HostSession()
    with pytest.raises(LocalProtocolError):
        host.command(Stream(rate_hz=0), now=0.0)
    assert host.pending is None


def test_tokens_wrap_around_to_zero():
    host = HostSession()
    sent = [decode(host.command(Stop(), now=0.0)) for _ in range(300)]
    assert sent == [Stop(n % 256) for n in range(1, 301)]


def test_status_is_mirrored():
    host, device = HostSession(), DeviceSession(DEVICE)
    host.receive(device.status(1, 2, 3))
    assert host.status == Status(State.IDLE, device.fault_code, False, 1, 2, 3)


@pytest.mark.parametrize(
    "frame",
    [
        encode(Ack(33, 1), node=2),
        encode(Stop(1)),
        Frame(frame_id(1, 20), b"a newer"),
    ],
    ids=["another node", "another host", "a newer minor version"],
)
def test_what_is_not_for_this_host_is_left_alone(frame: Frame):
    host = HostSession()
    host.command(Hold(), now=0.0)
    assert host.receive(frame) is None
    assert host.outcome is None


def test_an_invalid_frame_is_counted_as_an_error_of_the_other_end():
    with pytest.raises(RemoteProtocolError):
        HostSession().receive(Frame(frame_id(1, NUMBERS[Nak]), b"\0\0\0"))
