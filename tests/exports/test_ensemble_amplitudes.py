"""Amplitudes of swings, and recordings beyond those of the fitted ones."""

import numpy as np
import pytest

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.effects import effect_params
from dpr_lab.exports.ensemble.amplitudes import FittedAmplitudes, amplitudes, beyond_fitted, fitted_amplitudes
from dpr_lab.exports.ensemble.bands import PredictiveBand
from dpr_lab.fitting.estimate import Estimate, unknown_ratios
from dpr_lab.rig import load_rig
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record
from sim_device.trials.parameters import weighed
from tests.exports.test_export_command import whole_model


def test_amplitudes_outside_by_more_than_the_tolerance_are_beyond() -> None:
    assert FittedAmplitudes(0.2, 1.0).beyond(np.array([0.1, 0.195, 0.5, 1.04, 1.06])) == pytest.approx(0.4)


def test_no_recording_has_no_amplitudes() -> None:
    rig = load_rig("paper")
    model = whole_model(
        rig,
        Estimate.of(unknown_ratios(base_parameters(rig.nominal, rig.L1, rig.g)), effect_params({}), np.zeros((1, 4))),
    )
    assert fitted_amplitudes(model, [], rig) is None


@pytest.mark.slow
def test_straight_rods_at_rest_have_the_amplitude_of_their_release() -> None:
    """The swing decays from there; a release from twice the angle is beyond it."""
    plant, rig = weighed(load_plant("paper", 5), load_rig("paper"))
    given = rig.model_dump(exclude_none=True)
    given["poses"] = {f"at {angle}": {"theta1": np.pi - angle, "theta2": np.pi - angle} for angle in (0.8, 1.6)}
    rig = type(rig).model_validate(given)
    small, large = record(plant, rig, duration=2.0)
    estimate = Estimate.of(unknown_ratios(base_parameters(plant.Z, rig.L1, rig.g)), effect_params({}), np.zeros((1, 4)))
    model = whole_model(rig, estimate).model_copy(update={"effects": {}})
    begins, angles = amplitudes(model, small, rig)
    assert angles[0] == pytest.approx(0.8, abs=0.05)
    assert np.all(np.diff(angles) < 0)
    fitted = fitted_amplitudes(model, [small], rig)
    assert fitted is not None
    assert fitted.high == pytest.approx(angles[0])
    none = np.zeros((0, 2))
    bands = [PredictiveBand(run.name, 2.0, begins, none, none, none) for run in (small, large)]
    shares = [beyond_fitted(fitted, band, model, run, rig) for band, run in zip(bands, (small, large), strict=True)]
    assert shares == [0.0, 1.0]
