"""Models for export tests, and the simulation of dpr-lab for comparison."""

import runpy
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import RATIOS, base_parameters, ratios
from dpr_lab.dynamics.prediction import predict
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import segments
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.identification.model import EstimatedValue, Model, ParameterValue, RigFacts
from dpr_lab.rig import PARAMETERS, Rig

BASE = ("a", "b", "d", "e1", "c1", "c2")
X0 = (np.pi / 2, np.pi / 3, 0.0, 0.0)


def model_of(rig: Rig, effects: Mapping[str, Mapping[str, float]], name: str = "paper") -> Model:
    """Model with the nominal parameters of the rig. Fields that no export reads are left at their defaults."""

    def values(names: tuple[str, ...], numbers: Any) -> dict[str, ParameterValue]:
        return {
            name: ParameterValue(value=float(value), std=None, fixed_by="data")
            for name, value in zip(names, numbers, strict=True)
        }

    return Model.model_construct(
        rig=RigFacts.model_construct(name=name, sha256="", L1=rig.rig.L1, g=rig.rig.g),
        base=values(BASE, base_parameters(rig.nominal, rig.rig.L1, rig.rig.g)),
        parameters=values(PARAMETERS, rig.nominal),
        effects={name: dict(coefficients) for name, coefficients in effects.items()},
    )


def identified_model(rig: Rig, effects: Mapping[str, Mapping[str, float]], name: str = "paper") -> Model:
    """The same model with ratios, which replays and comparisons read."""
    exact = [EstimatedValue(value=value, std=0.0, interval90=(value, value)) for value in ratios(base_of(rig)).tolist()]
    return model_of(rig, effects, name).model_copy(update={"ratios": dict(zip(RATIOS, exact, strict=True))})


def typical(effect: str) -> dict[str, dict[str, float]]:
    """Effect with a typical size of a laboratory rig."""
    return {effect: {p.name: p.default or p.typical for p in EFFECTS[effect].parameters}}


def base_of(rig: Rig) -> NDArray[np.float64]:
    return base_parameters(rig.nominal, rig.rig.L1, rig.rig.g)


def lab_states(rig: Rig, effects: Mapping[str, Mapping[str, float]], t: NDArray[np.float64], step: float = 1e-3) -> Any:
    """States (n, 4) of a release from `X0`, simulated by dpr-lab."""
    params, constants = effect_params(effects), rig_constants(rig)
    return simulate(base_of(rig), rig.rig.L1, rig.rig.g, X0, t, step, params, constants)


def lab_readings(rig: Rig, effects: Mapping[str, Mapping[str, float]], t: NDArray[np.float64], run: int) -> Any:
    """Encoder readings (n, 2), as predicted in a fit."""
    cut = segments([t] * (run + 1), run=range(run + 1), step=1e-3)
    read = predict(base_of(rig), effect_params(effects), rig_constants(rig), cut, [X0] * (run + 1))
    return read[-len(t) :]


def run_source(source: str, folder: Path) -> dict[str, Any]:
    """Run an exported module and return its names."""
    path = folder / "model.py"
    path.write_text(source, encoding="utf-8")
    return runpy.run_path(str(path))


SETS: Sequence[Sequence[str]] = (
    ("stribeck_joint1", "friction_curve_joint2", "air_drag_both", "spring_joint2", "detent_joint1"),
    ("load_friction_joint1", "hysteresis_joint2", "rotor_inertia_joint2", "base_tilt", "friction_drift_joint1"),
    ("arm_compliance", "coulomb_joint1", "com_offset_link2", "latency_joint2", "clock_rate", "backlash_joint2"),
)
"""Sets of several effects."""
