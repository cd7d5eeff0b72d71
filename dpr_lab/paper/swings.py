"""Error E(Z) of docs/theory.md, equation (2), for the published experiment.

The experiment consists of 10 s from each of the poses X1, X2 and X3.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import base_parameters, rows
from dpr_lab.dynamics.rollout import trajectory_errors
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.joint_angles import JointAngles
from dpr_lab.paper.printed import POSES
from dpr_lab.rig import Rig
from dpr_lab.search.problem import Objective

STEP = 0.005
"""Sampling interval and Runge-Kutta step of the simulation, s (section 4.1 of the publication)."""

INSTANTS = STEP * np.arange(2001)
"""(2001,) sampling instants of the 10 s of a swing, s."""


def _angles(error: Array) -> Array:
    return error[..., :2]


TERMS: dict[str, Callable[[Array], Array]] = {
    "angles": _angles,
    "relative angles": lambda error: JointAngles(relative2=True).of_rods(_angles(error)),
    "angles and speeds": lambda error: error,
}
"""Interpretations of E(Z) by name: functions that return the errors of which E is the sum of squares.

Equation (2) contains angles and speeds, but the printed values are compatible with angles alone. The relative angle
theta2 - theta1 is the reading of an encoder at joint 2.
"""


@dataclass(frozen=True, slots=True)
class Reading:
    """Interpretation of the cost H, which the publication does not define uniquely."""

    poses: tuple[str, ...]
    """Names of the poses whose E is summed to H."""
    speeds: bool
    """Whether E contains speeds in addition to angles."""
    why: str


READINGS = {
    "sum": Reading(POSES, True, "equation (2) with angles and speeds, summed over all three poses (section 3.7)"),
    "X1": Reading(("X1",), False, "angles alone from pose X1, suggested by the size of the printed H"),
}


def start_states(rig: Rig) -> Array:
    """Return the (3, 4) initial states of X1, X2, X3, rad and rad/s.

    The columns are theta1, theta2, omega1, omega2.
    """
    return np.array([[rig.poses[pose].theta1, rig.poses[pose].theta2, 0.0, 0.0] for pose in POSES])


def swings(Z: ArrayLike, rig: Rig, step: float = STEP) -> Array:
    """Simulate the free swings from all poses for one set of parameters.

    Args:
        Z: (9,) parameters, SI units
        rig: L1, g and poses
        step: maximum Runge-Kutta step, s

    Returns:
        (3, 2001, 4) theta1, theta2, omega1, omega2 from X1, X2, X3 at `INSTANTS`, rad and rad/s
    """
    L1, g = rig.L1, rig.g
    base = base_parameters(Z, L1, g)
    return np.stack([simulate(base, L1, g, state, INSTANTS, step) for state in start_states(rig)])


def errors(Z: ArrayLike, truth: Array, rig: Rig) -> dict[str, Array]:
    """Compute E(Z) of one set of parameters for each interpretation in `TERMS`.

    Args:
        Z: (9,) parameters, SI units
        truth: (3, 2001, 4) swings with the true parameters
        rig: L1, g and poses

    Returns:
        for the name of each interpretation, E (3,) of the poses X1, X2, X3; squared angles in rad^2 and squared speeds
        in (rad/s)^2 are added
    """
    error = swings(Z, rig) - truth
    return {name: np.sum(term(error) ** 2, axis=(1, 2)) for name, term in TERMS.items()}


def objective(reading: Reading, truth: Array, rig: Rig) -> Objective:
    """Create the objective of a search for one interpretation of H.

    Args:
        reading: the interpretation: poses and terms
        truth: (3, 2001, 4) swings with the true parameters
        rig: L1, g and poses

    Returns:
        function that maps candidates (n, 9) to E (n, poses)
    """
    places = [POSES.index(pose) for pose in reading.poses]
    starts = start_states(rig)[places]
    reference = truth[places] if reading.speeds else truth[places][..., :2]
    L1, g = rig.L1, rig.g
    return lambda Z: trajectory_errors(rows(base_parameters(Z, L1, g), L1, g), starts, reference, STEP)
