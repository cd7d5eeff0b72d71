"""Information of planned releases, compared with exact sensitivities and dense least squares."""

from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.acceptance.limits import Limits
from dpr_lab.dynamics.base import base_parameters
from dpr_lab.effects import effect_params
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.estimate import SCALE
from dpr_lab.fitting.linearise import linearise
from dpr_lab.gap.hypothesis.detectable import SIGMAS
from dpr_lab.identification.expected import Releases, ratio_information
from dpr_lab.planning.information import horizon_s, informed, problem_of_releases, reached_speeds
from dpr_lab.planning.knowledge import Knowledge, known_before, schur_complement
from dpr_lab.planning.limits import PlanLimits
from dpr_lab.planning.release import CandidateRelease
from dpr_lab.planning.stopping import Causes
from dpr_lab.planning.summary import summed_up
from dpr_lab.planning.worth.criteria import OpenPairs, detectable, shown_ratio_std
from dpr_lab.planning.worth.objective import Objective, limit_forecasts
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import AddedMass, Pose

CALM = CandidateRelease(2.2, 2.6, 4.0)


@pytest.fixture(scope="module")
def known(paper: Rig) -> Knowledge:
    return known_before(paper)


def test_information_agrees_with_exact_sensitivities(paper: Rig, known: Knowledge) -> None:
    base = base_parameters(paper.nominal, paper.L1, paper.g)
    exact = ratio_information(base, paper, [Pose(theta1=2.2, theta2=2.6)], Releases(4.0, 0.5))
    (one,) = informed([CALM], known.model)
    ours, theirs = (np.sqrt(np.diag(np.linalg.inv(H))) for H in (one.information[:5, :5], exact))
    assert ours == pytest.approx(theirs, rel=0.1)


def test_shorter_durations_contain_less_information(known: Knowledge) -> None:
    long, short = informed([CALM], known.model, (2.0,))
    assert (long.release.duration_s, short.release.duration_s) == (4.0, 2.0)
    assert np.linalg.eigvalsh(long.information - short.information).min() > -1e-6 * np.trace(long.information)


def test_a_shorter_duration_determines_the_zeros_of_its_encoders_itself(known: Knowledge) -> None:
    rezeroed = replace(known.model, rezeroed=True)
    _, short = informed([CALM], rezeroed, (2.0,))
    (alone,) = informed([replace(CALM, duration_s=2.0)], rezeroed)
    assert short.information == pytest.approx(alone.information, rel=1e-6, abs=1e-6 * np.abs(alone.information).max())


def test_a_limit_of_a_cable_is_forecast_with_its_other_amplitudes_free(known: Knowledge) -> None:
    size = {"stiffness_Nm_per_rad": {"max": 1.0, "unit": "N m/rad"}}
    cogging = {"cos1_Nm": {"max": 1.0, "unit": "N m"}}
    limits = Limits.model_validate({"effects": {"spring_joint2": size, "detent_joint2": cogging}})
    (one,) = informed([CALM], known.model)
    F = known.prior + one.information
    cable, detent = limit_forecasts(known, F, limits)
    alone = detectable(known, F, NORMAL_Q90, ["spring_joint2"])["spring_joint2"]["stiffness_Nm_per_rad"]
    assert cable.decides
    assert cable.reach is not None
    assert alone is not None
    assert cable.reach > alone
    assert not detent.decides
    assert (cable.all_shapes, detent.all_shapes) == (False, True)


def test_amplitudes_without_information_are_not_forecast_despite_rounding(known: Knowledge) -> None:
    """The information of an amplitude that fitted values replace is a rounding error of either sign."""
    size = {"stiffness_Nm_per_rad": {"max": 1.0, "unit": "N m/rad"}}
    limits, places = Limits.model_validate({"effects": {"spring_joint1": size}}), known.places["spring_joint1"]
    F = np.diag(np.diag(known.prior) + 1.0)
    F[np.ix_(places, places)] = 10.0
    F[places, places] = known.prior[places, places] - 1e-9
    (spring,) = limit_forecasts(known, F, limits)
    assert spring.reach is None
    assert not spring.decides


def test_minimum_detectable_sizes_of_a_plan_hold_for_the_assumed_scale(known: Knowledge) -> None:
    """The uncertain b widens the size of a named effect, but does not hide it: the ratio of torque and b is known."""
    name, torque = "coulomb_joint1", "torque_Nm"
    params = effect_params({name: {torque: 1e-3}})
    model = replace(known.model, estimate=known.model.estimate.changed(params=params))
    (one,) = informed([CALM], model)
    named = replace(known, model=model, information=known.prior + one.information, named=frozenset({name}))
    planned = summed_up(Objective.of(named), [], PlanLimits(), 0.0).detectable
    (size,) = (least.before for least in planned if least.effect == name)
    weighed = np.zeros_like(named.information)
    weighed[SCALE, SCALE] = 1e6 * named.information[SCALE, SCALE]
    exact = detectable(named, named.information + weighed, SIGMAS, [name])[name][torque]
    assert size == pytest.approx(exact, rel=0.01)


