from pathlib import Path

import numpy as np
import pytest

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.exports.corrected import (
    _insignificant_effects,
    _without_insignificant,
    corrected_model,
    significant_values,
)
from dpr_lab.fitting.estimate import SCALE
from dpr_lab.gap.result.causes import EffectSize, NamedEffect
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.posterior import PosteriorComponent
from dpr_lab.gap.result.saved import Interval
from dpr_lab.identification.compare import compare_run
from dpr_lab.identification.model import Model, load_model
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


def test_without_an_insignificant_amplitude_the_other_values_are_those_of_a_fit_without_it():
    """A linear regression with and without the column of the cubic term."""
    rng = np.random.default_rng(29)
    names = ["a/b", "spring_joint1.stiffness_Nm_per_rad", "spring_joint1.cubic_Nm_per_rad3"]
    columns = rng.normal(size=(50, 3)) + rng.normal(size=(50, 1))
    readings = columns @ [1.5, 0.08, 0.0] + 0.1 * rng.normal(size=50)
    fitted = dict.fromkeys(RATIOS, 1.0) | dict(zip(names, np.linalg.lstsq(columns, readings)[0].tolist(), strict=True))
    effects = {"spring_joint1": {name.partition(".")[2]: fitted[name] for name in names[1:]}}
    covariance = np.linalg.inv(columns.T @ columns).tolist()
    sizes = {
        key: EffectSize(value=value, interval90=(low, 1.0))
        for (key, value), low in zip(effects["spring_joint1"].items(), (0.01, -1.0), strict=True)
    }
    named = NamedEffect.model_construct(name="spring_joint1", parameters=sizes)
    posterior = PosteriorComponent(
        probability=1.0,
        ratios={name: fitted[name] for name in RATIOS},
        effects=effects,
        free=names,
        covariance=covariance,
    )
    diagnosis = Diagnosis.model_construct(effects=[named], posterior=[posterior], model_effects=effects)
    significant = _without_insignificant(diagnosis, fitted)
    assert significant[names[2]] == 0.0
    assert [significant[name] for name in names[:2]] == pytest.approx(np.linalg.lstsq(columns[:, :2], readings)[0])
    assert abs(significant[names[1]] - fitted[names[1]]) > 1e-3


@pytest.mark.parametrize(("value", "absent"), [(1e-6, {"load_friction_joint2"}), (1e-4, set())])
def test_an_effect_that_is_not_named_is_left_out_if_its_interval_contains_zero(value: float, absent: set[str]):
    """Every rig with a gear is fitted with load-dependent friction, whether it is significant or not."""
    key = "load_friction_joint2.friction_radius_m"
    effects = {"load_friction_joint2": {"friction_radius_m": value}}
    posterior = PosteriorComponent(
        probability=1.0,
        ratios=dict.fromkeys(RATIOS, 1.0),
        effects=effects,
        free=["c2/b", key, "coulomb_joint1.torque_Nm"],  # the estimate of this torque is zero
        covariance=[[1e-10, 3e-12, 0.0], [3e-12, 4e-12, 0.0], [0.0, 0.0, 1e-9]],
    )
    diagnosis = Diagnosis.model_construct(effects=[], posterior=[posterior], model_effects=effects)
    fitted = dict.fromkeys(RATIOS, 1.0) | {key: value}
    assert _insignificant_effects(diagnosis, fitted) == absent
    assert _without_insignificant(diagnosis, fitted, absent)["c2/b"] == 1.0 - (0.75 * value if absent else 0.0)


def test_the_scale_follows_an_effect_that_is_left_out():
    """Known torques determine b and the offset of a torque together."""
    key = "torque_offset_joint1.offset_Nm"
    effects = {"torque_offset_joint1": {"offset_Nm": 1e-4}}
    posterior = PosteriorComponent(
        probability=1.0,
        ratios=dict.fromkeys(RATIOS, 1.0) | {"b": 0.02},
        effects=effects,
        free=["b", key],
        covariance=[[1e-6, 2e-8], [2e-8, 1e-6]],
    )
    ratios = {name: Interval(value=1.0, interval90=(0.9, 1.1)) for name in RATIOS}
    diagnosis = Diagnosis.model_construct(
        effects=[], posterior=[posterior], model_effects=effects, ratios=ratios, scale_b=0.02, fitted=[], p_over_b=None
    )
    unknown, left = significant_values(diagnosis)
    assert left == {}
    assert unknown[SCALE] == pytest.approx(0.02 - 0.02 * 1e-4, rel=1e-9)
