import json
from pathlib import Path
from typing import get_type_hints

import pytest

import firmware_protocol
from firmware_protocol.framing import FrameDecoder, encode_frame
from firmware_protocol.messages import MESSAGES, Info, Message, decode, encode

VECTORS = json.loads(Path(firmware_protocol.__file__).with_name("vectors.json").read_text(encoding="utf-8"))


def message_of(row: dict) -> Message:
    kind, result = MESSAGES[row["message"]], dict(row["fields"])
    if kind is Info:
        return Info(result.pop("page"), result)
    hints = get_type_hints(kind)
    return kind(**{name: hints[name](value) for name, value in result.items()})


@pytest.mark.parametrize("row", VECTORS["frames"], ids=lambda row: row.get("serial", row["message"]))
def test_golden_frame(row: dict):
    message = message_of(row)
    frame = encode(message, row["node"])
    made = {**row, "id": frame.id, "data": frame.data.hex(), "serial": encode_frame(frame).hex()}
    assert row == made, f"the row of these fields is {json.dumps(made)}"
    (received,) = FrameDecoder().feed(bytes.fromhex(row["serial"]))
    assert received == frame
    assert decode(received) == message


@pytest.mark.parametrize("row", VECTORS["rejected"], ids=lambda row: row["why"])
def test_golden_rejection(row: dict):
    decoder = FrameDecoder()
    assert decoder.feed(bytes.fromhex(row["serial"])) == []
    assert {"crc": decoder.crc_errors, "framing": decoder.framing_errors} == {
        "crc": 0,
        "framing": 0,
        row["cause"]: 1,
    }


def test_every_message_has_a_golden_frame():
    assert {row["message"] for row in VECTORS["frames"]} == set(MESSAGES)
