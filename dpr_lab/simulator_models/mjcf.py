"""Read MJCF files with `MjSpec` of MuJoCo.

Meshes, textures and plugins are removed from the file first.
"""

import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, tostring

import numpy as np

from dpr_lab.errors import ConfigError
from dpr_lab.simulator_models.numbers import refuse_bad_attributes
from dpr_lab.simulator_models.tree import ModelActuator, ModelJoint, Part, SimulatorModel, Vector
from dpr_lab.simulator_models.xml_file import with_includes

NUMBERS = frozenset(
    "mass density diaginertia fullinertia pos quat euler axisangle xyaxes zaxis fromto size axis damping frictionloss"
    " armature stiffness springref ref range gravity wind viscosity gear kp kv".split()
)
"""Attributes that contain numbers, in any element."""

IGNORED = {"asset", "visual", "statistic", "sensor", "keyframe", "size", "custom", "extension", "camera", "light"}
"""Elements that are removed: they do not influence the motion of rods, or they refer to other files."""

REFUSED = {"composite", "flexcomp", "replicate", "attach"}
"""Elements from which MuJoCo generates bodies; files that contain such elements are refused."""

LISTED = {
    "plugin": "plugins, not loaded",
    "tendon": "tendons, not in the rig file",
    "equality": "equality constraints (closed chains, couplings), not in the rig file",
    "contact": "contact pairs or exclusions, not in the rig file",
    "deformable": "flexible bodies, not in the rig file",
}
"""Elements that act on the rods but have no equivalent in a rig file, with their descriptions in notes."""

SWITCHES = {"damping": ("damper",), "frictionloss": ("frictionloss", "constraint"), "stiffness": ("spring",)}
"""For each attribute of a joint, the attributes of `<flag>` that disable it."""

JOINT_KINDS = ("free", "ball", "slide", "hinge")
"""Names of the joint types, in the order of their numbers in MuJoCo."""


@dataclass(frozen=True, slots=True)
class BodyFrame:
    """Position and inertia of a body in its own frame, with the axes of this frame."""

    name: str
    turned: Vector
    """(3, 3) axes of its frame in world coordinates."""
    local_centroid: Vector
    """(3,) centre of mass in its frame, m."""
    local_turn: Vector
    """(4,) quaternion of its principal axes in its own frame."""
    principal: Vector
    """(3,) principal inertias, kg m^2."""
    local_place: Vector
    """(3,) origin of its frame in the frame of its parent, m."""


@dataclass(frozen=True, slots=True)
class CompiledMjcf:
    """A compiled MJCF file with all joints at zero."""

    name: str
    model: Any
    data: Any
    degrees: bool
    """Whether angles in the file are in degrees."""
    notes: tuple[str, ...]

    @property
    def unnamed(self) -> set[str]:
        """Names that this reader gives to joints without a name in the file."""
        return {_name(self.model, j) for j in range(self.model.njnt) if not self.model.joint(j).name}

    def body(self, joint: str) -> BodyFrame:
        """Return the frame of the body that a joint moves."""
        m, b = self.model, int(self.model.joint(joint).bodyid[0])
        turned = np.array(self.data.xmat[b]).reshape(3, 3)
        local = (np.array(values[b]) for values in (m.body_ipos, m.body_iquat, m.body_inertia, m.body_pos))
        return BodyFrame(m.body(b).name or f"of joint {joint}", turned, *local)

    def simulator_model(self) -> SimulatorModel:
        """Return the parts, joints and gravity of the model."""
        parts = tuple(_parts(self.model, self.data))
        gravity = np.zeros(3) if _disabled(self.model, "gravity") else np.array(self.model.opt.gravity)
        return SimulatorModel(self.name, "MJCF", gravity, parts, tuple(_actuators(self.model)), self.notes)


