"""Recordings with a wrong interpretation are refused with the cause; correct but noisy recordings are accepted."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.errors import IdentificationError
from dpr_lab.estimation.arm_motion import arm_motion
from dpr_lab.fitting.gauss_newton import StopReason
from dpr_lab.identification.identify import identify
from dpr_lab.identification.misread import tried
from dpr_lab.identification.misread.energy import energy_remedy, energy_rise
from dpr_lab.identification.misread.readings import HELD_BY_SPRING, listed_causes, readings
from dpr_lab.identification.misread.refuse import refuse_impossible_scale, refuse_misread
from dpr_lab.identification.misread.tried import check_description, fitted, impossible
from dpr_lab.identification.preprocess import preprocess
from dpr_lab.identification.ratio_fit import first_fit, short_fit
from dpr_lab.rig import Rig
from dpr_lab.run import FilmNoise, Run
from sim_device.plant.config import ArmConfig, load_plant
from sim_device.trials.driven import driven_runs
from sim_device.trials.offline_recorder import record
from tests.thinned import FULL, thinned

PI = np.pi


@pytest.fixture(scope="module")
def swings(paper: Rig) -> list[Run]:
    """One release, because the time is proportional to the number of releases."""
    return record(load_plant("paper", 1), paper, 1.5, 250)[:1]


def read_as(runs: list[Run], angles: Callable) -> list[Run]:
    """Runs as given by another interpretation of the same table."""
    made = []
    for run in runs:
        inner, outer = angles(run.theta[:, 1], run.theta[:, 2])
        made.append(replace(run, theta=np.column_stack([run.theta[:, 0], inner, outer]), counts=None))
    return made


def test_correctly_interpreted_recordings_pass(swings, paper: Rig) -> None:
    refuse_misread(swings, paper)
    refuse_misread(read_as(swings, lambda a, b: (-a, -b)), paper)  # the same rig seen from behind


def test_friction_that_the_bare_model_lacks_passes(recorded, paper: Rig) -> None:
    refuse_misread(
        recorded({"coulomb_joint1": {"torque_Nm": 0.03}, "coulomb_joint2": {"torque_Nm": 0.01}}, duration=2.0), paper
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("angles", "message"),
    [
        pytest.param(lambda a, b: (a - PI, b - PI), "zero of the angles", marks=pytest.mark.long),
        pytest.param(lambda a, b: (2 * PI - a, b), "one rod's sign", marks=pytest.mark.long),
        pytest.param(lambda a, b: (a, 2 * PI - b), "one rod's sign", marks=pytest.mark.long),
        pytest.param(lambda a, b: (a, 2 * a - b), "sign of joint 2", marks=pytest.mark.long),
        pytest.param(lambda a, b: (a, b + PI), "zero of joint 2", marks=pytest.mark.long),
        (lambda a, b: (b, a), "swapped"),
        pytest.param(lambda a, b: (b - a + PI, b), "swapped", marks=pytest.mark.long),  # relative angles
        pytest.param(lambda a, b: (a, b - a + PI), "--angles relative", marks=pytest.mark.long),
        pytest.param(lambda a, b: (a, b + a - PI), "--angles absolute", marks=pytest.mark.long),
        pytest.param(lambda a, b: (a - PI, b - a), "--zero hanging --angles relative"),
        pytest.param(lambda a, b: (a + PI, a + b + PI), "--zero upright --angles absolute", marks=pytest.mark.long),
        pytest.param(lambda a, b: (np.degrees(a), np.degrees(b)), "--unit deg", marks=pytest.mark.long),
        pytest.param(
            lambda a, b: (PI + np.degrees(a - PI), PI + np.degrees(b - PI)), "--unit deg", marks=pytest.mark.long
        ),
        pytest.param(
            lambda a, b: (PI + np.radians(a - PI), PI + np.radians(b - PI)), "--unit rad", marks=pytest.mark.long
        ),
    ],
)
@pytest.mark.filterwarnings("error")
def test_a_wrong_interpretation_is_refused_with_its_cause(
    swings, paper: Rig, angles: Callable, message: str, few_readings
) -> None:
    few_readings(message)
    with pytest.raises(IdentificationError, match=message):
        refuse_misread(read_as(swings, angles), paper)


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_identify_reports_a_wrong_interpretation_before_the_search(swings, paper: Rig, few_readings) -> None:
    few_readings("zero of the angles")
    with pytest.raises(IdentificationError, match=r"zero of the angles.*other --zero"):
        identify(read_as(swings, lambda a, b: (a - PI, b - PI)), paper)


@pytest.mark.long
def test_a_length_in_another_unit_is_refused(swings, paper: Rig) -> None:
    millimetres = paper.model_copy(update={"rig": paper.rig.model_copy(update={"L1": 400.0})})
    with pytest.raises(IdentificationError, match=r"L1 and g in the rig file.* a motor, a hand or a stop"):
        refuse_misread(swings, millimetres)


def in_time(run: Run, factor: float) -> Run:
    return replace(run, t=run.t * factor, rate_hz=run.rate_hz / factor)


@pytest.fixture(scope="module")
def driven(paper: Rig) -> list[Run]:
    return driven_runs(paper, 0, duration=2.0)[1][:1]


@pytest.fixture(scope="module")
def on_a_moving_arm(paper: Rig) -> list[Run]:
    arm = {"arm": ArmConfig(mode="free", J0=0.05, c0=0.02, k0=1.0)}
    return record(load_plant("paper", 5).model_copy(update=arm), paper, 3.0, 250)[1:2]


def test_driven_runs_with_their_torques_pass(driven, paper: Rig) -> None:
    refuse_misread(driven, paper)


def test_the_torques_of_a_thinned_run_have_the_same_impulse(driven, paper: Rig) -> None:
    every, fourth = (preprocess(driven[0], paper, count).run for count in (1, 4))
    assert len(fourth.t) == -(-len(every.t) // 4)
    impulses = []
    for run in (every, fourth):
        assert run.setup.torques is not None
        t, impulse = run.setup.torques.knots
        impulses.append(np.diff([np.interp(fourth.t, t, column) for column in impulse.T]))
    assert impulses[1] == pytest.approx(impulses[0], abs=1e-12)


def test_thinned_samples_of_continuous_torques_keep_their_values(driven, paper: Rig) -> None:
    every, fourth = (preprocess(replace(driven[0], continuous=True), paper, count).run for count in (1, 4))
    np.testing.assert_array_equal(fourth.torques, every.torques[::4])


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    thinned(
        [
            ((2.0, 2.0), "both joints turn by 0.5 times .* 32768 for joint 1 and 32768 for joint 2"),
            ((0.5, 0.5), "both joints turn by 2 times .* 8192 for joint 1"),
            ((2.0, 1.0), "joint 1 turns by 0.5 times .* 32768 for joint 1"),
            ((1.0, 0.5), "joint 2 turns by 2 times .* 8192 for joint 2"),
        ],
        each=4,
    ),
)
def test_a_wrong_counts_per_rev_is_named_with_its_value(swings, paper: Rig, case, few_readings) -> None:
    scales, cause = case
    few_readings("turns? by")

    def read(inner: np.ndarray, outer: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        first = PI + scales[0] * (inner - PI)
        return first, first + scales[1] * (outer - inner)

    with pytest.raises(IdentificationError, match=cause):
        refuse_misread(read_as(swings, read), paper)


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    thinned(
        [
            ((1, -1), "sign of torque 2.* reverse the sign of the drive"),
            ((-1, 1), "sign of torque 1.* reverse the sign of the drive"),
            ((-1, -1), "signs of both torques.* reverse the signs of the angles"),
        ],
        each=3,
    ),
)
def test_a_reversed_torque_is_named(driven, paper: Rig, case, few_readings) -> None:
    signs, cause = case
    few_readings("torque")
    reversed_ = [replace(run, torques=run.torques * signs, commanded=None) for run in driven]
    with pytest.raises(IdentificationError, match=cause):
        refuse_misread(reversed_, paper)


@pytest.mark.slow
@pytest.mark.parametrize(("unit", "to_Nm"), [("mN m", "0.001"), pytest.param("kN m", "1000", marks=pytest.mark.long)])
def test_torques_in_another_unit_are_named(driven, paper: Rig, unit: str, to_Nm: str, few_readings) -> None:
    few_readings("torque")
    in_unit = [replace(run, torques=run.torques / float(to_Nm), commanded=None) for run in driven]
    with pytest.raises(
        IdentificationError, match=re.escape(f"in {unit} (import with --scale tau1={to_Nm},tau2={to_Nm})")
    ):
        refuse_misread(in_unit, paper)


@pytest.mark.slow
@pytest.mark.parametrize("case", thinned([(25.0, 65.0), (0.0, 90.0), (0.0, -37.0)], each=3))
def test_wrong_zeros_are_named_with_their_offset(swings, paper: Rig, case: tuple[float, float], few_readings) -> None:
    inner, outer = case
    few_readings("zero")
    moved = read_as(swings, lambda a, b: (a + np.radians(inner), b + np.radians(outer)))
    with pytest.raises(IdentificationError, match="the angles have other zeros") as refused:
        refuse_misread(moved, paper)
    stated = re.search(r"theta1=(\S+),theta2=(\S+), in degrees", str(refused.value))
    assert stated is not None
    np.testing.assert_allclose([float(stated[1]), float(stated[2])], [-inner, -outer], atol=0.3)


@pytest.mark.slow
def test_an_arm_that_moves_but_is_given_as_clamped_is_named(on_a_moving_arm, paper: Rig, few_readings) -> None:
    few_readings("the arm moves")
    with pytest.raises(IdentificationError, match=r"the arm moves .*--arm prescribed"):
        refuse_misread(on_a_moving_arm, paper)


def test_a_moving_arm_is_estimated_at_the_rate_of_the_fits(swings, paper: Rig) -> None:
    run = in_time(swings[0].swing, 0.25)  # at 1 kHz
    readings_of_arm = 0.3 * np.sin(20.0 * run.t) + 1e-4 * np.random.default_rng(0).normal(size=len(run.t))
    run = replace(run, theta=np.column_stack([readings_of_arm, run.theta[:, 1:]]))
    (moving,) = (reading for reading in readings(paper) if reading.arm)
    read = moving.read(run)
    assert read is not None
    assert read.arm is not None
    assert len(read.arm.t) == pytest.approx(len(run.t) / 4, abs=1)
    error = (read.arm.omega - 6.0 * np.cos(20.0 * read.arm.t))[5:-5]
    assert np.sqrt(np.mean(error**2)) < 0.05


@pytest.mark.long
def test_rods_that_turn_against_the_arm_are_named(paper: Rig) -> None:
    plant = load_plant("paper", 5).model_copy(update={"arm": ArmConfig(mode="free", J0=0.05, c0=0.02, k0=1.0)})
    turned = [replace(run, theta=run.theta * [-1.0, 1.0, 1.0]) for run in record(plant, paper, 3.0, 250)[:1]]
    prescribed = [replace(run, arm=arm_motion(run.t, run.theta[:, 0], run.name), counts=None) for run in turned]
    with pytest.raises(IdentificationError, match=r"in the opposite direction to the arm .*--scale theta0=-1"):
        refuse_misread(prescribed, paper)


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "milliseconds .*--time-unit ms"), (1e-3, "--time-unit s")])
def test_times_in_another_unit_are_named(swings, paper: Rig, factor: float, unit: str) -> None:
    with pytest.raises(IdentificationError, match=unit):
        refuse_misread([in_time(run.swing, factor) for run in swings], paper)


@pytest.mark.slow
def test_energy_from_an_undescribed_source_is_named(swings, driven, on_a_moving_arm, paper: Rig) -> None:
    without_torques = [replace(run, torques=None, commanded=None, torque_kind="") for run in driven]
    hidden = [replace(run, theta=run.theta * [0.0, 1.0, 1.0], counts=None) for run in on_a_moving_arm]
    for runs in (without_torques, hidden) if FULL else (hidden,):
        sentence = check_description(runs, paper).sentence
        assert "--torque none" in sentence
        assert ("--arm prescribed" in sentence) is (runs is hidden)
    assert check_description(swings, paper).sentence == ""


def test_an_abandoned_fit_would_not_have_improved(swings, paper: Rig) -> None:
    read = [replace(run, theta=run.theta * [1.0, 1.0, -1.0], counts=None) for run in swings]
    whole = fitted(read, paper, quick=True)
    assert whole is not None
    given_up = fitted(read, paper, quick=True, worst=0.05 * whole.chi2_per_dof)
    assert given_up is not None
    assert 0.05 < given_up.chi2_per_dof / whole.chi2_per_dof < 1.1
    assert given_up.longest_s < 0.6 * whole.longest_s
    assert fitted(read, paper, quick=True, worst=20.0) is None  # after a part of the first run
    assert whole.chi2_per_dof > 20.0


def test_a_fit_that_cannot_reach_its_limit_ends_early(swings, paper: Rig) -> None:
    read = [preprocess(replace(run, theta=run.theta * [1.0, 1.0, -1.0], counts=None), paper) for run in swings]
    whole, early = (
        first_fit(paper.nominal, read, paper, iterations=20, settings=tried._ending_early(limit))
        for limit in (np.inf, 1.0)
    )
    assert early.fit.stop is StopReason.PRELIMINARY
    assert early.fit.iterations < whole.fit.iterations
    assert whole.chi2_per_dof > 1.0  # without an early end, the fit does not reach the limit either
    assert (
        short_fit(paper.nominal, read, paper, settings=tried._ending_early(1.0), worst=1.0).segments == early.segments
    )


def test_a_part_of_a_run_is_rejected_without_a_fit_to_its_minimum(swings, paper: Rig, monkeypatch) -> None:
    fits = []

    def stored(*args, **options):
        fits.append(first_fit(*args, **options))
        return fits[-1]

    monkeypatch.setattr(tried, "first_fit", stored)
    read = [replace(run, theta=run.theta * [1.0, 1.0, -1.0], counts=None) for run in swings]
    assert fitted(read, paper, quick=True, worst=20.0) is None
    assert fits[0].fit.stop is StopReason.BEATEN


def test_the_right_reading_is_fitted_to_the_whole_runs(swings, paper: Rig) -> None:
    whole = fitted(swings, paper, quick=True)
    assert whole is not None
    limited = fitted(swings, paper, quick=True, worst=whole.chi2_per_dof)
    assert limited is not None
    assert limited.chi2_per_dof == whole.chi2_per_dof


def test_passive_rods_and_known_torques_let_no_energy_in(swings, driven, paper: Rig) -> None:
    for runs in (swings, driven[:1]):
        assert energy_rise([preprocess(run, paper) for run in runs], paper) < 0.05


def test_the_remedy_of_an_energy_rise_is_the_one_of_this_rig(swings, driven, paper: Rig) -> None:
    (swing,) = swings
    still = np.zeros(len(swing.t))
    turning = np.column_stack([0.1 * np.sin(swing.t), swing.theta[:, 1:]])
    geared = paper.model_copy(update={"joints": paper.joints.model_copy(update={"geared": (2,)})})
    table = replace(swing, counts=None, arm_read=False, theta=np.column_stack([still, swing.theta[:, 1:]]))
    cases = (
        (driven[0], paper, "known torques"),
        (swing, geared, "motor at joint 2"),
        (replace(swing, theta=turning), paper, "--arm prescribed"),
        (swing, paper, "counts_per_rev"),
        (table, paper, "unit and scale of the angles"),
    )
    texts = [energy_remedy([run], rig) for run, rig, _ in cases]
    for text, (_, _, own) in zip(texts, cases, strict=True):
        assert own in text
    assert len(set(texts)) == len(cases)
    assert "theta0" in texts[-1]  # its arm was not read, so it may have moved
    standing = np.column_stack([1e-6 * np.cos(np.arange(len(still))), swing.theta[:, 1:]])
    assert "theta0" not in energy_remedy([replace(table, arm_read=True, theta=standing)], paper)


def test_ratios_of_positive_masses_are_possible_and_others_not(paper: Rig, rng: np.random.Generator) -> None:
    from dpr_lab.dynamics.base import base_parameters, ratios

    for _ in range(200):
        Z = np.exp(rng.uniform(np.log(1e-3), 0.0, 9)) * [paper.L1, 1, 1, 1, 1, 1e-3, 1e-3, 1e-2, 1e-2]
        assert impossible(np.asarray(ratios(base_parameters(Z, paper.L1, paper.g))), paper) == ""
    for wrong in ([-1.0, 1, 100, 0, 0], [2, 1.6, 100, 0, 0], [10, 1.6, 20, 0, 0], [np.nan, 1, 1, 1, 1]):
        assert impossible(np.array(wrong, dtype=float), paper) != ""


def test_a_slow_swing_that_nothing_explains_is_fitted_again_at_faster_times_only(
    swings, paper: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    factors: list[float] = []

    def nothing_fits(runs: list[Run], rig: Rig, *, time_factor: float = 1.0, **settings: object) -> None:
        factors.append(time_factor)

    monkeypatch.setattr(tried, "fitted", nothing_fits)
    slow = replace(swings[0], t=4 * swings[0].t, rate_hz=swings[0].rate_hz / 4)
    assert not check_description([slow], paper).tried
    assert factors[-3:] == [1 / 2, 1 / 4, 1 / 8]
    assert factors.count(1 / 8) == 2
    assert factors.count(8.0) == 1


def test_angles_from_points_in_a_film_need_no_scale_factor(swings, paper: Rig) -> None:
    film = replace(swings[0], film_noise=FilmNoise((1e-3, 1e-3), 0.0))
    scaled = [reading for reading in readings(paper) if "times the reading" in reading.cause]
    assert scaled
    assert all(reading.read(film) is None for reading in scaled)


def test_readings_larger_than_the_angles_are_named_if_a_spring_replaces_gravity(swings, paper: Rig) -> None:
    unknown = np.array([4.0, 1.5, -28.0, 0.5, 0.06, 1e-3, 3.0])
    with pytest.raises(IdentificationError, match=r"e1/b = -28.*The readings are then larger than the angles.*--scale"):
        refuse_impossible_scale(unknown, swings, paper, ("spring_joint1",))


def test_a_spring_is_a_cause_of_readings_that_seem_too_large_only_below_upright(paper: Rig):
    t = np.arange(0.0, 5.0, 0.01)
    swung = [np.pi + amplitude * np.cos(6.0 * t) for amplitude in (1.0, 40.0)]
    small, large = (
        Run("cosine", t, np.column_stack([0 * t, theta, theta]), None, None, paper.name, "", 100.0, mounting="inner")
        for theta in swung
    )
    smaller = [reading for reading in readings(paper) if reading.smaller]
    assert any("in degrees" in reading.cause for reading in smaller)
    assert all(np.ptp(reading.read(small).theta[:, 1]) < 2.0 for reading in smaller if reading.read(small))
    assert listed_causes(smaller, [small]).endswith(HELD_BY_SPRING)
    assert HELD_BY_SPRING not in listed_causes(smaller, [large])
    assert HELD_BY_SPRING not in listed_causes([r for r in readings(paper) if not r.smaller], [small])
