"""A blind trial as the device prepares it: a rig of other parts, a plant drawn for it, sealed, perhaps recorded."""

import secrets
from pathlib import Path
from typing import Any

from dpr_lab.rig import Rig, load_rig
from sim_device.assemble import Options, plant_of
from sim_device.config import PlantConfig, load_plant
from sim_device.direct import record
from sim_device.draw import ANY, draw_plant, parse_wanted, settled, weighed
from sim_device.seal import keep
from sim_device.toml import toml_text

SEEDS = 1 << 32
"""A seed that nobody gave is fresh chance below this."""


def sealed_trial(options: Options, folder: Path, direct: bool = False) -> dict[str, Any]:
    """Draw and seal a plant.

    Args:
        options: rig, plant, what to draw (anything where that is left out) and seed
        folder: where the device keeps the truth
        direct: whether to record the plant at once, without device and link

    Returns:
        `seal`; `rig`, the rig file as TOML text; `runs` where they were asked for: pose, rate, samples lost, time since
        the release and counts of each

    Raises:
        ConfigError: nothing that could be drawn, or the folder is there already.
    """
    seed = secrets.randbelow(SEEDS) if options.seed is None else options.seed
    text = settled(options.draw_effects or ANY, seed)
    wanted = parse_wanted(text)
    base, rig = weighed(load_plant(options.plant, seed), load_rig(options.rig))
    plant = draw_plant(wanted, base, rig)
    drawn = {"kind": wanted.kind, "level": wanted.level, "seed": seed}
    told = {"seal": keep(plant_of(plant, rig), drawn, folder), "rig": _rig_file(rig)}
    return told | ({"runs": _runs(plant, rig)} if direct else {})


def _rig_file(rig: Rig) -> str:
    return toml_text(rig.model_dump(mode="json", exclude_none=True)).lstrip()


def _runs(plant: PlantConfig, rig: Rig) -> list[dict[str, Any]]:
    runs = record(plant, rig)
    return [
        {
            "pose": run.pose,
            "rate_hz": run.rate_hz,
            "lost": dict(run.lost),
            "t": run.t.tolist(),
            "counts": [] if run.counts is None else run.counts.tolist(),
        }
        for run in runs
    ]