def read_mjcf(path: Path, text: bytes | None = None) -> SimulatorModel:
    """Read a file of MuJoCo with its includes.

    See `compile_mjcf` for arguments and errors.
    """
    return compile_mjcf(path, text).simulator_model()


def compile_mjcf(path: Path, text: bytes | None = None) -> CompiledMjcf:
    """Compile a file of MuJoCo with its includes.

    If `text` is given, it replaces the content of the file.

    Raises:
        ConfigError: MuJoCo is not installed or refuses the file, or masses would come from a mesh.
    """
    try:
        mujoco = import_module("mujoco")  # the names of this module are created at run time
    except ModuleNotFoundError as missing:
        raise ConfigError("reading MJCF needs MuJoCo: pip install 'dpr-lab[exports]'") from missing
    root = with_includes(path, text)
    notes = _bared(root, path)
    refuse_bad_attributes(root, NUMBERS, path, words={"flag"})
    degrees = [compiler.get("angle", "degree") for compiler in root.iter("compiler")][-1:] != ["radian"]
    try:
        with warnings.catch_warnings():
            # MuJoCo warns of a nearly singular inertia matrix; the checks below report it too
            warnings.simplefilter("ignore")
            spec = mujoco.MjSpec.from_string(tostring(root, encoding="unicode"))
            model = spec.compile()
        data = mujoco.MjData(model)
        data.qpos[:] = np.where(np.isin(np.arange(model.nq), _scalar_positions(model)), 0.0, model.qpos0)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise ConfigError(f"{path}: MuJoCo cannot read it: {' '.join(str(error).split())}") from error
    if np.any(model.opt.wind) or model.opt.density or model.opt.viscosity:
        notes.append(
            f"fluid, not in the rig file: density {model.opt.density:g} kg/m^3, viscosity {model.opt.viscosity:g} Pa s"
        )
    notes += [
        f"body {model.body(b).name!r}: gravcomp {share:g}, the share of its weight that is compensated"
        for b, share in enumerate(model.body_gravcomp)
        if share
    ]
    compiled = CompiledMjcf(spec.modelname or path.stem, model, data, degrees, tuple(notes))
    if compiled.unnamed:
        unnamed = f"joints without a name: {len(compiled.unnamed)}; their numbers can be read, but not corrected"
        return replace(compiled, notes=(*notes, unnamed))
    return compiled


def _scalar_positions(model: Any) -> list[int]:
    """Return the indices in qpos of the positions of hinges and slides."""
    return [
        int(model.jnt_qposadr[j]) for j in range(model.njnt) if JOINT_KINDS[model.jnt_type[j]] in ("slide", "hinge")
    ]


def _bared(root: Element, path: Path) -> list[str]:
    """Remove the elements in `IGNORED`, and return notes on the removed elements.

    Raises:
        ConfigError: the file generates bodies by a macro, or takes a mass from a mesh.
    """
    counts: Counter[str] = Counter()
    refused = next((element.tag for element in root.iter() if element.tag in REFUSED), None)
    if refused is not None:
        raise ConfigError(f"{path}: <{refused}> is not expanded: save the compiled model with mj_saveLastXML")
    shapes = _ShapeMasses.of(root)
    for body in root.iter("worldbody"):
        _refuse_masses_of_meshes(body, False, "main", shapes, path)
    _strip(root, counts)
    notes = [f"{text}: {counts[tag]}" for tag, text in LISTED.items() if counts[tag]]
    return notes + ([f"meshes, not loaded: {counts['mesh']}"] if counts["mesh"] else [])


def _strip(parent: Element, counts: Counter[str]) -> None:
    for child in list(parent):
        if child.tag in IGNORED or child.tag in LISTED:
            counts[child.tag] += 1 if child.tag == "plugin" else len(child)
            counts["plugin"] += sum(part.tag == "plugin" for part in child)
            parent.remove(child)
        elif child.tag in ("geom", "site") and _shaped_by_file(child) and parent.tag != "default":
            counts["mesh"] += 1
            parent.remove(child)
        elif parent.tag == "actuator" and "joint" not in child.attrib:
            counts["tendon"] += 1
            parent.remove(child)
        else:
            for key in ("material", "mesh", "hfield", "fluidshape", "file"):
                child.attrib.pop(key, None)
            if child.tag == "geom" and child.get("type") in ("mesh", "hfield", "sdf"):
                del child.attrib["type"]
            _strip(child, counts)


