"""The screen in a browser: the real command under Textual's web driver, spoken to as `textual serve` speaks."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

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
@pytest.mark.parametrize("allowed", [False, True], ids=["read-only", "--allow-release"])
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
