"""The corrected model in MuJoCo: motion and readings agree with dpr-lab."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.errors import ConfigError
from dpr_lab.exports.bodies import in_words
from dpr_lab.exports.mjcf import CALLBACK, WORDS, XML, mjcf, passive
from dpr_lab.exports.programs import Replay, in_mujoco
from dpr_lab.rig import Rig
from tests.exports.models import SETS, X0, lab_readings, lab_states, model_of, run_source, typical
from tests.thinned import thinned

pytest.importorskip("mujoco")

SMOOTH = [
    (name,)
    for name, effect in EFFECTS.items()
    if (effect.stage in ("torque", "arm") and not effect.dry and not effect.internal) or effect.stage == "arm"
]
ABRUPT = [(name,) for name, effect in EFFECTS.items() if effect.dry or (effect.dissipative and effect.internal)]
T = np.linspace(0, 2.0, 81)


def engine(paper: Rig, chosen: dict, folder: Path) -> dict:
    model = model_of(paper, chosen)
    (folder / XML).write_text(mjcf(model, paper), encoding="utf-8")
    names = run_source(passive(model, paper), folder)
    names["EngineSwing"].file = str(folder / XML)
    return names


def chosen_of(effects) -> dict:
    return {name: values for effect in effects for name, values in typical(effect).items()}


def error(names: dict, want: np.ndarray, step: float | None = None) -> float:
    """Largest difference of the rod angles at the first instants of T, rad."""

    class Swing(names["EngineSwing"]):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            self.longest = step or self.longest

    return float(np.abs(names["simulate"](X0, T[: len(want)], kind=Swing) - want)[:, :2].max())


def test_a_file_that_mujoco_refuses_is_an_error_with_its_reason(paper: Rig, tmp_path: Path):
    model = model_of(paper, {})
    impossible = mjcf(model, paper).replace('diaginertia="', 'diaginertia="-')
    (tmp_path / XML).write_text(impossible, encoding="utf-8")
    (tmp_path / CALLBACK).write_text(passive(model, paper), encoding="utf-8")
    swing = Replay("a", T, np.zeros((len(T), 2)), np.zeros((len(T), 2)), 0.0, X0, np.ones(2), np.zeros((1, 2)))
    with pytest.raises(ConfigError, match=r"MuJoCo refuses corrected_model.xml of a: .*inertia"):
        in_mujoco(tmp_path / XML, model, paper)(swing)


@pytest.mark.slow
@pytest.mark.parametrize("effects", thinned(SMOOTH, 7), ids="+".join)
def test_smooth_effects_in_mujoco_agree_with_dpr_lab(paper: Rig, tmp_path: Path, effects):
    chosen = chosen_of(effects)
    assert error(engine(paper, chosen, tmp_path), lab_states(paper, chosen, T, 2.5e-4)) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("effects", thinned(ABRUPT, 5), ids="+".join)
def test_friction_at_rest_is_mujoco_s_own_and_softer(paper: Rig, tmp_path: Path, effects):
    chosen = chosen_of(effects)
    assert error(engine(paper, chosen, tmp_path), lab_states(paper, chosen, T, 2.5e-4)) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("effects", thinned([("coulomb_joint1",), ("hysteresis_joint1",)], 2), ids="+".join)
def test_friction_at_rest_converges_to_that_of_dpr_lab_with_small_steps(paper: Rig, tmp_path: Path, effects):
    chosen = chosen_of(effects)
    beginning = T[: len(T) // 8]
    assert error(engine(paper, chosen, tmp_path), lab_states(paper, chosen, beginning, 2.5e-4), 2e-5) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("effects", thinned(SETS[:2], 2), ids="+".join)
def test_several_effects_at_once(paper: Rig, tmp_path: Path, effects):
    chosen = chosen_of(effects)
    assert error(engine(paper, chosen, tmp_path), lab_states(paper, chosen, T, 2.5e-4)) < 1e-3


@pytest.mark.slow
def test_encoders_are_read_in_mujoco_too(paper: Rig, tmp_path: Path):
    chosen = chosen_of(("encoder_offset_joint1", "encoder_scale_joint2", "latency_joint2", "backlash_joint2"))
    names, t = engine(paper, chosen, tmp_path), np.arange(0.03, 2.0, 0.01)
    read = names["readings"](X0, t, kind=names["EngineSwing"])
    assert read == pytest.approx(lab_readings(paper, chosen, t, 0), abs=1e-6)


def test_effects_with_an_attribute_need_no_callback(paper: Rig, tmp_path: Path):
    chosen = chosen_of(("rotor_inertia_joint2", "base_tilt", "detent_joint1", "spring_joint2", "spring_joint1"))
    chosen["spring_joint2"]["cubic_Nm_per_rad3"] = chosen["spring_joint1"]["cubic_Nm_per_rad3"] = 0.0
    model = model_of(paper, chosen)
    assert set(in_words(model, paper, WORDS)) == set(chosen)
    names = engine(paper, chosen, tmp_path)
    names["EngineSwing"].after.__globals__["passive"] = None
    assert error(names, lab_states(paper, chosen, T, 2.5e-4)) < 1e-6


def test_an_arm_lighter_than_its_rods_stays_still(paper: Rig, tmp_path: Path):
    chosen = {"arm_compliance": {"coupling_per_kg": 1e3, "frequency_hz": 8.0, "damping_ratio": 0.05}}
    model = model_of(paper, chosen)
    assert in_words(model, paper, WORDS) == {}
    assert "arm_compliance" in mjcf(model, paper)
    assert CALLBACK.endswith(".py")
