"""Identifiable parameters of a rig with a free or driven arm, and bench measurements for the other parameters.

Information is represented by whitened rows, as in `dpr_lab.identification.identifiability`. The rows are sensitivities
to relative changes of the physical parameters x of rods, arm and motor. The recordings determine unknowns q with the
Fisher information F^T F. The rows of the recordings are F dq/dx diag(x). A measured value x adds the row x / std.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.arm import DRIVEN
from dpr_lab.dynamics.moving_arm.followed import FOLLOW
from dpr_lab.dynamics.moving_arm.swing import SWING_PARAMETERS, swing_segments
from dpr_lab.errors import ConfigError
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.identification.directions import spread
from dpr_lab.identification.expected import RELEASES, information_root
from dpr_lab.identification.identifiability import Directions, InformationRows
from dpr_lab.identification.instruments import BenchReading, Measurement, rod_measurements
from dpr_lab.identification.moving_arm.fit import ArmFit, fit_moving_arm, fit_segments
from dpr_lab.identification.moving_arm.problem import ArmRecording, arm_problem, recordings_of
from dpr_lab.identification.moving_arm.unknowns import Unknowns, best, mode_number, rod_inertias
from dpr_lab.rig import PARAMETERS, Rig, of_inner_rod
from dpr_lab.rig_tables import Parameter, Pose
from dpr_lab.run import Run
from dpr_lab.shown import Row, Shown


@dataclass(frozen=True, slots=True)
class Excitation:
    """Assumed excitation of a driven arm, used without recordings."""

    turn_rad: float = 0.5
    """Amplitude of the arm's motion for each sine of the input, on a rigid rig, rad."""
    rates: tuple[float, ...] = (3.0, 5.1, 8.7)
    """Angular frequencies of the sines, rad/s."""
    step: float = 1e-6
    """Relative increment for the derivatives of the unknowns."""
    kt: float = 0.05
    """Assumed torque constant of an unknown motor, N m/A."""
    R: float = 5.0
    """Assumed resistance of an unknown motor, ohm."""


EXCITATION = Excitation()


@dataclass(frozen=True, slots=True)
class ArmInstrument(Measurement):
    """A bench measurement of arm or motor, and its typical uncertainty."""

    parameter: str
    """Name of the measured parameter."""
    relative_std: float
    """Relative standard uncertainty of the measurement."""


ARM_INSTRUMENTS = (
    ArmInstrument(
        "measure R", "measure the winding resistance of the disconnected motor with an ohmmeter",
        BenchReading("resistance of the winding", "ohm", "R"), "R", 0.02,
    ),
    ArmInstrument(
        "measure ke", "turn the motor at a known speed with its wires disconnected and measure its voltage",
        BenchReading("back-EMF constant", "V s/rad", "ke"), "ke", 0.02,
    ),
    ArmInstrument(
        "measure kt", "let the motor press on a balance through a lever, at a known constant current",
        BenchReading("torque constant", "N m/A", "kt"), "kt", 0.03,
    ),
    ArmInstrument(
        "measure A", "accelerate the arm by a weight on a string over a pulley and measure the time",
        BenchReading("total inertia about the arm's axis", "kg m^2", "A"), "A", 0.02,
    ),
    ArmInstrument(
        "measure c0", "remove the rods, disconnect the motor and measure the arm's decay",
        BenchReading("viscous friction of the arm", "N m s/rad", "c0"), "c0", 0.05,
    ),
)  # fmt: skip
"""Bench measurements that can be recommended in addition to the measurements of the rods."""


@dataclass(frozen=True, slots=True, repr=False)
class ArmIdentifiability(Directions, Shown):
    """Results of an identifiability analysis with a moving arm."""

    arm: tuple[str, ...]
    """Modes of the arm in the recordings."""
    input: str
    """Kind of the input of the arm; empty if there is no input."""
    simulated: bool
    """Whether the recordings were simulated with the values of the rig file; values are then not results."""
    combinations: Mapping[str, float]
    """Expected relative standard deviations of the determined combinations of parameters."""
    values: Mapping[str, float]
    """Estimates of the determined combinations of parameters, SI; empty for simulated recordings."""
    unseen: tuple[str, ...]
    """Combinations of parameters that are not determined."""
    fixed_by: Mapping[str, str]
    """Source of each parameter: `data`, `measured` or `bound`."""
    spread: Mapping[str, float]
    """Relative standard deviation of each determined parameter."""

    @property
    def heading(self) -> str:
        """Heading with the mode of the arm, its input, and the number of determined directions."""
        drive = f" (input: {self.input})" if self.input else ""
        return (
            f"Identifiability with a {' and '.join(self.arm)} arm{drive}: {self.rank} of"
            f" {len(self.fixed_by)} combinations of parameters are determined"
        )

    def _heading(self) -> str:
        return self.heading

    def _rows(self) -> list[Row]:
        return [("parameter", "determined by"), *self.fixed_by.items()]

    def to_json(self) -> dict[str, Any]:
        """Return the analysis as JSON values."""
        return self._json() | {
            "arm": list(self.arm),
            "input": self.input,
            "simulated": self.simulated,
            "combinations": {
                name: {"relative_std": std} | ({"value": self.values[name]} if name in self.values else {})
                for name, std in self.combinations.items()
            },
            "unseen": list(self.unseen),
            "parameters": {
                name: {"fixed_by": source} | ({"relative_std": self.spread[name]} if name in self.spread else {})
                for name, source in self.fixed_by.items()
            },
        }


