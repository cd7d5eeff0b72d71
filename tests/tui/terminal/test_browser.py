"""The screen in a browser: the real command under Textual's web driver."""

import asyncio
import os
import signal
import socket
import subprocess
import threading
import time
import urllib.error
import urllib.request
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.thinned import thinned
from tests.tui.terminal_emulator import PATIENCE_S, VirtualScreen
from tests.warm_process import started


class Browser(VirtualScreen):
    """Page with `dpr-lab tui`: packets with type, length and data in both directions."""

    def __init__(self, *options: str, environment: dict[str, str]) -> None:
        super().__init__((80, 24), self._send)
        pipe = subprocess.PIPE
        self.process = started("dpr_lab", ["tui", *options], stdin=pipe, stdout=pipe, env=environment)
        threading.Thread(target=self._read, daemon=True).start()

    def press(self, keys: str) -> None:
        """Press keys."""
        self._send(keys.encode())

    def until_shown(self, text: str) -> None:
        """Wait until a text is displayed."""
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


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Browser]]:
    """Fixture (arguments of the command) that returns the screen on a page."""
    monkeypatch.setenv("TEXTUAL_DRIVER", "textual.drivers.web_driver:WebDriver")
    monkeypatch.setenv("TERM", "xterm-256color")
    opened: list[Browser] = []

    def show(*words: str) -> Browser:
        options = ["--link", "sim://?seed=1", "--out", str(tmp_path / "bench"), *words]
        opened.append(Browser(*options, environment=dict(os.environ)))
        opened[-1].until_shown("Connect")
        return opened[-1]

    yield show
    for browser in opened:
        browser.process.kill()
        browser.process.communicate()


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_browser_releases_where_that_was_allowed(tmp_path: Path, page: Callable[..., Browser]) -> None:
    browser = page("--allow-release")
    browser.press("c")
    browser.until_shown("SIMULATED")
    browser.press("3")
    browser.until_shown("the latch closes")
    browser.press("s")
    browser.until_shown("to RELEASE")
    browser.press("r")
    browser.until_shown("REC")
    assert list((tmp_path / "bench").rglob("*.mcap"))


def children(pid: int) -> list[str]:
    stdout = subprocess.run(["ps", "-o", "args=", "--ppid", str(pid)], capture_output=True, text=True).stdout
    return [line for line in stdout.splitlines() if "resource_tracker" not in line]


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_read_only_page_neither_calls_a_device_nor_writes(tmp_path: Path, page: Callable[..., Browser]) -> None:
    browser = page()
    browser.press("c")
    browser.until_shown("read-only")
    assert children(browser.process.pid) == []
    assert list(tmp_path.iterdir()) == []


ATTEMPTS = 3


def free_port() -> int:
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        return bound.getsockname()[1]


def answers(port: int) -> bool:
    with socket.socket() as tried:
        return tried.connect_ex(("127.0.0.1", port)) == 0


def opened(url: str, **headers: str) -> tuple[int, str, str]:
    """Open a page, and return status, permitted sources and text."""
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=PATIENCE_S) as page:
            return page.status, page.headers["Content-Security-Policy"], page.read().decode()
    except urllib.error.HTTPError as refused:
        return refused.code, "", ""


@dataclass
class Served:
    """Process `dpr-lab tui --serve`, and the address that it printed."""

    process: subprocess.Popen[str]
    port: int
    words: list[str]
    url: str

    @property
    def place(self) -> str:
        return f"127.0.0.1:{self.port}"

    @property
    def token(self) -> str:
        return self.url.split("/")[3]

    def websocket(self, path: str) -> str:
        return f"ws://{self.place}{path}"


