"""What the lab asks of the simulated device's own process: draw and seal a plant, and open it again.

The truth stays in a folder of the device's. Nothing here reads it; the lab sees a seal, a rig file and recordings.
"""

import json
import subprocess
import sys
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from dpr_lab.errors import ConfigError, DprError


class Kind(StrEnum):
    """What is hidden in a plant."""

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


DRAWN: tuple[Kind, ...] = tuple(kind for kind in Kind if kind is not Kind.ANY)
"""All but `ANY`."""


class Level(StrEnum):
    """How visible it is."""

    CLEAR = "clear"
    """A gap of at least twice the noise."""
    SUBTLE = "subtle"
    """A gap of about the noise."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """What the device is to draw."""

    kind: Kind = Kind.ANY
    level: Level = Level.CLEAR
    seed: int | None = None
    """None: fresh chance, which nobody can draw again."""
    rig: str = "paper"
    """Rig file or built-in name that the rig is drawn around."""
    plant: str = "paper"
    """Plant file or built-in name that the plant is drawn around; never read here."""


def seal(wanted: Wanted, folder: Path, *, direct: bool = False) -> dict[str, Any]:
    """Have a plant drawn, sealed and kept in a folder of the device's.

    Args:
        wanted: what to draw
        folder: made by the device
        direct: whether the device is to record it too, without link

    Returns:
        `seal`; `rig`, the text of the rig file that goes with it; `runs` when recorded

    Raises:
        ConfigError: no such rig or plant, or the folder is there already.
    """
    words = ["--rig", wanted.rig, "--plant", wanted.plant, "--draw-effects", f"{wanted.kind}:{wanted.level}"]
    seed = [] if wanted.seed is None else ["--seed", str(wanted.seed)]
    return ask(*words, *seed, "--seal", str(folder), *(["--direct"] if direct else []))


def unseal(folder: Path) -> dict[str, Any]:
    """The truth that the device keeps in a folder, with its salt.

    Raises:
        ConfigError: no sealed plant is there.
    """
    return ask("--unseal", str(folder))


def ask(*words: str) -> dict[str, Any]:
    """What the simulated device prints when it is started with some words.

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
        refused = ConfigError if done.returncode == ConfigError.exit_code else DprError
        raise refused(f"the simulated device says: {done.stderr.strip() or f'nothing, code {done.returncode}'}")
    return json.loads(done.stdout)
