"""Export the corrected model as SDFormat 1.10: inertia, viscous and Coulomb friction, linear springs, gravity.

Source: http://sdformat.org/spec (world, link, joint/axis/dynamics).
"""

from collections.abc import Mapping
from dataclasses import replace

from dpr_lab.exports.bodies import bodies, in_words, notes
from dpr_lab.exports.xml import rendered
from dpr_lab.identification.moving_arm.model import AnyModel
from dpr_lab.rig import Rig

WORDS = frozenset({"friction", "stiffness", "rest_angle", "offset", "added_length", "tilt"})
"""Elements of effects that SDFormat supports."""


def sdf(model: AnyModel, rig: Rig, lost: Mapping[str, str]) -> str:
    """Generate SDFormat text: a world with gravity and one model.

    The links of the model are `arm` (if the arm moves), `inner` and `outer`. All joint angles are 0 with the rods
    upright. The parts at joint 2 belong to the inner rod.
    """
    corrected = bodies(model, rig, in_words(model, rig, WORDS))
    inner, *outer = corrected.rods
    corrected = replace(corrected, rods=(inner.with_mass_at_end(corrected.tip_mass), *outer))
    return rendered("sdf.xml", name=model.rig.name, corrected=corrected, notes=notes(model, corrected, lost))
