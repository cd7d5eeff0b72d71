"""Seal a drawn plant: publish a salted hash of the true values before any recording.

The true values remain in a folder of the device, or in its memory, until they are requested. The salt is random and
does not depend on the seed. With the seed the plant can be drawn again, but without the salt the seal cannot confirm
that it is the same plant.
"""

import hashlib
import json
import secrets
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.errors import ConfigError
from sim_device.options import SEALED_FILE, SEALED_TORQUES

if TYPE_CHECKING:
    from sim_device.plant.config import PlantConfig
    from sim_device.plant.drives import JointDrives
    from sim_device.plant.hidden import HiddenPlant

TRUTH = "truth.json"


def seal(truth: dict[str, Any], salt: str) -> str:
    """Compute the SHA-256 of the salt and the truth, in hexadecimal digits.

    The truth is written as compact JSON with sorted keys.
    """
    text = salt + json.dumps(truth, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def truth(plant: "HiddenPlant") -> dict[str, Any]:
    """Return the true parameters, ratios and effects of a plant.

    For an out-of-library effect, the library effects that count as correct answers are included.
    """
    from sim_device.plant.foreign import FOREIGN
    from sim_device.trials.driven import done_by_drives

    config, revealed = plant.config, plant.reveal()
    return revealed | {
        "effects": revealed["effects"] | done_by_drives(config.drives),
        "foreign": {name: dict(values) for name, values in config.foreign.items()},
        "family": {name: [effect.name for effect in FOREIGN[name].family] for name in config.foreign},
        "held_back": [name for name in config.foreign if FOREIGN[name].held_back],
        "encoders": config.encoders.model_dump(mode="json"),
    }


def salted(plant: "HiddenPlant", drawn: dict[str, Any]) -> dict[str, Any]:
    """Return the truth of a plant (key `truth`), including the request, and the `salt` of its hash."""
    return {"salt": secrets.token_hex(16), "truth": truth(plant) | {"drawn": drawn}}


def keep(plant: "PlantConfig", truth: dict[str, Any], folder: Path, drives: "JointDrives | None" = None) -> None:
    """Store a plant and its salted truth in a folder.

    Args:
        plant: the sealed plant
        truth: result of `salted`
        folder: folder to create, accessible by the device only
        drives: drives of its joints, if any

    Raises:
        ConfigError: the folder exists already, or cannot be written.
    """
    from sim_device.plant.drives import write_table
    from sim_device.trials.toml import toml_text

    try:
        folder.mkdir(mode=0o700, parents=True)
        (folder / SEALED_FILE.name).write_text(
            toml_text(plant.model_dump(mode="json", exclude_none=True)), encoding="utf-8"
        )
        if drives is not None:
            write_table(drives, folder / SEALED_TORQUES.name)
        (folder / TRUTH).write_text(json.dumps(truth), encoding="utf-8")
    except FileExistsError as error:
        raise ConfigError(f"{folder}: exists already; a sealed plant is never replaced") from error
    except OSError as error:
        raise ConfigError(f"{folder}: the sealed plant cannot be written there: {error.strerror}") from error


def opened(folder: Path) -> dict[str, Any]:
    """Return the truth stored in a folder, with the salt that is needed to verify its seal.

    Raises:
        ConfigError: the folder contains no sealed plant.
    """
    try:
        return json.loads((folder / TRUTH).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigError(f"{folder}: contains no sealed plant: {error}") from error
