"""Plans: within limits and budget, reproducible by their seed, and useful on simulated rigs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.errors import ConfigError
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.planning.candidates import longest_s, mountings, novelty
from dpr_lab.planning.forecast import FORECAST, decision_probability
from dpr_lab.planning.information import informed, simulated_states
from dpr_lab.planning.knowledge import Acting, known_after, known_before
from dpr_lab.planning.limits import PlanLimits, ReachablePoses, load_plan_limits
from dpr_lab.planning.plan import plan
from dpr_lab.planning.release import CandidateRelease
from dpr_lab.planning.result import Plan
from dpr_lab.planning.signals import driven_releases, write_signal
from dpr_lab.planning.stopping import decided
from dpr_lab.planning.worth.criteria import OpenPairs
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from dpr_lab.shown import percent
from sim_device.plant.config import DriveConfig
from sim_device.plant.drives import load_drives

SHORT = {"recording": {"shortest_s": 5.0, "longest_s": 5.0}}


def limits(**tables: object) -> PlanLimits:
    return PlanLimits.model_validate({**SHORT, **tables})


@pytest.fixture(scope="module")
def first_plan(paper: Rig) -> Plan:
    """Three releases of 5 s, planned without any recording."""
    return plan(paper, limits=limits())


@pytest.mark.slow
def test_a_first_plan_shows_more_than_the_poses_of_the_rig_file(paper: Rig, first_plan: Plan) -> None:
    made = first_plan
    assert made.state == "first"
    assert [one.number for one in made.releases] == [1, 2, 3]
    assert not any(one.text.endswith("arm clamped") for one in made.releases)  # the rig has no arm that moves
    known = known_before(paper)
    poses = [CandidateRelease(pose.theta1, pose.theta2, 5.0) for pose in paper.poses.values()]
    F = known.information + sum(one.information for one in informed(poses, known.model))
    fixed = np.sqrt(np.diag(np.linalg.inv(F[:7, :7])))[:5]
    assert np.mean(np.array(list(made.releases[-1].ratio_std.values())) / fixed) < 1.0
    coulomb = next(one for one in made.detectable if one.effect == "coulomb_joint1")
    assert coulomb.before is None
    assert coulomb.after is not None
    assert coulomb.after < coulomb.typical


@pytest.mark.slow
def test_without_a_budget_recordings_are_long_and_with_one_their_time_counts(paper: Rig) -> None:
    times = PlanLimits.model_validate({"recording": {"shortest_s": 2.0, "longest_s": 8.0}})
    (free,), (paid,) = (plan(paper, limits=times, count=1, budget_min=budget).releases for budget in (None, 5.0))
    assert free.duration_s == 8.0
    assert paid.duration_s < 8.0


@pytest.mark.slow
def test_the_same_seed_gives_the_same_plan(paper: Rig) -> None:
    assert plan(paper, limits=limits(), count=0).releases == []
    first, second = (plan(paper, limits=limits(), count=1, seed=4) for _ in range(2))
    assert first.releases == second.releases


@pytest.mark.long
def test_minutes_in_which_no_further_release_fits_lengthen_the_releases(paper: Rig) -> None:
    made = plan(paper, budget_min=1.8)  # two of at least 0.67 min fit, a third one does not
    assert len(made.releases) == 2
    assert sum(release.duration_s for release in made.releases) == pytest.approx(48.0)
    assert made.minutes == pytest.approx(1.8)


@pytest.mark.slow
@pytest.mark.parametrize(("shortest_s", "budget_min"), [(5.0, 0.6), pytest.param(15.0, 5.0, marks=pytest.mark.long)])
def test_no_release_is_shorter_than_permitted_and_the_shortest_one_uses_a_small_budget(
    paper: Rig, shortest_s: float, budget_min: float
) -> None:
    times = PlanLimits.model_validate({"recording": {"shortest_s": shortest_s, "longest_s": 20.0}})
    (release,) = plan(paper, limits=times, budget_min=budget_min, count=1).releases
    assert release.duration_s >= shortest_s
    assert release.minutes <= budget_min + 1e-9


@pytest.mark.slow
def test_it_keeps_the_budget_and_the_reachable_poses(paper: Rig) -> None:
    reach = limits(poses={"theta1_rad": [2.5, 3.0], "theta2_rad": [2.0, 3.5], "elbow_rad": [-0.5, 0.5]})
    made = plan(paper, limits=reach, budget_min=1.3)
    assert 1 <= len(made.releases) <= 2
    assert made.minutes <= 1.3
    theta = np.array([[one.theta1_rad, one.theta2_rad] for one in made.releases])
    assert reach.poses.reachable(theta).all()


@pytest.mark.parametrize(
    ("times", "alone_s", "later_s"),
    [({}, 19.0, 30.0), ({"longest_s": 15.0}, 15.0, 15.0), ({"shortest_s": 25.0}, 25.0, 30.0)],
)
def test_a_first_release_is_short_enough_to_be_fitted_as_a_whole(
    times: dict[str, float], alone_s: float, later_s: float
) -> None:
    permitted = PlanLimits.model_validate({"recording": times})
    assert [longest_s(permitted, alone=alone) for alone in (True, False)] == [alone_s, later_s]


def test_planned_mountings_follow_the_limits_file(paper: Rig) -> None:
    mass = {"rod": "outer", "mass": 0.1, "position": 0.2}
    allowed = limits(rods={"mounted": ["both", "inner"], "elbow": ["free", "clamped"]}, masses=[mass])
    (added,) = allowed.masses
    expected = [("both", None), ("both", added), ("clamped", None), ("clamped", added), ("inner", None)]
    assert list(mountings(paper, allowed)) == [(*one, True) for one in expected]


@pytest.mark.parametrize(
    ("present", "rods", "expected"),
    [
        (("both", "clamped"), {"mounted": ["both"], "elbow": ["clamped"]}, ("clamped",)),
        (("both", "clamped"), {"elbow": ["free", "clamped"]}, ("clamped", "both")),
        (("both", "clamped"), {"mounted": ["both"]}, ("clamped",)),
        (("inner", "free"), {"mounted": ["both"]}, ("both",)),
        (("inner", "free"), {"mounted": ["both"], "elbow": []}, ("both",)),
        (("inner", "free"), {"mounted": ["both", "inner"], "elbow": ["clamped"]}, ("inner", "clamped")),
        (("both", "free"), {}, ("both",)),
    ],
)
def test_only_permitted_mountings_are_planned(
    paper: Rig, present: tuple[str, str], rods: dict[str, list[str]], expected: tuple[str, ...]
) -> None:
    assert limits(rods=rods).allowed_rods(paper.with_rods(*present)) == expected


def test_the_range_of_an_elbow_may_contain_the_half_turn() -> None:
    reachable = ReachablePoses(elbow_rad=(3.0, 3.3)).reachable(np.array([[0.0, 3.1], [0.0, 3.2], [4.0, 0.9], [0, 3.5]]))
    assert reachable.tolist() == [True, True, True, False]


@pytest.mark.parametrize("highest_hz", [0.2, 0.26, 5.0])
def test_a_signal_has_no_frequency_above_its_limit(paper: Rig, highest_hz: float) -> None:
    allowed = limits(recording={}, drive={"torque_Nm": [0.02, 0.01], "rate_hz": 100, "highest_hz": highest_hz})
    signals = driven_releases(known_before(paper, Acting.of(paper, allowed)).model, allowed, paper)
    assert {one.signal for one in signals} == {"multisine", "chirp"}
    for one in signals:
        assert one.torques is not None
        values = one.torques.joints.sum(axis=1)
        signs = np.sign(values[values != 0.0])
        assert np.count_nonzero(np.diff(signs)) <= 2 * highest_hz * one.duration_s


@pytest.mark.slow
def test_the_outer_rod_alone_is_proposed_where_it_costs_no_more_than_a_release_of_both(paper: Rig) -> None:
    cheap, usual = (
        plan(paper, limits=limits(rods={"mounted": ["both", "outer"]}, minutes={"mount": mount}), count=2)
        for mount in (0.0, 5.0)
    )
    assert "outer" in [release.mounted for release in cheap.releases]
    assert [release.mounted for release in usual.releases] == ["both", "both"]
    stds = np.array([list(one.releases[-1].ratio_std.values()) for one in (cheap, usual)])
    assert np.exp(np.log(stds[0] / stds[1]).mean()) < 0.9  # geometric mean over the five ratios


@pytest.mark.slow
def test_rods_that_a_rig_does_not_have_are_not_planned() -> None:
    furuta = load_rig("furuta")
    assert [one.mounting for one in mountings(furuta, PlanLimits())] == ["inner"]
    made = plan(furuta, count=1)
    assert (made.releases[0].mounted, made.releases[0].arm) == ("inner", "held")
    assert made.releases[0].text.endswith("arm clamped")
    assert set(made.ratio_std) == {"e1/a", "c1/a"}
    assert not [one.effect for one in made.detectable if one.effect.endswith("joint2")]


@pytest.mark.parametrize("rods", ["inner", "outer"])
def test_effects_that_need_two_rods_are_not_planned_for_one(paper: Rig, rods: str) -> None:
    rigs = (paper.with_rods(rods), paper)
    one, both = (known_before(rig, Acting.of(rig, PlanLimits())).places for rig in rigs)
    with_elbow = {name for name in both if EFFECTS[name].joints == (1,)}
    assert set(both) - set(one) - with_elbow == {"air_drag_outer", "wrong_length_L1"}
    assert set(one) <= set(both)
    assert {name: len(one[name]) for name in one} == {name: len(both[name]) for name in one}


def test_a_signal_keeps_speed_and_torque_and_a_device_replays_it(paper: Rig, tmp_path: Path) -> None:
    allowed = limits(drive={"torque_Nm": [0.2, 0.1], "speed_rad_s": [6.0, 8.0], "rate_hz": 100})
    assert allowed.drive is not None
    model = known_before(paper, Acting.of(paper, allowed)).model
    signals = driven_releases(model, allowed, paper)
    assert {one.signal for one in signals} == {"multisine", "chirp"}
    for one in signals:
        assert one.torques is not None
        assert (np.abs(one.torques.joints) <= [0.2, 0.1]).all()
        speeds = simulated_states([one], model)[0][:, 2:]
        assert np.abs(speeds[:, 0]).max() <= 6.0
        assert np.abs(speeds[:, 1] - speeds[:, 0]).max() <= 8.0
    file = tmp_path / "input.csv"
    assert signals[0].torques is not None
    write_signal(signals[0].torques, file, paper)
    replayed = load_drives(file, DriveConfig(), 0)
    np.testing.assert_allclose(replayed.joints, signals[0].torques.joints, atol=1e-8)


def test_a_forecast_grows_with_information_and_with_releases() -> None:
    pairs = OpenPairs(("a", "b"), np.array([0.5, 0.48]), 0.02, (), ((0,), (1,)), (np.ones(1),) * 2, (np.eye(1),) * 2)
    probability = [decision_probability([pairs], [np.full((2, 2), d2)]) for d2 in (0.0, 4.0, 20.0, 200.0)]
    assert probability == sorted(probability)
    assert probability[0] == 0.0
    assert probability[-1] == pytest.approx(0.98 * FORECAST.confirmed, abs=0.01)
    assert decision_probability([], []) == FORECAST.confirmed
    first, weight = FORECAST.confirmed, FORECAST.weight
    assert decision_probability([], [], 2) == pytest.approx(1 - (1 - first) * (1 - first * weight / (weight + 1)))


def test_a_forecast_falls_with_each_release_that_left_the_causes_undecided() -> None:
    """It is the posterior mean of a share with a beta prior."""
    from scipy.stats import beta  # slow to import

    chances = [decision_probability([], [], failed=failed) for failed in range(6)]
    a, b = FORECAST.confirmed * FORECAST.weight, (1 - FORECAST.confirmed) * FORECAST.weight
    assert chances == pytest.approx([float(beta(a, b + failed).mean()) for failed in range(6)])
    two = float(beta(a, b + 3).expect(lambda share: 1 - (1 - share) ** 2))
    assert decision_probability([], [], 2, failed=3) == pytest.approx(two, rel=1e-6)


def test_causes_that_no_release_separates_count_as_one_in_a_forecast() -> None:
    names, p = ("a", "b", "c"), np.array([0.5, 0.45, 0.03])
    pairs = OpenPairs(names, p, 0.02, (), ((0,), (1,), (2,)), (np.ones(1),) * 3, (np.eye(1),) * 3)
    d2 = np.array([[0.0, 0.0, 200.0], [0.0, 0.0, 200.0], [200.0, 200.0, 0.0]])  # no release separates a from b
    assert decision_probability([pairs], [d2]) < 0.05
    for probabilities in (p, p[::-1]):  # also if the most probable cause is not one of them
        same = replace(pairs, probabilities=probabilities)
        together = decision_probability([same], [d2], inseparable=[d2 == 0.0])
        assert together == pytest.approx(0.98 * FORECAST.confirmed, abs=0.01)


def test_a_forecast_is_the_share_of_draws_in_which_one_cause_is_sure() -> None:
    p, d2, rng = np.array([0.6, 0.4]), 8.0, np.random.default_rng(3)
    pairs = OpenPairs(("a", "b"), p, 0.0, (), ((0,), (1,)), (np.ones(1),) * 2, (np.eye(1),) * 2)
    truth = rng.random(200_000) < p[0]
    mean = np.where(truth, d2 / 2, -d2 / 2)
    log_odds = np.log(p[0] / p[1]) + mean + np.sqrt(d2) * rng.standard_normal(len(truth))
    share = np.mean(np.abs(log_odds) >= np.log(0.95 / 0.05))
    assert decision_probability([pairs], [np.full((2, 2), d2)]) == pytest.approx(FORECAST.confirmed * share, abs=0.02)
    halved = replace(pairs, outside=0.5)  # the cause is outside the library with a probability of 0.5
    made = decision_probability([halved], [np.full((2, 2), d2)])
    assert made == pytest.approx(0.5 * FORECAST.confirmed * share, abs=0.01)


@pytest.mark.slow
def test_a_repeated_release_is_worth_less_and_a_plan_does_not_repeat_itself(first_plan: Plan) -> None:
    release, turned = CandidateRelease(0.3, 0.4, 5.0), CandidateRelease(0.3 + 2 * np.pi, 0.4, 5.0)
    assert novelty(release, ()) == 1.0
    assert novelty(turned, [release]) == pytest.approx(0.5)
    assert novelty(replace(release, theta1=1.8), [release]) > 0.99
    assert novelty(replace(release, mounting="inner"), [release]) == 1.0
    poses = np.array([[one.theta1_rad, one.theta2_rad] for one in first_plan.releases])
    apart = (poses[:, None] - poses + np.pi) % (2 * np.pi) - np.pi
    assert np.linalg.norm(apart, axis=2)[np.triu_indices(3, 1)].min() > 0.5


@pytest.mark.slow
def test_each_release_states_the_information_that_it_adds(first_plan: Plan) -> None:
    first, second, third = first_plan.releases
    assert first.reason.startswith("distinguishes 9")
    assert first.reason.endswith("% of the effects of the library")
    assert second.reason.startswith("verifies the result of the first release with another swing")
    shares = np.array([third.ratio_std[name] / std for name, std in second.ratio_std.items()])
    assert (
        third.reason
        == f"reduces the standard deviations of the ratios by a further {percent(1 - np.exp(np.log(shares).mean()))}"
    )


@pytest.mark.slow
def test_once_the_causes_are_decided_nothing_is_planned_without_a_budget(
    two_runs: list[Run], two_found: Diagnosis, paper: Rig
) -> None:
    settled = two_found.model_copy(update={"verdict": "no_gap", "effects": [], "rivals": [], "hints": []})
    made = plan(paper, two_runs, settled, limits=limits())
    assert (made.state, made.releases, made.minutes) == ("enough", [], 0.0)
    assert len(plan(paper, two_runs, settled, limits=limits(), count=1).releases) == 1
    for largest, releases in ((5.0, 0), (1e-3, 0), (settled.stated_ratios["c2/b"].value, 3)):  # met, violated, open
        bounded = plan(paper, two_runs, settled, limits=limits(ratios={"c2/b": {"max": largest, "unit": "1/s"}}))
        assert len(bounded.releases) == releases
        assert ("Not decided by these recordings: the limits of c2/b." in bounded.sentence) is bool(releases)


@pytest.mark.slow
def test_a_plan_after_runs_lists_the_undecided_causes(two_runs: list[Run], two_found: Diagnosis, paper: Rig) -> None:
    made = plan(paper, two_runs, two_found, limits=limits(), count=1)
    known = known_after(two_runs, paper, two_found)
    named = {effect.name for effect in two_found.effects}
    assert {causes.about for causes in known.causes} == named
    assert {pair.causes[0] for pair in made.releases[0].pairs} <= {n for e in two_found.effects for n in e.members}
    assert made.state == ("enough" if decided(two_found) else made.state)
    for name, std in made.releases[0].ratio_std.items():
        assert 0 < std < made.ratio_std[name]
    now = np.sqrt(np.diag(np.array(two_found.ratio_covariance)))
    ratio = np.array(list(made.ratio_std.values())) / now
    assert (ratio > 0.3).all()
    assert (ratio < 3.0).all()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[poses]\ntheta1_rad = [3.0, 2.0]", "reversed or empty"),
        (
            "[poses]\ntheta1_rad = [0.0, 0.1]\ntheta2_rad = [3.0, 3.1]\nelbow_rad = [-0.1, 0.1]",
            "no pose is inside the limits",
        ),
        ("[poses]\ntheta1_rad = [90, 170]", "angles are in rad; as degrees these would be [1.57, 2.97]"),
        ('[rods]\nelbow = ["clamped"]', "rods.elbow: does not contain free, the elbow of rig paper: add it"),
        ("[rods]\nelbow = []", "rods.elbow: does not contain free"),
        ("[poses]\ntheta3_rad = [0.0, 1.0]", "unknown key; available: elbow_rad, theta1_rad, theta2_rad"),
        ("[recrding]\nlongest_s = 20.0", "recrding: unknown key; nearest of 11: recording"),
        (
            '[effects.coulomb_joint2]\ntorque_Nm = {mx = 1.0, unit = "N m"}',
            "mx = 1.0: unknown key; available: max, unit",
        ),
        ("[drive]\ntorque_Nm = 0.1", "drive.torque_Nm = 0.1: must be a list in square brackets"),
        ("[recording]\nlongest_s = 5.0", "shortest_s = 10 (default) is above longest_s = 5: give"),
        ("[recording]\nshortest_s = 9.0\nlongest_s = 5.0", "shortest_s = 9 is above longest_s = 5: give"),
        ('[rods]\nmounted = ["inner"]', "does not contain both"),
        ('[[masses]]\nrod = "outer"\nmass = 0.1\nposition = 0.9', "is 0.4 m long"),
        (
            '[[masses]]\nrod = "outer"\nmass = 100\nposition = 0.2',
            "mass = 100: masses are in kg, and the rods of rig paper",
        ),
        ("[drive]\ntorque_Nm = [0.1]", "drive.torque_Nm, entry 2"),
        ("[drive]\ntorque_Nm = [0.1, -0.1]", "drive.torque_Nm, entry 2 = -0.1"),
        ('[effects.coulomb_jont2]\ntorque_Nm = {max = 1.0, unit = "N m"}', "coulomb_joint2"),
        ("[minutes]\nplace = nan", "minutes.place"),
        (
            '[friction.joint3]\nmax = 1.0\nspeed_rad_s = 1.0\nunit = "N m"',
            "friction.joint3: must be 'joint0', 'joint1' or 'joint2'",
        ),
        ("[poses", "not valid TOML"),
    ],
)
def test_wrong_limits_are_refused_with_key_and_value(paper: Rig, tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "limits.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as refused:
        load_plan_limits(path, paper)
    assert str(path) in str(refused.value)
    assert words in str(refused.value)


@pytest.mark.slow
def test_a_latch_with_a_single_pose_is_planned(paper: Rig, tmp_path: Path) -> None:
    path = tmp_path / "limits.toml"
    path.write_text("[poses]\ntheta1_rad = [1.6, 1.6001]\ntheta2_rad = [1.0, 1.0001]\n[recording]\nlongest_s = 10.0")
    (release,) = plan(paper, limits=load_plan_limits(path, paper), count=1).releases
    assert (release.theta1_rad, release.theta2_rad) == (pytest.approx(1.6, abs=1e-3), pytest.approx(1.0, abs=1e-3))


def test_a_bob_of_fifteen_times_the_mass_of_the_rods_is_allowed(paper: Rig, tmp_path: Path) -> None:
    path = tmp_path / "limits.toml"
    heavy = 15 * float(paper.nominal[:2].sum())
    path.write_text(f'[[masses]]\nrod = "outer"\nmass = {heavy}\nposition = 0.2\n')
    assert load_plan_limits(path, paper).masses[0].mass == heavy


def test_a_budget_for_less_than_one_release_is_refused(paper: Rig) -> None:
    with pytest.raises(ConfigError, match=r"a budget of 0\.2 min is too small: one release takes 0\.67 min"):
        plan(paper, budget_min=0.2)


def test_drives_that_can_do_nothing_are_refused(paper: Rig) -> None:
    still = limits(drive={"torque_Nm": [0.2, 0.1], "speed_rad_s": [1e-6, 1e-6]})
    with pytest.raises(ConfigError, match="no signal stays within speed_rad_s"):
        plan(paper, limits=still)


@pytest.mark.slow
def test_limits_that_the_rig_must_keep_are_forecast(paper: Rig) -> None:
    def amplitude(size: float) -> dict[str, object]:
        return {"torque_Nm": {"max": size, "unit": "N m"}}

    kept = limits(effects={"coulomb_joint1": amplitude(1e-3), "coulomb_joint2": amplitude(1e-9)})
    first, second = plan(paper, limits=kept, count=1).limits
    assert first.decides
    assert not second.decides
