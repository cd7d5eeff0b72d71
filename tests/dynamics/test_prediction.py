"""Predicted encoder readings along segments, compared with the simulator, brute force and closed forms."""

import numpy as np
import pytest

from dpr_lab.dynamics.base import added_base, base_parameters
from dpr_lab.dynamics.prediction import INTERNAL, PAD, predict, predict_batch, predict_with_internal
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import segments
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.effects import EFFECTS, SIZE, effect_params
from dpr_lab.rig import load_rig
from dpr_lab.rig_tables import AddedMass
from dpr_lab.setup import BOTH, Setup

RIG = load_rig("paper")
CONSTANTS = rig_constants(RIG)
L1, G = CONSTANTS.L1, CONSTANTS.g
BASE = base_parameters(RIG.nominal, L1, G)
OFF = effect_params({})
RELEASE = np.array([0.4, 2.8, 0.0, 0.0])
FINE = np.arange(0, 12001) * 1e-4


@pytest.fixture(scope="module")
def truth():
    return simulate(BASE, L1, G, RELEASE, FINE, 1e-4)


def at(truth, t):
    return truth[np.rint(np.asarray(t) * 1e4).astype(int)]


def relative(states):
    return np.column_stack([states[:, 0], states[:, 1] - states[:, 0]])


T = PAD + np.arange(100) / 200
SWING = segments([T], [0])


def read(values, start=RELEASE, swing=SWING, constants=CONSTANTS):
    return predict(BASE, effect_params(values), constants, swing, [start])


def test_reads_the_simulated_angles(truth):
    np.testing.assert_allclose(read({}), relative(at(truth, T)), atol=1e-6)


def test_uneven_and_fine_instants_lie_on_the_swing(truth):
    t = PAD + 1e-4 * np.array([0, *np.sort(np.random.default_rng(0).choice(np.arange(1, 9000), 300, replace=False))])
    result = predict(BASE, OFF, CONSTANTS, segments([t], [0]), [RELEASE])
    np.testing.assert_allclose(result, relative(at(truth, t)), atol=5e-6)


def test_an_absolute_encoder_reads_theta2(truth):
    absolute = CONSTANTS._replace(relative2=0.0)
    np.testing.assert_allclose(read({}, constants=absolute), at(truth, T)[:, :2], atol=1e-6)


def test_is_of_fourth_order_at_least(truth):
    steps = np.array([10e-3, 5e-3, 2.5e-3])
    errors = [
        np.abs(predict(BASE, OFF, CONSTANTS, segments([T], [0], step=h), [RELEASE]) - relative(at(truth, T))).max()
        for h in steps
    ]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] > 3.8


def test_segments_are_independent(truth):
    times = [T, T + 0.5]
    starts = np.array([RELEASE, at(truth, 0.5)])
    both = predict(BASE, OFF, CONSTANTS, segments(times, [0, 0]), starts)
    np.testing.assert_array_equal(both[:100], read({}))
    np.testing.assert_allclose(both, relative(at(truth, np.concatenate(times))), atol=1e-6)


