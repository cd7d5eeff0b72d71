"""A rig with a moving arm as an FMU for co-simulation; input: that of the drive; outputs: angles and speeds."""

from dpr_lab.exports.fmu import built_unit
from dpr_lab.exports.moving_arm.python_module import python_module
from dpr_lab.identification.moving_arm.model import MovingArmModel

_SLAVE = '''
from pythonfmu3 import Fmi3Causality, Fmi3Slave, Fmi3Variability, Float64 as Real

OUTPUTS = ("theta0", "theta1", "theta2", "omega0", "omega1", "omega2")
STARTS = tuple(f"{name}_start" for name in OUTPUTS)


class MovingArm(Fmi3Slave):
    """The input of the arm's drive in, in its own unit; angles and speeds of arm and rods out, rad and rad/s."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.description = f"rods on a moving arm, identified by dpr-lab. {SCALE}"
        for name in (*OUTPUTS, *STARTS, "time", "drive"):
            setattr(self, name, 0.0)
        self.theta1_start = self.theta2_start = math.pi
        self.max_step = 1e-3
        continuous = Fmi3Variability.continuous
        if hasattr(Fmi3Causality, "independent"):
            self.register_variable(Real("time", causality=Fmi3Causality.independent, variability=continuous))
        self.register_variable(Real("drive", causality=Fmi3Causality.input, variability=continuous, start=0.0))
        for name in (*STARTS, "max_step"):
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
        self.state = None

    def exit_initialization_mode(self):
        self.show(np.array([getattr(self, name) for name in STARTS]))

    def show(self, state):
        self.state = state
        for name, value in zip(OUTPUTS, state.tolist()):
            setattr(self, name, value)

    def do_step(self, current_time, step_size):
        count = max(1, math.ceil(step_size / self.max_step - 1e-9))
        state = self.state
        for _ in range(count):
            state = step(state, self.drive, step_size / count)
        self.show(state)
        self.time = current_time + step_size
        return bool(np.isfinite(state).all())
'''


def fmu(model: MovingArmModel, standard: str = "3.0") -> bytes:
    """The model as an FMU of a version of the standard; errors as of `built_unit`."""
    return built_unit(python_module(model), _SLAVE, standard)
