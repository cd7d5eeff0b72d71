"""Corrected model as a Python module: results of dpr-lab without dpr-lab."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS, OF_FREE_SWINGS
from dpr_lab.exports.python_module import python_module
from dpr_lab.rig import Rig
from tests.exports.models import SETS, X0, lab_readings, lab_states, model_of, run_source, typical
from tests.thinned import thinned

ALONE = [(name,) for name in OF_FREE_SWINGS]
RODS = ("torque", "load", "arm")
IN_THE_RODS = [effects for effects in (*SETS, *ALONE) if EFFECTS[effects[0]].stage in RODS]
IN_ENCODERS = [effects for effects in (*SETS, *ALONE) if EFFECTS[effects[-1]].stage not in RODS]


def names(effects) -> str:
    return "+".join(effects)


@pytest.mark.slow
@pytest.mark.parametrize("effects", thinned(IN_THE_RODS, 6), ids=names)
def test_the_module_agrees_with_dpr_lab(paper: Rig, tmp_path: Path, effects):
    chosen = {name: values for effect in effects for name, values in typical(effect).items()}
    module = run_source(python_module(model_of(paper, chosen), paper), tmp_path)
    t = np.linspace(0, 2.0, 81)
    assert module["simulate"](X0, t) == pytest.approx(lab_states(paper, chosen, t), abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("effects", thinned(IN_ENCODERS, 3), ids=names)
def test_readings_of_the_module_agree_with_dpr_lab(paper: Rig, tmp_path: Path, effects):
    chosen = {name: values for effect in effects for name, values in typical(effect).items()}
    module = run_source(python_module(model_of(paper, chosen), paper), tmp_path)
    t = np.arange(0.03, 2.0, 2.51e-3)  # a segment that starts with the release
    run = 1 if "missed_counts" in effects else 0
    if run:
        chosen["missed_counts"]["time_s"] = 1.0
        module = run_source(python_module(model_of(paper, chosen), paper), tmp_path)
    read = module["readings"](X0, t, run)
    assert read == pytest.approx(lab_readings(paper, chosen, t, run), abs=1e-9)
    plain = lab_readings(paper, {}, t, run)
    assert np.abs(read - plain).max() > 1e-5


@pytest.mark.parametrize(
    ("effects", "resting"),
    [
        ({"coulomb_joint1": {"torque_Nm": 0.15}, "coulomb_joint2": {"torque_Nm": 0.04}}, (1,)),
        ({"coulomb_joint2": {"torque_Nm": 0.05}}, (1,)),
        ({"stribeck_joint1": {"torque_Nm": 0.2, "extra_at_rest_Nm": 0.2, "speed_rad_per_s": 0.5}}, (0,)),
    ],
)
def test_sticking_joints_of_the_module_agree_with_dpr_lab(paper: Rig, tmp_path: Path, effects, resting):
    from tests.exports import models

    module = run_source(python_module(model_of(paper, effects), paper), tmp_path)
    x0, t = (np.pi + 0.4, np.pi + 0.9, 0.0, 0.0), np.linspace(0, 1.0, 21)
    base, constants = models.base_of(paper), models.rig_constants(paper)
    params = models.effect_params(effects)
    expected = models.simulate(base, paper.rig.L1, paper.rig.g, x0, t, 2.5e-3, params, constants)
    result = module["simulate"](x0, t, 2.5e-3)
    assert result == pytest.approx(expected, abs=1e-9)
    speeds = np.column_stack([result[:, 2], result[:, 3] - result[:, 2]])
    assert (speeds[1:, list(resting)] == 0).any(axis=0).all()
    assert np.abs(module["derivative"](0.0, np.array([np.pi, np.pi, 0.0, 0.0]))).max() < 1e-12


def test_torques_of_one_s_own_drive_the_joints(paper: Rig, tmp_path: Path):
    module = run_source(python_module(model_of(paper, {}), paper), tmp_path)
    hanging = [np.pi, np.pi, 0.0, 0.0]
    a, b, d, *_ = module["BASE"]
    pushed = module["derivative"](0.0, hanging, (1.0, 0.5))[2:]
    assert np.array([[a, d], [d, b]]) @ pushed == pytest.approx([0.5, 0.5])
    e1, e2 = module["BASE"][3], module["MODEL"].base.e2
    x0 = [np.pi + 0.1, np.pi - 0.2, 0.0, 0.0]
    own = (-e1 * np.sin(x0[0]) - e2 * np.sin(x0[1]), -e2 * np.sin(x0[1]))
    held = module["simulate"](x0, [0.0, 0.1], torques=lambda t, state: own)
    assert held[-1] == pytest.approx(x0, abs=1e-12)


@pytest.mark.slow
def test_the_module_needs_numpy_alone(paper: Rig, tmp_path: Path):
    chosen = {name: values for effect in EFFECTS for name, values in typical(effect).items()}
    (tmp_path / "corrected_model.py").write_text(python_module(model_of(paper, chosen), paper), encoding="utf-8")
    asked = (
        "import sys, corrected_model; corrected_model.simulate([1.0, 2.0, 0.0, 0.0], [0.0, 0.01])\n"
        "print(sorted(name for name in ('dpr_lab', 'numba', 'scipy') if name in sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", asked], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_a_diverging_swing_is_nan(paper: Rig, tmp_path: Path):
    module = run_source(python_module(model_of(paper, {}), paper), tmp_path)
    states = module["simulate"]([1.0, 1.0, 1e200, 0.0], [0.0, 0.01, 0.02])
    assert np.isfinite(states[0]).all()
    assert np.isnan(states[-1]).all()
