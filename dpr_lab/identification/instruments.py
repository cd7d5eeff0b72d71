"""Bench measurements for parameters that a free swing does not determine."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import added_base, base_jacobian, base_parameters, ratio_slopes, ratios
from dpr_lab.identification.expected import information_root, ratio_information
from dpr_lab.rig import PARAMETERS, Rig
from dpr_lab.rig_tables import AddedMass


@dataclass(frozen=True, slots=True)
class BenchReading:
    """Quantity that a bench instrument measures."""

    name: str
    """Description of the quantity, for example `mass of the outer rod`."""
    unit: str
    symbol: str
    """Symbol of the quantity. If the quantity is a parameter of the rig file, the symbol is its name."""


@dataclass(frozen=True, slots=True)
class Measurement:
    """A bench measurement that can be recommended."""

    name: str
    how: str
    """Instruction for the operator."""
    quantity: BenchReading
    """Measured quantity."""


@dataclass(frozen=True, slots=True)
class Instrument(Measurement):
    """A bench measurement of the rods, with its typical uncertainty."""

    parameters: tuple[str, ...]
    """Parameters on which the reading depends."""
    std: tuple[float, ...]
    """Standard uncertainty of the reading, SI."""
    answer: "Callable[[Instrument, Array, Rig], Array]"
    """Function of (self, Z, rig) that returns the (k, 9) derivatives of the whitened readings, 1/SI.

    The derivatives are those with respect to the nine parameters.
    """


def _one_parameter(instrument: Instrument, Z: Array, rig: Rig) -> Array:
    return np.array([[float(name == instrument.parameters[0]) for name in PARAMETERS]]) / instrument.std[0]


def _rod_alone(instrument: Instrument, Z: Array, rig: Rig) -> Array:
    """Return the gradient of h = J / (m l) + l of one rod with respect to the parameters.

    h follows from the period T = 2 pi sqrt(h / g) of small swings of the rod.
    """
    columns = [PARAMETERS.index(name) for name in instrument.parameters]
    centroid, m, J = Z[columns]
    row = np.zeros((1, len(PARAMETERS)))
    row[0, columns] = 1 - J / (m * centroid**2), -J / (m**2 * centroid), 1 / (m * centroid)
    return row / instrument.std[0]


def _loaded_release(instrument: Instrument, Z: Array, rig: Rig, rod: Literal["inner", "outer"]) -> Array:
    """Return the derivative of the whitened readings of a release with a known attached mass.

    With this mass, the ratios determine the scale of all masses.

    The uncertainties of the mass and of its position limit the accuracy. Each column of N is the change of the whitened
    readings by one standard uncertainty of the mass or of its position. The covariance of the readings is therefore I +
    N N^T. Friction is assumed to be independent of the load.
    """
    L1, g = rig.L1, rig.g
    position = L1 / 2 if rod == "inner" else rig.L2 or 2 * Z[PARAMETERS.index("l2")]
    mass, (mass_std, position_std) = Z[PARAMETERS.index("m2")] / 2, instrument.std

    def load(more_mass: float = 0.0, further: float = 0.0) -> Array:
        return added_base(AddedMass(rod=rod, mass=mass + more_mass, position=position + further), L1, g)

    base = base_parameters(Z, L1, g) + load()
    loaded = ratio_information(base, rig, list(rig.poses.values())[:1])
    answer = information_root(loaded, ratios(base)) @ ratio_slopes(base)
    N = answer @ np.transpose([load(mass_std) - load(), load(0.0, position_std) - load()])
    root = np.linalg.cholesky(np.eye(len(N)) + N @ N.T)
    return np.linalg.solve(root, answer @ base_jacobian(Z, L1, g)).astype(np.float64)


@dataclass(frozen=True, slots=True)
class BenchAccuracy:
    """Standard uncertainties of measurements with simple tools."""

    scale_kg: float = 1e-4
    """Uncertainty of a kitchen scale with a resolution of 0.1 g, kg."""
    rule_m: float = 5e-4
    """Uncertainty of the centre of mass, measured with ruler and knife edge, m."""
    swings_m: float = 5e-4
    """Uncertainty of h for a 0.4 m rod, from twenty swings timed to 0.02 s, m."""


BENCH = BenchAccuracy()


def _weigh(name: str, part: str) -> Instrument:
    quantity = BenchReading(f"mass of {part}", "kg", name)
    return Instrument(f"weigh {name}", f"weigh {part} to 0.1 g", quantity, (name,), (BENCH.scale_kg,), _one_parameter)


def _balance(name: str, part: str) -> Instrument:
    instruction = f"balance {part} on an edge and measure from pivot to edge with an accuracy of 0.5 mm"
    quantity = BenchReading(f"distance from pivot to centre of mass of {part}", "m", name)
    return Instrument(f"balance {name}", instruction, quantity, (name,), (BENCH.rule_m,), _one_parameter)


def _swing(rod: int, part: str) -> Instrument:
    instruction = (
        f"hang {part} alone from its pivot and measure the time of twenty small swings with an accuracy of 0.02 s"
    )
    parameters, equal = (f"l{rod}", f"m{rod}", f"J{rod}"), f"J{rod} / (m{rod} l{rod}) + l{rod} = g (T / 2 pi)^2"
    quantity = BenchReading(f"length of the simple pendulum with the period T of {part}, {equal}", "m", f"h{rod}")
    name = f"swing {part.removeprefix('the ')} alone"
    return Instrument(name, instruction, quantity, parameters, (BENCH.swings_m,), _rod_alone)


def _add_mass(rod: Literal["inner", "outer"], place: str) -> Instrument:
    instruction = f"repeat the first pose's release with a weighed mass, about half of m2, fixed to {place}"
    quantity = BenchReading(f"added mass, fixed to {place}", "kg", "added mass")
    std, answer = (BENCH.scale_kg, BENCH.rule_m), partial(_loaded_release, rod=rod)
    return Instrument(f"add mass to {rod} rod", instruction, quantity, PARAMETERS, std, answer)


JOINT2_ENCODER = " without the joint-2 encoder"
"""Words for the part that must be removed from the inner rod of a rig with two rods before its measurement."""

INSTRUMENTS = (
    _weigh("m1", f"the inner rod{JOINT2_ENCODER}"),
    _weigh("m2", "the outer rod"),
    _weigh("mb", "the joint-2 encoder with its mount"),
    _balance("l1", f"the inner rod{JOINT2_ENCODER}"),
    _balance("l2", "the outer rod"),
    _swing(1, "the inner rod"),
    _swing(2, "the outer rod"),
    _add_mass("inner", "the middle of the inner rod"),
    _add_mass("outer", "the end of the outer rod"),
)
"""Bench measurements of the rods that can be recommended."""


def rod_measurements(names: Sequence[str], Z: Array, rig: Rig) -> dict[Measurement, Array]:
    """Return the bench measurements of the named parameters that the rig file does not contain.

    Returns:
        whitened readings (k, n) of each measurement; the n columns belong to relative changes of the named parameters
    """
    columns = [PARAMETERS.index(name) for name in names]
    return {
        tool if "mb" in names else _of_one_rod(tool): (tool.answer(tool, Z, rig) * Z)[:, columns]
        for tool in INSTRUMENTS
        if set(tool.parameters) <= set(names) and not already_made(tool, rig)
    }


def _of_one_rod(instrument: Instrument) -> Instrument:
    """Adapt a measurement to a rig with a single rod.

    A single rod does not carry the encoder of joint 2.
    """
    quantity = replace(instrument.quantity, name=instrument.quantity.name.replace(JOINT2_ENCODER, ""))
    return replace(instrument, how=instrument.how.replace(JOINT2_ENCODER, ""), quantity=quantity)


def already_made(instrument: Instrument, rig: Rig) -> bool:
    """Check whether the rig file contains this measurement at the same or a better accuracy."""
    if len(instrument.parameters) != 1:
        return False
    std = rig.parameters[instrument.parameters[0]].std
    return std is not None and std <= instrument.std[0]
