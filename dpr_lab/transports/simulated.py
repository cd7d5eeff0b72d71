"""Simulated device in a child process: `sim://?plant=paper&seed=1&clock=fast&bus=can`.

The child communicates over a pseudo-terminal (or slcan, or TCP), like a real device. The child prints the URL of its
link, which this module opens like any other link.
"""

import json
import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dpr_lab.child_process import ChildProgram
from dpr_lab.errors import ConfigError, DeviceLost, LinkError, LinkUrlError
from dpr_lab.kernel_cache import compiling_simulator, simulator_compiled
from dpr_lab.transports import open_transport
from dpr_lab.transports.transport import Capacity, Received, Transport
from dpr_lab.transports.url import LinkUrl, one_of, whole_number
from firmware_protocol.messages import Frame


@dataclass(frozen=True, slots=True)
class Patience:
    """Time limits for the simulated device."""

    start_s: float = 180.0
    first_start_s: float = 600.0
    """Maximum duration of the first start on a computer, s. The first start takes long because it compiles the
    dynamics."""
    notice_s: float = 5.0
    """Time after which a first start is reported as compiling, s. Errors in the arguments are reported earlier."""
    stop_s: float = 2.0
    """Waiting time after each attempt to end the child, s: closing its standard input, terminating it, killing it."""


PATIENCE = Patience()

LINKS = {"pty": "pty", "can": "slcan", "tcp": "tcp:0"}
"""Value of the child's option `--link` for each value of the URL option `bus`."""
DEFAULT_BUS = "tcp" if sys.platform == "win32" else "pty"  # Windows has no pseudo-terminals


def compiles_first(link: str) -> bool:
    """Return whether a link starts a simulated device that compiles its kernels first.

    Such a device sends nothing during its first release.
    """
    return link.startswith("sim:") and not simulator_compiled()


def open_simulated(url: LinkUrl, rig_file: Path | None) -> "SimulatedTransport":
    """Start a simulated device and connect to it.

    Options: `bus` (pty, can, tcp), and the options explained by `python -m sim_device --help`: `rig`, `plant`, `seed`,
    `clock`, `firmware` (python, c), `draw` (true), `draw_effects`, `baud`, `uid`, `drift_ppm`, `hand_error`, `torques`
    and `fault` (NAME=VALUE, several separated by commas).

    Raises:
        LinkUrlError: an option is unknown, or the device refuses it; the device writes the message.
        LinkError: the device did not start; the device writes the message.
    """
    options = url.options(_OPTIONS)
    if url.host or url.path.strip("/"):
        raise LinkUrlError(f"{url.text}: a simulated device has no address; use for example sim://?plant=paper&seed=1")
    child = ChildProgram([sys.executable, "-m", "sim_device", "--exit-with-parent", *_arguments(options, rig_file)])
    notice = threading.Timer(PATIENCE.notice_s, compiling_simulator)
    notice.start()
    try:
        link = open_transport(_ready_url(url.text, child))
        compiling_simulator()  # the device already answers while it compiles
        return SimulatedTransport(url.text, child, link)
    except BaseException:
        child.end(PATIENCE.stop_s)
        raise
    finally:
        notice.cancel()


def _arguments(options: dict[str, Any], rig_file: Path | None) -> list[str]:
    """Return the command line of the child process."""
    words = dict(options)
    arguments = ["--link", LINKS[words.pop("bus", DEFAULT_BUS)], "--rig", words.pop("rig", str(rig_file or "paper"))]
    for fault in words.pop("fault", "").split(","):
        arguments += ["--fault", fault] if fault else []
    if words.pop("draw", "false") == "true":
        arguments.append("--draw")
    return arguments + [word for name, value in words.items() for word in (f"--{name.replace('_', '-')}", str(value))]


class SimulatedTransport:
    """`Transport` to a simulated device, whose child process ends on `close`."""

    def __init__(self, url: str, child: ChildProgram, link: Transport) -> None:
        self.url = url
        self._child = child
        self._link = link

    @property
    def errors(self) -> dict[str, int]:
        """Number of damaged frames so far, by cause."""
        return self._link.errors

    @property
    def capacities(self) -> tuple[Capacity, ...]:
        """Capacities of the link to the child."""
        return self._link.capacities

    def send(self, frame: Frame) -> None:
        """Send one frame."""
        self._link.send(frame)

    def receive(self, timeout: float) -> Received:
        """Return all frames that have arrived; wait at most `timeout` s for the first frame."""
        try:
            return self._link.receive(timeout)
        except DeviceLost as error:
            raise DeviceLost(f"{self.url}: the simulated device has ended{_last_words(self._child)}") from error

    def close(self) -> None:
        """Close the link and end the child."""
        self._link.close()
        self._child.end(PATIENCE.stop_s)


def _ready_url(url: str, child: ChildProgram) -> str:
    """Wait for the first line of the child, which contains the URL of its link.

    Raises:
        LinkUrlError: the child refuses its arguments.
        LinkError: the line did not arrive in time or has another content.
    """
    patience_s = PATIENCE.start_s if simulator_compiled() else PATIENCE.first_start_s
    try:
        return json.loads(child.line(patience_s))["url"]
    except (KeyError, TypeError, ValueError) as error:
        if child.exit_code is None and not child.last_words:
            raise LinkError(
                f"{url}: the simulated device did not start within {patience_s:g} s: try again when this computer is"
                " less busy"
            ) from error
        child.end(PATIENCE.stop_s)
        refused = child.exit_code in (LinkUrlError.exit_code, ConfigError.exit_code)
        kind = LinkUrlError if refused else LinkError
        raise kind(f"{url}: the simulated device did not start{_last_words(child)}") from error


def _last_words(child: ChildProgram) -> str:
    return f": {child.last_words}" if child.last_words else ""


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
    "torques": _word,
}
