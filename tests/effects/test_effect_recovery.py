"""Recovery of every effect from the counts of a plant, with unknown base parameters and initial states."""

from functools import cache

import numpy as np
import pytest

from dpr_lab.dynamics.base import BASE, base_parameters
from dpr_lab.dynamics.prediction import PAD, predict_batch, predict_with_internal
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import segments
from dpr_lab.effects import EFFECTS, OF_FREE_SWINGS, effect_params, param_index
from dpr_lab.rig import load_rig
from sim_device.plant.config import load_plant
from sim_device.plant.plant import Plant, Swing
from tests.plant_motion import motion
from tests.thinned import thinned

RIG = load_rig("paper")
CONFIG = load_plant("paper")
CONSTANTS = rig_constants(RIG)._replace(**{name: CONFIG.parameters[name] for name in ("m1", "m2", "mb")})
TRUTH = base_parameters(CONFIG.Z, CONSTANTS.L1, CONSTANTS.g)
RATE, SAMPLES, SEGMENTS = 200.0, 100, 6
NOISE = np.sqrt(0.5**2 + 1 / 12) * 2 * np.pi / 16384
STEP_AT = {"missed_counts": {"time_s": 1.2}}
FREE = [BASE.index(name) for name in ("a", "d", "e1", "c1", "c2")]  # b sets the scale
SWINGS = segments(
    [(np.arange(SAMPLES) + s * SAMPLES) / RATE for _ in RIG.poses for s in range(SEGMENTS)],
    np.repeat(np.arange(len(RIG.poses)), SEGMENTS),
)


def record(effects):
    """Encoder angles (N, 2) of one release from each pose, and true states (S, 4) at the starts of the segments."""
    plant = Plant(CONFIG.model_copy(update={"effects": effects}), RIG)
    rng = np.random.default_rng(5)
    angles, starts = [], []
    for run, pose in enumerate(RIG.poses.values()):
        t = np.arange(SAMPLES * SEGMENTS) / RATE
        theta = plant.misread(Swing(plant, pose.theta, np.zeros(3), RATE).theta(0, len(t)), t, run)
        counts = np.rint(RIG.positions(theta) + rng.normal(0, 0.5, theta.shape))
        seen = RIG.theta(counts)
        angles.append(np.column_stack([seen[:, 1], seen[:, 2] - seen[:, 1]]))
        at = np.concatenate([[0.0], t[SAMPLES::SAMPLES] - PAD])
        starts.append(motion(plant, pose.theta, np.zeros(3), at)[:, [1, 2, 4, 5]])
    return np.concatenate(angles), np.concatenate(starts)


def sensitivities(base, params, starts, columns):
    """Readings (N, 2), their derivatives by ratios and `columns` (N, 2, p) and by their own start state (N, 2, 4)."""
    n = len(FREE) + len(columns)
    bases, rows = np.repeat(base[None], n + 1, 0), np.repeat(params[None], n + 1, 0)
    steps = np.concatenate([1e-5 * base[FREE], 1e-3 * np.array(list(columns.values()))])
    for i, k in enumerate(FREE):
        bases[1 + i, k] += steps[i]
    for i, k in enumerate(columns):
        rows[1 + len(FREE) + i, k] += steps[len(FREE) + i]
    shared, internal = predict_with_internal(bases, rows, CONSTANTS, SWINGS, np.repeat(starts[None], n + 1, 0))
    moved = np.repeat(starts[None], 4, 0) + 1e-5 * np.eye(4)[:, None, :]
    own = predict_batch(bases[:1].repeat(4, 0), rows[:1].repeat(4, 0), CONSTANTS, SWINGS, moved, internal[0])
    by_shared = np.moveaxis((shared[1:] - shared[0]) / steps[:, None, None], 0, -1)
    return shared[0], by_shared, np.moveaxis((own - shared[0]) / 1e-5, 0, -1)


def projected(residual, by_shared, own):
    """Whitened residual and derivatives, projected onto the complement of the initial states of the segments."""
    r, J = [], []
    for s in range(len(SWINGS)):
        part = slice(SWINGS.offsets[s], SWINGS.offsets[s + 1])
        Q, _ = np.linalg.qr(own[part].reshape(-1, 4))
        for values, to in ((residual[part].reshape(-1, 1), r), (by_shared[part].reshape(Q.shape[0], -1), J)):
            to.append((values - Q @ (Q.T @ values)) / NOISE)
    return np.concatenate(r)[:, 0], np.concatenate(J)


