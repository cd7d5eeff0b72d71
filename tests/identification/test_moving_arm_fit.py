"""Rigs with a free or driven arm, simulated by MuJoCo, are identified: values, intervals, Cramer-Rao bound."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from dpr_lab.dynamics.arm import ArmParameters, mounted
from dpr_lab.dynamics.moving_arm.followed import FOLLOW
from dpr_lab.errors import ConfigError, RunError
from dpr_lab.fitting.estimate import SCALE, Estimate, alone_share
from dpr_lab.gap.bare_model import nominal_ratios
from dpr_lab.identification.moving_arm.fit import ARM_FIT, covariance_of, fit_moving_arm, fit_segments, merged
from dpr_lab.identification.moving_arm.identify import (
    compare_moving_arm,
    identify_moving_arm,
    runs_used,
    undetermined,
)
from dpr_lab.identification.moving_arm.problem import arm_problem, recordings_of
from dpr_lab.identification.moving_arm.scale import (
    ArmScale,
    absolute_values,
    estimated,
    motor_notes,
    scale_of_arm,
    stated_scale,
)
from dpr_lab.identification.moving_arm.search import searched_start
from dpr_lab.identification.moving_arm.unknowns import rod_inertias
from dpr_lab.identification.preprocess import preprocess
from dpr_lab.identification.prior_update import posterior_of
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.report.data_frame import to_dataframe
from dpr_lab.rig import NO_ENCODER, Rig, load_rig
from dpr_lab.run import Run
from tests.thinned import FULL
from tests.three_hinges import L0, three_hinges

NOISE = 3e-4
T = np.arange(0, 3, 0.005)
PUSH = 0.6 * np.sin(4 * T) + 0.5 * np.sin(7.3 * T + 1)


def rig_with(mode, kind=None, rods="both", **motor):
    table = load_rig("paper").model_dump(exclude_none=True)
    table["rig"]["L0"] = L0
    table["rods"]["mounted"] = rods
    table["arm"] = {"mode": mode, "A": {"nominal": 0.08, "lower": 0.01, "upper": 1.0}}
    if kind:
        table["motor"] = {"input": kind, **motor}
    return Rig.model_validate(table)


def recorded(rig, Z, arm, start, shown, torque, rng):
    theta = three_hinges(mujoco, Z, arm, start, T, torque, (rig.L0, rig.L1, rig.g))
    noise = rng.normal(0, NOISE, theta.shape)
    noise[:, 2] += noise[:, 1]
    return Run(
        name="drawn", t=T, theta=theta + noise, counts=None, pose=None, rig_name=rig.name, rig_sha256="", rate_hz=200.0,
        arm_mode=rig.arm.mode, arm_input=shown, mounting=rig.rods.mounted,
    )  # fmt: skip


def drawn(rng, rig):
    Z = rig.nominal * rng.uniform(0.9, 1.1, 9)
    arm = ArmParameters(J0=rng.uniform(0.01, 0.03), c0=rng.uniform(0.01, 0.05), mode="free")
    start = np.array([0.0, np.pi + rng.uniform(0.4, 1.0), np.pi + rng.uniform(-1.0, 1.0), 0.0, 0.0, 0.0])
    return Z, arm, start


def truth_of(rig, Z, arm):
    base, model = mounted(Z, (rig.L0, rig.L1, rig.g), arm)
    values = base._asdict() | {"A": model.inertia, "c0": model.friction, "k0": model.stiffness}
    return {f"{name}/b": value / base.b for name, value in values.items()} | {"1/b": 1 / base.b}, base, model


@pytest.mark.slow
def test_a_known_torque_determines_ratios_and_absolute_values():
    rng, rig = np.random.default_rng(1), rig_with("driven", "torque")
    Z, arm, start = drawn(rng, rig)
    run = recorded(rig, Z, arm, start, PUSH, PUSH, rng)
    model = identify_moving_arm([run], rig)
    truth, base, held = truth_of(rig, Z, arm)
    assert set(model.ratios) == {"a/b", "d/b", "e1/b", "c1/b", "c2/b", "A/b", "c0/b", "1/b"}
    for name, one in model.ratios.items():
        assert abs(one.value - truth[name]) < 4 * one.std, name
        assert one.std < 0.02 * abs(one.value), name
    for name, true in (("b", base.b), ("A", held.inertia), ("c0", held.friction)):
        assert abs(model.absolute[name].value / true - 1) < 0.01, name
    assert model.fit.chi2_per_dof < 1.3
    assert not model.failures
    with pytest.raises(RunError, match="the input of the model is torque, that of the rig file voltage"):
        model.refuse_run(run, rig_with("driven", "voltage"))
    shorter = rig.model_copy(update={"rig": rig.rig.model_copy(update={"L1": 0.5})})
    with pytest.raises(
        RunError, match=rf"L1 = 0.5 m, rods: both\), but the model belongs to .* \(L1 = {rig.L1:g} m, rods: both"
    ):
        model.refuse_run(run, shorter)
    compared = compare_moving_arm(run, rig, model)
    assert all(compared.rms_rad[name] < 1.3 * NOISE for name in compared.rms_rad)
    assert to_dataframe(model).loc["A/b", "value"] == model.ratios["A/b"].value
    frame = to_dataframe(compared)
    for joint in range(3):
        np.testing.assert_array_equal(frame[f"tracked_joint{joint}"], compared.simulated[:, joint])


@pytest.mark.slow
def test_a_voltage_drive_of_a_furuta_pendulum_shows_lumped_constants_only():
    rng = np.random.default_rng(2)
    nominal = {"lower": 1e-3, "upper": 10.0}
    motor = {name: {"nominal": value, **nominal} for name, value in (("kt", 0.5), ("R", 2.0), ("ke", 0.1))}
    table = rig_with("driven", "voltage", "inner", **motor).model_dump(exclude_none=True)
    rig = Rig.model_validate(table | {"parameters": table["parameters"] | {"mb": NO_ENCODER}})
    Z, arm, start = drawn(rng, rig)
    Z[[3, 4]] = 1e-9  # no outer rod and no encoder of joint 2
    Z[[6, 8]] = 0.0, 1e-12
    start[2] = start[1]
    a = Z[7] + Z[2] * Z[0] ** 2
    back_emf = 0.04
    volts = 3.0 * PUSH
    lossy = arm._replace(c0=arm.c0 + back_emf)
    run = recorded(rig, Z, lossy, start, volts, 0.25 * volts, rng)
    model = identify_moving_arm([run], rig)
    truth = {
        "e1/a": Z[2] * Z[0] * rig.g / a,
        "c1/a": Z[5] / a,
        "A/a": (arm.J0 + Z[2] * rig.L0**2) / a,
        "c0/a": lossy.c0 / a,
        "kt/(R a)": 0.25 / a,
    }
    assert set(model.ratios) == set(truth)
    for name, true in truth.items():
        assert abs(model.ratios[name].value / true - 1) < 0.02, name
    assert model.scale == "a"
    assert model.absolute["kt gear/R"].fixed_by == "bound"
    l1, m1, J1 = rng.uniform(*rig.bounds[:, [0, 2, 7]], (400_000, 3)).T
    inertia, assumed = J1 + m1 * l1**2, model.absolute["a"]
    same_ratio = np.abs(m1 * l1 * rig.g / inertia / truth["e1/a"] - 1) < 0.01  # the recording determines e1/a
    assert assumed.std / assumed.value == pytest.approx(np.std(inertia[same_ratio]) / a, rel=0.25)
    assert 0 < assumed.interval90[0] < a < assumed.interval90[1]
    assert any("separates kt from R" in note for note in model.notes)


def test_values_at_an_assumed_scale_name_this_assumption():
    rig = load_rig("furuta")
    unknowns = SimpleNamespace(scale="a", free=("gain",))
    fit: Any = SimpleNamespace(problem=SimpleNamespace(unknowns=unknowns), value=lambda name: 38.7)
    notes = motor_notes(fit, scale_of_arm(fit, np.array([[1.0]]), rig), rig, ["gain", "c0"])
    assert sum("with the assumed a" in note for note in notes) == 2


def test_the_scale_of_one_rod_is_that_of_a_diagnosis_with_equal_ratios():
    table = load_rig("furuta").model_dump(exclude_none=True)
    table["parameters"]["mb"] = {"nominal": 0.01, "lower": 0.005, "upper": 0.02}  # an encoder at the end of the rod
    rig = Rig.model_validate(table)
    a, _, _, e1, c1, _ = rod_inertias(rig.nominal, rig)
    assert a == pytest.approx(3.3e-5 + 0.024 * 0.0645**2 + 0.01 * 0.129**2)
    unknowns = SimpleNamespace(scale="a", free=("e1", "c1"))
    fit: Any = SimpleNamespace(problem=SimpleNamespace(unknowns=unknowns), value={"e1": e1 / a, "c1": c1 / a}.get)
    scale = scale_of_arm(fit, np.zeros((2, 2)), rig)
    unknown = nominal_ratios(rig)
    diagnosed = posterior_of(unknown, rig, alone=True).scale(unknown[SCALE]).as_inertia("a", alone_share(unknown))
    identified = stated_scale(absolute_values({}, np.zeros((0, 0)), scale, "a", "")["a"], "a", scale.fixed_by)
    assert identified.sentence == diagnosed.sentence


def test_measured_rods_on_a_free_arm_have_the_inertia_of_their_fitted_ratios():
    table = load_rig("paper").model_dump(exclude_none=True)
    for name in ("m2", "l2"):
        nominal = table["parameters"][name]["nominal"]
        table["parameters"][name] |= {"measured": nominal, "std": 1e-4 * nominal}
    rig = Rig.model_validate(table)
    a, b, d, e1, c1, c2 = rod_inertias(rig.nominal, rig)
    values = {"a": a / b, "d": 1.05 * d / b, "e1": e1 / b, "c1": c1 / b, "c2": c2 / b}  # J2 is smaller than in the file
    unknowns = SimpleNamespace(scale="b", free=tuple(values))
    fit: Any = SimpleNamespace(problem=SimpleNamespace(unknowns=unknowns), value=values.get)
    scale = scale_of_arm(fit, np.zeros((5, 5)), rig)
    assert scale.fixed_by == "measured"
    assert scale.value == pytest.approx(b / 1.05, rel=1e-3)


def test_absolute_values_have_the_interval_of_an_assumed_scale_at_its_edge():
    scale = ArmScale.of(Scale(b=0.005, interval90=(0.005, 0.0062), fixed_by="measured"))
    absolute = absolute_values({"e1": 40.0}, np.array([[0.01]]), scale, "b", "")
    assert absolute["b"].interval90 == pytest.approx((0.005, 0.0062))
    low, high = absolute["e1"].interval90
    assert low == pytest.approx(0.2, rel=0.01)
    assert high == pytest.approx(40.0 * 0.0062, rel=0.01)


def test_the_bounds_of_a_nominal_kt_give_the_uncertainty_of_the_scale():
    rig = rig_with("driven", "current", kt={"nominal": 0.5, "lower": 0.1, "upper": 2.0})
    unknowns = SimpleNamespace(scale="b", free=("gain",))
    fit: Any = SimpleNamespace(problem=SimpleNamespace(unknowns=unknowns), value=lambda name: 100.0)
    scale = scale_of_arm(fit, np.array([[1.0]]), rig)
    kt = np.random.default_rng(0).uniform(0.1, 2.0, 20_000)
    assert not scale.known
    b = absolute_values({"gain": 100.0}, np.array([[1.0]]), scale, "b", "current")["b"]
    sentence = stated_scale(b, "b", scale.fixed_by, scale.constants_std).sentence
    assert f"assume b = {b.value:.4g} kg m^2, from the recorded input of the motor and its nominal" in sentence
    assert f"(90 % interval from its bounds {b.interval90[0]:.4g} to {b.interval90[1]:.4g})" in sentence
    assert scale.relative_std == pytest.approx(np.std(kt) / 0.5, rel=0.02)
    measured = rig_with("driven", "current", kt={"nominal": 0.5, "measured": 0.5, "std": 0.01})
    of_kt = scale_of_arm(fit, np.array([[1.0]]), measured)
    words = stated_scale(b, "b", of_kt.fixed_by, of_kt.constants_std).sentence
    assert words.startswith("The recordings and measured motor constants determine the scale")
    torque = scale_of_arm(fit, np.array([[1.0]]), rig_with("driven", "torque"))
    assert stated_scale(b, "b", torque.fixed_by, torque.constants_std).sentence.startswith("The recordings determine")


def test_each_run_has_its_own_chi_square():
    rng, rig = np.random.default_rng(1), rig_with("driven", "torque")
    Z, arm, start = drawn(rng, rig)
    runs = [recorded(rig, Z, arm, start, PUSH, share * PUSH, rng).between(0.0, 1.0) for share in (1.0, 1.5)]
    problem, initial = arm_problem(recordings_of(runs, rig), rig, 0.25)
    fit = fit_segments(problem, Estimate(problem.unknowns.start, initial), 3, states_only=True)
    weighed = replace(fit, problem=replace(problem, weight=0.5 * problem.weight), at_noise=fit.chi2_per_dof)
    for used in (runs_used(runs, fit), runs_used(runs, weighed)):
        assert [run.segments for run in used] == [4, 4]
        reduced = [run.chi2_per_dof for run in used]
        assert np.mean(reduced) == pytest.approx(problem.chi2(fit.estimate) / problem.evidence)
        assert reduced[1] > 1.2 * reduced[0]


@pytest.mark.slow
def test_a_reversed_arm_encoder_is_named():
    rng, rig = np.random.default_rng(3), rig_with("driven", "torque")
    Z, arm, start = drawn(rng, rig)
    run = recorded(rig, Z, arm, start, PUSH, PUSH, rng).between(0.0, 1.0)
    run.theta[:, 0] *= -1
    assert any("--scale theta0=-1" in failure for failure in identify_moving_arm([run], rig).failures)


def test_other_commands_refuse_a_moving_arm():
    rng, rig = np.random.default_rng(4), rig_with("free")
    Z, arm, start = drawn(rng, rig)
    run = recorded(rig, Z, arm, start, None, 0 * T, rng)
    with pytest.raises(RunError, match="its arm was free"):
        preprocess(run, rig)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"arm": {"mode": "driven"}}, r"needs \[motor\]"),
        ({"arm": {"mode": "free"}, "rods": {"elbow": "clamped"}}, "both rods, or with the inner rod alone"),
        ({"motor": {"input": "torque", "R": {"nominal": 1.0, "lower": 0.1, "upper": 9.0}}}, "R has no meaning"),
    ],
)
def test_arms_that_cannot_be_are_refused(change, words):
    table = load_rig("paper").model_dump(exclude_none=True)
    table["rig"]["L0"] = L0
    with pytest.raises((ValueError, ConfigError), match=words):
        Rig.model_validate(table | change)


@pytest.mark.long
@pytest.mark.parametrize("mode", ["free", pytest.param("driven", marks=pytest.mark.long)])
def test_intervals_cover_and_errors_keep_to_the_cramer_rao_bound(mode):
    rng, rig = np.random.default_rng(5), rig_with(mode, "torque" if mode == "driven" else None)
    scores, sizes = [], []
    for _ in range(8 if FULL else 2):
        Z, arm, start = drawn(rng, rig)
        driven = mode == "driven"
        run = recorded(rig, Z, arm, start, PUSH if driven else None, PUSH if driven else 0 * T, rng)
        model = identify_moving_arm([run], rig)
        truth, _, _ = truth_of(rig, Z, arm)
        scores += [(one.value - truth[name]) / one.std for name, one in model.ratios.items()]
        sizes.append(len(model.ratios))
    scores = np.array(scores)
    assert min(sizes) >= (8 if mode == "driven" else 7)
    assert np.sqrt(np.mean(scores**2)) < 1.2
    assert 0.80 < np.mean(abs(scores) < 1.645) <= 1.0


@pytest.mark.slow
def test_residuals_of_one_segment_do_not_reduce_the_standard_deviations():
    rng, rig = np.random.default_rng(4), rig_with("free", None, "inner")
    Z, arm, start = drawn(rng, rig)
    Z[[3, 4, 6, 8]] = 1e-9, 1e-9, 0.0, 1e-12  # no outer rod
    run = recorded(rig, Z, arm, start, None, 0 * PUSH, rng).between(0.0, 1.0)
    problem, initial = arm_problem(recordings_of([run], rig), rig, 1.0)
    fit = fit_segments(problem, Estimate(problem.unknowns.start, initial))
    assert (fit.converged, len(problem.segments)) == (True, 1)
    white = covariance_of(fit)
    np.testing.assert_allclose(covariance_of(replace(fit, at_noise=3.0)), white, rtol=0.1)


@pytest.mark.slow
def test_a_global_search_over_rods_arm_and_drive_finds_the_start_of_a_fit():
    """The search varies the arm's inertia and friction and the gain together with the rods, in wide bounds."""
    rng, rig = np.random.default_rng(2), rig_with("driven", "torque")
    Z, arm, start = drawn(rng, rig)
    run = recorded(rig, Z, arm, start, PUSH, PUSH, rng).between(0.0, 1.0)
    table = rig.model_dump(exclude_none=True)
    for parameter in table["parameters"].values():
        parameter.update(lower=parameter["nominal"] / 3, upper=3 * parameter["nominal"])
    far = Rig.model_validate(table)
    recordings = recordings_of([run], far)
    problem, initial = arm_problem(recordings, far, 0.25)
    result = searched_start(problem, initial)
    assert result is not None
    places = problem.unknowns.places
    moved = np.abs(np.log(result[places] / problem.unknowns.start[places]))
    assert (moved > 1e-3).all()  # every unknown is a gene
    cost = [problem.chi2(Estimate(p, initial)) for p in (result, problem.unknowns.start)]
    assert cost[0] < cost[1]
    model = fit_moving_arm(recordings, far, replace(ARM_FIT, searched=0.0))
    truth, *_ = truth_of(rig, Z, arm)
    for name, value in zip(model.problem.unknowns.free, model.values, strict=True):
        assert value == pytest.approx(truth[model.problem.unknowns.name(name)], rel=0.1)


