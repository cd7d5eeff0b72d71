"""Local motion and torque balance of motions whose angles, velocities and accelerations are known exactly."""

from dataclasses import fields, replace

import numpy as np
import pytest

from dpr_lab.identification.misread.balance import mounted_base, periods
from dpr_lab.identification.misread.local_motion import LocalMotion, LocalMotionSettings, local_motion
from dpr_lab.identification.misread.torque_balance import TORQUES, TorqueBalance, inertia_bounds, torque_balance
from dpr_lab.rig import Rig

SETTINGS = LocalMotionSettings(degree=3, window_share=0.5, window=(7, 31), fewest=20, looked_at=100, instants=60)
NAMES = ("a", "b", "d", "e1", "c1", "c2")
FACTORS = {"a": 1.2, "b": 0.8, "c1": 3.0, "c2": 2.0}
"""Parameters of the moving rods relative to those of the rig file."""
COULOMB = (0.1, 0.2)
"""Coulomb friction of the joints relative to the largest torque of gravity on their rods."""


@pytest.fixture
def clamped(paper: Rig) -> Rig:
    return paper.model_copy(update={"rods": paper.rods.model_copy(update={"elbow": "clamped"})})


def balance(rig: Rig, *, driven: bool, coulomb: tuple[float, float] = COULOMB, **factors: float) -> TorqueBalance:
    """Torque balance of random motion with the accelerations of equation (1), with the elbow mode of the rig."""
    rng = np.random.default_rng(7)
    a, b, d, e1, c1, c2 = (
        factors.get(name, 1.0) * value for name, value in zip(NAMES, mounted_base(rig, rig.nominal), strict=True)
    )
    e2, both = d * rig.g / rig.L1, rig.rods.mounting == "both"
    rods, omega = rng.uniform(-3.0, 3.0, (400, 2)), rng.normal(0.0, 3.0, (400, 2))
    if not both:
        rods[:, 1], omega[:, 1] = rods[:, 0] + 0.7, omega[:, 0]
    torques = rng.normal(0.0, e1, (400, 2)) if driven else np.zeros((400, 2))
    (t1, t2), (w1, w2), (tau1, tau2) = rods.T, omega.T, torques.T
    slip1, slip2 = np.tanh(w1 / TORQUES.slipping), np.tanh((w2 - w1) / TORQUES.slipping)
    joint1 = tau1 - c1 * w1 - coulomb[0] * e1 * slip1
    joint2 = tau2 - c2 * (w2 - w1) - coulomb[1] * e2 * slip2
    whirl, cos = d * np.sin(t1 - t2), np.cos(t1 - t2)
    right = np.stack([e1 * np.sin(t1) - whirl * w2**2 + joint1 - joint2, e2 * np.sin(t2) + whirl * w1**2 + joint2], 1)
    if both:
        mass = np.array([[a + 0 * cos, d * cos], [d * cos, b + 0 * cos]]).transpose(2, 0, 1)
        alpha = np.linalg.solve(mass, right[:, :, None])[:, :, 0]
    else:
        alpha = np.repeat((right.sum(axis=1) / (a + b + 2 * d * cos))[:, None], 2, axis=1)
    moving = LocalMotion(np.arange(400), np.arange(400.0), rods, omega, alpha)
    return TorqueBalance(moving, torques if driven else None, rig)


@pytest.mark.parametrize("driven", [False, True])
def test_motion_of_equation_1_balances(paper: Rig, driven: bool) -> None:
    assert balance(paper, driven=driven, **FACTORS).residual() < 1e-5


@pytest.mark.parametrize("driven", [False, True])
def test_motion_with_a_clamped_elbow_balances_by_the_sum_of_both_equations(clamped: Rig, driven: bool) -> None:
    assert balance(clamped, driven=driven, **FACTORS).residual() < 1e-5


@pytest.mark.parametrize(
    "factors",
    [
        {"a": 4.0},
        {"a": 0.25},
        {"b": 4.0},
        {"b": 0.25},
        {"c1": -30.0},
        {"c1": 400.0},
        {"c2": -30.0},
        {"c2": 400.0},
        {"coulomb": (-0.2, 0.0)},
        {"coulomb": (1.5, 0.0)},
        {"coulomb": (0.0, -0.2)},
        {"coulomb": (0.0, 1.5)},
    ],
)
def test_parameters_beyond_their_bounds_do_not_balance(paper: Rig, factors: dict) -> None:
    assert balance(paper, driven=False, **factors).residual() > 1e-2


