"""Contract of every effect in the table."""

import numpy as np
import pytest

from dpr_lab.dynamics.base import BASE, base_parameters
from dpr_lab.dynamics.prediction import predict
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import segments
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.effects import EFFECTS, SIZE, SLICES, effect_params, named_params, param_index, proposed_shapes
from dpr_lab.effects.effect import Recorded
from dpr_lab.effects.effect_kernels import ARM, INTERNAL, active_effects
from dpr_lab.effects.fold import arguments
from dpr_lab.effects.rig_scales import LIMITS
from dpr_lab.effects.stages import STAGES
from dpr_lab.rig import load_rig
from dpr_lab.setup import Setup, Torques
from tests.whole_swing import energy

RIG = load_rig("paper")
CONSTANTS = rig_constants(RIG)
L1, G = CONSTANTS.L1, CONSTANTS.g
BASE_VALUES = base_parameters(RIG.nominal, L1, G)
FRICTIONLESS = BASE_VALUES * [1, 1, 1, 1, 0, 0]

CANONICAL = """
coulomb_joint1 coulomb_joint2 stribeck_joint1 stribeck_joint2 friction_curve_joint1 friction_curve_joint2
load_friction_joint1 load_friction_joint2 hysteresis_joint1 hysteresis_joint2 friction_drift_joint1
friction_drift_joint2 viscous_ground_link2 air_drag_outer air_drag_both spring_joint1 spring_joint2 detent_joint1
detent_joint2 rotor_inertia_joint1 rotor_inertia_joint2 backlash_joint2 base_tilt com_offset_link1 com_offset_link2
wrong_length_L1 arm_compliance base_vibration encoder_offset_joint1 encoder_offset_joint2 encoder_scale_joint1
encoder_scale_joint2 encoder_eccentricity_joint1 encoder_eccentricity_joint2 latency_joint2 clock_rate missed_counts
torque_scale_joint1 torque_scale_joint2 torque_offset_joint1 torque_offset_joint2 torque_ripple_joint1
torque_ripple_joint2 input_delay free_arm drive_gain coulomb_joint0 stribeck_joint0 friction_curve_joint0
spring_joint0 hard_stop_joint0 detent_joint0 encoder_offset_joint0 encoder_scale_joint0 encoder_eccentricity_joint0
latency_joint0 torque_scale_joint0 torque_offset_joint0 torque_ripple_joint0 dead_zone_joint0 saturation_joint0
hysteresis_joint0 axis_tilt_joint0 air_drag_joint0 backlash_joint1 backlash_joint0 encoder_drift_joint1
encoder_drift_joint2
""".split()


def some(keep):
    """Effects of the rods. Effects of a moving arm are in `test_arm_effects`."""
    chosen = {name: effect for name, effect in EFFECTS.items() if keep(effect) and not effect.of_arm}
    return pytest.mark.parametrize("effect", chosen.values(), ids=chosen)


def either_sign(effect):
    return all(parameter.sign == "any" for parameter in effect.amplitudes)


each_effect_of_rods = some(lambda effect: True)
each_effect = pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)
RUNS, SAMPLES = 3, 60


def typical(effect, factor=1.0):
    return effect_params({effect.name: {p.name: factor * p.typical for p in effect.amplitudes}})


@pytest.fixture(scope="module")
def record():
    """Driven segments after the middle of the run, which include a step, and their initial states."""
    rng = np.random.default_rng(7)
    times = [start + np.arange(SAMPLES) / 200 for _ in range(RUNS) for start in (0.0, 4.9)]
    starts = np.column_stack([rng.uniform(-7, 7, (2 * RUNS, 2)), rng.normal(0, 6, (2 * RUNS, 2))])
    logged = np.arange(0.0, 6.0, 2e-3)
    driven = Setup(torques=Torques(logged, 0.1 * np.sin(np.outer(logged, [5.0, 3.0]))))
    return segments(times, np.repeat(range(RUNS), 2), [driven] * RUNS), starts


def read(params, record):
    return predict(BASE_VALUES, params, CONSTANTS, *record, arm=True)


def test_new_effects_come_last_in_the_table():
    """The order of the table is that of the flat parameter vector."""
    assert list(EFFECTS)[: len(CANONICAL)] == CANONICAL, "append new effects at the end of EFFECTS"


