"""Export the corrected model as an FMU (functional mock-up unit) for co-simulation, FMI 3.0 or 2.0.

The inputs of the FMU are the joint torques, or the input of the drive of a moving arm. The outputs are angles, speeds
and encoder readings. The FMU contains the exported Python module, so that it requires a Python installation with
numpy. Sources: FMI 3.0 specification, sec. 4, and 2.0.4, sec. 4 (Modelica Association, 2022).
"""

import importlib.util
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from dpr_lab.errors import ConfigError, DprError
from dpr_lab.exports.python_module import python_module
from dpr_lab.identification.moving_arm.model import AnyModel, MovingArmModel
from dpr_lab.rig import Rig

BUILDERS = {"3.0": "pythonfmu3", "2.0": "pythonfmu"}
"""Packages that build FMUs, by version of the FMI standard."""

_SLAVE = '''
from pythonfmu3 import Fmi3Causality, Fmi3Slave, Fmi3Variability, Float64 as Real

INPUTS, STATES = {inputs!r}, {states!r}
OUTPUTS = (*STATES, {encoders})
STARTS = tuple(f"{{name}}_start" for name in STATES)
MEANINGS = {{
    "theta": ("angle", "rad"),
    "omega": ("angular velocity", "rad/s"),
    "encoder": ("encoder reading", "rad"),
    "torque": ("joint torque", "N.m"),
    "drive": ("input of the drive, in its own unit", None),
    "max_step": ("longest integration step", "s"),
    "time": ("time", "s"),
}}
DIMENSIONS = {{
    "rad": {{"rad": 1}},
    "rad/s": {{"rad": 1, "s": -1}},
    "N.m": {{"kg": 1, "m": 2, "s": -2}},
    "s": {{"s": 1}},
}}


def real(name, **properties):
    """Variable of the unit with its description, and with its physical unit if the package supports units."""
    meaning, unit = next(MEANINGS[kind] for kind in MEANINGS if name.startswith(kind))
    words = f"initial {{meaning}}" if name in STARTS else meaning
    variable = Real(name, description=f"{{words}}, {{unit}}" if unit else words, **properties)
    if unit and hasattr(variable, "unit"):
        variable.unit = unit
    return variable


class {name}(Fmi3Slave):
    """Inputs: {inputs_words}. Outputs: angles and encoder readings, rad, and speeds, rad/s."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.description = f"{what} dpr-lab. {{SCALE}}"
        for name in (*OUTPUTS, *STARTS, "time", *INPUTS):
            setattr(self, name, 0.0)
        self.theta1_start = self.theta2_start = math.pi
        self.max_step = 1e-3
        if hasattr(self, "register_units"):
            from pythonfmu3 import Unit

            self.register_units([Unit(name, **powers) for name, powers in DIMENSIONS.items()])
        continuous = Fmi3Variability.continuous
        if hasattr(Fmi3Causality, "independent"):
            self.register_variable(real("time", causality=Fmi3Causality.independent, variability=continuous))
        for name in INPUTS:
            self.register_variable(real(name, causality=Fmi3Causality.input, variability=continuous, start=0.0))
        for name in (*STARTS, "max_step"):
            self.register_variable(
                real(
                    name,
                    causality=Fmi3Causality.parameter,
                    variability=Fmi3Variability.fixed,
                    start=getattr(self, name),
                )
            )
        for name in OUTPUTS:
            self.register_variable(real(name, causality=Fmi3Causality.output, variability=continuous))
        self.swing = None

    def exit_initialization_mode(self):
        self.swing = {kind}([getattr(self, name) for name in STARTS], self.time)
        self.show()

    def show(self):
        for name, value in zip(OUTPUTS, [*self.swing.state().tolist(), *self.swing.read(self.swing.t)]):
            setattr(self, name, value)
        self.time = self.swing.t

    def do_step(self, current_time, step_size):
        if not self.swing.steps:
            self.swing.t, self.swing.began, self.swing.followed = current_time, current_time, 3 * [current_time]
        count = max(1, math.ceil(step_size / self.max_step - 1e-9))
        for _ in range(count):
            self.swing.step(step_size / count, *[getattr(self, name) for name in INPUTS])
        self.show()
        return bool(np.isfinite(self.swing.state()).all())
'''


@dataclass(frozen=True, slots=True)
class UnitPorts:
    """Inputs, states and descriptions of an FMU, and the names of its Python classes."""

    name: str
    kind: str
    inputs: tuple[str, ...]
    states: tuple[str, ...]
    inputs_words: str
    what: str

    @property
    def encoders(self) -> tuple[str, ...]:
        """Names of the encoder readings."""
        return tuple(f"encoder{name[-1]}" for name in self.states if name.startswith("theta"))

    @property
    def starts(self) -> tuple[str, ...]:
        """Names of the parameters for the initial state."""
        return tuple(f"{name}_start" for name in self.states)


PORTS = UnitPorts(
    "DoublePendulum", "Swing", ("torque1", "torque2"), ("theta1", "theta2", "omega1", "omega2"), "joint torques, N m",
    "double pendulum corrected by",
)  # fmt: skip
ARM_PORTS = UnitPorts(
    "MovingArm", "ArmSwing", ("drive",), ("theta0", "theta1", "theta2", "omega0", "omega1", "omega2"),
    "input of the arm's drive, in its own unit", "rods on a moving arm, identified by",
)  # fmt: skip


def ports_of(model: AnyModel) -> UnitPorts:
    """Return the inputs and states of the FMU of a model."""
    return ARM_PORTS if isinstance(model, MovingArmModel) else PORTS


def fmu(model: AnyModel, rig: Rig, standard: str = "3.0") -> bytes:
    """Build the FMU of a model, and return the content of the file.

    `standard` is the version of FMI, `3.0` or `2.0`.

    Raises:
        ConfigError: the required package is not installed.
        DprError: the package failed to build the unit.
    """
    ports = ports_of(model)
    slave = _SLAVE.format(
        inputs=ports.inputs, states=ports.states, encoders=", ".join(map(repr, ports.encoders)), name=ports.name,
        inputs_words=ports.inputs_words, what=ports.what, kind=ports.kind,
    )  # fmt: skip
    module = python_module(model, rig)
    package = BUILDERS[standard]
    if importlib.util.find_spec(package) is None:
        raise ConfigError(f"an FMU of FMI {standard} needs {package}: pip install 'dpr-lab[exports]'")
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / f"corrected_model_fmi{standard[0]}.py"
        script.write_text(module + _for_standard(slave, standard), encoding="utf-8")
        # In a separate process, because the builder imports the script under its name.
        built = subprocess.run(
            [sys.executable, "-m", package, "build", "-f", script.name], cwd=folder, capture_output=True, text=True
        )
        units = [*Path(folder).glob("*.fmu")]
        if built.returncode or not units:
            raise DprError(
                f"{package} did not build the FMU: {(built.stderr.strip().splitlines() or ['no message'])[-1]}"
            )
        return units[0].read_bytes()


def _for_standard(slave: str, standard: str) -> str:
    """Convert the source of the slave class to a version of the standard.

    The builder finds the class by the literal name of its base class.
    """
    if standard == "3.0":
        return slave
    return slave.replace("Float64 as Real", "Real").replace("pythonfmu3", BUILDERS[standard]).replace("Fmi3", "Fmi2")
