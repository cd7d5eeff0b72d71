"""The screen in a browser: the real command under Textual's web driver, spoken to as `textual serve` speaks."""

import asyncio
import os
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from tests.thinned import thinned
from tests.tui.terminal_emulator import PATIENCE_S, VirtualScreen


class Browser(VirtualScreen):
    """A page with `dpr-lab tui` on it: packets of a type, a length and data both ways."""

    def __init__(self, *options: str, environment: dict[str, str]) -> None:
        super().__init__((80, 24), self._send)
        command = [sys.executable, "-m", "dpr_lab", "tui", *options]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment)
        threading.Thread(target=self._read, daemon=True).start()

    def press(self, keys: str) -> None:
        """Type."""
        self._send(keys.encode())

    def until_shown(self, text: str) -> None:
        """Wait."""
        deadline = time.monotonic() + PATIENCE_S
        while text not in self.text():
            assert time.monotonic() < deadline, self.text()
            time.sleep(0.05)

    def _send(self, data: bytes) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(b"D" + len(data).to_bytes(4, "big") + data)
        self.process.stdin.flush()

    def _read(self) -> None:
        stdout = self.process.stdout
        assert stdout is not None
        assert stdout.readline() == b"__GANGLION__\n"
        while head := stdout.read(5):
            data = stdout.read(int.from_bytes(head[1:], "big"))
            if head[:1] == b"D":
                self.take(data)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("allowed", thinned([False, True], 2), ids=["read-only", "--allow-release"])
def test_a_browser_releases_only_where_that_was_allowed(tmp_path: Path, allowed: bool, monkeypatch) -> None:
    monkeypatch.setenv("TEXTUAL_DRIVER", "textual.drivers.web_driver:WebDriver")
    monkeypatch.setenv("TERM", "xterm-256color")
    options = ["--link", "sim://?seed=1", "--out", str(tmp_path / "bench"), *(["--allow-release"] if allowed else [])]
    page = Browser(*options, environment=dict(os.environ))
    try:
        page.until_shown("Connect")
        page.press("c")
        page.until_shown("SIMULATED")
        page.press("3")
        page.until_shown("the latch closes")
        page.press("s")
        page.until_shown("to RELEASE")
        page.press("r")
        page.until_shown("REC" if allowed else "read-only")
        assert bool(list((tmp_path / "bench").rglob("*.mcap"))) == allowed
    finally:
        page.process.kill()
        page.process.communicate()


def free_port() -> int:
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        return bound.getsockname()[1]


def answers(port: int) -> bool:
    with socket.socket() as tried:
        return tried.connect_ex(("127.0.0.1", port)) == 0


def opened(url: str, **headers: str) -> tuple[int, str, str]:
    """Status, what the page may load, text."""
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=PATIENCE_S) as page:
            return page.status, page.headers["Content-Security-Policy"], page.read().decode()
    except urllib.error.HTTPError as refused:
        return refused.code, "", ""


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_page_is_for_this_computer_alone_and_shows_the_first_screen(tmp_path: Path) -> None:
    pytest.importorskip("textual_serve")
    port = free_port()
    place = f"127.0.0.1:{port}"
    words = ["tui", "--serve", str(port), "--link", "sim://", "--out", str(tmp_path / "bench")]
    server = subprocess.Popen([sys.executable, "-m", "dpr_lab", *words], stdout=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + PATIENCE_S
        while not answers(port):
            assert server.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.1)
        listening = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()]
        assert {word[1] for word in listening if word[3] == "0A" and word[1].endswith(f":{port:04X}")} == {
            f"0100007F:{port:04X}"
        }
        status, may_load, text = opened(f"http://{place}/")
        assert status == 200
        assert f"ws://{place}/ws" in text
        assert "//" not in may_load.replace(f"http://{place}", "").replace(f"ws://{place}", "")
        assert opened(f"http://{place}/", Host="evil.example")[0] == 403
        assert opened(f"http://{place}/ws", Origin="http://evil.example")[0] == 403
        assert "Connect" in asyncio.run(first_screen(f"ws://{place}/ws?width=80&height=24", f"http://{place}"))
        taken = subprocess.run([sys.executable, "-m", "dpr_lab", *words], capture_output=True, text=True)
        assert taken.returncode == 4
        assert "name another port" in taken.stderr
    finally:
        server.terminate()
        server.wait(PATIENCE_S)


async def first_screen(url: str, origin: str) -> str:
    from aiohttp import ClientSession  # pyright: ignore[reportMissingImports]

    screen = VirtualScreen((80, 24), lambda answer: None)
    async with ClientSession() as session, session.ws_connect(url, headers={"Origin": origin}) as page:
        async with asyncio.timeout(PATIENCE_S):
            while "Connect" not in screen.text():
                said = await page.receive()
                if isinstance(said.data, bytes):
                    screen.take(said.data)
    return screen.text()