def test_a_ratio_limit_is_forecast_with_the_common_effects_that_accept_allows_for(known: Knowledge) -> None:
    """A small Coulomb friction or air drag has nearly the same effect on a swing as the viscous friction."""
    (one,) = informed([CALM], known.model)
    F = known.prior + one.information
    ranges = {"c1/b": {"min": 0.0, "max": 1.0, "unit": "1/s"}, "a/b": {"min": 0.0, "max": 9.0, "unit": "1"}}
    forecasts = limit_forecasts(known, F, Limits.model_validate({"ratios": ranges}))
    alone = shown_ratio_std(known, F)
    shares = [(forecast.reach or 0.0) / (NORMAL_Q90 * alone[forecast.quantity]) for forecast in forecasts]
    assert min(shares) >= 1.0
    assert 1.5 < shares[0] < 20.0


def test_a_friction_limit_is_decided_only_if_the_joint_reaches_its_speed(known: Knowledge) -> None:
    (one,) = informed([CALM], known.model)
    reached = reached_speeds([CALM], known.model)
    assert reached.pop("joint0") == 0.0
    F = known.prior + 1e6 * one.information
    for share, decides in ((0.9, True), (1.1, False)):
        joints = {name: {"max": 1.0, "speed_rad_s": share * speed, "unit": "N m"} for name, speed in reached.items()}
        forecasts = limit_forecasts(known, F, Limits.model_validate({"friction": joints}), [CALM])
        assert [limit.decides for limit in forecasts] == [decides] * 2
        slow = [limit.reached_rad_per_s for limit in forecasts]
        assert slow == ([None] * 2 if decides else list(reached.values()))


def test_a_spring_with_a_constant_torque_does_not_hide_the_friction(known: Knowledge) -> None:
    (one,) = informed([CALM], known.model)
    limits = Limits.model_validate({"friction": {"joint1": {"max": 1.0, "speed_rad_s": 1.0, "unit": "N m"}}})
    reaches = [
        limit_forecasts(replace(known, named=frozenset(named)), known.prior + one.information, limits)[0].reach or 0.0
        for named in ((), ("spring_joint1",))
    ]
    assert 0.0 < reaches[1] < 3 * reaches[0]


def test_a_joint_without_a_rod_or_with_a_clamp_has_no_speed(known: Knowledge) -> None:
    alone, clamped = CandidateRelease(2.2, 2.2, 4.0, "inner"), CandidateRelease(2.2, 2.2, 4.0, "clamped")
    assert reached_speeds([alone], known.model)["joint2"] == 0.0
    assert reached_speeds([clamped], known.model)["joint2"] == pytest.approx(0.0, abs=1e-6)
    assert reached_speeds([alone], known.model)["joint1"] > 3.0


def test_a_release_from_near_upright_is_predictable_for_less_long_than_a_calm_one(known: Knowledge) -> None:
    assert horizon_s(CandidateRelease(0.1, 0.1, 6.0), known.model) < 2.0
    assert horizon_s(CandidateRelease(3.0, 3.0, 6.0), known.model) == 6.0


def test_only_a_known_mass_shows_the_scale(known: Knowledge) -> None:
    mass = AddedMass(rod="outer", mass=0.1, position=0.2)
    free, weighed = informed([CALM, CandidateRelease(2.2, 2.6, 4.0, added=mass)], known.model)
    assert schur_complement(free.information + 1e-9 * np.eye(len(free.information)), range(5), [5])[0, 0] < 1e-3
    assert schur_complement(weighed.information, range(5), [5])[0, 0] > 1e3


def test_a_single_rod_has_no_information_about_joint_2(known: Knowledge) -> None:
    (alone,) = informed([CandidateRelease(2.2, 2.2, 4.0, "inner")], known.model)
    (column,) = known.places["coulomb_joint2"]
    assert alone.information[column, column] == pytest.approx(0.0, abs=1e-12)


def test_the_distance_of_two_causes_is_the_residual_of_a_least_squares_fit(known: Knowledge) -> None:
    pairs = _pairs(known)
    (one,) = informed([CALM], known.model)
    F = one.information + 1e-9 * np.eye(len(one.information))
    apart = pairs.distances(F)[0, 1]
    problem, states = problem_of_releases([CALM], known.model)
    at = known.model.estimate.changed(initial=states)
    slopes = problem.slopes(at, known.model.columns)
    A, _ = linearise(problem, at, known.model.columns, problem.measured, slopes).flat
    (signal,), (other,) = (known.places[name] for name in pairs.names)
    change, fitted = A[:, signal] * pairs.sizes[0][0], A[:, [*pairs.fitted, other]]
    fitted = fitted / np.maximum(np.linalg.norm(fitted, axis=0), 1e-30)
    left = change - fitted @ np.linalg.lstsq(fitted, change, rcond=1e-12)[0]
    assert apart == pytest.approx(float(left @ left), rel=1e-2)


def _pairs(known: Knowledge) -> OpenPairs:
    """A small spring at joint 1, or an encoder scale, with no spread."""
    names = ("clock_rate", "encoder_scale_joint1")
    places = tuple(known.places[name] for name in names)
    assert [len(own) for own in places] == [1, 1]
    causes = Causes(names[0], dict.fromkeys(names, 0.5), 0.0)
    open_pairs = OpenPairs.of(known, causes)
    size = np.array([1e-4])
    return OpenPairs(
        names,
        open_pairs.probabilities,
        open_pairs.outside,
        open_pairs.fitted,
        places,
        (size, np.zeros(1)),
        (np.zeros((1, 1)), np.zeros((1, 1))),
    )
