"""A planted error in an MJCF model is the first cause, and the corrected file agrees with the true model."""

from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from dpr_lab.errors import ConfigError
from dpr_lab.exports.corrected import corrected_model
from dpr_lab.exports.into import WORDS, into_file
from dpr_lab.exports.into.least_change import LeastChange, _base, _changed_gears, least_change
from dpr_lab.exports.refit import fitted_in_words
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.identification.model import Model
from dpr_lab.rig import Rig, load_rig
from dpr_lab.simulator_models import read_model
from dpr_lab.simulator_models.double_pendulum import double_pendulum
from dpr_lab.workflows.rig_from import rig_from_model
from tests.thinned import candidates, thinned

pytest.importorskip("mujoco")
from tests.exports.planted_errors import ELBOW, PLANTED, ROBOT, SHOULDER, SOFTENED, held_out_error, recordings

SECONDS, DRIVEN_SECONDS = 3.0, 2.0
LIKELY = ("coulomb", "stribeck", "spring", "wrong_length", "com_", "rotor", "torque_", "encoder_offset", "base_tilt")
QUICK = ("rod too short",)
"""Errors that fast tests plant. Damping and gear of an arm are in `test_least_change_of_arm.py`."""
ATTRIBUTES = {
    "Coulomb friction": "frictionloss",
    "rotor inertia (armature)": "armature",
    "damping": "damping",
    "spring stiffness": "stiffness",
    "centre of mass of the body along the rod": "pos",
    "error of length L1 or gravity": "pos",
}


def corrected(
    folder: Path, file: str, truth: str, gears: tuple[float, float] | None = None
) -> tuple[LeastChange, str, Rig]:
    """Causes, corrected file and rig. If gears are given, the motors are driven."""
    (folder / "robot.xml").write_text(file, encoding="utf-8")
    rig_from_model(folder / "robot.xml", folder / "rig.toml")
    rig = load_rig(folder / "rig.toml")
    runs = recordings(truth, rig, SECONDS if gears is None else DRIVEN_SECONDS, gears=gears)
    diagnosis = diagnose(runs, rig, library=candidates(*LIKELY))
    chain = double_pendulum(read_model(folder / "robot.xml"))
    model = fitted_in_words(corrected_model(diagnosis, runs, rig), WORDS["MJCF"], runs, rig)
    assert isinstance(model, Model)
    least = least_change(diagnosis, model, rig, chain, runs)
    return least, into_file(least.model, rig, folder / "robot.xml").text.decode(), rig


def changed(before: str, after: str) -> list[str]:
    """Attributes that differ between two files with the same elements."""
    old, new = (list(ElementTree.fromstring(text).iter()) for text in (before, after))
    assert [element.tag for element in old] == [element.tag for element in new]
    pairs = zip(old, new, strict=True)
    return sorted(key for one, two in pairs for key in {*one.attrib, *two.attrib} if one.get(key) != two.get(key))


def test_the_benchmark_expects_the_same_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    of_benchmark = import_module("simulator_models").PLANTED
    words = {planted.cause for planted in PLANTED.values()} | {"gear of the motor"}
    assert {quantity for quantity, *_ in of_benchmark.values()} == words


def diagnosed(a: float, known: bool = False) -> tuple[Any, Any]:
    """Model with this a/b, other ratios of 1 and b = 2 kg m^2, and its diagnosis."""
    scale = SimpleNamespace(known=known, interval90=(1.9, 2.1))
    diagnosis = SimpleNamespace(scale=scale, ratio_covariance=1e-8 * np.eye(5))
    ratios = np.array([a, 1.0, 1.0, 1.0, 1.0])
    return SimpleNamespace(ratio_values=ratios, base={"b": SimpleNamespace(value=2.0)}), diagnosis


@pytest.mark.parametrize(("estimated", "of_rod"), [(3.0, 5.5), (3.255, 6.0)])
def test_a_changed_inertia_is_that_of_the_rod_without_its_rotor(estimated: float, of_rod: float) -> None:
    """The estimate contains the rotor of 0.5; a difference of 0.2 % does not change the rod of the file."""
    of_file, rotor = np.array([6.0, 2.0, 2.0, 2.0, 2.0, 2.0]), np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    base = _base(of_file, rotor, *diagnosed(estimated), gears=np.zeros(0))
    assert base.tolist() == pytest.approx([of_rod, 2.0, 2.0, 2.0, 2.0, 2.0])


