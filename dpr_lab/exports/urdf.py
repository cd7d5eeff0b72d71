"""Export the corrected model as URDF: inertia, viscous and Coulomb friction.

URDF contains no gravity, because gravity is a setting of the simulator. A tilt is a fixed joint below the base. Source:
https://wiki.ros.org/urdf/XML (link, joint).
"""

from collections.abc import Mapping

from dpr_lab.exports.bodies import bodies, in_words, notes
from dpr_lab.exports.rigid_bodies import THIN
from dpr_lab.exports.xml import rendered
from dpr_lab.identification.moving_arm.model import AnyModel
from dpr_lab.rig import Rig

WORDS = frozenset({"friction", "offset", "added_length", "tilt"})
"""Elements of effects that URDF supports."""


def urdf(model: AnyModel, rig: Rig, lost: Mapping[str, str]) -> str:
    """Generate URDF text with the links of base, arm and rods.

    The links are `world`, `base`, `arm` (if the arm moves), `inner`, `encoder2` and `outer`. All joint angles are 0
    with the rods upright. The angle of joint 2 is relative to the inner rod.
    """
    corrected = bodies(model, rig, in_words(model, rig, WORDS))
    return rendered(
        "urdf.xml", name=model.rig.name, corrected=corrected, notes=notes(model, corrected, lost), thin=THIN
    )
