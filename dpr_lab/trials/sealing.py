"""What the lab asks of the simulated device's own process: draw and seal a plant, and open it again.

The truth stays in a folder of the device's. Nothing here reads it; the lab sees a seal, a rig file and recordings.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from dpr_lab.errors import ConfigError, DprError
from dpr_lab.kernel_cache import compiling_simulator


class Kind(StrEnum):
    """Kind of hidden content of a plant."""

    ANY = "any"
    """One of the others; which is withheld too."""
    SINGLE = "single"
    """One effect of the library."""
    PAIR = "pair"
    TRIPLE = "triple"
    CLEAN = "clean"
    """None."""
    FORM = "form"
    """An effect of the library in another form."""
    OUTSIDE = "outside"
    """An effect that the library does not hold."""
    DIRTY = "dirty"
    """One or none, and faulty encoders."""
    DRIVEN = "driven"
    """Joints that are driven by torques the device tells, their drives with a fault or none; never in place of any."""
    BACKGROUND = "background"
    """One effect among several small ones, sometimes with a fault of the logger; never in place of any."""


DRAWN: tuple[Kind, ...] = tuple(kind for kind in Kind if kind not in (Kind.ANY, Kind.DRIVEN, Kind.BACKGROUND))
"""Those of free swings: what `ANY` stands for."""


class Level(StrEnum):
    """Visibility of the hidden content."""

    CLEAR = "clear"
    """A gap of at least twice the noise."""
    SUBTLE = "subtle"
    """A gap of about the noise."""


@dataclass(frozen=True, slots=True)
class PlantRequest:
    """Plant to be drawn by the simulated device."""

    kind: Kind = Kind.ANY
    level: Level = Level.CLEAR
    seed: int | None = None
    """None: fresh chance of 128 bits, which nobody can draw again; with a seed, whoever tries seeds finds the plant."""
    rig: str = "paper"
    """Rig file or built-in name that the rig is drawn around."""
    plant: str = "paper"
    """Plant file or built-in name that the plant is drawn around; never read here."""


def seal(request: PlantRequest, folder: Path, *, direct: bool = False) -> dict[str, Any]:
    """Draw and seal a plant in a folder of the simulated device.

    Args:
        request: what to draw
        folder: made by the device
        direct: whether the device is to record it too, without link

    Returns:
        `seal`; `rig`, the text of the rig file that goes with it; `runs` when recorded

    Raises:
        ConfigError: no such rig or plant, or the folder is there already.
    """
    compiling_simulator()
    return ask(*_words(request), "--rig", request.rig, "--seal", str(folder), *(["--direct"] if direct else []))


def _words(request: PlantRequest) -> list[str]:
    seed = [] if request.seed is None else ["--seed", str(request.seed)]
    return ["--plant", request.plant, "--draw-effects", f"{request.kind}:{request.level}", *seed]


@contextmanager
def sealed_in_memory(request: PlantRequest, rig: str) -> Iterator[tuple[dict[str, Any], Callable[[], dict[str, Any]]]]:
    """Draw, seal and record a plant in a process that keeps the truth in memory only.

    Args:
        request: what to draw
        rig: text of the rig file that it is drawn around

    Yields:
        What `seal` gives, with `runs`; and a function that has the plant opened, once

    Raises:
        ConfigError: it refuses a file or a word; with what it says.
        DprError: it failed; likewise.
    """
    words = [sys.executable, "-m", "sim_device", *_words(request), "--seal", "-"]
    with (
        tempfile.TemporaryFile("w+") as log,
        subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True) as device,
    ):

        def parsed(line: str) -> dict[str, Any]:
            assert device.stdin is not None
            assert device.stdout is not None
            with suppress(BrokenPipeError):  # what it says is better than that it is gone
                device.stdin.write(line + "\n")
                device.stdin.flush()
            if answer := device.stdout.readline():
                return json.loads(answer)
            code = device.wait()
            log.seek(0)
            raise _refusal(code, log.read())

        yield parsed(json.dumps(rig)), lambda: parsed("open")


def unseal(folder: Path) -> dict[str, Any]:
    """The truth that the device keeps in a folder, with its salt.

    Raises:
        ConfigError: no sealed plant is there.
    """
    return ask("--unseal", str(folder))


def ask(*words: str) -> dict[str, Any]:
    """Output of the simulated device for some arguments.

    Raises:
        ConfigError: it refuses a file or a word; with what it says.
        DprError: it failed; likewise.
    """
    done = subprocess.run(
        [sys.executable, "-m", "sim_device", *words],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise _refusal(done.returncode, done.stderr)
    return json.loads(done.stdout)


def _refusal(code: int, output: str) -> DprError:
    refused = ConfigError if code == ConfigError.exit_code else DprError
    return refused(f"the simulated device says: {output.strip() or f'nothing, code {code}'}")
