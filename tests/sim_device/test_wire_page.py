"""A program written only from docs/wire.md and the DBC communicates with the device."""

import hashlib
import re
import socket
import time
from binascii import crc_hqx
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cantools
import numpy as np
import pytest

from dpr_lab.rig import Rig

PATIENCE_S = 60.0
ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "wire.md").read_text(encoding="utf-8")
DBC_FILE = ROOT / "firmware_protocol" / "dpr.dbc"


def section(title: str) -> str:
    return PAGE.partition(f"\n## {title}\n")[2].partition("\n## ")[0]


def table(title: str) -> list[dict[str, str]]:
    head, _, *rows = (line.strip("| ").split(" | ") for line in section(title).splitlines() if line.startswith("|"))
    return [dict(zip(head, row, strict=True)) for row in rows]


NUMBERS = {row["name"]: int(row["number"]) for row in table("Messages")}
ORDER = [
    re.findall(r"[A-Z]{4,}", line)[0] for line in re.findall(r"^\d\. .*", section("Sequence of a recording"), re.M)
]
COUNTERS, ANGLES = (
    np.array([[float(row[name]) for name in names] for row in table("Meaning of the counters")])
    for names in (("`position0`", "`position1`", "`position2`"), ("θ0", "θ1", "θ2"))
)


def angles(turns: np.ndarray) -> np.ndarray:
    """What the page's rows say, and what lies between them."""
    rule, *_ = np.linalg.lstsq(np.column_stack([COUNTERS, np.ones(len(COUNTERS))]), ANGLES, rcond=None)
    return np.append(turns, 1.0) @ rule


class Stranger:
    """Client that sends and receives frames on a socket as the page describes."""

    def __init__(self, line: socket.socket) -> None:
        self._dbc: Any = cantools.database.load_file(DBC_FILE)
        self._line = line
        self._line.settimeout(0.02)
        self._rest, self._token = b"", 0
        self.heard: dict[str, dict[str, Any]] = {}
        self.positions: dict[int, int] = {}

    def send(self, name: str, **fields: int) -> None:
        message = self._dbc.get_message_by_name(name)
        frame = (64 + NUMBERS[name]).to_bytes(2, "little") + (message.encode(fields) if message.length else b"")
        data = frame + crc_hqx(frame, 0xFFFF).to_bytes(2, "little")
        self._line.sendall(b"".join(bytes([len(run) + 1]) + run for run in data.split(b"\0")) + b"\0")

    def listen(self) -> None:
        """Received messages by name. Also sends a KEEPALIVE."""
        self.send("KEEPALIVE")
        try:
            self._rest += self._line.recv(65536)
        except TimeoutError:
            return
        *packets, self._rest = self._rest.split(b"\0")
        for packet in packets:
            data, at = bytearray(), 0
            while at < len(packet):
                data += packet[at + 1 : at + packet[at]] + b"\0"
                at += packet[at]
            number = int.from_bytes(data[:2], "little") - 64
            name = next(name for name, known in NUMBERS.items() if known == number)
            result = self._dbc.get_message_by_name(name).decode(bytes(data[2:-3]))
            self.heard[name] = (self.heard.get(name, {}) if name == "INFO" else {}) | result
            if name == "POSITION":
                self.positions[result["joint"]] = result["position"]

    def until(self, condition: Callable[[], object]) -> None:
        give_up = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < give_up, self.heard
            self.listen()

    def ask(self, name: str, **fields: int) -> str:
        """Send a command, and return ACK or the name of the refusal."""
        self._token += 1
        self.heard.pop("ACK", None)
        self.heard.pop("NAK", None)
        self.send(name, token=self._token, **fields)
        self.until(lambda: "ACK" in self.heard or "NAK" in self.heard)
        return str(self.heard["NAK"]["code"]) if "NAK" in self.heard else "ACK"

    def state(self) -> tuple[str, bool]:
        """State and latch, from the next STATUS."""
        self.heard.pop("STATUS", None)
        self.until(lambda: "STATUS" in self.heard)
        return str(self.heard["STATUS"]["state"]), bool(self.heard["STATUS"]["latched"])

    def angles(self) -> np.ndarray:
        """Where the rods are now."""
        self.positions.clear()
        self.until(lambda: len(self.positions) == 3)
        turn = [self.heard["INFO"][f"counts_per_rev{joint}"] for joint in range(3)]
        return angles(np.array([self.positions[joint] / turn[joint] for joint in range(3)]))

    def off(self, pose: np.ndarray) -> float:
        """Distance of a rod from a pose without whole turns, degrees."""
        return float(np.abs((self.angles() - pose + 180) % 360 - 180).max())


def test_the_page_of_the_protocol_suffices_to_decode_counters_and_their_order(
    simulated: Callable[..., Any], paper: Rig
) -> None:
    per_rev, pose = np.array(paper.encoders.counts_per_rev), np.degrees(paper.poses["X1"].theta)
    assert np.allclose(np.degrees(paper.theta(COUNTERS * per_rev)), ANGLES)

    major, minor = re.findall(r'^VERSION "(\d+)\.(\d+)"', DBC_FILE.read_text(encoding="utf-8"), re.M)[0]
    schema = int.from_bytes(hashlib.sha256(DBC_FILE.read_bytes()).digest()[:4], "big")
    fields = {
        "HELLO": {"major": int(major), "minor": int(minor), "schema_hash": schema},
        "HOLD": {"pose": 1},
        "STREAM": {"rate_hz": 100},
        "RELEASE": {"key": 53425},
    }
    commands = [name for name in ORDER if name != "POSITION"]
    assert commands == [*fields, "STOP"]
    with socket.create_connection(("127.0.0.1", int(simulated(link="tcp:0").url.rpartition(":")[2]))) as line:
        stranger = Stranger(line)
        for index, name in enumerate(commands[:-1]):
            before = stranger.state() if index else None  # it says nothing before it is greeted
            for later in commands[index + 1 : -1]:  # no pose, no stream and no release before its turn
                assert stranger.ask(later, **fields[later]) == ("WRONG_STATE" if index else "NOT_GREETED")
            assert not index or stranger.state() == before
            assert stranger.ask(name, **fields[name]) == "ACK"
            if name == "HELLO":
                stranger.until(lambda: "rate_max_hz" in stranger.heard.get("INFO", {}))
                assert stranger.angles() == pytest.approx(ANGLES[0], abs=1.0)  # count 0, as the first row says
                assert stranger.off(pose) > 90  # nobody is asked to the pose yet
            elif name == "HOLD":
                stranger.until(lambda: stranger.off(pose) < np.degrees(paper.poses["X1"].tolerance))
        assert stranger.state() == ("RELEASED", False)
        assert stranger.ask("STOP") == "ACK"
        assert stranger.state() == ("IDLE", False)