def identifiability_of_arm(runs: Sequence[Run], rig: Rig) -> ArmIdentifiability:
    """Analyse which parameters of a rig with a free or driven arm are identifiable.

    Args:
        runs: recordings; if empty, releases from the poses of the rig are simulated with the values of the rig file (a
            driven rig without poses starts from hanging rods)
        rig: bounds, measured values and motor

    Raises:
        ConfigError: there are neither runs nor poses of a free arm.
        RunError: a run cannot be used.
        IdentificationError: the values of the rig file cannot be simulated.
    """
    modes = tuple(sorted({run.arm_mode for run in runs} or {rig.arm.mode}))
    fit = fit_moving_arm(recordings_of(runs, rig), rig) if runs else _simulated(rig)
    unknowns = fit.problem.unknowns
    sizes, slopes = _physical(rig, unknowns)
    tables = {**rig.parameters, **dict(rig.arm), **(dict(rig.motor) if rig.motor else {})}
    parameters: dict[str, Parameter | None] = {name: tables.get(name) for name in sizes}
    scatter = max(1.0, fit.chi2_per_dof) if runs else 1.0  # a misfit is already in the weights of the fit
    root = information_root(fit.information / scatter, fit.values) * fit.values
    rows = InformationRows.of(root @ slopes, parameters, np.array(list(sizes.values())))
    combinations = [unknowns.name(name) for name in unknowns.free]
    relative = dict(zip(combinations, spread(root).tolist(), strict=True))
    determined = {name: std for name, std in relative.items() if np.isfinite(std)}
    of_parameters = dict(zip(sizes, spread(rows.known).tolist(), strict=True))
    values = dict(zip(combinations, fit.values.tolist(), strict=True)) if runs else {}
    return ArmIdentifiability(
        **rows.directions(_answers(sizes, parameters, rig)),
        arm=modes,
        input=unknowns.input if "driven" in modes else "",
        simulated=not runs,
        combinations=determined,
        values={name: value for name, value in values.items() if name in determined},
        unseen=tuple(name for name in relative if name not in determined),
        fixed_by={
            name: "measured" if _std(parameters[name]) else "data" if np.isfinite(std) else "bound"
            for name, std in of_parameters.items()
        },
        spread={name: std for name, std in of_parameters.items() if np.isfinite(std)},
    )


def _physical(rig: Rig, unknowns: Unknowns) -> tuple[dict[str, float], Array]:
    """Return the parameters of the rig file, SI, and the sensitivities of the unknowns.

    The sensitivities (free, n) are d ln(unknown) / d ln(parameter). Missing motor constants are replaced by those of a
    small motor whose back-EMF is as large as the friction.
    """
    both_rods, motor = rig.rods.mounted == "both", rig.motor
    of_rods = PARAMETERS if both_rods else of_inner_rod(rig.nominal[PARAMETERS.index("mb")])
    sizes = {name: float(rig.nominal[PARAMETERS.index(name)]) for name in of_rods}
    scale = rod_inertias(rig.nominal, rig)[1]
    start = dict(zip(SWING_PARAMETERS, (unknowns.start * scale).tolist(), strict=True))
    sizes |= {name: start[name] or 1.0 for name in ("A", "c0", "k0", "f0") if name in unknowns.free}
    if "L0" in unknowns.free:
        sizes["L0"] = rig.L0
    kind = unknowns.input if "gain" in unknowns.free and motor is not None else ""
    if motor is not None and kind in ("current", "voltage"):
        sizes["kt"] = best(motor.kt, EXCITATION.kt)
    if motor is not None and kind == "voltage":
        sizes |= {"ke": best(motor.ke, sizes["kt"]), "R": best(motor.R, EXCITATION.R)}
        if "c0" in sizes and rig.arm.c0 is None:
            sizes["c0"] = sizes["ke"] * sizes["kt"] * motor.gear**2 / sizes["R"]

    def logarithms(changes: Array) -> Array:
        x = dict(zip(sizes, np.array(list(sizes.values())) * np.exp(changes), strict=True))
        Z = rig.nominal
        for name in of_rods:
            Z[PARAMETERS.index(name)] = x[name]
        q = dict(zip(SWING_PARAMETERS[:6], rod_inertias(Z, rig), strict=True)) | x
        q["gain"] = x.get("kt", 1.0) / x.get("R", 1.0)
        if "ke" in x and motor is not None:
            q["c0"] = x["c0"] + x["ke"] * x["kt"] * motor.gear**2 / x["R"]
        return np.log([q[name] / (1.0 if name == "L0" else q["b"]) for name in unknowns.free])

    steps = EXCITATION.step * np.eye(len(sizes))
    slopes = [(logarithms(step) - logarithms(-step)) / (2 * EXCITATION.step) for step in steps]
    return sizes, np.stack(slopes, axis=1)


