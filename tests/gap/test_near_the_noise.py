"""A gap just above the noise has the same cause as just below it, and its reduction is uncertain."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.conclusion.verdict import VERDICT, shows_reduction
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.residuals import ResidualStatistics
from dpr_lab.gap.hypothesis.significance import accepted
from dpr_lab.gap.result.saved import Interval
from dpr_lab.gap.transfer.outcome import Transfer
from dpr_lab.gap.which.sizes import impossible_together
from dpr_lab.rig import load_rig
from sim_device.plant.config import load_plant
from sim_device.trials.draw import draw_plant
from sim_device.trials.offline_recorder import record
from sim_device.trials.parameters import weighed
from sim_device.trials.request import parse_request

READINGS = 16_000
SPRING = "spring_joint2"


def fitted(above: float, effects: tuple[str, ...] = (), parameters: int = 5) -> Hypothesis:
    """A set whose residual is some standard deviations above the noise."""
    chi2 = READINGS + above * READINGS**0.5
    residuals = ResidualStatistics(chi2, READINGS, level=1.0, autocorrelation=0.0)
    linear = SimpleNamespace(chi2_by_segment=np.array([chi2]))
    fit = cast(Any, SimpleNamespace(free=(None,) * parameters, chi2=chi2, linear=linear))
    return Hypothesis(effects, fit, residuals, chi2, {})


@pytest.mark.parametrize("above", [3.9, 4.1, 4.9])
def test_a_significant_effect_that_leaves_only_noise_is_accepted_on_both_sides_of_the_noise_floor(above: float) -> None:
    bare, scale = fitted(above), fitted(above - 3.0, ("encoder_scale_joint1",), 6)
    assert scale.at_noise_floor
    assert accepted(bare, bare, scale)


def test_a_significant_effect_that_leaves_nearly_all_of_a_residual_is_not_accepted() -> None:
    bare, scale = fitted(30.0), fitted(29.0, ("encoder_scale_joint1",), 6)
    assert not accepted(bare, bare, scale)


@pytest.mark.parametrize(
    ("gap", "estimate", "upper", "shown"),
    [
        (0.2, 0.43, 1.0, True),  # 0.2 of the noise: the interval decides
        (0.2, 0.43, VERDICT.closes - 0.01, False),
        (0.2, -0.1, 1.0, False),  # no reduction at all
        (0.0, 0.0, 1.0, True),  # the noise hides the whole gap: the test of each effect decides
        (3.0, 0.43, 1.0, False),  # far above the noise the estimate decides
        (3.0, 0.6, 0.7, True),
    ],
)
def test_the_interval_of_a_share_decides_for_a_gap_below_the_noise(
    gap: float, estimate: float, upper: float, shown: bool
) -> None:
    closed = Interval(value=estimate, interval90=(-1.0, upper))
    transferred = Transfer("releases left out", True, closed, gap, (), {}, {}, {}, (), (), (), None)
    assert shows_reduction(transferred) is shown


@pytest.mark.long
def test_a_spring_whose_stiffness_is_lost_in_the_noise_is_possible() -> None:
    """With the stiffness of the fit, 0, its constant and its hardening term contradict each other."""
    base, rig = weighed(load_plant("paper", 997003), load_rig("paper"))
    wanted = parse_request(f"single:subtle:{SPRING}")
    diagnosis = diagnose(record(draw_plant(wanted, base, rig), rig, 6.0), rig, library={SPRING: EFFECTS[SPRING]})
    assert (diagnosis.verdict, [effect.name for effect in diagnosis.effects]) == ("named", [SPRING])


@pytest.mark.parametrize(("error", "impossible"), [(0.5e-4, True), (2e-4, False)])
def test_sizes_are_impossible_together_only_beyond_their_errors(error: float, impossible: bool) -> None:
    sizes = {"stiffness_Nm_per_rad": 0.0, "cubic_Nm_per_rad3": 1e-5, "constant_Nm": 1e-4}
    errors = {"cubic_Nm_per_rad3": 1e-6, "constant_Nm": error}
    assert impossible_together(EFFECTS[SPRING], sizes, errors) is impossible
    assert not impossible_together(EFFECTS[SPRING], sizes, errors | {"stiffness_Nm_per_rad": 1e-2})
