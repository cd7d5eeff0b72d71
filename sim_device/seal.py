"""The seal of a drawn plant: a salted hash, given away before anything is recorded, that fixes the truth."""

import hashlib
import json
from typing import Any

from sim_device.chance import Stream, generator
from sim_device.foreign import FOREIGN
from sim_device.foreign.plant import ForeignPlant
from sim_device.plant import Plant


def seal(plant: Plant | ForeignPlant) -> str:
    """Hex SHA-256 of the salt and the truth as compact JSON with sorted keys."""
    return hashlib.sha256((salt(plant) + _text(truth(plant))).encode()).hexdigest()


def salt(plant: Plant | ForeignPlant) -> str:
    """32 hex digits that keep the truth from being found by hashing guesses of it."""
    return generator(plant.config.seed, Stream.SEAL).bytes(16).hex()


def opened(plant: Plant | ForeignPlant) -> dict[str, Any]:
    """The truth with what anybody needs to check the seal."""
    return {"seal": seal(plant), "salt": salt(plant), "truth": truth(plant)}


def truth(plant: Plant | ForeignPlant) -> dict[str, Any]:
    """Parameters, ratios and effects; of a foreign effect the library's effects that would be a right answer."""
    config = plant.config
    return plant.reveal() | {
        "foreign": {name: dict(values) for name, values in config.foreign.items()},
        "family": {name: list(FOREIGN[name].family) for name in config.foreign},
        "held_back": [name for name in config.foreign if FOREIGN[name].held_back],
        "encoders": config.encoders.model_dump(mode="json"),
    }


def _text(truth: dict[str, Any]) -> str:
    return json.dumps(truth, sort_keys=True, separators=(",", ":"))