@pytest.mark.parametrize("factor", [-1.0, 0.25, 4.0])
def test_torques_of_another_sign_or_unit_do_not_balance(paper: Rig, factor: float) -> None:
    right = balance(paper, driven=True)
    assert right.torques is not None
    for column in (0, 1):
        factors = np.where(np.arange(2) == column, factor, 1.0)
        assert replace(right, torques=right.torques * factors).residual() > 0.05
    assert replace(right, torques=right.torques * factor).residual() > 0.05


def test_torques_within_the_slack_balance(paper: Rig) -> None:
    right = balance(paper, driven=True)
    assert right.torques is not None
    for factor in (0.4, 2.5):
        assert replace(right, torques=right.torques * factor).residual() < 1e-5


def test_the_residual_is_relative_to_the_torques_of_gravity(paper: Rig) -> None:
    right = balance(paper, driven=False)
    moving = right.moving
    a, _, d, e1, *_ = mounted_base(paper, paper.nominal)
    error = np.random.default_rng(8).normal(0.0, 1.0, 400)
    shaken = replace(moving, alpha=moving.alpha + np.column_stack([error, np.zeros(400)]))
    gravity = np.hypot(*(np.array([e1, d * paper.g / paper.L1]) * np.sin(moving.rods)).std(axis=0))
    inner, outer = a * error, d * np.cos(moving.rods @ [1.0, -1.0]) * error
    expected = np.sqrt(np.mean(inner**2 + outer**2)) / gravity
    assert replace(right, moving=shaken).residual() == pytest.approx(expected, rel=0.03)


def test_rods_at_rest_do_not_balance(paper: Rig) -> None:
    still = LocalMotion(np.arange(9), np.arange(9.0), *np.zeros((3, 9, 2)))
    assert TorqueBalance(still, None, paper).residual() == np.inf


@pytest.mark.parametrize("added", [(0.3, -0.2), (0.0, 0.1)])
def test_the_nearest_zeros_balance_again(paper: Rig, added: tuple[float, float]) -> None:
    right = balance(paper, driven=True)
    moved = replace(right, moving=replace(right.moving, rods=right.moving.rods - np.array(added)))
    assert moved.residual() > 0.02
    assert moved.residual(added) < 1e-5
    np.testing.assert_allclose(moved.zeros(nearest=True), added, atol=1e-3)


def test_inertias_are_those_of_the_moving_rods(paper: Rig) -> None:
    residual, ratios = balance(paper, driven=False, **FACTORS).inertias()
    a, b, d, e1, *_ = mounted_base(paper, paper.nominal)
    assert residual < 1e-5
    np.testing.assert_allclose(ratios, np.array([1.2 * a, 0.8 * b, d]) / e1, rtol=1e-4)


def test_with_a_clamped_elbow_the_inertia_is_that_of_the_pendulum_of_both_rods(clamped: Rig) -> None:
    moving = balance(clamped, driven=False)
    residual, ratios = moving.inertias()
    a, b, d, e1, *_ = mounted_base(clamped, clamped.nominal)
    e2 = d * clamped.g / clamped.L1
    gravity = np.sqrt((e1 + e2 * np.cos(0.7)) ** 2 + (e2 * np.sin(0.7)) ** 2)
    assert residual < 1e-5
    assert moving.elbow == pytest.approx(0.7)
    np.testing.assert_allclose(ratios, [(a + b + 2 * d * np.cos(0.7)) / gravity], rtol=1e-4)


def test_bounds_of_the_inertias_are_those_of_the_masses(paper: Rig, clamped: Rig) -> None:
    corners = np.stack(np.meshgrid(*paper.bounds.T), axis=-1).reshape(-1, 9)
    a, b, d, e1, *_ = mounted_base(paper, corners).T
    for rig, elbow, ratios in (
        (paper, 0.0, np.array([a, b, d]) / e1),
        (clamped, 0.0, [(a + b + 2 * d) / (e1 + d * paper.g / paper.L1)]),
        (clamped, np.pi, [(a + b - 2 * d) / np.abs(e1 - d * paper.g / paper.L1)]),
    ):
        low, high = inertia_bounds(rig, elbow)
        np.testing.assert_allclose(low, np.min(ratios, axis=1))
        np.testing.assert_allclose(high, np.max(ratios, axis=1))


