import hashlib
import re
from dataclasses import fields
from enum import IntEnum
from pathlib import Path

import cantools
import pytest

import firmware_protocol
from firmware_protocol.definition import PROTOCOL_VERSION, SCHEMA_HASH, schema_hash
from firmware_protocol.messages import MESSAGES, NUMBERS, EventKind, Fault, Info, NakCode, State, explain
from firmware_protocol.session import LEASE_S

DBC_FILE = Path(firmware_protocol.__file__).with_name("dpr.dbc")
DOCS = Path(__file__).parents[2] / "docs" / "wire.md"
DBC = cantools.database.load_file(DBC_FILE)


def test_every_message_of_the_dbc_has_a_dataclass_with_its_fields():
    assert {message.name: message.frame_id for message in DBC.messages} == {
        name: NUMBERS[kind] for name, kind in MESSAGES.items()
    }
    for name, kind in MESSAGES.items():
        if kind is not Info:
            signals = [signal.name for signal in DBC.get_message_by_name(name).signals]
            assert [field.name for field in fields(kind)] == signals


@pytest.mark.parametrize(
    ("message", "signal", "enum"),
    [
        ("EVENT", "kind", EventKind),
        ("STATUS", "state", State),
        ("STATUS", "fault", Fault),
        ("NAK", "code", NakCode),
    ],
)
def test_enums_are_the_value_tables(message: str, signal: str, enum: type[IntEnum]):
    choices = DBC.get_message_by_name(message).get_signal_by_name(signal).choices
    assert {int(value): str(name) for value, name in choices.items()} == {member.value: member.name for member in enum}


def test_command_tables_name_the_messages():
    for answer in ("ACK", "NAK"):
        choices = DBC.get_message_by_name(answer).get_signal_by_name("command").choices
        assert {str(name): int(value) for value, name in choices.items()} == {
            name: NUMBERS[kind]
            for name, kind in MESSAGES.items()
            if hasattr(kind, "token") and name not in ("PING", "PONG", "ACK", "NAK")
        }


@pytest.mark.parametrize("code", [*NakCode, *Fault, *EventKind], ids=lambda code: f"{type(code).__name__}.{code.name}")
def test_every_code_has_a_text_and_a_remedy(code: NakCode | Fault | EventKind):
    text, remedy = explain(code)
    for sentence in (text, remedy):
        assert len(sentence) > 8
        assert sentence[0].isupper()
        assert sentence.endswith(".")


def test_everything_is_commented_and_has_a_range():
    for message in DBC.messages:
        assert message.comment, message.name
        for signal in message.signals:
            assert signal.comment, f"{message.name}.{signal.name}"
            assert signal.minimum is not None
            assert signal.maximum is not None
            assert signal.byte_order == "little_endian"


def test_messages_fit_one_frame_and_their_numbers_determine_the_direction():
    for message in DBC.messages:
        assert message.length <= 8
        assert message.senders == (["HOST"] if message.frame_id >= 32 else ["DEVICE"])


def test_schema_hash_is_the_sha256_of_the_file_with_any_line_ends():
    data = DBC_FILE.read_bytes()
    assert b"\r" not in data
    assert SCHEMA_HASH.to_bytes(4, "big") == hashlib.sha256(data).digest()[:4]
    assert schema_hash(data.decode().replace("\n", "\r\n")) == SCHEMA_HASH
    assert schema_hash(data.decode().replace("Hz", "kHz")) != SCHEMA_HASH


def test_version_is_the_dbc_s():
    assert DBC.version == "{}.{}".format(*PROTOCOL_VERSION)


def test_documented_message_table_is_the_dbc():
    rows = re.findall(r"^\| (\d+) \| ([A-Z_]+) \| (\d) \| ([^|]*) \|", DOCS.read_text(encoding="utf-8"), re.MULTILINE)
    documented = [
        (int(number), name, int(length), set(re.findall("`(.*?)`", result))) for number, name, length, result in rows
    ]
    assert documented == [(m.frame_id, m.name, m.length, {s.name for s in m.signals}) for m in DBC.messages]


def test_documented_lease_is_the_one_kept():
    assert f"{LEASE_S * 1000:.0f} ms" in DOCS.read_text(encoding="utf-8")