@each_effect
def test_an_amplitude_of_zero_has_exactly_no_effect_for_any_shape(effect, record):
    params = effect_params({})
    for scale in (0.0, 0.3, 3.0):
        for parameter in effect.shapes:
            params[param_index(effect.name, parameter.name)] = scale * parameter.default
        assert not active_effects(params).any()
        assert np.array_equal(read(params, record), read(np.zeros(SIZE), record))


@each_effect_of_rods
def test_acts_at_typical_size_and_stays_finite(effect, record):
    change = read(typical(effect), record) - read(np.zeros(SIZE), record)
    assert np.isfinite(change).all()
    assert 1e-5 < np.abs(change).max() < 2.0


@each_effect_of_rods
def test_each_amplitude_acts_alone(effect, record):
    off = read(np.zeros(SIZE), record)
    for parameter in effect.amplitudes:
        params = effect_params({effect.name: {parameter.name: parameter.typical}})
        assert np.abs(read(params, record) - off).max() > 1e-6, parameter.name


@each_effect
def test_depends_only_on_its_own_parameters(effect, record):
    params, own = typical(effect), np.zeros(SIZE)
    own[SLICES[effect.name]] = params[SLICES[effect.name]]
    assert np.array_equal(read(params, record), read(own, record))


@some(either_sign)
def test_an_amplitude_of_opposite_sign_has_the_opposite_effect(effect, record):
    off = read(np.zeros(SIZE), record)
    plus, minus = (read(typical(effect, factor), record) - off for factor in (1e-3, -1e-3))
    assert np.abs(plus + minus).max() < 0.02 * np.abs(plus).max()


@some(lambda effect: effect.dissipative)
def test_a_dissipative_effect_never_adds_energy(effect):
    assert all(p.sign == "positive" for p in effect.amplitudes)
    a, b, d, e1, *_ = FRICTIONLESS
    params = typical(effect)
    for start in ([0.1, 3.0, 0.0, 0.0], [2.0, 0.3, 5.0, -9.0], [3.3, 3.2, 0.1, 0.4]):
        states = simulate(FRICTIONLESS, L1, G, start, np.linspace(0, 3, 601), 2e-4, params, CONSTANTS)
        levels = np.array([energy(*state, a, b, d, e1, d * G / L1) for state in states])
        gained = (levels - np.minimum.accumulate(levels)).max()
        assert gained <= 1e-9 + stored(effect, params)
        assert levels[-1] < levels[0] - 1e-6


def stored(effect, params):
    """Maximum energy that presliding can return: F z^2 / 2 over its length (Dahl), slightly less than F length."""
    if not effect.name.startswith("hysteresis"):
        return 0.0
    return params[param_index(effect.name, "torque_Nm")] * params[param_index(effect.name, "length_rad")]


@each_effect
def test_describes_itself(effect):
    assert EFFECTS[effect.name] is effect
    assert effect.amplitudes
    assert len({p.name for p in effect.parameters}) == len(effect.parameters)
    for parameter in effect.parameters:
        assert parameter.unit
        assert parameter.typical > 0
    for parameter in effect.amplitudes:
        assert (parameter.default, parameter.scan) == (0.0, ())
        has_limit = (parameter.limit or parameter.unit) in LIMITS or np.isfinite(parameter.most)
        assert has_limit, f"give {parameter.name} a limit `most`, or a key of LIMITS as `limit`"
    for parameter in effect.shapes:
        assert parameter.default >= 0
        assert list(parameter.scan) == sorted(parameter.scan)
    assert effect.equation
    assert all(parameter.name.isidentifier() for parameter in effect.parameters)  # a key in TOML and JSON
    assert effect.bench_check.endswith(".")
    assert effect.symptom.endswith(".")
    assert "{" not in effect.symptom + effect.bench_check + effect.equation
    assert len(effect.source) > 20
    assert set(effect.absorbed_by) <= set(BASE)


@each_effect
def test_lists_its_twins_and_nested_effects(effect):
    for name in (*effect.twins, *effect.nested):
        assert name in EFFECTS, f"{effect.name} has the twin or simpler form {name}, which no effect is called"
        assert name != effect.name
    for twin in effect.twins:
        assert effect.name in EFFECTS[twin].twins, f"add {effect.name} to the twins of {twin}"
    for simpler in effect.nested:
        assert len(EFFECTS[simpler].parameters) <= len(effect.parameters)
        assert effect.name not in EFFECTS[simpler].nested


