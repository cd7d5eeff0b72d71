import runpy
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from dpr_lab.compare import compare_run
from dpr_lab.dynamics.known import known_of
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.effects import effect_vector
from dpr_lab.gap.corrected import corrected_model
from dpr_lab.gap.diagnosis import Diagnosis
from dpr_lab.gap.export import TORQUES, mjcf, python_module
from dpr_lab.model import Model, load_model
from dpr_lab.rig import Rig


@pytest.fixture(scope="module")
def corrected(two_found: Diagnosis, two_runs, paper: Rig) -> Model:
    return corrected_model(two_found, two_runs, paper)


@pytest.mark.slow
def test_compare_draws_the_effects(corrected: Model, two_runs, paper: Rig, tmp_path: Path):
    corrected.save(tmp_path / "model.json")
    kept = load_model(tmp_path / "model.json")
    assert set(kept.effects) == {"coulomb_joint1", "latency_joint2"}
    bare = compare_run(two_runs[0], paper, kept.model_copy(update={"effects": {}}))
    full = compare_run(two_runs[0], paper, kept)
    assert (full.segment_rms_rad < 1.1 * full.noise_rad).all()
    assert (bare.segment_rms_rad > 1.2 * bare.noise_rad).any()
    assert (full.free_run_rms_rad < 0.2 * bare.free_run_rms_rad).all()


@pytest.mark.slow
def test_the_module_swings_as_the_lab_does(corrected: Model, paper: Rig, tmp_path: Path):
    effects = {
        "coulomb_joint1": {"torque_Nm": 1e-3},
        "stribeck_joint2": {"torque_Nm": 5e-4, "extra_at_rest_Nm": 3e-4, "speed_rad_per_s": 0.5},
        "air_drag_both": {"coefficient_kg_per_m2": 5e-3},
        "spring_joint2": {"stiffness_Nm_per_rad": 2e-3, "cubic_Nm_per_rad3": 1e-5},
        "detent_joint1": {"cos1_Nm": 1e-3, "sin1_Nm": 0.0, "cos2_Nm": 0.0, "sin2_Nm": 2e-4, "order": 7.0},
    }
    assert set(effects) <= set(TORQUES)
    model = corrected.model_copy(update={"effects": effects})
    path = tmp_path / "model.py"
    path.write_text(python_module(model, paper), encoding="utf-8")
    module = runpy.run_path(str(path))
    x0, t = [np.pi / 2, np.pi / 3, 0.0, 0.0], np.linspace(0, 1.0, 21)
    base = [model.base[name].value for name in ("a", "b", "d", "e1", "c1", "c2")]
    expected = simulate(base, paper.rig.L1, paper.rig.g, x0, t, 1e-3, effect_vector(effects), known_of(paper))
    assert module["simulate"](x0, t) == pytest.approx(expected, abs=2e-4)


@pytest.mark.slow
def test_mjcf_says_what_it_can_and_lists_the_rest(corrected: Model, paper: Rig):
    text = mjcf(corrected, paper)
    joints = {joint.attrib["name"]: joint.attrib for joint in ElementTree.fromstring(text).iter("joint")}
    assert float(joints["joint1"]["frictionloss"]) == pytest.approx(corrected.effects["coulomb_joint1"]["torque_Nm"])
    assert float(joints["joint2"]["damping"]) == pytest.approx(corrected.base["c2"].value)
    assert "Not expressed here: latency_joint2" in text
