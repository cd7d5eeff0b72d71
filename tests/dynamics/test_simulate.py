import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.dynamics.arm import ArmParameters
from dpr_lab.dynamics.base import base_from_ratios, base_parameters, ratios
from dpr_lab.dynamics.schedule import steps_between
from dpr_lab.dynamics.simulate import simulate
from tests.whole_swing import energy, simulate_arm

Z = np.array([0.2, 0.2, 0.1, 0.1, 0.208, 0.001, 0.001, 0.00133, 0.00133])
L0, L1, G = 0.3, 0.4, 9.81
BASE = base_parameters(Z, L1, G)
X1, X2, X3 = [np.pi, 0.1, 0.0, 0.0], [0.1, 0.1, 0.0, 0.0], [0.1, np.pi, 0.0, 0.0]


def exact(base, state, t):
    """Solve docs/theory.md equation (1), written with matrices, by DOP853 at full accuracy."""
    a, b, d, e1, c1, c2 = base

    def slope(_, x):
        theta1, theta2, w1, w2 = x
        c, s = d * np.cos(theta1 - theta2), d * np.sin(theta1 - theta2)
        right = [
            -s * w2**2 - c1 * w1 - c2 * (w1 - w2) + e1 * np.sin(theta1),
            s * w1**2 - c2 * (w2 - w1) + d * G / L1 * np.sin(theta2),
        ]
        return [w1, w2, *np.linalg.solve([[a, c], [c, b]], right)]

    return solve_ivp(slope, (t[0], t[-1]), state, "DOP853", t, rtol=1e-12, atol=1e-12).y.T


@pytest.mark.parametrize("pose", [X1, X2, X3], ids=["X1", "X2", "X3"])
def test_agrees_with_dop853_at_uneven_instants(pose):
    t = np.concatenate([[0.0], np.sort(np.random.default_rng(1).uniform(0, 2, 60))])
    np.testing.assert_allclose(simulate(BASE, L1, G, pose, t), exact(BASE, pose, t), atol=2e-6)
    np.testing.assert_allclose(simulate(BASE, L1, G, pose, t)[:, :2], exact(BASE, pose, t)[:, :2], atol=3e-8)


def test_is_of_fourth_order():
    t = np.array([0.0, 1.0])
    reference = exact(BASE, X3, t)[-1]
    steps = np.array([8e-3, 4e-3, 2e-3, 1e-3])
    errors = [np.abs(simulate(BASE, L1, G, X3, t, step)[-1] - reference).max() for step in steps]
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(4.0, abs=0.2)


def rod_energy(states, base=BASE):
    a, b, d, e1, *_ = base
    return np.array([energy(*state, a, b, d, e1, d * G / L1) for state in states])


def test_energy_stays_without_friction():
    base = BASE * [1, 1, 1, 1, 0, 0]
    levels = rod_energy(simulate(base, L1, G, X2, np.linspace(0, 5, 501), 2.5e-4))
    assert np.ptp(levels) < 1e-8


def test_energy_decays_with_friction():
    levels = rod_energy(simulate(BASE, L1, G, X2, np.linspace(0, 5, 501), 5e-4))
    assert (np.diff(levels) < 1e-9).all()
    assert levels[-1] < levels[0] - 0.1


def test_only_ratios_matter():
    t = np.linspace(0, 2, 41)
    np.testing.assert_allclose(
        simulate(base_from_ratios(ratios(BASE)), L1, G, X1, t), simulate(BASE, L1, G, X1, t), atol=1e-10
    )


@pytest.mark.parametrize(
    ("pose", "low", "high"), [(X1, 1, 1e2), (X2, 1e6, 1e9), (X3, 1e5, 1e8)], ids=["X1", "X2", "X3"]
)
def test_growth_of_a_small_error_over_ten_seconds(pose, low, high):
    t, small = np.linspace(0, 10, 1001), 1e-9
    moved = [pose[0] + small, *pose[1:]]
    apart = simulate(BASE, L1, G, moved, t) - simulate(BASE, L1, G, pose, t)
    assert low < np.linalg.norm(apart, axis=1).max() / small < high


def test_a_diverging_simulation_is_nan_from_there_on():
    states = simulate(BASE * [1, 1, 20, 1, 1, 1], L1, G, X2, np.linspace(0, 50, 501))
    finite = np.isfinite(states).all(axis=1)
    assert finite[0]
    assert not finite[-1]
    assert (np.diff(finite.astype(int)) <= 0).all()


@pytest.mark.parametrize("t", [[0.0, 0.0], [1.0, 0.5], [0.0, np.nan], []])
def test_instants_must_increase(t):
    with pytest.raises(ValueError, match="t must be"):
        simulate(BASE, L1, G, X1, t)


def test_shapes_are_checked():
    with pytest.raises(ValueError, match="base must have shape"):
        simulate(BASE[:5], L1, G, X1, [0.0, 1.0])
    with pytest.raises(ValueError, match="effects must have shape"):
        simulate(BASE, L1, G, X1, [0.0, 1.0], effects=[0.0])
    with pytest.raises(ValueError, match="arm mode"):
        simulate_arm(Z, (L0, L1, G), ArmParameters(mode="loose"), np.zeros(6), [0.0, 1.0])


def test_steps_divide_each_interval_evenly():
    step, count = steps_between([0.0, 0.005, 0.0061, 0.1], max_step=1e-3)
    np.testing.assert_array_equal(count, [0, 5, 2, 94])
    np.testing.assert_allclose(step * count, [0.0, 0.005, 0.0011, 0.0939])


def test_clamped_arm_swings_as_the_reduced_rods():
    t = np.linspace(0, 2, 201)
    states = simulate_arm(Z, (L0, L1, G), ArmParameters(), [0.3, *X3[:2], 1.0, *X3[2:]], t)
    np.testing.assert_array_equal(states[:, [1, 2, 4, 5]], simulate(BASE, L1, G, X3, t))
    assert (states[:, 0] == 0.3).all()
    assert (states[:, 3] == 0.0).all()


def test_stiff_arm_comes_near_a_clamped_one_and_a_loose_one_does_not():
    t = np.linspace(0, 1, 101)
    start = [0.0, *X3[:2], 0.0, 0.0, 0.0]
    clamped = simulate(BASE, L1, G, X3, t)
    stiff = simulate_arm(Z, (L0, L1, G), ArmParameters(0.01, 0.05, 2e3, "free"), start, t, 1e-4)
    loose = simulate_arm(Z, (L0, L1, G), ArmParameters(0.01, 0.001, 0.0, "free"), start, t, 1e-4)
    assert np.abs(stiff[:, [1, 2, 4, 5]] - clamped).max() < 0.05
    assert np.abs(loose[:, [1, 2, 4, 5]] - clamped).max() > 0.5


def test_prescribed_acceleration_is_held_from_instant_to_instant():
    t = np.array([0.0, 0.5, 1.0])
    states = simulate_arm(
        Z, (L0, L1, G), ArmParameters(mode="driven"), [0.0, np.pi, np.pi, 0.0, 0.0, 0.0], t, drive=[2.0, -2.0, 9.0]
    )
    np.testing.assert_allclose(states[:, 3], [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(states[:, 0], [0.0, 0.25, 0.5], atol=1e-12)
    assert np.abs(states[1, 1:3] - np.pi).min() > 1e-3