@each_effect
def test_arguments_of_a_kernel_are_quantities_of_its_stage_internal_states_or_parameters(effect):
    offered = set(STAGES[effect.stage].quantities)
    own = {p.name for p in effect.parameters}
    stepped = {state.name for state in effect.internal if state.after}
    wanted = arguments(effect.kernel)
    assert set(wanted) <= offered | stepped | own
    assert own <= set(wanted)
    assert [name for name in wanted if name in own] == [p.name for p in effect.parameters]
    if "joint" in offered & set(wanted):
        assert len(effect.joints) == 1
    for state in effect.internal:
        if state.after:
            assert set(arguments(state.after)) <= {state.name, "displacement"} | own


def test_stages_that_replace_a_quantity_have_at_most_one_effect():
    stages = [effect.stage for effect in EFFECTS.values()]
    assert stages.count("arm") <= 1
    assert stages.count("input") <= 1
    assert all(stages.count(stage) <= 1 for stage in ("play", "play1", "play0"))


def test_internal_states_are_in_the_order_of_the_table():
    every = [f"{effect.name}.{state.name}" for effect in EFFECTS.values() for state in effect.internal]
    assert list(INTERNAL) == every
    assert [INTERNAL[ARM].split(".")[1], INTERNAL[ARM + 1].split(".")[1]] == ["angle", "speed"]


def test_shapes_are_proposed_from_the_recording():
    still, moving = (Recorded((moves, False), [(1, 0, 2.5), (0, 1, 0.7)]) for moves in (False, None))
    counts, arm = EFFECTS["missed_counts"], EFFECTS["arm_compliance"]
    first = proposed_shapes(counts, still)[0]
    assert dict(first) == {param_index(counts.name, n): v for n, v in [("joint", 2.0), ("run", 0.0), ("time_s", 2.5)]}
    assert proposed_shapes(arm, still) == []
    assert proposed_shapes(arm, moving) is None
    assert proposed_shapes(EFFECTS["detent_joint1"], still) is None


def test_a_compliant_arm_needs_forty_steps_per_period_but_no_step_below_a_quarter_of_the_usual():
    longest = EFFECTS["arm_compliance"].longest_step
    assert longest({"frequency_hz": 14.0}) == pytest.approx(1 / (40 * 14.0))
    assert longest({"frequency_hz": 100.0}) == 2.5e-3 / 4


def test_vector_has_a_place_for_every_parameter():
    places = [i for own in SLICES.values() for i in range(own.start, own.stop)]
    assert places == list(range(SIZE))
    assert list(SLICES) == list(EFFECTS)


def test_values_are_the_inverse_of_the_vector():
    values = {
        "detent_joint1": {"cos1_Nm": 1e-3, "sin1_Nm": 0.0, "cos2_Nm": 0.0, "sin2_Nm": 0.0, "order": 7.0},
        "latency_joint2": {"delay_s": -1e-3},
    }
    assert named_params(effect_params(values)) == values
    assert named_params(effect_params({})) == {}


def test_effects_of_one_stage_add_up(record):
    off = read(np.zeros(SIZE), record)
    names = ("encoder_offset_joint1", "encoder_scale_joint1", "encoder_eccentricity_joint2", "missed_counts")
    each = [read(typical(EFFECTS[name]), record) - off for name in names]
    params = effect_params({name: {p.name: p.typical for p in EFFECTS[name].amplitudes} for name in names})
    np.testing.assert_allclose(read(params, record) - off, np.sum(each, axis=0), atol=1e-12)


@pytest.mark.parametrize(
    ("values", "message"),
    [({"stiction": {"torque_Nm": 1.0}}, "no effect 'stiction'"), ({"coulomb_joint1": {"torque": 1.0}}, "torque_Nm")],
)
def test_unknown_names_are_refused(values, message):
    with pytest.raises(ValueError, match=message):
        effect_params(values)


@pytest.mark.parametrize(("rest", "cubic"), [(0.4, 0.0), (-0.9, 0.0), (0.4, 2e-3), (0.0, 1e-3), (-3.0, 2e-4)])
def test_a_spring_states_its_rest_angle(rest, cubic):
    spring, stiffness = EFFECTS["spring_joint1"], 1e-2
    assert spring.implied is not None
    constant = stiffness * rest + cubic * rest**3
    values = {"stiffness_Nm_per_rad": stiffness, "cubic_Nm_per_rad3": cubic, "constant_Nm": constant}
    assert spring.implied(values) == {"rest_angle_rad": pytest.approx(rest, abs=1e-12)}
    assert spring.implied({"stiffness_Nm_per_rad": 1e-9, "constant_Nm": 1e-3}) == {}
    assert spring.implied({"constant_Nm": 1e-3}) == {}
