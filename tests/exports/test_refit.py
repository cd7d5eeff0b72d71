"""Effects that a format cannot contain, refitted without the amplitudes that it lacks."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.dynamics.base import RATIOS, added_base, ratios
from dpr_lab.dynamics.segments import segments
from dpr_lab.dynamics.sensitivity import swings
from dpr_lab.effects import effect_params
from dpr_lab.exports.into import WORDS
from dpr_lab.exports.refit import bare_model, fitted_in_words, unchanged
from dpr_lab.fitting.estimate import Estimate, unknown_ratios
from dpr_lab.identification.model import Model
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.rig import Rig, load_rig
from dpr_lab.rig_tables import AddedMass
from dpr_lab.run import Run
from dpr_lab.workflows.rig_from import rig_from_model
from tests.exports.models import base_of
from tests.exports.test_export_command import whole_model
from tests.thinned import covered

pytest.importorskip("mujoco")
from tests.exports.planted_errors import ROBOT, SHOULDER, recordings


@pytest.mark.slow
@pytest.mark.parametrize(
    ("further", "cubic"),
    covered(({"stribeck_joint2": {"coulomb_Nm": 1e-3, "extra_Nm": 1e-3, "speed_rad_s": 0.3}}, {}), (-3e-4, 0.0)),
)
def test_a_spring_with_a_cubic_term_becomes_a_linear_one(
    tmp_path: Path, cubic: float, further: dict[str, dict[str, float]]
) -> None:
    """Left out as a whole, the spring would be compensated by impossible inertias."""
    (tmp_path / "robot.xml").write_text(ROBOT, encoding="utf-8")
    rig_from_model(tmp_path / "robot.xml", tmp_path / "rig.toml")
    rig = load_rig(tmp_path / "rig.toml")
    runs = recordings(ROBOT.replace(SHOULDER, SHOULDER + ' stiffness="0.08"'), rig, 3.0)
    model = whole_model(rig, Estimate.of(unknown_ratios(base_of(rig)), effect_params({}), np.zeros((1, 4))))
    spring = {"stiffness_Nm_per_rad": 0.084, "cubic_Nm_per_rad3": cubic, "constant_Nm": 0.0}
    model = model.model_copy(update={"effects": {"spring_joint1": spring, **further}})
    fitted = fitted_in_words(model, WORDS["SDFormat"], runs, rig)
    stiffness = fitted.effects["spring_joint1"]["stiffness_Nm_per_rad"]
    simplified = {"spring_joint1"} if cubic else set[str]()
    assert unchanged(model, fitted) == set(fitted.effects) - simplified
    assert fitted.effects["spring_joint1"] == spring | {"stiffness_Nm_per_rad": stiffness, "cubic_Nm_per_rad3": 0.0}
    if cubic or further:
        assert stiffness == pytest.approx(0.08, rel=0.02)
    else:
        assert fitted is model


@pytest.mark.parametrize("added", [None, AddedMass(rod="outer", mass=0.1, position=0.3)])
def test_the_intervals_of_a_refitted_model_belong_to_its_values(paper: Rig, added: AddedMass | None) -> None:
    """The given model has other ratios and another b, which are wrong by 5 %, with narrow intervals."""
    base = base_of(paper)
    true = unknown_ratios(base)
    truth: dict[str, float] = dict(zip(RATIOS, true.tolist(), strict=False))
    t, rng = np.arange(800) / 400.0, np.random.default_rng(3)
    runs = list[Run]()
    for start, mass in (([1.0, 0.4, 0.0, 0.0], None), ([-0.8, 0.9, 0.0, 0.0], added)):
        of_run = ratios(base + added_base(mass, paper.L1, paper.g)) if mass else true[:5]
        layout = segments([t], run=[0], step=2.5e-3)
        swung = swings(of_run, paper.L1, paper.g, layout, np.array([start]))[:, :2]
        theta = np.insert(swung + 1e-3 * rng.standard_normal(swung.shape), 0, 0.0, axis=1)
        name = f"swing {len(runs)}"
        runs.append(Run(name, t, theta, None, None, paper.name, paper.sha256, 400.0, added_mass=mass))
    given = whole_model(paper, Estimate.of(1.05 * true, effect_params({}), np.zeros((1, 4))))
    other = Scale(b=1.05 * true[5], interval90=(1.04 * true[5], 1.06 * true[5]), fixed_by="data" if added else "bound")
    given = given.model_copy(update={"effects": {"coulomb_joint1": {"torque_Nm": 1e-3}}, "scale": other})
    refitted = bare_model(given, runs, paper)
    assert isinstance(refitted, Model)
    if added:
        b, scale = refitted.base["b"], refitted.scale
        assert scale is not None
        assert (scale.fixed_by, scale.b) == ("data", pytest.approx(b.value))
        assert b.fixed_by == "data"
        assert b.interval90 == pytest.approx(scale.interval90, rel=0.01)
        assert scale.interval90[0] < true[5] < scale.interval90[1]
    for name, ratio in refitted.ratios.items():
        low, high = ratio.interval90
        assert low <= ratio.value <= high
        assert (high - low) / 2 == pytest.approx(1.645 * ratio.std, rel=0.01)
        assert abs(ratio.value - truth[name]) < 4 * ratio.std
        assert ratio.std < 0.1 * ratio.value
    for value in (*refitted.parameters.values(), *refitted.base.values()):
        assert value.interval90 is not None
        assert value.interval90[0] <= value.value <= value.interval90[1]
    a_over_b = refitted.base["a"].value / refitted.base["b"].value
    assert a_over_b == pytest.approx(refitted.ratios["a/b"].value, rel=1e-3)
