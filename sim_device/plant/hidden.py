"""Plant of a plant file: with library effects, or with an out-of-library effect."""

from dpr_lab.rig import Rig
from sim_device.plant.config import PlantConfig
from sim_device.plant.foreign.plant import ForeignPlant, ForeignSwing
from sim_device.plant.plant import Plant, Swing

HiddenPlant = Plant | ForeignPlant
HiddenSwing = Swing | ForeignSwing


def plant_of(config: PlantConfig, rig: Rig) -> HiddenPlant:
    """Create the plant that a plant file describes.

    Raises:
        ConfigError: unknown effects, or effects that cannot be combined.
    """
    return ForeignPlant(config, rig) if config.foreign else Plant(config, rig)
