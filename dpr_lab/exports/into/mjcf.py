"""Edit the numerical attributes of joints, bodies and motors in MJCF files."""

import math
from pathlib import Path

import numpy as np

from dpr_lab.errors import ConfigError
from dpr_lab.exports.into.target import PATCH, BodyChange, Target, joint_values, numbers
from dpr_lab.simulator_models.chain import ChainArm, ChainRod
from dpr_lab.simulator_models.mjcf import SWITCHES, CompiledMjcf, compile_mjcf
from dpr_lab.simulator_models.tree import SimulatorModel, Vector
from dpr_lab.simulator_models.xml_edit import XmlEdit
from dpr_lab.simulator_models.xml_file import with_includes

ATTRIBUTES = {"friction": "frictionloss", "rest": "springref"}
"""MJCF attributes of the quantities of a joint, where the names differ."""


class MjcfEditor:
    """Editor of MJCF files. Positions are converted with the frames of the content that `read` has compiled last."""

    name = "MJCF"
    words = frozenset({"friction", "stiffness", "rest_angle", "armature", "offset", "added_length", "gear"})
    passive = True
    _compiled: CompiledMjcf

    def __init__(self, path: Path) -> None:
        self.path = path

    def read(self, text: bytes) -> SimulatorModel:
        """Read the compiled model of the content `text`."""
        self._compiled = compile_mjcf(self.path, text)
        return self._compiled.simulator_model()

    def move_joint(self, edit: XmlEdit, joints: tuple[str, str], shift: Vector) -> None:
        """Shift the second joint by changing the position of its body.

        Raises:
            ConfigError: the second body is not a child of the first.
        """
        (_, carrier), (_, moved) = (self._tags(edit, name) for name in joints)
        if edit.tags[moved].parent != carrier:
            raise ConfigError(f"{self.path}: the body of {joints[1]!r} is not a child of that of {joints[0]!r}")
        frame = self._compiled.body(joints[1])
        place = frame.local_place + self._compiled.body(joints[0]).turned.T @ shift
        edit.set(moved, f"body {frame.name}", pos=numbers(place))

    def set_body(self, edit: XmlEdit, joint: str, change: BodyChange) -> None:
        """Change the inertial element of a body; create this element if the body has none."""
        if not change.moves and not change.scales:
            return
        frame, (_, body) = self._compiled.body(joint), self._tags(edit, joint)
        place = frame.local_centroid + frame.turned.T @ change.shift
        label, inertial = f"body {frame.name}, inertial", edit.child(body, "inertial")
        if inertial is None:
            inertia = change.factor * frame.principal
            values = {"pos": place, "quat": frame.local_turn, "mass": [change.mass], "diaginertia": inertia}
            edit.insert(body, "inertial", label, **{name: numbers(value) for name, value in values.items()})
            return
        if change.moves:
            edit.set(inertial, label, pos=numbers(place))
        if change.scales:
            form = "fullinertia" if "fullinertia" in edit.tags[inertial].attributes else "diaginertia"
            values = np.array(edit.tags[inertial].attributes.get(form, "").split(), dtype=np.float64)
            edit.set(inertial, label, **{form: numbers(change.factor * values)})

    def set_joint(self, edit: XmlEdit, part: ChainRod | ChainArm, target: Target) -> None:
        """Set the quantities of a joint, and its motor's gear, to the target."""
        turn = math.degrees(1.0) if self._compiled.degrees else 1.0
        changed = {
            ATTRIBUTES.get(name, name): numbers([turn * after if name == "rest" else after])
            for name, (_, after) in joint_values(part, target).items()
        }
        edit.set(self._tags(edit, part.joint.name)[0], f"joint {part.joint.name}", **changed)
        self._set_gear(edit, part, target.gear)

    def overriding(self) -> str:
        """Return the message for a file whose settings override the written numbers, with a remedy."""
        root, switches = with_includes(self.path), {flag for flags in SWITCHES.values() for flag in flags}
        off = [
            f'<flag {name}="disable">'
            for flag in root.iter("flag")
            for name, state in flag.items()
            if state == "disable" and name in switches
        ]
        global_values = [
            f'<compiler {name}="{value}">'
            for compiler in root.iter("compiler")
            for name, value in compiler.items()
            if (name, value) == ("inertiafromgeom", "true") or name == "settotalmass"
        ]
        remedy = "save the compiled model with mj_saveLastXML, and change that"
        if settings := [*off, *global_values]:
            single = len(settings) == 1
            remove = "remove it" if single else "remove them"
            remedy = f"{remove}, or {remedy}" if global_values else f"{remove}, and repeat the command"
            verbs = "switches off or overrides" if single else "switch off or override"
            return f"{self.path}: {' and '.join(settings)} {verbs} the numbers to be changed: {remedy}"
        return f"{self.path}: a default class or compiler option overrides the changed numbers: {remedy}"

    def _tags(self, edit: XmlEdit, name: str) -> tuple[int, int]:
        """Return the indices of a joint and of the body of this joint.

        Raises:
            ConfigError: the joint has no name, or is not in the file itself.
        """
        if name in self._compiled.unnamed:
            raise ConfigError(
                f"{self.path}: the joint listed as {name!r} has no name in the file: add one to its <joint>"
            )
        index = edit.find("joint", name=name)
        if index is None:
            raise ConfigError(
                f"{self.path}: no <joint name={name!r}> in the file itself: add the name to the joint in this file"
            )
        return index, edit.tags[index].parent

    def _set_gear(self, edit: XmlEdit, part: ChainRod | ChainArm, gear: float | None) -> None:
        """Set the gear of a joint's motor; keep the other numbers of the attribute.

        Raises:
            ConfigError: the motor is not in the file itself.
        """
        if part.gear is None or gear is None or abs(gear - part.gear) <= PATCH.negligible * abs(part.gear):
            return
        name = part.joint.name
        motors = (i for i, tag in enumerate(edit.tags) if tag.attributes.get("joint") == name)
        index = next((i for i in motors if edit.tags[edit.tags[i].parent].tag == "actuator"), None)
        if index is None:
            raise ConfigError(
                f"{self.path}: the motor of joint {name!r} is not in the file itself: move it into this file"
            )
        further = edit.tags[index].attributes.get("gear", "").split()[1:]
        edit.set(index, f"motor of joint {name}", gear=" ".join([numbers([gear]), *further]))
