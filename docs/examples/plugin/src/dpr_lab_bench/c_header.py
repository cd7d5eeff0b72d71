"""Export format: the base parameters as a C header for a controller, without effects."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from dpr_lab.errors import ConfigError
from dpr_lab.exports import ExportFormat
from dpr_lab.exports.bodies import AnyModel
from dpr_lab.exports.programs import Replay
from dpr_lab.identification.model import Model
from dpr_lab.rig import Rig

HEADER = "rig.h"
NAMES = ("a", "b", "d", "e1", "e2", "c1", "c2")


def header(model: AnyModel, rig: Rig, lost: Mapping[str, str]) -> dict[str, str | bytes]:
    """Write the constants of equation (1) of the theory, SI.

    Raises:
        ConfigError: the rods hang on a moving arm.
    """
    if not isinstance(model, Model):
        raise ConfigError(f"{HEADER} holds a rig with a clamped arm: choose another format")
    values = {name: parameter.value for name, parameter in model.base.items()}
    values["e2"] = values["d"] * rig.g / rig.L1
    lines = [f"#define RIG_{name.upper()} {values[name]!r}" for name in NAMES]
    return {HEADER: "\n".join([f"/* {rig.name}, SI */", *lines]) + "\n"}


def in_scipy(file: Path, model: AnyModel, rig: Rig) -> Callable[[Replay], NDArray[np.float64]]:
    """Simulate recordings with the constants of the header; the result is the angles at the encoders."""
    constants = re.findall(r"#define RIG_\w+ (\S+)", file.read_text(encoding="utf-8"))
    a, b, d, e1, e2, c1, c2 = map(float, constants)

    def rates(t: float, x: NDArray[np.float64], replay: Replay) -> list[float]:
        theta1, theta2, omega1, omega2 = x
        s, c = np.sin(theta1 - theta2), d * np.cos(theta1 - theta2)
        tau1, tau2 = replay.driven(t, x)
        friction2 = c2 * (omega2 - omega1) - tau2
        torques = [
            e1 * np.sin(theta1) - d * s * omega2**2 - c1 * omega1 + friction2 + tau1,
            e2 * np.sin(theta2) + d * s * omega1**2 - friction2,
        ]
        return [omega1, omega2, *np.linalg.solve([[a, c], [c, b]], torques)]

    def replayed(replay: Replay) -> NDArray[np.float64]:
        span = (replay.start, float(replay.t[-1]))
        done = solve_ivp(rates, span, replay.x0, t_eval=replay.t, args=(replay,), rtol=1e-9, atol=1e-10)
        return rig.encoders.joint_angles.of_rods(done.y[:2].T)

    return replayed


FORMAT = ExportFormat("C header", HEADER, header, in_scipy)
