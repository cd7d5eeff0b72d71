"""tmux, GNU screen and similar programs confirm frames without a viewer; a release requires the displayed code."""

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from textual import events

from dpr_lab.tui.terminal.multiplexer import from_attributes, from_environment, from_version
from dpr_lab.tui.terminal.replies import ReplyParser
from tests.tui.terminal_emulator import PATIENCE_S, Terminal, to_ready, without_multiplexer

SIM = "sim://?seed=1"
CODE = re.compile(r"RELEASE X1: type ([a-z]{3})")


@pytest.mark.parametrize(
    ("environment", "name"),
    [
        ({"TERM": "xterm-256color"}, ""),
        ({"TERM": "xterm-256color", "TMUX": "/run/tmux-0/default,1,0"}, "tmux"),
        ({"TERM": "xterm-256color", "STY": "123.pts-0.host"}, "GNU screen"),
        ({"TERM": "xterm-256color", "ZELLIJ": "0"}, "Zellij"),
        ({"TERM": "tmux-256color"}, "tmux"),
        ({"TERM": "screen.xterm-256color"}, "GNU screen or tmux"),
        ({"TERM": "xterm", "TMUX": ""}, ""),
        ({}, ""),
    ],
)
def test_the_environment_names_the_multiplexer(environment: dict[str, str], name: str) -> None:
    assert from_environment(environment) == name


def test_replies_identify_the_multiplexer_and_plain_terminals_are_not_mistaken_for_one() -> None:
    assert [from_attributes(reply) for reply in ("84;0;0", "83;40900;0", "1;10;0")] == ["tmux", "GNU screen", "mosh"]
    assert [from_attributes(reply) for reply in ("41;390;0", "1;4000;35", "0;276;0", "65;7600;1", "")] == [""] * 5
    assert from_version("tmux 3.4") == "tmux 3.4"
    assert from_version("Zellij(4200)") == "Zellij(4200)"
    assert [from_version(reply) for reply in ("XTerm(390)", "kitty(0.35.2)", "WezTerm 2024")] == [""] * 3


@pytest.mark.parametrize("piece", [1, 3, 1000])
def test_a_reply_of_the_terminal_is_never_taken_as_a_key(piece: int) -> None:
    names: list[str] = []
    parser = ReplyParser(names.append)
    text = "a\x1b[>84;0;0cb\x1bP>|tmux 3.4\x1b\\\x1b[Ar\x1b[5;70R"
    arrived = [event for i in range(0, len(text), piece) for event in parser.feed(text[i : i + piece])]
    assert [event.key for event in arrived if isinstance(event, events.Key)] == ["a", "b", "up", "r"]
    assert [(event.x, event.y) for event in arrived if isinstance(event, events.CursorPosition)] == [(69, 4)]
    assert names == ["tmux", "tmux 3.4"]


def test_a_reply_that_is_cut_or_endless_does_not_swallow_the_keys_that_follow() -> None:
    parser = ReplyParser(lambda _: None)
    keys = [
        event.key
        for event in parser.feed("\x1bP>|tm\x1b[Ar" + "\x1bP>|" + "x" * 65 + "yz")
        if isinstance(event, events.Key)
    ]
    assert keys[:2] == ["up", "r"]
    assert keys[-2:] == ["y", "z"]


class Tmux:
    """Detached tmux session that runs a command without a viewer."""

    def __init__(self, socket: Path, command: list[str]) -> None:
        self._socket = socket
        environment = without_multiplexer(os.environ)
        self._tmux("new-session", "-d", "-x", "80", "-y", "24", *command, env=environment)

    def press(self, *keys: str) -> None:
        """Press keys, as a script does without seeing the screen."""
        self._tmux("send-keys", *keys)

    def text(self) -> str:
        """Displayed text in one line."""
        return " ".join(re.sub(r"[^ -~]", " ", self._tmux("capture-pane", "-p")).split())

    def until_shown(self, text: str) -> None:
        """Wait until a text is displayed."""
        deadline = time.monotonic() + PATIENCE_S
        while text not in self.text():
            assert time.monotonic() < deadline, self.text()
            time.sleep(0.1)

    def close(self) -> None:
        """End the session."""
        subprocess.run(["tmux", "-S", str(self._socket), "kill-server"], capture_output=True, check=False)

    def _tmux(self, *words: str, env: dict[str, str] | None = None) -> str:
        command = ["tmux", "-S", str(self._socket), "-f", "/dev/null", *words]
        return subprocess.run(command, capture_output=True, text=True, check=True, env=env).stdout


@pytest.fixture
def tmux(tmp_path: Path) -> Iterator[Tmux]:
    if shutil.which("tmux") is None:
        pytest.skip("needs tmux")
    command = [sys.executable, "-m", "dpr_lab", "tui", "--link", SIM, "--out", str(tmp_path / "bench")]
    session = Tmux(tmp_path / "tmux", command)
    yield session
    session.close()


def runs(folder: Path) -> list[Path]:
    return list((folder / "bench" / "runs").glob("*.mcap"))


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_in_a_detached_session_of_tmux_the_release_key_alone_releases_nothing(tmux: Tmux, tmp_path: Path) -> None:
    # The latch opened 4.1 s after the key, with nobody attached: tmux confirms what it draws for nobody.
    tmux.until_shown("Connect")
    tmux.press("c")
    tmux.until_shown("latch OPEN")
    tmux.press("3")
    tmux.until_shown("the latch closes")
    tmux.press("s")
    tmux.until_shown("to RELEASE")
    tmux.press("r")
    tmux.until_shown("type")
    assert CODE.search(tmux.text())
    time.sleep(6.0)
    assert "latch CLOSED" in tmux.text()
    assert runs(tmp_path) == []
    tmux.press("r", "1")
    tmux.until_shown("the key 1 was pressed")
    tmux.press("r")
    tmux.until_shown("type")
    code = CODE.search(tmux.text())
    assert code is not None
    tmux.press(*code[1])
    tmux.until_shown("REC")
    assert len(runs(tmp_path)) == 1


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    "reply",
    [b"\x1b[>83;40900;0c", pytest.param(b"\x1bP>|Zellij(4200)\x1b\\", marks=pytest.mark.long)],
    ids=["GNU screen", "Zellij"],
)
def test_a_multiplexer_beyond_ssh_is_known_by_its_reply(on_terminal, tmp_path: Path, reply: bytes) -> None:
    terminal: Terminal = on_terminal(SIM, replies={b"c": reply} if reply.endswith(b"c") else {b"q": reply})
    to_ready(terminal)
    terminal.press("r")
    terminal.until(lambda: CODE.search(terminal.text()))
    code = CODE.search(terminal.text())
    assert code is not None
    terminal.press(code[1])
    terminal.until_shown("RELEASING")
    terminal.press("x")
    terminal.until_shown("the key x was pressed")
    assert runs(tmp_path) == []
