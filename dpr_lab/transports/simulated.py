"""A simulated device in a child process: `sim://?plant=paper&seed=1&clock=fast&bus=can`.

The child speaks over a pseudo-terminal (or slcan, or TCP) exactly as a device does; this end opens the URL that the
child prints and from there on does not know the difference.
"""

import json
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from typing import IO, Any

from dpr_lab.errors import ConfigError, DeviceLost, LinkError, LinkUrlError
from dpr_lab.transports import open_transport
from dpr_lab.transports.transport import Capacity, Received, Transport
from dpr_lab.transports.url import LinkUrl, one_of, whole_number
from firmware_protocol.messages import Frame

START_TIMEOUT_S = 60.0  # the first start on a computer compiles the dynamics
STOP_TIMEOUT_S = 2.0

LINKS = {"pty": "pty", "can": "slcan", "tcp": "tcp:0"}
"""Option `bus` -> the child's `--link`."""
DEFAULT_BUS = "tcp" if sys.platform == "win32" else "pty"  # Windows has no pseudo-terminals


def open_simulated(url: LinkUrl, rig_file: Path | None) -> "Simulated":
    """Start a simulated device and connect to it.

    Options: `bus` (pty, can, tcp) and, as `python -m sim_device --help` explains them, `rig`, `plant`, `seed`, `clock`,
    `firmware` (python, c), `draw` (true), `draw_effects`, `baud`, `uid`, `drift_ppm`, `hand_error` and `fault`
    (NAME=VALUE, several with commas between).

    Raises:
        LinkUrlError: an option that is unknown, or that the device does not take; with what it said.
        LinkError: the device did not start; with what it said.
    """
    options = url.options(_OPTIONS)
    if url.host or url.path.strip("/"):
        raise LinkUrlError(
            f"{url.text}: a simulated device has no address; write for example sim://?plant=paper&seed=1"
        )
    child = _Child(url.text, _arguments(options, rig_file))
    try:
        return Simulated(url.text, child, open_transport(child.ready_url(START_TIMEOUT_S)))
    except BaseException:
        child.stop()
        raise


def _arguments(options: dict[str, Any], rig_file: Path | None) -> list[str]:
    """The child's command line."""
    said = dict(options)
    arguments = ["--link", LINKS[said.pop("bus", DEFAULT_BUS)], "--rig", said.pop("rig", str(rig_file or "paper"))]
    for fault in said.pop("fault", "").split(","):
        arguments += ["--fault", fault] if fault else []
    if said.pop("draw", "false") == "true":
        arguments.append("--draw")
    return arguments + [word for name, value in said.items() for word in (f"--{name.replace('_', '-')}", str(value))]


class Simulated:
    """A `Transport` to a child process that ends when the transport is closed."""

    def __init__(self, url: str, child: "_Child", link: Transport) -> None:
        self.url = url
        self._child = child
        self._link = link

    @property
    def errors(self) -> dict[str, int]:
        """Damaged frames so far, by cause."""
        return self._link.errors

    @property
    def capacities(self) -> tuple[Capacity, ...]:
        """The limits of the link to the child."""
        return self._link.capacities

    def send(self, frame: Frame) -> None:
        """Send one frame."""
        self._link.send(frame)

    def receive(self, timeout: float) -> Received:
        """All that has arrived, waiting at most `timeout` s for the first frame."""
        try:
            return self._link.receive(timeout)
        except DeviceLost as error:
            raise DeviceLost(f"{self.url}: the simulated device is gone{self._child.last_words()}") from error

    def close(self) -> None:
        """Close the link and end the child."""
        self._link.close()
        self._child.stop()


class _Child:
    """The process of a simulated device; its stdin pipe is its life line, also when this process is killed."""

    def __init__(self, url: str, arguments: list[str]) -> None:
        self._url = url
        self._log: IO[bytes] = tempfile.TemporaryFile()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "sim_device", "--exit-with-parent", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            # Ctrl-C at the terminal is for us: the device must live on to hear STOP.
            start_new_session=True,
        )

    def ready_url(self, timeout: float) -> str:
        """The URL the device listens on, from its first line.

        Raises:
            LinkUrlError: the process does not take its arguments.
            LinkError: the line did not come in time or is not it.
        """
        lines: list[bytes] = []
        stdout = self._process.stdout
        assert stdout is not None
        reader = threading.Thread(target=lambda: lines.append(stdout.readline()), daemon=True)
        reader.start()
        reader.join(timeout)
        try:
            return json.loads(lines[0])["url"]
        except (IndexError, KeyError, TypeError, ValueError) as error:
            self._end_process()
            reader.join()
            refused = self._process.returncode in (LinkUrlError.exit_code, ConfigError.exit_code)
            kind = LinkUrlError if refused else LinkError
            raise kind(f"{self._url}: the simulated device did not start{self.last_words()}") from error

    def last_words(self) -> str:
        """`: ` and the last line the process wrote to its log; a full stop when it wrote none."""
        if self._log.closed:
            return "."
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").split("\n")
        said = [line.strip() for line in lines if line.strip()]
        return f": {said[-1]}" if said else "."

    def stop(self) -> None:
        """End the process and wait for it; stopping twice is harmless."""
        self._end_process()
        for pipe in (self._process.stdin, self._process.stdout, self._log):
            if pipe is not None:
                pipe.close()

    def _end_process(self) -> None:
        """Ask by closing its stdin, then by SIGTERM, then end it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        for insist in (lambda: None, self._process.terminate, self._process.kill):
            insist()
            try:
                self._process.wait(STOP_TIMEOUT_S)
                return
            except subprocess.TimeoutExpired:
                continue


def _seed(text: str) -> int:
    return 0 if text == "0" else whole_number(text)


def _word(text: str) -> str:
    if not text:
        raise ValueError("is empty")
    return text


_OPTIONS = {
    "rig": _word,
    "plant": _word,
    "seed": _seed,
    "clock": one_of("realtime", "fast"),
    "bus": one_of(*LINKS),
    "firmware": one_of("python", "c"),
    "fault": _word,
    "draw": one_of("true", "false"),
    "draw_effects": _word,
    "baud": whole_number,
    "uid": _word,
    "drift_ppm": _word,
    "hand_error": _word,
}