def _shaped_by_file(geom: Element) -> bool:
    return bool({"mesh", "hfield"} & set(geom.attrib)) or geom.get("type") in ("mesh", "hfield", "sdf")


@dataclass(frozen=True, slots=True)
class _ShapeMasses:
    """Rules of a file for deciding which shapes have mass."""

    defaults: dict[str, dict[str, str]]
    """Attributes of the shapes of each default class, including inherited attributes."""
    groups: tuple[float, float]
    """Range of the groups whose shapes have mass."""
    always: bool
    """Whether shapes determine the masses even of bodies with an `<inertial>` element."""

    @classmethod
    def of(cls, root: Element) -> "_ShapeMasses":
        """Read the rules from the defaults and compiler options of a file."""
        defaults: dict[str, dict[str, str]] = {"main": {}}

        def visit(default: Element, inherited: dict[str, str]) -> None:
            attributes = inherited | {k: value for geom in default.findall("geom") for k, value in geom.attrib.items()}
            defaults[default.get("class", "main")] = attributes
            for child in default.findall("default"):
                visit(child, attributes)

        for default in root.findall("default"):
            visit(default, defaults["main"])
        options = {key: value for compiler in root.iter("compiler") for key, value in compiler.attrib.items()}
        least, most = ([*options.get("inertiagrouprange", "").split(), "", ""])[:2]
        return cls(defaults, (_number(least, 0.0), _number(most, 5.0)), options.get("inertiafromgeom") == "true")

    def has_mass(self, geom: Element, inherited: str) -> bool:
        """Check whether a shape has mass.

        `inherited` is the default class that the surrounding elements define.
        """
        values = self.defaults.get(geom.get("class", inherited), {}) | geom.attrib
        least, most = self.groups
        return _number(values.get("mass", values.get("density", "")), 1.0) != 0.0 and (
            least <= _number(values.get("group", ""), 0.0) <= most
        )


def _number(text: str, default: float) -> float:
    try:
        return float(text)
    except ValueError:
        return default


def _elements_of(parent: Element, inherited: str) -> Iterator[tuple[Element, str]]:
    """Yield the child elements of a body, including those within frames, with their inherited default class."""
    inherited = parent.get("childclass", inherited)
    for child in parent:
        if child.tag == "frame":
            yield from _elements_of(child, inherited)
        else:
            yield child, inherited


def _refuse_masses_of_meshes(body: Element, moving: bool, inherited: str, shapes: _ShapeMasses, path: Path) -> None:
    elements = list(_elements_of(body, inherited))
    tags = {element.tag for element, _ in elements}
    moving = moving or bool(tags & {"joint", "freejoint"})
    if moving and (shapes.always or "inertial" not in tags):
        for geom, around in elements:
            if geom.tag == "geom" and _shaped_by_file(geom) and shapes.has_mass(geom, around):
                name = body.get("name", "without a name")
                raise ConfigError(
                    f"{path}: the mass of body {name!r} is defined by the mesh {geom.get('mesh', '')!r}, which is not"
                    " loaded: give the body an <inertial> element"
                )
    for child, around in elements:
        if child.tag == "body":
            _refuse_masses_of_meshes(child, moving, around, shapes, path)