@pytest.fixture
def served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Served]]:
    pytest.importorskip("textual_serve")
    monkeypatch.setenv("DPR_LAB_STATE", str(tmp_path / "state"))
    processes: list[subprocess.Popen[str]] = []

    def start(*words: str) -> Served:
        port = free_port()
        line = ["tui", "--serve", str(port), "--link", "sim://", "--out", str(tmp_path / "bench"), *words]
        process = started("dpr_lab", line, stdout=subprocess.PIPE, text=True)
        processes.append(process)
        assert process.stdout is not None
        result = process.stdout.readline().split()
        if not result and len(processes) < ATTEMPTS:  # another program took the port meanwhile
            return start(*words)
        assert result[0] == "open"
        deadline = time.monotonic() + PATIENCE_S
        while not answers(port):
            assert time.monotonic() < deadline
            time.sleep(0.1)
        return Served(process, port, line, result[1])

    yield start
    for process in processes:
        process.terminate()
        process.wait(PATIENCE_S)
        assert process.stdout is not None
        process.stdout.close()


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_page_is_for_this_computer_and_its_token_alone_and_its_screen_is_read_only(
    served: Callable[..., Served],
) -> None:
    page = served()
    without_a_token_there_is_neither_page_nor_screen(page)
    place, at = page.place, f"{page.port:04X}"
    listening = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()]
    assert {word[1] for word in listening if word[3] == "0A" and word[1].endswith(f":{at}")} == {f"0100007F:{at}"}
    status, may_load, text = opened(page.url)
    assert status == 200
    assert page.websocket(f"/{page.token}/ws") in text
    assert "//" not in may_load.replace(f"http://{place}", "").replace(f"ws://{place}", "")
    assert opened(page.url, Host="evil.example")[0] == 403
    assert opened(page.url, Origin="http://evil.example")[0] == 403
    url = page.websocket(f"/{page.token}/ws?width=80&height=24")
    assert "read-only" in asyncio.run(screen_of(url, "Connect", "c", "read-only"))
    assert "Connect" in asyncio.run(screen_of(page.websocket(f"/ws?token={page.token}"), "Connect"))
    with started("dpr_lab", page.words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as second:
        _, errors = second.communicate()
    assert second.returncode == 4
    assert "choose another port" in errors


def without_a_token_there_is_neither_page_nor_screen(page: Served) -> None:
    assert len(page.token) >= 40
    wrong = page.token[:-1] + ("a" if page.token[-1] != "a" else "b")
    for path in ("/", "/ws", "/static/css/xterm.css", "/anything", f"/{wrong}/", f"/{wrong}/ws", f"/?token={wrong}"):
        assert opened(f"http://{page.place}{path}")[0] == 403, path
    for path in (
        f"/?token={page.token}",
        f"/static/css/xterm.css?token={page.token}",
        f"/{page.token}/static/js/textual.js",
    ):
        assert opened(f"http://{page.place}{path}")[0] == 200, path
    for path in ("/ws", f"/{wrong}/ws", f"/ws?token={wrong}"):
        with pytest.raises(Exception, match="403"):
            asyncio.run(screen_of(page.websocket(path), "Connect"))
    assert children(page.process.pid) == []  # no screen was started


def session_of(leader: int) -> list[str]:
    """Processes of a session that still run."""
    stdout = subprocess.run(["ps", "-o", "pid=,args=", "-s", str(leader)], capture_output=True, text=True).stdout
    return [line for line in stdout.splitlines() if "<defunct>" not in line]


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("number", thinned([signal.SIGKILL, signal.SIGTERM, signal.SIGINT], 3))
def test_screens_that_hold_a_device_end_with_the_server(number: int, served: Callable[..., Served]) -> None:
    page = served("--allow-release")

    async def end_while_connected() -> int:
        async with screen(page.websocket(f"/{page.token}/ws?width=80&height=24")) as (websocket, shown):
            await until(websocket, shown, "Connect")
            await websocket.send_json(["stdin", "c"])
            await until(websocket, shown, "SIMULATED")
            (leader,) = subprocess.run(
                ["ps", "-o", "pid=", "--ppid", str(page.process.pid)], capture_output=True, text=True
            ).stdout.split()
            page.process.send_signal(number)
            return int(leader)

    leader = asyncio.run(end_while_connected())
    deadline = time.monotonic() + PATIENCE_S
    while page.process.poll() is None or session_of(leader):
        assert time.monotonic() < deadline, session_of(leader)
        time.sleep(0.2)


@asynccontextmanager
async def screen(url: str) -> AsyncIterator[tuple[Any, VirtualScreen]]:
    """Websocket of a page, and the screen that it draws."""
    from aiohttp import ClientSession  # pyright: ignore[reportMissingImports]

    origin = f"http://{url.split('/')[2]}"
    async with ClientSession() as session, session.ws_connect(url, headers={"Origin": origin}) as websocket:
        yield websocket, VirtualScreen((80, 24), lambda answer: None)


async def until(websocket: Any, shown: VirtualScreen, text: str) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while text not in shown.text():
            result = await websocket.receive()
            if isinstance(result.data, bytes):
                shown.take(result.data)


async def screen_of(url: str, text: str, *then: str) -> str:
    """Wait for a text on the screen, then press keys and wait for further texts in turn."""
    async with screen(url) as (websocket, shown):
        await until(websocket, shown, text)
        for key, answer in zip(then[::2], then[1::2], strict=True):
            await websocket.send_json(["stdin", key])
            await until(websocket, shown, answer)
        return shown.text()