def test_candidates_are_independent():
    rng = np.random.default_rng(1)
    n, swing = 7, segments([T, T + 1.0, T], [0, 0, 1])
    bases = BASE * rng.uniform(0.9, 1.1, (n, 6))
    params = np.array([effect_params({name: {p.name: p.typical for p in EFFECTS[name].amplitudes}})
                        for name in list(EFFECTS)[:: len(EFFECTS) // n][:n]])  # fmt: skip
    starts = rng.normal(0, 2, (n, 3, 4))
    together = predict_batch(bases, params, CONSTANTS, swing, starts)
    for i in range(n):
        np.testing.assert_array_equal(together[i], predict(bases[i], params[i], CONSTANTS, swing, starts[i]))


def test_effects_may_differ_between_runs():
    swing = segments([T, T], [0, 1])
    params = np.array([effect_params({"encoder_offset_joint1": {"offset_rad": x}}) for x in (0.01, 0.02)])
    result = predict_batch([BASE], [params], CONSTANTS, swing, [[RELEASE, RELEASE]])[0]
    np.testing.assert_allclose(result[100:] - result[:100], [[0.01, 0.0]] * 100, atol=1e-14)


def test_a_run_with_an_added_mass_swings_as_a_heavier_rig():
    added = AddedMass(rod="outer", mass=0.05, position=0.3)
    heavy = simulate(BASE + added_base(added, L1, G), L1, G, RELEASE, np.concatenate([[0.0], T]))
    result = predict(BASE, OFF, CONSTANTS, segments([T, T], [0, 1], [BOTH, Setup(added=added)]), [RELEASE, RELEASE])
    np.testing.assert_allclose(result[100:], relative(heavy[1:]), atol=1e-6)
    np.testing.assert_array_equal(result[:100], read({}))


def test_latency_delays_the_reading_of_joint_2(truth):
    result = read({"latency_joint2": {"delay_s": 3e-3}})
    np.testing.assert_allclose(result[:, 0], at(truth, T)[:, 0], atol=1e-6)
    np.testing.assert_allclose(result[:, 1], relative(at(truth, T - 3e-3))[:, 1], atol=1e-6)


def test_a_fast_clock_reads_earlier(truth):
    # The segment starts PAD before the true instant of its first sample.
    excess = 0.25
    start = at(truth, round(T[0] / (1 + excess) * 1e4) * 1e-4)
    first = T[0] / (1 + excess) - PAD
    assert first == pytest.approx(-0.004)
    before = simulate(BASE, L1, G, start * [1, 1, -1, -1], [0.0, 0.02])[-1]  # backwards in time, as friction is small
    result = read({"clock_rate": {"excess": excess}}, before * [1, 1, -1, -1])
    np.testing.assert_allclose(result, relative(at(truth, np.round(T / (1 + excess), 4))), atol=3e-4)


def test_eccentricity_adds_its_harmonics(truth):
    angles = relative(at(truth, T))
    values = {"cos1_rad": 1e-2, "sin2_rad": 2e-2, "sin6_rad": 3e-3}
    for joint in (1, 2):
        q = angles[:, joint - 1]
        error = 1e-2 * np.cos(q) + 2e-2 * np.sin(2 * q) + 3e-3 * np.sin(6 * q)
        expected = angles.copy()
        expected[:, joint - 1] += error
        np.testing.assert_allclose(read({f"encoder_eccentricity_joint{joint}": values}), expected, atol=2e-6)


def test_scale_and_offset_of_the_encoders(truth):
    angles = relative(at(truth, T))
    result = read({"encoder_scale_joint1": {"excess": 0.01}, "encoder_offset_joint2": {"offset_rad": 0.1}})
    expected = np.column_stack([np.pi + 1.01 * (angles[:, 0] - np.pi), angles[:, 1] + 0.1])
    np.testing.assert_allclose(result, expected, atol=2e-6)


def test_missed_counts_strike_one_joint_of_one_run_once(truth):
    swing, starts = segments([T, T], [0, 1]), [RELEASE, RELEASE]
    step = {"counts": 30.0, "joint": 1.0, "run": 1.0, "time_s": 0.3}
    moved = predict(BASE, effect_params({"missed_counts": step}), CONSTANTS, swing, starts)
    moved -= predict(BASE, OFF, CONSTANTS, swing, starts)
    late = np.concatenate([np.zeros(100, dtype=bool), T >= 0.3])
    np.testing.assert_allclose(moved[:, 0], late * 30 * 2 * np.pi / 16384, atol=1e-14)
    assert (moved[:, 1] == 0).all()


def test_play_drags_the_encoder_along(truth):
    play = 0.02
    hold, held = relative(truth[:1])[0, 1], []
    for angle in relative(truth)[:, 1]:
        hold = min(max(hold, angle - play / 2), angle + play / 2)
        held.append(hold)
    result = read({"backlash_joint2": {"play_rad": play}})
    np.testing.assert_allclose(result[:, 1], at(np.array(held), T), atol=2e-5)
    assert np.abs(result[:, 1] - relative(at(truth, T))[:, 1]).max() == pytest.approx(play / 2, rel=1e-3)


def test_play_of_encoder_1_leaves_encoder_2_alone(truth):
    play = 0.02
    hold, held = truth[0, 0], []
    for angle in truth[:, 0]:
        hold = min(max(hold, angle - play / 2), angle + play / 2)
        held.append(hold)
    result = read({"backlash_joint1": {"play_rad": play}})
    np.testing.assert_allclose(result[:, 0], at(np.array(held), T), atol=2e-5)
    np.testing.assert_allclose(result[:, 1], read({})[:, 1], atol=1e-12)


REMEMBERING = {
    "hysteresis_joint1": {"torque_Nm": 5e-3, "length_rad": 0.1},
    "hysteresis_joint2": {"torque_Nm": 2e-3, "length_rad": 0.1},
    "backlash_joint2": {"play_rad": 1.0},
    "backlash_joint1": {"play_rad": 1.0},
    "arm_compliance": {"coupling_per_kg": 0.1, "frequency_hz": 6.0},
}


LONG = PAD + np.arange(400) * 2.5e-3
CUT = segments([LONG[:200], LONG[200:]], [0, 0])


def long_and_cut(values):
    """A swing in one segment, its effects, and the initial states that divide it into two segments."""
    params = effect_params(values)
    whole = predict(BASE, params, CONSTANTS, segments([LONG], [0]), [RELEASE], arm=True)
    states = simulate(BASE, L1, G, RELEASE, [0.0, 0.5], 2.5e-3, params, CONSTANTS)[-1]
    return whole, params, np.array([RELEASE, states])


@pytest.mark.parametrize("name", REMEMBERING)
def test_memory_passes_from_segment_to_segment(name):
    whole, params, starts = long_and_cut({name: REMEMBERING[name]})
    passed = predict(BASE, params, CONSTANTS, CUT, starts, arm=True) - whole
    forgot = predict(BASE, params, CONSTANTS, CUT, starts, internal=np.zeros((2, len(INTERNAL))), arm=True) - whole
    assert np.abs(passed).max() < 3e-5
    assert np.abs(forgot).max() > 10 * np.abs(passed).max()


def test_memory_can_be_held_still():
    _, params, starts = long_and_cut(REMEMBERING)
    internal = predict_with_internal([BASE], [params], CONSTANTS, CUT, [starts])[1][0]
    assert internal.shape == (2, len(INTERNAL))
    assert (internal[0] == 0).all()
    acting = ["joint0" not in name for name in INTERNAL]  # this arm is clamped
    assert (np.abs(internal[1, acting]) > 0).all()
    whole = predict(BASE, params, CONSTANTS, CUT, starts)
    np.testing.assert_array_equal(predict(BASE, params, CONSTANTS, CUT, starts, internal), whole)
    moved = np.add(starts, [[0, 0, 0.1, 0], [0, 0, 0, 0]])
    np.testing.assert_array_equal(predict(BASE, params, CONSTANTS, CUT, moved, internal)[200:], whole[200:])
    assert (predict(BASE, params, CONSTANTS, CUT, moved)[200:] != whole[200:]).any()


@pytest.mark.parametrize("name", ["hysteresis_joint1", *REMEMBERING])
def test_a_first_sample_soon_after_the_release_still_remembers_the_release(name):
    values = {"hysteresis_joint1": {"torque_Nm": 0.02, "length_rad": 0.2}}.get(name, REMEMBERING.get(name))
    params = effect_params({name: values})
    late = segments([LONG[LONG > 0.03]], [0])
    whole = predict(BASE, params, CONSTANTS, segments([LONG], [0]), [RELEASE])
    np.testing.assert_allclose(predict(BASE, params, CONSTANTS, late, [RELEASE]), whole[LONG > 0.03], atol=1e-12)


def test_the_arm_is_held_until_the_release():
    params = effect_params({"arm_compliance": REMEMBERING["arm_compliance"]})
    # Without friction a swing that begins at rest runs backwards before it.
    base = BASE * [1, 1, 1, 1, 0, 0]
    start = simulate(base, L1, G, RELEASE, [0.0, PAD])[-1] * [1, 1, -1, -1]
    t = np.arange(100) / 200
    result = predict(base, params, CONSTANTS, segments([t], [0]), [start], arm=True)
    expected = simulate(base, L1, G, RELEASE, t, 1e-3, params, CONSTANTS)
    np.testing.assert_allclose(result[:, :2], relative(expected), atol=2e-5)
    assert result[0, 2] == 0
    assert np.abs(result[:, 2]).max() > 1e-4


def test_a_candidate_that_fails_is_not_finite_and_spoils_no_other():
    bases = np.array([BASE, BASE * [1, 1, 50, 1, 1, 1], BASE * np.nan])
    result = predict_batch(bases, np.repeat(OFF[None], 3, 0), CONSTANTS, SWING, np.repeat(RELEASE[None, None], 3, 0))
    assert not np.isfinite(result[2]).any()
    np.testing.assert_array_equal(result[0], read({}))


@pytest.mark.parametrize(
    ("times", "run", "message"),
    [
        ([], [], "at least one segment"),
        ([[0.0, 1.0]], [0, 1], "one run index for each"),
        ([[0.0, 0.0]], [0], "strictly increasing"),
        ([[0.0], [1.0]], [1, 0], "order of runs"),
        ([[1.0], [0.0]], [0, 0], "order of runs"),
    ],
)
def test_segments_out_of_order_are_refused(times, run, message):
    with pytest.raises(ValueError, match=message):
        segments(times, run)


def test_shapes_are_checked():
    with pytest.raises(ValueError, match=r"initial must have shape \(1, 1, 4\)"):
        predict(BASE, OFF, CONSTANTS, SWING, [[0.0, 1.0]])
    with pytest.raises(ValueError, match="params must have shape"):
        predict(BASE, OFF[:-1], CONSTANTS, SWING, [RELEASE])
    assert len(OFF) == SIZE


@pytest.mark.parametrize("values", [{"clock_rate": {"excess": -1.0}}, {"latency_joint2": {"delay_s": np.nan}}])
def test_an_absurd_clock_error_gives_nan(values):
    assert not np.isfinite(read(values)).any()
