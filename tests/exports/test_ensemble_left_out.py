"""Width of an ensemble from recordings that are predicted by models fitted without them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.effects import effect_params
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.exports.ensemble.left_out import factor_without, widening, without
from dpr_lab.fitting.estimate import Estimate, unknown_ratios
from dpr_lab.gap.result.posterior import PosteriorComponent
from dpr_lab.identification.model import Model
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record
from sim_device.trials.parameters import weighed
from tests.exports.test_export_command import whole_model
from tests.thinned import thinned

COMPONENT = PosteriorComponent(
    probability=1.0,
    ratios={"a/b": 4.0, "d/b": 1.0},
    effects={"coulomb_joint2": {"torque_Nm": 1e-3}},
    free=["a/b", "coulomb_joint2.torque_Nm"],
    covariance=[[1e-4, 0.0], [0.0, 1e-8]],
    between=[[2e-4, 0.0], [0.0, 0.0]],
    left_out=[[4.1, 9e-4], [3.9, 1.1e-3], [4.0, 1e-3]],
)


@pytest.mark.parametrize("recordings", thinned([3, 6], 2))
@pytest.mark.parametrize("error", thinned([3.0, 1.0, 8.0], 3))
def test_the_band_of_the_next_recording_covers_about_90_percent(recordings: int, error: float) -> None:
    """Errors of some standard deviations in three independent directions of each recording."""
    rng = np.random.default_rng(recordings)
    squared = np.mean((error * rng.standard_normal((1000, recordings, 3))) ** 2, axis=2)
    factors = np.array([widening(of_fit.tolist()) for of_fit in squared])
    assert np.mean(2 * ndtr(factors * NORMAL_Q90 / error) - 1) == pytest.approx(0.9, abs=0.03)


def test_errors_by_chance_and_small_ones_change_nothing() -> None:
    assert widening([0.01] * 8) == 1.0
    assert widening([2.5, 0.9, 1.0]) == 1.0
    assert widening([4.0, 2.0, 3.0]) > 2.0


def test_one_recording_far_from_the_others_does_not_decide() -> None:
    assert widening([0.8, 60.0, 1.1]) == 1.0
    assert widening([2.0, 60.0, 3.0]) == widening([2.0, 4.0, 3.0])
    assert widening([]) == 1.0


def test_the_posterior_without_a_recording_has_its_values_and_a_wider_fit() -> None:
    (part,) = without([COMPONENT], 1)
    assert part.ratios == {"a/b": 3.9, "d/b": 1.0}
    assert part.effects == {"coulomb_joint2": {"torque_Nm": 1.1e-3}}
    assert np.diag(part.covariance) == pytest.approx([1.5e-4, 1.5e-8])
    assert np.array(part.between) == pytest.approx(1.5 * np.array(COMPONENT.between))


def test_an_effect_of_size_zero_is_there_without_a_recording_that_hides_it() -> None:
    (part,) = without([COMPONENT.model_copy(update={"effects": {}})], 0)
    assert part.effects == {"coulomb_joint2": {"torque_Nm": 9e-4}}


@pytest.fixture(scope="module")
def released() -> tuple[Model, list[Run], Rig]:
    """A plant's true model, four of its releases and its rig."""
    plant, rig = weighed(load_plant("paper", 5), load_rig("paper"))
    runs = [replace(run, name=str(i)) for i, run in enumerate([*record(plant, rig, duration=2.0)] * 2)][:4]
    estimate = Estimate.of(unknown_ratios(base_parameters(plant.Z, rig.L1, rig.g)), effect_params({}), np.zeros((1, 4)))
    return whole_model(rig, estimate).model_copy(update={"effects": {}}), runs, rig


def test_a_posterior_of_an_older_version_keeps_its_width(released: tuple[Model, list[Run], Rig]) -> None:
    truth, runs, rig = released
    old = COMPONENT.model_copy(update={"left_out": []})
    assert factor_without(truth, [old], runs, rig, 0) == 1.0


def test_two_recordings_are_too_few(released: tuple[Model, list[Run], Rig]) -> None:
    truth, runs, rig = released
    pair = COMPONENT.model_copy(update={"left_out": COMPONENT.left_out[:2]})
    assert factor_without(truth, [pair], runs[:2], rig, 0) == 1.0


@pytest.mark.long
def test_a_posterior_that_is_too_narrow_is_widened(released: tuple[Model, list[Run], Rig]) -> None:
    """Four releases of one plant; the values without each differ by ten standard deviations of the posterior."""
    truth, runs, rig = released
    ratio = truth.ratios["a/b"].value
    std = 2e-4 * ratio
    posterior = PosteriorComponent(
        probability=1.0,
        ratios={name: value.value for name, value in truth.ratios.items()},
        effects={},
        free=["a/b"],
        covariance=[[std**2]],
        left_out=[[ratio + shift * std] for shift in (10, -10, 10, -10)],
    )
    assert factor_without(truth, [posterior], runs, rig, 0) > 5.0
    right = posterior.model_copy(update={"left_out": [[ratio]] * 4})
    assert factor_without(truth, [right], runs, rig, 0) == 1.0