def _std(parameter: Parameter | None) -> float:
    return (parameter and parameter.std) or 0.0


def _answers(
    sizes: Mapping[str, float], parameters: Mapping[str, Parameter | None], rig: Rig
) -> dict[Measurement, Array]:
    """Compute the whitened readings (k, n) of measurements that the rig file lacks.

    The n columns belong to relative changes of the parameters.
    """
    names, answers = list(sizes), dict[Measurement, Array]()
    of_rods = [name for name in names if name in PARAMETERS]
    for measurement, readings in rod_measurements(of_rods, rig.nominal, rig).items():
        if measurement.quantity.symbol != "added mass":  # a release with an added mass needs a clamped arm
            answers[measurement] = np.pad(readings, ((0, 0), (0, len(names) - len(of_rods))))
    for reading in ARM_INSTRUMENTS:
        if reading.parameter in sizes and not 0 < _std(parameters[reading.parameter]) <= (
            reading.relative_std * sizes[reading.parameter]
        ):
            answers[reading] = np.eye(len(names))[[names.index(reading.parameter)]] / reading.relative_std
    return answers


def _simulated(rig: Rig) -> ArmFit:
    """Simulate releases from the poses of the rig without noise, and linearise their fit.

    All values are those of the rig file.
    """
    driven = rig.arm.mode == "driven"
    poses = list(rig.poses.values()) or ([Pose(theta1=np.pi, theta2=np.pi)] if driven else [])
    if not poses:
        raise ConfigError(f"{rig.path}: poses: there are no poses to simulate; add [poses.X1], or give recorded runs")
    t = np.arange(round(RELEASES.duration_s * rig.link.rate_hz)) / rig.link.rate_hz
    mode = mode_number(rig.arm.mode, rig.input)
    still = [
        Run(
            "expected", t, np.tile(pose.theta, (len(t), 1)), None, None, rig.name, rig.sha256, rig.link.rate_hz,
            arm_mode=rig.arm.mode, mounting=rig.rods.mounting,
        )
        for pose in poses
    ]  # fmt: skip
    recordings = [ArmRecording(run, mode, rig.reading_std, *np.zeros((2, len(t)))) for run in still]
    problem, _ = arm_problem(recordings, rig, 2 * RELEASES.duration_s)
    p, gain = problem.unknowns.start.copy(), SWING_PARAMETERS.index("gain")
    if driven:
        p[gain] = p[gain] or 1.0  # the gain is zero if the constants of the motor are unknown
        recordings = [replace(recording, drive=_program(t, p, mode)) for recording in recordings]
        problem, _ = arm_problem(recordings, rig, 2 * RELEASES.duration_s)
    initial = np.array([[*pose.theta, 0.0, 0.0, 0.0] for pose in poses])
    initial[:, [2, 5]] *= rig.rods.mounted == "both"
    states = swing_segments(p, (rig.L1, rig.g), problem.model.inputs, initial)
    recordings = [
        replace(recording, run=replace(recording.run, theta=swung[:, :3]))
        for recording, swung in zip(recordings, np.split(states, len(poses)), strict=True)
    ]
    problem, _ = arm_problem(recordings, rig, RELEASES.segment_s)
    initial = states[problem.segments.offsets[:-1]][:, np.argsort(FOLLOW.order)] * problem.model.free
    return fit_segments(problem, Estimate(p, initial), 0)


def _program(t: Array, p: Array, mode: int) -> Array:
    """Compute an input (n,) of three sines, each of which turns a rigid rig by `Excitation.turn_rad`."""
    per_unit = 1.0 if mode == DRIVEN else p[SWING_PARAMETERS.index("A")] / p[SWING_PARAMETERS.index("gain")]
    sines = [rate**2 * np.sin(rate * t + k) for k, rate in enumerate(EXCITATION.rates)]
    return EXCITATION.turn_rad * per_unit * np.sum(sines, axis=0)