@pytest.mark.parametrize(("theta1", "segments"), [(np.pi - 0.5, 1), (0.1, 2)])
def test_segments_are_not_merged_to_a_swing_that_is_too_chaotic_for_its_derivatives(theta1, segments):
    """After 6 s near upright, derivatives by differences are wrong; intervals of 1e-9 of the values resulted."""
    rig, t = rig_with("free"), np.arange(0, 6, 0.005)
    start = np.array([[0.0, theta1, np.pi, 0.0, 0.0, 0.0]])[:, np.argsort(FOLLOW.order)]
    noise = np.random.default_rng(0).normal(0, 0.003, (len(t), 3))
    run = Run(
        name="drawn", t=t, theta=3 + 100 * noise, counts=None, pose=None, rig_name=rig.name, rig_sha256="",
        rate_hz=200.0, arm_mode="free", mounting="both",
    )  # fmt: skip
    whole, _ = arm_problem(recordings_of([run], rig), rig, 10.0)
    estimate = Estimate(whole.unknowns.start, start)
    theta = whole.predict(estimate)
    theta[:, 2] += theta[:, 1]
    problem = replace(whole, recordings=recordings_of([replace(run, theta=theta + noise)], rig))
    halves = problem.with_cuts([(0, slice(0, 600)), (0, slice(600, 1200))])
    longer = merged(halves, Estimate(estimate.vector, np.repeat(start, 2, axis=0)), 0.2)
    assert len((halves if longer is None else longer[0]).cuts) == segments


@pytest.mark.parametrize(
    ("value", "std", "words"),
    [
        (1e-9, 1e21, "not determined by these recordings"),
        (0.1, 0.2, "not distinguishable from zero: -0.229 to 0.429 (90 %)"),
        (4.0, 2.3, "poorly determined: 0.217 to 7.78 (90 %)"),
    ],
)
def test_the_interval_of_a_failed_fit_is_nan(value, std, words):
    assert undetermined("c0/a", estimated(value, std)) == words