def test_a_rotor_larger_than_the_identified_inertia_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "robot.xml"
    file.write_text(ROBOT.replace('name="shoulder"', 'name="shoulder" armature="9"'), encoding="utf-8")
    model, diagnosis = diagnosed(3.0)
    model.effects, rig = {}, rig_from_model(file, tmp_path / "rig.toml").file
    with pytest.raises(ConfigError, match=r"armature 9 kg m.2 of joint 'shoulder' is larger than"):
        least_change(diagnosis, model, load_rig(rig), double_pendulum(read_model(file)), [])


def test_a_gear_changes_by_its_torque_constant_times_the_factor_of_the_masses() -> None:
    gears = {"torque_scale_joint1": 1.25, "torque_scale_joint2": 0.8}
    changed = _changed_gears(gears, 1.25, diagnosed(3.0)[1])
    assert changed == {"torque_scale_joint1": {"excess": pytest.approx(0.5625)}}


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.long] * (name not in QUICK)) for name in PLANTED if name != SOFTENED],
)
def test_a_planted_error_is_the_first_cause_and_the_corrected_file_closes_the_gap(tmp_path: Path, name: str) -> None:
    planted = PLANTED[name]
    least, text, rig = corrected(tmp_path, planted.before, planted.truth)
    first = least.causes[0]
    assert (first.quantity, first.joint) == (planted.cause, planted.joint)
    assert changed(planted.before, text) == [ATTRIBUTES[planted.cause]]
    assert 'drawn > weighed: "keep" me' in text
    before, after = (held_out_error(file, planted.truth, rig) for file in (planted.before, text))
    assert after < 0.1 * before


MOTORS = '</worldbody><actuator><motor joint="shoulder" gear="10"/><motor joint="elbow" gear="5"/></actuator>'


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize(("joint", "before", "true"), [("shoulder", "10", "11.8"), ("elbow", "5", "4.2")])
def test_a_wrong_gear_is_the_only_change(tmp_path: Path, joint: str, before: str, true: str) -> None:
    """Both drives are in the recordings, so that only the ratio of their torque constants is identifiable."""
    file = ROBOT.replace("</worldbody>", MOTORS)
    truth = file.replace(f'gear="{before}"', f'gear="{true}"')
    least, text, _ = corrected(tmp_path, file, truth, (10.0, 5.0))
    (cause,) = least.causes
    assert (cause.quantity, cause.joint) == ("gear of the motor", joint)
    assert cause.after == pytest.approx(float(true), rel=2e-3)
    assert changed(file, text) == ["gear"]


RIGHT = {
    "bare": ROBOT,
    "friction": ROBOT.replace(ELBOW, ELBOW + ' frictionloss="0.004"'),
    "friction too small to see": ROBOT.replace(ELBOW, ELBOW + ' frictionloss="1e-7"'),
    "rotor in the shoulder": ROBOT.replace(SHOULDER, SHOULDER + ' armature="0.003"'),
    "preloaded spring": ROBOT.replace(SHOULDER, SHOULDER + ' stiffness="0.08" springref="0.3"'),
}


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", thinned(reversed(RIGHT), 5))
def test_a_right_model_stays_as_it_is(tmp_path: Path, name: str) -> None:
    least, text, _ = corrected(tmp_path, RIGHT[name], RIGHT[name])
    assert (least.causes, text) == ((), RIGHT[name])


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.timeout(900)
def test_softened_friction_is_corrected_as_coulomb_friction(tmp_path: Path) -> None:
    """The file gets Coulomb friction, whether the diagnosis names it or Stribeck friction."""
    planted = PLANTED[SOFTENED]
    least, text, rig = corrected(tmp_path, planted.before, planted.truth)
    assert (least.causes[0].quantity, least.causes[0].joint, least.unnamed) == (planted.cause, planted.joint, ())
    assert changed(planted.before, text) == ["frictionloss"]
    assert held_out_error(text, planted.truth, rig) < 0.1 * held_out_error(planted.before, planted.truth, rig)
