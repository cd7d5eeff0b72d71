"""Out-of-library effects: effects that the library lacks, or library effects in another form.

They test the diagnosis: a plant contains at most one of them.
"""

from sim_device.plant.foreign.bodies import BODIES
from sim_device.plant.foreign.disturbances import DISTURBANCES
from sim_device.plant.foreign.effect import OutOfLibraryEffect
from sim_device.plant.foreign.friction import FRICTION
from sim_device.plant.foreign.sensors import SENSORS
from sim_device.plant.foreign.torques import TORQUES

FOREIGN: dict[str, OutOfLibraryEffect] = {
    effect.name: effect for effect in (*FRICTION, *TORQUES, *BODIES, *DISTURBANCES, *SENSORS)
}

FORMS = tuple(name for name, effect in FOREIGN.items() if effect.family)
"""Effects of a family in the library, in another form."""

OUTSIDE = tuple(name for name, effect in FOREIGN.items() if not effect.family)
"""Effects of no family in the library."""
