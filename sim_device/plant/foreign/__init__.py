"""Effects that the lab cannot know: none of its library, or one of it in another form.

They exist to test the diagnosis: a plant carries at most one of them.
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
"""Of a family in the library, in another form."""

OUTSIDE = tuple(name for name, effect in FOREIGN.items() if not effect.family)
"""Of no family in the library."""
