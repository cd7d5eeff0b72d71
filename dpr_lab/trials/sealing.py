"""Requests to the simulated device, which draws, seals and reveals a plant.

The truth stays in the memory of the device, or in a folder of the device that dpr-lab never reads. dpr-lab receives a
seal, a rig file and recordings.
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


class Kind(StrEnum):
    """Kind of the hidden content of a plant."""

    ANY = "any"
    """One of the kinds in `DRAWN`; the kind is hidden too."""
    SINGLE = "single"
    """One effect of the library."""
    PAIR = "pair"
    TRIPLE = "triple"
    CLEAN = "clean"
    """No effect."""
    FORM = "form"
    """An effect of the library with another functional form."""
    OUTSIDE = "outside"
    """An effect outside the library."""
    DIRTY = "dirty"
    """Faulty encoders, with one effect or without an effect."""
    DRIVEN = "driven"
    """Driven joints with reported torques, with or without a fault of the drives; never chosen by `ANY`."""
    BACKGROUND = "background"
    """One effect among several small effects, sometimes with a fault of the logger; never chosen by `ANY`."""


DRAWN: tuple[Kind, ...] = tuple(kind for kind in Kind if kind not in (Kind.ANY, Kind.DRIVEN, Kind.BACKGROUND))
"""Kinds of plants that swing freely; `ANY` chooses one of them."""


ON_ARM: tuple[Kind, ...] = (Kind.SINGLE, Kind.PAIR, Kind.TRIPLE, Kind.CLEAN, Kind.DIRTY)
"""Kinds of plants with a free or driven arm."""


class Level(StrEnum):
    """Visibility of the hidden content of a plant."""

    CLEAR = "clear"
    """A gap of at least twice the noise."""
    SUBTLE = "subtle"
    """A gap of about the size of the noise."""
    FAINT = "faint"
    """A gap of 0.1 to 1 times the noise: 1 to 10 times the smallest gap that is detectable in a release of 10 s."""


class TrialArm(StrEnum):
    """Mode of the arm of a plant."""

    FREE = "free"
    """The arm moves freely; effects at joint 0 may be drawn."""
    DRIVEN = "driven"
    """A motor drives the arm with a reported input; effects at joint 0 and of the drive may be drawn."""


@dataclass(frozen=True, slots=True)
class PlantRequest:
    """Request for a plant that the simulated device draws."""

    kind: Kind = Kind.ANY
    level: Level = Level.CLEAR
    seed: int | None = None
    """Seed of the draw. None: 128 random bits, so that nobody can guess the seed and repeat the draw."""
    rig: str = "paper"
    """Rig file or built-in name of the rig about which the random rig is drawn."""
    plant: str = "paper"
    """Plant file or built-in name of the plant about which the random plant is drawn; dpr-lab never reads this file."""
    arm: TrialArm | None = None
    """Mode of the arm; None: the mode of the rig file."""


def seal(request: PlantRequest, folder: Path) -> dict[str, Any]:
    """Draw and seal a plant in a folder of the simulated device.

    Args:
        request: the requested plant
        folder: folder that the device creates

    Returns:
        `seal`, and `rig`, the text of the rig file of the plant

    Raises:
        ConfigError: rig or plant is unknown, or the folder already exists.
    """
    from dpr_lab.kernel_cache import compiling_simulator  # this import hashes every kernel source

    compiling_simulator()
    return ask(*_words(request), "--rig", request.rig, "--seal", str(folder))


def _words(request: PlantRequest) -> list[str]:
    seed = [] if request.seed is None else ["--seed", str(request.seed)]
    arm = [] if request.arm is None else ["--arm", request.arm]
    return ["--plant", request.plant, "--draw-effects", f"{request.kind}:{request.level}", *seed, *arm]


@dataclass(frozen=True, slots=True)
class HeldPlant:
    """A sealed plant whose truth exists only in the memory of the device process."""

    public: dict[str, Any]
    """Public data: `seal`; `rig`, the text of the rig file of the plant; `runs` if the device recorded it."""
    _ask: Callable[[str], dict[str, Any]]

    def record(self, release: dict[str, Any]) -> dict[str, Any]:
        """Record one release of the plant.

        Args:
            release: `theta1`, `theta2`, `duration_s`, and optionally `rods` and `added_mass` as in a rig file

        Raises:
            DprError: the rig cannot make this release.
        """
        return self._ask(json.dumps(release))

    def opened(self) -> dict[str, Any]:
        """Reveal truth and salt of the plant, which can then no longer be recorded."""
        return self._ask("open")


@contextmanager
def sealed_in_memory(request: PlantRequest, rig: str, *, direct: bool = True) -> Iterator[HeldPlant]:
    """Draw and seal a plant in a device process that keeps the truth only in memory.

    Args:
        request: the requested plant
        rig: text of the rig file about which the plant is drawn
        direct: whether the device itself records one release from each pose of the rig file, without a link

    Raises:
        ConfigError: the device refuses a file or an argument; the error contains its message.
        DprError: the device failed; the error contains its message.
    """
    words = [sys.executable, "-m", "sim_device", *_words(request), "--seal", "-", *(["--direct"] if direct else [])]
    with (
        tempfile.TemporaryFile("w+") as log,
        subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True) as device,
    ):

        def parsed(line: str) -> dict[str, Any]:
            assert device.stdin is not None
            assert device.stdout is not None
            with suppress(BrokenPipeError):  # the message of the device is more informative than the lost connection
                device.stdin.write(line + "\n")
                device.stdin.flush()
            if answer := device.stdout.readline():
                return json.loads(answer)
            code = device.wait()
            log.seek(0)
            raise _refusal(code, log.read())

        yield HeldPlant(parsed(json.dumps(rig)), parsed)


def ask(*words: str) -> dict[str, Any]:
    """Run the simulated device with the given arguments, and return its output.

    Raises:
        ConfigError: the device refuses a file or an argument; the error contains its message.
        DprError: the device failed; the error contains its message.
    """
    child = subprocess.run(
        [sys.executable, "-m", "sim_device", *words],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    if child.returncode != 0:
        raise _refusal(child.returncode, child.stderr)
    return json.loads(child.stdout)


def _refusal(code: int, output: str) -> DprError:
    refused = ConfigError if code == ConfigError.exit_code else DprError
    return refused(f"the simulated device reports: {output.strip() or f'nothing, code {code}'}")
