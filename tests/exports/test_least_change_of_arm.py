"""A planted error in an MJCF model with a driven arm is the first cause, and nothing else in the file changes."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import ConfigError
from dpr_lab.exports.corrected import corrected_model
from dpr_lab.exports.into import WORDS, into_file
from dpr_lab.exports.into.least_change_of_arm import kept_numbers, least_change_of_arm, numbers_of_file
from dpr_lab.exports.into.replay import replay_files
from dpr_lab.exports.refit import fitted_in_words
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.identification.model import EstimatedValue
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.simulator_models import read_model
from dpr_lab.simulator_models.chain import ModelChain
from dpr_lab.simulator_models.double_pendulum import double_pendulum

pytest.importorskip("mujoco")
from tests.exports.arm_files import NUMBERS, imported, model_like, recorded, text_of
from tests.thinned import candidates

SECONDS = 3.0
LIKELY = ("coulomb", "spring", "arm_", "torque_", "input_", "com_", "encoder_offset")
PLANTED = {
    "damping of the arm": ("arm_damping", "0.05", "yaw", "damping"),
    "inertia of the arm": ("arm_inertia", "0.012", "yaw", "inertia of the arm about its axis"),
    "friction of the arm": ("arm_more", 'frictionloss="0.03"', "yaw", "Coulomb friction"),
    "spring of the arm": ("arm_more", 'stiffness="0.3"', "yaw", "spring stiffness"),
    "gear": ("gear", "2.4", "yaw", "gear of the motor"),
    "damping of the rod": ("rod_damping", "0.006", "shoulder", "damping"),
    "centre of mass of the rod": ("rod_centroid", "0.13", "shoulder", "centre of mass of the body along the rod"),
}
"""Number of the file, its true value, joint and quantity of the first cause."""
QUICK = [("damping of the arm", 2), ("gear", 1)]
"""Errors with the number of rods that `make test` plants: of arm and drive, with one rod and with two.

Friction takes four times as long; `test_least_change.py` plants errors of rods and joints.
"""


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("planted", "rods"),
    [pytest.param(*case, marks=[pytest.mark.long] * (case not in QUICK)) for case in product(PLANTED, (1, 2))],
)
def test_a_planted_error_is_the_first_cause_and_alone(planted: str, rods: int, tmp_path: Path) -> None:
    name, value, joint, quantity = PLANTED[planted]
    file, rig = imported(tmp_path / "own", "xml", text_of("xml", rods))
    truth = text_of("xml", rods, **{name: value})
    gear = float(value) / float(NUMBERS["gear"]) if name == "gear" else 1.0
    runs = [recorded(truth, rig, number, SECONDS, gear) for number in range(4)]
    diagnosis = diagnose(runs[:3], rig, library=candidates(*LIKELY))
    model = fitted_in_words(corrected_model(diagnosis, runs[:3], rig), WORDS["MJCF"], runs[:3], rig)
    assert isinstance(model, MovingArmModel)
    least = least_change_of_arm(diagnosis, model, rig, double_pendulum(read_model(file)), runs[:3])
    assert (least.causes[0].joint, least.causes[0].quantity) == (joint, quantity)
    patched = into_file(least.model, rig, file)
    assert len({change.element for change in patched.changes}) == 1
    (replay,) = replay_files(file, patched, (), least.model, rig, runs[3:])
    softened = quantity == "Coulomb friction"  # by MuJoCo
    assert replay.after_rad < (0.06 * replay.before_rad if softened else 1.1 * replay.lab_rad)
    assert replay.before_rad > 3 * replay.after_rad
    assert np.isclose(least.causes[0].share, 1.0, atol=0.05)


@pytest.mark.parametrize("rods", [1, 2])
def test_the_rotor_of_the_shoulder_changes_no_number_of_the_rod(rods: int, tmp_path: Path) -> None:
    of_file, model, chain = with_rotor(tmp_path, rods, "0.003", 0.003)
    assert kept_numbers(of_file, model, chain) == (of_file, pytest.approx(1.0))


def test_a_rotor_larger_than_the_identified_inertia_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"armature 0.05 kg m.2 of joint 'shoulder' is larger than .* correct"):
        kept_numbers(*with_rotor(tmp_path, 1, "0.05", 0.0))


def with_rotor(
    folder: Path, rods: int, armature: str, rotor: float
) -> tuple[dict[str, float], MovingArmModel, ModelChain]:
    """Numbers of a file with this armature of the shoulder, model with another rotor, kg m^2, and rods of the file."""
    text = text_of("xml", rods).replace('name="shoulder"', f'name="shoulder" armature="{armature}"')
    file, rig = imported(folder / "own", "xml", text)
    chain, model = double_pendulum(read_model(file)), model_like(rig, rig)
    sizes = model.sizes | {"a": model.sizes["a"] + rotor}
    scale = sizes[model.scale]
    ratio = {name: value if name == "L0" else value / scale for name, value in sizes.items()}
    estimates = {
        f"{name}/{model.scale}": EstimatedValue(value=value, std=1e-4 * value, interval90=(value, value))
        for name, value in ratio.items()
        if name in (*("e1", "A", "c1"), *(("a", "d") if rods == 2 else ()))
    }
    absolute = {model.scale: model.absolute[model.scale].model_copy(update={"value": scale})}
    model = model.model_copy(update={"ratios": estimates, "absolute": absolute, "swing": list(ratio.values())})
    assert chain.arm is not None
    return numbers_of_file(chain, chain.arm, rig, model), model, chain
