"""Diagnosis constructed by hand, for tests of functions that read a diagnosis."""

from typing import Any

import numpy as np

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import EFFECTS
from dpr_lab.gap.result.checks import Quantity
from dpr_lab.gap.result.diagnosis import Diagnosis

CLOCK, LENGTH = "clock_rate", "wrong_length_L1"
SIZES = {CLOCK: 0.00505, LENGTH: -0.0022}


def interval(value: float, relative: float = 0.02) -> dict[str, Any]:
    return {"value": value, "interval90": [value - relative * abs(value), value + relative * abs(value)]}


def measurement(name: str, about: str, k: int) -> dict[str, Any]:
    parameter = EFFECTS[name].amplitudes[0].name
    return {
        "id": f"{k}-abcd",
        "kind": "measurement",
        "text": EFFECTS[name].bench_check,
        "about": about,
        "splits": list(SIZES),
        "expected_bits": 1.0,
        "measures": name,
        "quantity": Quantity.of(name, parameter).model_dump(),
        "expected": interval(SIZES[name]),
    }


def made(**changes: Any) -> Diagnosis:
    """Create a diagnosis that cannot distinguish an error of the clock rate from an error of the inner rod's length."""
    effect = {
        "name": CLOCK,
        "class": [CLOCK, LENGTH],
        "probability": 0.98,
        "parameters": {"excess": interval(SIZES[CLOCK])},
        "share": 0.99,
    }
    rad = {"joint1": 1e-3, "joint2": 1e-3}
    closed = {"estimate": 0.99, "interval90": [0.98, 1.0], "per_run": {}}
    values: dict[str, Any] = {
        "verdict": "named",
        "sentence": f"The gap is explained by ({CLOCK} or {LENGTH}) (probability 98 %).",
        "gap": {
            "floor_rad": rad,
            "before_rad": rad,
            "after_rad": rad,
            "explained_share": 0.99,
            "closed_held_out": closed,
        },
        "where": [],
        "where_sentence": "",
        "effects": [effect],
        "rivals": [],
        "probabilities": {"no_gap": 0.0, "unexplained": 0.02, CLOCK: 0.98},
        "detectable": {},
        "sensor_findings": [],
        "remedies": [f"For {CLOCK}: divide the device's times by 1.005."],
        "advice": [],
        "checks": [measurement(CLOCK, CLOCK, 1), measurement(LENGTH, CLOCK, 2)],
        "ratios": {name: interval(1.0) for name in RATIOS},
        "ratio_covariance": (1e-4 * np.eye(len(RATIOS))).tolist(),
        "chi2_per_dof": 1.0,
        "segments": 10,
        "scale_b": 0.01,
        "model_effects": {CLOCK: {"excess": SIZES[CLOCK]}},
        "assumptions": [],
        "seconds": 1.0,
    }
    return Diagnosis.model_validate(values | changes)
