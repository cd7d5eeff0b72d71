"""The model of a rig with a moving arm, with one rod or two, written into the user's MJCF, URDF or SDFormat file."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import ConfigError
from dpr_lab.exports.into import into_file
from dpr_lab.exports.into.replay import replay_files
from dpr_lab.exports.into.target import rod_targets
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.simulator_models import read_model
from dpr_lab.simulator_models.chain import ModelChain
from dpr_lab.simulator_models.double_pendulum import double_pendulum

pytest.importorskip("mujoco")
pytest.importorskip("urdf_parser_py")
from tests.exports.arm_files import FORMATS, NUMBERS, imported, model_like, recorded, text_of
from tests.thinned import covered

WRONG = {
    "arm_damping": "0.05", "arm_inertia": "0.011", "arm_length": "0.21", "rod_damping": "0.003", "rod_centroid": "0.13",
    "rod_inertia": "0.0025", "elbow_damping": "0.0004", "tip_centroid": "0.135",
}  # fmt: skip
"""True value of each number of the file."""


def needs(suffix: str) -> None:
    """Skip a format whose library is not installed."""
    if suffix == "sdf":
        pytest.importorskip("pydrake", reason="Drake has no wheel for this computer")


def numbers_of(chain: ModelChain) -> list[float]:
    """Values of rods and arm in a file."""
    arm = chain.arm
    assert arm is not None
    of_rods = [(rod.mass, rod.centroid, rod.inertia, rod.joint.damping) for rod in chain.rods]
    return [*np.ravel(of_rods).tolist(), arm.length, arm.inertia, arm.joint.damping]


@pytest.mark.parametrize("rods", [1, 2])
@pytest.mark.parametrize("suffix", FORMATS)
def test_a_rig_file_has_the_numbers_of_rods_and_arm(suffix: str, rods: int, tmp_path: Path) -> None:
    needs(suffix)
    file, rig = imported(tmp_path / "own", suffix, text_of(suffix, rods))
    assert rig.rods.mounted == ("both" if rods == 2 else "inner")
    assert (rig.L0, rig.parameters["l1"].nominal, rig.parameters["J1"].nominal) == pytest.approx((0.2, 0.12, 0.0021))
    carried = 0.3 if rods == 1 else 0.53
    assert rig.arm.A is not None
    assert rig.arm.A.nominal == pytest.approx(0.008 + carried * 0.2**2)
    assert into_file(model_like(rig, rig), rig, file).changes == ()


@pytest.mark.parametrize(("rods", "suffix"), covered((1, 2), FORMATS))
def test_the_changed_file_has_the_numbers_of_the_rig_and_keeps_all_others(
    suffix: str, rods: int, tmp_path: Path
) -> None:
    needs(suffix)
    file, rig = imported(tmp_path / "own", suffix, text_of(suffix, rods))
    wrong = {name: value for name, value in WRONG.items() if rods == 2 or name[:3] not in ("elb", "tip")}
    for name, value in wrong.items():
        right, true = imported(tmp_path / name, suffix, text_of(suffix, rods, **{name: value}))
        patched = into_file(model_like(true, rig), rig, file)
        gravity = None if suffix != "urdf" else 9.81
        changed, wanted = (
            double_pendulum(read_model(path, text), (), gravity) for path, text in ((file, patched.text), (right, None))
        )
        assert numbers_of(changed) == pytest.approx(numbers_of(wanted), rel=1e-6), name
        assert len({change.element for change in patched.changes}) == 1, name
        assert b'drawn > weighed: "keep" me' in patched.text


@pytest.mark.slow
@pytest.mark.parametrize("suffix", FORMATS)
def test_a_replay_of_one_rod_on_an_arm_shows_both_files(suffix: str, tmp_path: Path) -> None:
    needs(suffix)
    file, rig = imported(tmp_path / "own", suffix, text_of(suffix, 1))
    truth = text_of("xml", 1, arm_damping=WRONG["arm_damping"])
    _, true = imported(tmp_path / "true", "xml", truth)
    model = model_like(true, rig)
    (replay,) = replay_files(file, into_file(model, rig, file), (), model, rig, [recorded(truth, rig)])
    assert replay.after_rad == pytest.approx(replay.lab_rad, rel=0.1)
    assert replay.before_rad > 5 * replay.after_rad


def test_each_rod_gets_its_own_target(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, rig = imported(tmp_path / "own", "xml", text_of("xml", 2))
    monkeypatch.setattr("dpr_lab.exports.into.rod_targets", lambda *given: rod_targets(*given)[:1])
    with pytest.raises(ValueError, match="shorter"):  # the target of the arm is not that of the second rod
        into_file(model_like(rig, rig), rig, file)


def test_files_with_other_rods_are_refused(tmp_path: Path) -> None:
    one, rig1 = imported(tmp_path / "one", "xml", text_of("xml", 1))
    two, rig2 = imported(tmp_path / "two", "xml", text_of("xml", 2))
    with pytest.raises(ConfigError, match="it has two rods on the arm, but the model has one rod: name its joints"):
        into_file(model_like(rig1, rig1), rig1, two)
    with pytest.raises(ConfigError, match="it has one rod on the arm, but the model has two rods"):
        into_file(model_like(rig2, rig2), rig2, one)
    named = into_file(model_like(rig1, rig1), rig1, one, ("shoulder", "yaw"))
    assert named.changes == ()
    assert isinstance(model_like(rig1, rig1), MovingArmModel)
    level = text_of("xml", 1).replace('axis="0 0 -1"', 'axis="1 0 0"')
    with pytest.raises(ConfigError, match="'yaw' is 90 degrees away from the vertical"):
        imported(tmp_path / "level", "xml", level)
    assert set(WRONG) < set(NUMBERS)
