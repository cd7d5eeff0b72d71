"""The corrected model as a functional mock-up unit for co-simulation, FMI 3.0 or 2.0.

Inputs are the joint torques; outputs are angles, speeds and encoder readings. The unit contains the Python module, so
it requires a Python with numpy. Sources: FMI 3.0 specification, sec. 4, and 2.0.4, sec. 4 (Modelica Association, 2022).
"""

import importlib.util
import subprocess
import sys
import tempfile
from pathlib import Path

from dpr_lab.errors import ConfigError, DprError
from dpr_lab.exports.python_module import python_module
from dpr_lab.identification.model import Model
from dpr_lab.rig import Rig

BUILDERS = {"3.0": "pythonfmu3", "2.0": "pythonfmu"}
"""Version of the standard -> package that builds its units."""

_SLAVE = '''
from pythonfmu3 import Fmi3Causality, Fmi3Slave, Fmi3Variability, Float64 as Real

OUTPUTS = ("theta1", "theta2", "omega1", "omega2", "encoder1", "encoder2")


class DoublePendulum(Fmi3Slave):
    """Joint torques in, N m; angles, speeds and encoder readings out, rad and rad/s."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.description = f"double pendulum corrected by dpr-lab. {SCALE}"
        for name in (*OUTPUTS, "time", "torque1", "torque2"):
            setattr(self, name, 0.0)
        self.theta1_start, self.theta2_start, self.omega1_start, self.omega2_start = math.pi, math.pi, 0.0, 0.0
        self.max_step = 1e-3
        continuous = Fmi3Variability.continuous
        if hasattr(Fmi3Causality, "independent"):
            self.register_variable(Real("time", causality=Fmi3Causality.independent, variability=continuous))
        for name in ("torque1", "torque2"):
            self.register_variable(Real(name, causality=Fmi3Causality.input, variability=continuous, start=0.0))
        for name in ("theta1_start", "theta2_start", "omega1_start", "omega2_start", "max_step"):
            self.register_variable(
                Real(
                    name,
                    causality=Fmi3Causality.parameter,
                    variability=Fmi3Variability.fixed,
                    start=getattr(self, name),
                )
            )
        for name in OUTPUTS:
            self.register_variable(Real(name, causality=Fmi3Causality.output, variability=continuous))
        self.swing = None

    def exit_initialization_mode(self):
        self.swing = Swing((self.theta1_start, self.theta2_start, self.omega1_start, self.omega2_start), self.time)
        self.show()

    def show(self):
        self.theta1, self.theta2, self.omega1, self.omega2 = self.swing.state().tolist()
        self.encoder1, self.encoder2 = self.swing.read(self.swing.t)
        self.time = self.swing.t

    def do_step(self, current_time, step_size):
        if not self.swing.steps:
            self.swing.t = self.swing.began = self.swing.followed = current_time
        count = max(1, math.ceil(step_size / self.max_step - 1e-9))
        for _ in range(count):
            self.swing.step(step_size / count, self.torque1, self.torque2)
        self.show()
        return bool(np.isfinite(self.swing.state()).all())
'''


def fmu(model: Model, rig: Rig, standard: str = "3.0") -> bytes:
    """The corrected model as an FMU of a version of the standard.

    Raises:
        ConfigError: the required package is not installed.
        DprError: the package failed to build the unit.
    """
    return built_unit(python_module(model, rig), _SLAVE, standard)


def built_unit(module: str, slave: str, standard: str) -> bytes:
    """A unit of a Python module and a slave class in the words of FMI 3.0; errors as of `fmu`."""
    package = BUILDERS[standard]
    if importlib.util.find_spec(package) is None:
        raise ConfigError(f"an FMU of FMI {standard} needs {package}: pip install dpr-lab[exports]")
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / f"corrected_model_fmi{standard[0]}.py"
        script.write_text(module + _in_words_of(slave, standard), encoding="utf-8")
        # In a separate process: the builder imports the script under its name.
        built = subprocess.run(
            [sys.executable, "-m", package, "build", "-f", script.name], cwd=folder, capture_output=True, text=True
        )
        units = [*Path(folder).glob("*.fmu")]
        if built.returncode or not units:
            raise DprError(f"{package} did not build the FMU: {(built.stderr.strip().splitlines() or ['no word'])[-1]}")
        return units[0].read_bytes()


def _in_words_of(slave: str, standard: str) -> str:
    """The slave class with the names of the package, which finds the class by the literal name of its base."""
    if standard == "3.0":
        return slave
    return slave.replace("Float64 as Real", "Real").replace("pythonfmu3", BUILDERS[standard]).replace("Fmi3", "Fmi2")
