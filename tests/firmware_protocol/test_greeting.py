from dataclasses import replace

import pytest

from firmware_protocol.definition import PROTOCOL_VERSION, SCHEMA_HASH
from firmware_protocol.device_role import DeviceSession
from firmware_protocol.errors import DevicesCollide, VersionMismatch
from firmware_protocol.host_role import HostSession, Outcome
from firmware_protocol.identity import DeviceInfo, assemble, info_pages
from firmware_protocol.messages import Ack, Hello, Info, Message, Nak, NakCode, decode, encode

MAJOR, MINOR = PROTOCOL_VERSION
DEVICE = DeviceInfo("1.22.3", "0123456789abcdef", (16384, 4096, 1 << 20), 4000, 100, simulated_time=True)


def greet(device: DeviceInfo) -> tuple[HostSession, DeviceSession, list[Message]]:
    host, session = HostSession(), DeviceSession(device)
    frames = session.receive(host.hello(now=0.0), now=0.0).frames
    for frame in frames:
        host.receive(frame)
    return host, session, [decode(frame) for frame in frames]


def refusal(device: DeviceInfo) -> str:
    host, _, _ = greet(device)
    assert host.info is None
    assert host.outcome
    assert isinstance(host.outcome.error, VersionMismatch)
    return str(host.outcome.error)


def test_identity_survives_its_pages_in_any_order():
    pages = info_pages(DEVICE)
    assert assemble(pages[::-1] + pages) == DEVICE
    assert [decode(encode(page)) for page in pages] == pages


@pytest.mark.parametrize("missing", range(8))
def test_an_identity_with_a_missing_page_is_incomplete(missing: int):
    assert assemble([page for page in info_pages(DEVICE) if page.page != missing]) is None


def test_a_page_of_a_newer_minor_version_is_ignored():
    assert assemble([*info_pages(DEVICE), Info(9, {})]) == DEVICE


@pytest.mark.parametrize("late", [0, 9], ids=["at once", "after the greeting"])
def test_a_second_device_under_the_same_node_is_reported(late: int):
    host = HostSession()
    hello = host.hello(now=0.0)
    first, second = (DeviceSession(replace(DEVICE, uid=uid)).receive(hello, 0.0).frames for uid in ("1", "2"))
    frames = [*first[:late], *second] if late else [frame for pair in zip(first, second, strict=True) for frame in pair]
    with pytest.raises(DevicesCollide, match="two devices answer as node 1"):
        list(map(host.receive, frames))


def test_the_handshake_identifies_the_device():
    host, session, _ = greet(DEVICE)
    assert host.outcome == Outcome(Hello(1))
    assert host.info == DEVICE
    assert session.greeted


def test_a_newer_major_version_asks_for_an_upgrade_of_the_host():
    result = refusal(replace(DEVICE, major=MAJOR + 1, minor=0, schema_hash=5))
    assert result == (
        f"the device uses protocol {MAJOR + 1}.0 and this dpr-lab {MAJOR}.{MINOR}:"
        f" upgrade dpr-lab (or flash firmware of protocol {MAJOR}.x)"
    )


def test_an_older_major_version_asks_for_new_firmware():
    result = refusal(replace(DEVICE, major=MAJOR - 1, minor=7, schema_hash=5))
    assert result == (
        f"the device uses protocol {MAJOR - 1}.7 and this dpr-lab {MAJOR}.{MINOR}:"
        f" flash newer firmware, of protocol {MAJOR}.x (or install a dpr-lab of protocol {MAJOR - 1}.x)"
    )


def test_the_same_version_from_another_dbc_is_refused():
    result = refusal(replace(DEVICE, schema_hash=SCHEMA_HASH ^ 1))
    assert f"{SCHEMA_HASH ^ 1:08x} and {SCHEMA_HASH:08x}" in result
    assert result.endswith(
        "flash the firmware built from the same dpr.dbc, or install the dpr-lab release that matches"
    )


def test_another_minor_version_is_welcome_with_its_own_schema():
    device = replace(DEVICE, minor=MINOR + 1, schema_hash=SCHEMA_HASH ^ 1)
    host, session, _ = greet(device)
    assert host.info == device
    assert session.greeted


@pytest.mark.parametrize(
    ("device", "code"),
    [
        (replace(DEVICE, major=MAJOR + 1), NakCode.VERSION),
        (replace(DEVICE, schema_hash=SCHEMA_HASH ^ 1), NakCode.SCHEMA),
    ],
)
def test_the_device_refuses_by_itself(device: DeviceInfo, code: NakCode):
    _, session, (answer, *pages) = greet(device)
    assert answer == Nak(32, 1, code)
    assert len(pages) == 8
    assert not session.greeted


def test_page_0_alone_decides_on_a_mismatch_of_the_major_version():
    host = HostSession()
    host.hello(now=0.0)
    host.receive(encode(Info(0, {"major": MAJOR + 1, "minor": 0, "schema_hash": 0})))
    assert host.outcome
    assert isinstance(host.outcome.error, VersionMismatch)


@pytest.mark.parametrize("lost", range(9))
def test_a_greeting_with_a_frame_lost_is_asked_for_again(lost: int):
    host, session = HostSession(), DeviceSession(DEVICE)
    answer = list(session.receive(host.hello(now=0.0), now=0.0).frames)
    del answer[lost]
    for frame in answer:
        host.receive(frame)
    assert host.outcome is None
    assert host.info is None
    (again,) = host.due(now=0.1)
    for frame in session.receive(again, now=0.1).frames:
        host.receive(frame)
    assert host.info == DEVICE


def test_an_answer_to_another_token_is_ignored():
    host = HostSession()
    host.hello(now=0.0)
    for page in info_pages(DEVICE):
        host.receive(encode(page))
    host.receive(encode(Ack(32, 200)))
    assert host.outcome is None
    host.receive(encode(Ack(32, 1)))
    assert host.info == DEVICE


def test_a_device_that_refuses_although_its_pages_match_is_not_greeted():
    host = HostSession()
    host.hello(now=0.0)
    for page in info_pages(DEVICE):
        host.receive(encode(page))
    host.receive(encode(Nak(32, 1, NakCode.SCHEMA)))
    assert host.info is None
    assert host.outcome
    assert isinstance(host.outcome.error, VersionMismatch)
