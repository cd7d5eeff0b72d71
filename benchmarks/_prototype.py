"""The prototype of the diagnosis on the same recordings, where it knows the effect."""

import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from _trial_cases import Case, hidden, opened

from dpr_lab.run import Run
from sim_device.trials.offline_recorder import record

THINNED = 5
"""The prototype works at 200 Hz."""

NAMES = {
    "coulomb1": "coulomb_joint1",
    "coulomb2": "coulomb_joint2",
    "stribeck1": "stribeck_joint1",
    "drag_outer": "air_drag_outer",
    "drag_both": "air_drag_both",
    "spring1": "spring_joint1",
    "detent1": "detent_joint1",
    "tilt": "base_tilt",
    "off2": "encoder_offset_joint2",
    "ecc1": "encoder_eccentricity_joint1",
    "ecc2": "encoder_eccentricity_joint2",
    "scale2": "encoder_scale_joint2",
    "lat2": "latency_joint2",
    "clock": "clock_rate",
    "L1": "wrong_length_L1",
    "backlash2": "backlash_joint2",
    "load1": "load_friction_joint1",
    "load2": "load_friction_joint2",
    "drift1": "friction_drift_joint1",
    "drift2": "friction_drift_joint2",
    "jump": "missed_counts",
}
"""Its names -> the library's."""

TWINS = (
    {"base_tilt", "encoder_offset_joint1"},
    {"encoder_offset_joint2", "com_offset_link2"},
    {"clock_rate", "wrong_length_L1"},
    {"air_drag_outer", "air_drag_both"},
)


def prototype_score(folder: Path, cases: Sequence[Case]) -> dict[str, float]:
    """Its shares of right first names and false alarms, its median seconds, on those cases whose effect it knows."""
    sys.path.insert(0, str(folder))
    diag = import_module("diag")

    library = [name for name in diag.EFFECTS if name in NAMES] + ["jump"]
    first, alarms, seconds = [], [], []
    for case in cases:
        plant, rig = hidden(case)
        names = list(opened(plant, rig).effects)
        if names and _class(names[0]).isdisjoint(NAMES.values()):
            continue
        found, _ = diag.diagnose([_thinned(run) for run in record(plant, rig)], lib=library, lopo=False)
        seconds.append(found["time"])
        picked = [NAMES.get(name, name) for name in found["sel"]]
        if names:
            first.append(bool(picked) and picked[0] in _class(names[0]))
        else:
            alarms.append(bool(picked))
    return {
        "trials": len(first),
        "first": float(np.mean(first)) if first else float("nan"),
        "clean": len(alarms),
        "false_alarms": float(np.mean(alarms)) if alarms else float("nan"),
        "seconds": float(np.median(seconds)) if seconds else float("nan"),
    }


def _class(name: str) -> set[str]:
    return next((twins for twins in TWINS if name in twins), {name})


def _thinned(run: Run) -> dict[str, Any]:
    swing = run.swing
    theta = swing.theta[::THINNED]
    t = swing.t[::THINNED]
    return {"t": t, "q1": theta[:, 1], "q2": theta[:, 2] - theta[:, 1], "dt": float(np.median(np.diff(t)))}