def _parts(model: Any, data: Any) -> Iterator[Part]:
    """Yield the parts of all bodies.

    A body with several joints becomes several parts, of which only the last has mass.
    """
    last = {0: -1}
    count = 0
    for b in range(1, model.nbody):
        joints = range(model.body_jntadr[b], model.body_jntadr[b] + model.body_jntnum[b])
        above, name = last[int(model.body_parentid[b])], model.body(b).name or f"body {b}"
        for j in list(joints)[:-1]:
            yield Part(name, above, _joint(model, data, j), 0.0, np.zeros(3), np.zeros((3, 3)))
            above, count = count, count + 1
        turned = np.array(data.ximat[b]).reshape(3, 3)
        inertia = turned @ np.diag(model.body_inertia[b]) @ turned.T
        joint = _joint(model, data, joints[-1]) if len(joints) else None
        mass, centroid = float(model.body_mass[b]), np.array(data.xipos[b])
        yield Part(name, above, joint, mass, centroid, inertia, tuple(_ends(model, data, b)))
        last[b], count = count, count + 1


def _joint(model: Any, data: Any, j: int) -> ModelJoint:
    address, dof = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
    kind = JOINT_KINDS[model.jnt_type[j]]
    other = {}
    for values, text in ((model.dof_dampingpoly[dof], "damping"), (model.jnt_stiffnesspoly[j], "stiffness")):
        if np.any(values):
            other[f"{text} of higher order"] = " ".join(f"{value:g}" for value in values)
    values = {
        "damping": float(np.atleast_1d(model.dof_damping[dof])[0]),
        "frictionloss": float(model.dof_frictionloss[dof]),
        "stiffness": float(np.atleast_1d(model.jnt_stiffness[j])[0]),
    }
    for key, flags in SWITCHES.items():
        if values[key] and any(_disabled(model, flag) for flag in flags):
            other[f"{key}, switched off by a <flag> of the file:"] = f"{values[key]:g}"
            values[key] = 0.0
    lower, upper = model.jnt_range[j].tolist()
    limited = model.jnt_limited[j] and not any(_disabled(model, flag) for flag in ("limit", "constraint"))
    return ModelJoint(
        _name(model, j),
        kind,
        np.array(data.xaxis[j]),
        np.array(data.xanchor[j]),
        values["damping"],
        values["frictionloss"],
        float(model.dof_armature[dof]),
        values["stiffness"],
        float(model.qpos_spring[address]),
        (lower, upper) if limited else None,
        other,
    )


def _name(model: Any, j: int) -> str:
    return str(model.joint(j).name) or f"joint {j}"


def _disabled(model: Any, flag: str) -> bool:
    bits = import_module("mujoco").mjtDisableBit
    return bool(model.opt.disableflags & int(getattr(bits, f"mjDSBL_{flag.upper()}")))


def _ends(model: Any, data: Any, body: int) -> Iterator[np.ndarray]:
    """Yield points on the shapes of a body.

    These are the end points of capsules, cylinders and boxes along their axes, and the centres of spheres.
    """
    for g in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
        centre, axes = np.array(data.geom_xpos[g]), np.array(data.geom_xmat[g]).reshape(3, 3)
        size = model.geom_size[g]
        name = int(model.geom_type[g])
        reach = {3: (0.0, 0.0, size[1]), 5: (0.0, 0.0, size[1]), 6: tuple(size)}.get(name, (0.0, 0.0, 0.0))
        for axis, length in zip(axes.T, reach, strict=True):
            yield centre + length * axis
            yield centre - length * axis


def _actuators(model: Any) -> Iterator[ModelActuator]:
    for a in range(model.nu):
        kp, kv = (0.0 - float(term) for term in model.actuator_biasprm[a][1:3])  # removes a negative zero
        servo = f"position servo with kp {kp:g} and kv {kv:g}" if kp else f"velocity servo with kv {kv:g}"
        kind = servo if kp or kv else "motor"
        joint = model.joint(int(model.actuator_trnid[a][0])).name
        yield ModelActuator(model.actuator(a).name or f"actuator {a}", joint, kind, float(model.actuator_gear[a][0]))
