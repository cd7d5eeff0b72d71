import numpy as np
import pytest

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.equation import energy
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.effects import EFFECTS, SIZE, SLICES, effect_torques, effect_vector

Z = np.array([0.2, 0.2, 0.1, 0.1, 0.208, 0.0, 0.0, 0.00133, 0.00133])
L1, G = 0.4, 9.81
BASE = base_parameters(Z, L1, G)

each_effect = pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)


def typical(effect):
    return effect_vector({effect.name: {p.name: p.typical for p in effect.parameters}})


def random_states(n=500):
    rng = np.random.default_rng(7)
    return np.hstack([rng.uniform(-10, 10, (n, 2)), rng.normal(0, 10, (n, 2))])


@each_effect
def test_off_at_zero_exactly(effect):
    for state in [*random_states(), [np.nan] * 4, [np.inf] * 4]:
        assert effect.kernel(*state, np.zeros(SIZE), SLICES[effect.name].start) == (0.0, 0.0)


@each_effect
def test_acts_and_stays_finite(effect):
    torques = np.array([effect_torques(*state, typical(effect)) for state in random_states()])
    assert np.isfinite(torques).all()
    assert (torques != 0).any()


@each_effect
def test_feels_only_its_own_parameters(effect):
    vector = np.random.default_rng(0).uniform(1, 2, SIZE)
    own = np.zeros(SIZE)
    own[SLICES[effect.name]] = vector[SLICES[effect.name]]
    at = SLICES[effect.name].start
    for state in random_states(20):
        assert effect.kernel(*state, vector, at) == effect.kernel(*state, own, at)


@each_effect
def test_dissipative_effect_never_adds_energy(effect):
    if not effect.dissipative:
        pytest.skip(f"{effect.name} may store energy")
    for state in random_states():
        tau1, tau2 = effect_torques(*state, typical(effect))
        assert tau1 * state[2] + tau2 * state[3] <= 0
    states = simulate(BASE, L1, G, [0.1, 3.0, 0.0, 0.0], np.linspace(0, 3, 301), 5e-4, typical(effect))
    a, b, d, e1, *_ = BASE
    levels = np.array([energy(*state, a, b, d, e1, d * G / L1) for state in states])
    assert (np.diff(levels) < 1e-9).all()
    assert levels[-1] < levels[0] - 1e-4


@each_effect
def test_describes_itself(effect):
    assert EFFECTS[effect.name] is effect
    assert effect.parameters
    for parameter in effect.parameters:
        assert parameter.unit
        assert parameter.typical > 0
    assert set(effect.twins) <= set(EFFECTS) - {effect.name}
    assert effect.bench_check.endswith(".")
    assert len(effect.source) > 20


def test_vector_has_a_place_for_every_parameter():
    places = [i for place in SLICES.values() for i in range(place.start, place.stop)]
    assert places == list(range(SIZE))
    assert list(SLICES) == list(EFFECTS)


def test_fold_adds_all_effects():
    vector = np.random.default_rng(1).uniform(1e-4, 1e-3, SIZE)
    for state in random_states(50):
        single = [effect.kernel(*state, vector, SLICES[name].start) for name, effect in EFFECTS.items()]
        np.testing.assert_allclose(effect_torques(*state, vector), np.sum(single, axis=0), rtol=1e-14, atol=1e-18)


def test_coulomb_torque_is_constant_and_opposes_the_motion():
    vector = effect_vector({"coulomb_joint1": {"torque_Nm": 0.002}})
    assert effect_torques(0.0, 0.0, 3.0, 0.0, vector) == pytest.approx((-0.002, 0.0), rel=1e-6)
    assert effect_torques(0.0, 0.0, -9.0, 0.0, vector) == pytest.approx((0.002, 0.0), rel=1e-6)


def test_coulomb_torque_of_joint_2_acts_on_the_relative_speed_with_reaction():
    vector = effect_vector({"coulomb_joint2": {"torque_Nm": 0.002}})
    assert effect_torques(0.0, 0.0, 3.0, 5.0, vector) == pytest.approx((0.002, -0.002), rel=1e-6)
    assert effect_torques(1.0, 2.0, 5.0, 5.0, vector) == (0.0, 0.0)


def test_small_swing_loses_four_frictions_over_stiffness_each_period():
    # Closed form for one rod under dry friction alone; the outer rod is made too light to matter.
    base = np.array([0.02, 1e-9, 0.0, 0.4, 0.0, 0.0])
    friction = 5e-4
    vector = effect_vector({"coulomb_joint1": {"torque_Nm": friction}})
    period = 2 * np.pi * np.sqrt(base[0] / base[3])
    t = period * np.arange(6)
    swing = simulate(base, L1, G, [np.pi + 0.05, np.pi, 0.0, 0.0], t, 2e-4, vector)
    np.testing.assert_allclose(np.diff(swing[:, 0]), -4 * friction / base[3], rtol=0.06)


@pytest.mark.parametrize(
    ("values", "said"),
    [({"stiction": {"torque_Nm": 1.0}}, "no effect 'stiction'"), ({"coulomb_joint1": {"torque": 1.0}}, "torque_Nm")],
)
def test_unknown_names_are_refused(values, said):
    with pytest.raises(ValueError, match=said):
        effect_vector(values)
