"""Out-of-library effects: effects that the library does not contain, or library effects in another form.

They test the diagnosis. A plant contains at most one of them.
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
"""Names of effects that belong to a family of the library but have another form."""

OUTSIDE = tuple(name for name, effect in FOREIGN.items() if not effect.family)
"""Names of effects that belong to no family of the library."""
