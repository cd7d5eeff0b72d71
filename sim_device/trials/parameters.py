"""Draw true parameters of a rig near those of a plant file, and weighed masses."""

from dataclasses import dataclass

import numpy as np

from dpr_lab.errors import ConfigError
from dpr_lab.rig import MASSES, PARAMETERS, Rig
from dpr_lab.rig_tables import Parameter
from sim_device.plant.config import PlantConfig
from sim_device.random_streams import RandomStream, generator


@dataclass(frozen=True, slots=True)
class PartSpread:
    """Maximum deviations of drawn parameters from the plant file, and accuracy of the scales."""

    parameter: float = 0.15
    """Maximum relative deviation of a true parameter. The rig of the paper bounds the search at 0.2."""
    mass: float = 0.15
    """Maximum relative deviation of a mass that is weighed."""
    scales_std: float = 1e-4
    """Standard deviation of a weighing, kg."""
    scales_step: float = 1e-4
    """Resolution of the display of the scales, kg."""


SPREAD = PartSpread()


def drawn(config: PlantConfig, rig: Rig) -> PlantConfig:
    """Return a copy of the plant with other true parameters, drawn from the seed of the plant.

    Each searched parameter is uniformly distributed within `SPREAD` of the value in the file and within the bounds of
    the rig, so that the truth can be identified. A parameter that the rig file states as measured keeps its value.

    Raises:
        ConfigError: a value of the plant lies so far outside the rig's bounds that no range remains.
    """
    spread = np.array([[1 - SPREAD.parameter], [1 + SPREAD.parameter]]) * config.Z
    lower, upper = np.maximum(spread[0], rig.bounds[0]), np.minimum(spread[1], rig.bounds[1])
    empty = [name for name, none in zip(PARAMETERS, rig.searched & (lower > upper), strict=True) if none]
    if empty:
        raise ConfigError(
            f"plant {config.name}: {', '.join(empty)} more than {100 * SPREAD.parameter:.0f} % outside the bounds of"
            f" rig {rig.name}: choose a plant that belongs to this rig, or omit --draw"
        )
    share = generator(config.seed, RandomStream.TRUTH).random(len(PARAMETERS))
    values = np.where(rig.searched, lower + share * (upper - lower), config.Z)
    return config.model_copy(update={"parameters": dict(zip(PARAMETERS, values.tolist(), strict=True))})


def weighed(base: PlantConfig, rig: Rig, step: float = 0.0) -> tuple[PlantConfig, Rig]:
    """Draw other masses of a rig from the plant's seed, and write their weighed values into its rig file.

    Masses that the rig file states as measured do not change. `step` is the resolution of the scales, kg.
    """
    rng = generator(base.seed, RandomStream.RIG)
    drawn_masses = {name: base.parameters[name] * (1 + SPREAD.mass * rng.uniform(-1, 1)) for name in MASSES}
    read = {name: float(mass + rng.normal(0, SPREAD.scales_std)) for name, mass in drawn_masses.items()}
    if step:
        read = {name: round(round(mass / step) * step, 9) for name, mass in read.items()}
    known = {
        name: Parameter(nominal=rig.parameters[name].nominal, measured=read[name], std=SPREAD.scales_std)
        for name in MASSES
        if rig.parameters[name].measured is None
    }
    masses = {name: drawn_masses[name] for name in known}
    return (
        base.model_copy(update={"parameters": {**base.parameters, **masses}}),
        rig.model_copy(update={"parameters": {**rig.parameters, **known}}),
    )