def fitted(effects, columns):
    """Values of `columns` and their standard deviations, by Gauss-Newton from zero effects."""
    measured, starts = record(effects)
    base, params = TRUTH.copy(), effect_params(effects)
    params[list(columns)] = 0.0
    for _ in range(5):
        angles, by_shared, own = sensitivities(base, params, starts, columns)
        residual = measured - angles
        r, J = projected(residual, by_shared, own)
        scale = np.linalg.norm(J, axis=0)
        move = np.linalg.lstsq(J / scale, r, rcond=1e-9)[0] / scale
        base[FREE] += move[: len(FREE)]
        params[list(columns)] += move[len(FREE) :]
        left = residual - by_shared @ move
        for s in range(len(SWINGS)):
            part = slice(SWINGS.offsets[s], SWINGS.offsets[s + 1])
            starts[s] += np.linalg.lstsq(own[part].reshape(-1, 4), left[part].ravel(), rcond=None)[0]
    covariance = np.linalg.inv((J / scale).T @ (J / scale)) / np.outer(scale, scale)
    return params[list(columns)], np.sqrt(np.diag(covariance))[len(FREE) :], np.mean(r**2)


def unit(effect):
    return {param_index(effect.name, p.name): p.typical for p in effect.amplitudes}


@pytest.mark.slow
@pytest.mark.parametrize("name", thinned([name for name, e in OF_FREE_SWINGS.items() if not e.absorbed_by], 6))
def test_found_again_within_its_interval(name):
    effect = EFFECTS[name]
    values = {name: {p.name: p.typical for p in effect.amplitudes} | STEP_AT.get(name, {})}
    columns = unit(effect)
    result, deviation, chi2 = fitted(values, columns)
    truth = effect_params(values)[list(columns)]
    assert chi2 == pytest.approx(1.0, abs=0.1)
    assert (np.abs(result - truth) < 4 * deviation).all()
    assert (truth / deviation).max() > 2.5  # the record can see it


@cache
def signatures():
    """Sensitivities (n, p) of each effect at zero size, with base parameters and initial states projected out."""
    effects = {"detent_joint1": {"order": 1.0}, **STEP_AT}
    _, starts = record({})
    columns = {}
    for effect in OF_FREE_SWINGS.values():
        columns |= unit(effect)
    _, by_shared, own = sensitivities(TRUTH, effect_params(effects), starts, columns)
    _, J = projected(np.zeros(by_shared.shape[:2]), by_shared, own)
    Q, _ = np.linalg.qr(J[:, : len(FREE)])
    bare = J[:, len(FREE) :] - Q @ (Q.T @ J[:, len(FREE) :])
    places = list(columns)
    return J[:, len(FREE) :], bare, places


def signature(name, parameter):
    _, bare, places = signatures()
    return bare[:, places.index(param_index(name, parameter))]


def cosine(x, y):
    return x @ y / np.linalg.norm(x) / np.linalg.norm(y)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (("base_tilt", "tilt_rad"), ("encoder_offset_joint1", "offset_rad")),
        (("com_offset_link2", "offset_m"), ("encoder_offset_joint2", "offset_rad")),
        (("clock_rate", "excess"), ("wrong_length_L1", "added_m")),
        (("com_offset_link1", "offset_m"), ("detent_joint1", "cos1_Nm")),
    ],
)
def test_exact_twins_are_indistinguishable(one, other):
    assert abs(cosine(signature(*one), signature(*other))) > 0.999
    assert other[0] in EFFECTS[one[0]].twins


def test_effects_that_are_not_twins_are_distinguishable():
    for one, other in [
        (("coulomb_joint1", "torque_Nm"), ("coulomb_joint2", "torque_Nm")),
        (("spring_joint1", "stiffness_Nm_per_rad"), ("spring_joint2", "stiffness_Nm_per_rad")),
        (("encoder_offset_joint1", "offset_rad"), ("encoder_offset_joint2", "offset_rad")),
        (("latency_joint2", "delay_s"), ("clock_rate", "excess")),
    ]:
        assert abs(cosine(signature(*one), signature(*other))) < 0.95


def test_an_effect_that_base_parameters_absorb_is_not_visible():
    raw, bare, places = signatures()
    for effect in OF_FREE_SWINGS.values():
        own = [places.index(k) for k in unit(effect)]
        share = np.linalg.norm(bare[:, own]) / np.linalg.norm(raw[:, own])
        assert (share < 1e-3) == bool(effect.absorbed_by), effect.name


def test_the_sine_of_cogging_of_order_one_is_absorbed_by_gravity():
    raw, bare, places = signatures()
    k = places.index(param_index("detent_joint1", "sin1_Nm"))
    assert np.linalg.norm(bare[:, k]) < 1e-3 * np.linalg.norm(raw[:, k])