def test_a_balance_needs_rows_a_period_and_has_the_torques_of_its_instants(paper: Rig) -> None:
    fast = periods(paper)[1]
    for rows_a_period, some in ((29.0, False), (31.0, True)):
        t = np.arange(200) * fast / rows_a_period
        rods = np.column_stack([np.sin(t), np.cos(t)])
        made = torque_balance(t, rods, np.column_stack([t, -t]), paper)
        assert (made is not None) is some
    assert made is not None
    assert made.torques is not None
    np.testing.assert_allclose(made.torques, np.column_stack([made.moving.t, -made.moving.t]), atol=1e-9)
    np.testing.assert_allclose(made.moving.alpha[:, 0], -np.sin(made.moving.t), atol=0.02)
    assert torque_balance(t[:29], rods[:29], None, paper) is None
    free = torque_balance(t, rods, None, paper)
    assert free is not None
    assert free.torques is None


def test_a_polynomial_has_its_exact_derivatives_at_uneven_instants() -> None:
    t = 5.0 + np.cumsum(np.random.default_rng(3).uniform(0.5e-2, 1.5e-2, 300))
    s = t - 6.0
    rods = np.column_stack([1 + 2 * s - s**2, 3 - s + s**2 / 2])
    motion = local_motion(t, rods, 0.4, SETTINGS)
    assert motion is not None
    s = motion.t - 6.0
    np.testing.assert_allclose(motion.rods, np.column_stack([1 + 2 * s - s**2, 3 - s + s**2 / 2]), atol=1e-9)
    np.testing.assert_allclose(motion.omega, np.column_stack([2 - 2 * s, s - 1]), atol=1e-8)
    np.testing.assert_allclose(motion.alpha, np.broadcast_to([-2.0, 1.0], motion.alpha.shape), atol=1e-6)
    assert {len(getattr(motion, each.name)) for each in fields(motion)} == {57}
    assert motion.near[0] == 9
    np.testing.assert_allclose(t[motion.near], motion.t, atol=0.02)


@pytest.mark.parametrize(("period_s", "window"), [(0.01, 7), (0.31, 15), (0.33, 17), (5.0, 31)])
def test_a_window_is_a_share_of_the_period_within_its_bounds(period_s: float, window: int) -> None:
    t = 0.01 * np.arange(300)
    motion = local_motion(t, np.column_stack([t, t]), period_s, replace(SETTINGS, instants=300))
    assert motion is not None
    assert motion.near[0] == window // 2
    assert len(motion.t) == 300 - window + 1


def test_only_the_beginning_is_tested() -> None:
    t = 0.1 * np.arange(300)
    motion = local_motion(t, np.column_stack([t, t]), 0.01, replace(SETTINGS, instants=300))
    assert motion is not None
    assert motion.near[-1] == 96  # 10 s are 100 rows
    more = local_motion(t, np.column_stack([t, t]), 0.01, replace(SETTINGS, instants=300, looked_at=150))
    assert more is not None
    assert more.near[-1] == 146
    longer = local_motion(t, np.column_stack([t, t]), 0.01, replace(SETTINGS, instants=300, looked_at_s=20.0))
    assert longer is not None
    assert longer.near[-1] == 196


def test_too_few_rows_equal_instants_and_no_numbers_have_no_motion() -> None:
    t = 0.01 * np.arange(27)
    rods = np.column_stack([t, t])
    assert local_motion(t, rods, 0.01, SETTINGS) is not None  # 20 windows of 7 rows
    assert local_motion(t[:26], rods[:26], 0.01, SETTINGS) is None
    assert local_motion(t[:19], rods[:19], 0.01, SETTINGS) is None
    equal = np.repeat(t, 40)
    assert local_motion(equal, np.column_stack([equal, equal]), 0.01, SETTINGS) is None
    assert local_motion(t, np.full((27, 2), np.nan), 0.01, SETTINGS) is None
