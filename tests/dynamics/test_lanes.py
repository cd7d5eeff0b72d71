"""Batch simulation compared with the scalar steps of the simulator: every effect alone and in pairs."""

import itertools

import numpy as np
import pytest

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.lanes.tracks import tracks_of
from dpr_lab.dynamics.lanes.workspace import LANES
from dpr_lab.dynamics.prediction import INTERNAL, predict_batch, predict_with_internal
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import segments
from dpr_lab.effects import EFFECTS, OF_FREE_SWINGS, effect_params
from dpr_lab.effects.effect_kernels import active_effects
from dpr_lab.rig import load_rig
from dpr_lab.rig_tables import AddedMass
from dpr_lab.setup import Setup
from tests.dynamics.scalar_readings import read_segments

RIG = load_rig("paper")
CONSTANTS = rig_constants(RIG)
BASE = base_parameters(RIG.nominal, CONSTANTS.L1, CONSTANTS.g)
SETUPS = [
    Setup(),
    Setup(added=AddedMass(rod="outer", mass=0.05, position=0.3)),
    Setup(added=AddedMass(rod="inner", mass=0.05, position=0.2)),
]
T = np.arange(30) / 200
TIMES = [T, T + 0.15, T[:17] + 0.3, T + 0.05, T[:1] + 4.9, T + 1.0]  # from before the release, and first seen late
SEGMENTS = segments(TIMES, [0, 0, 0, 1, 1, 2], SETUPS)
RNG = np.random.default_rng(11)
INITIAL = np.column_stack([RNG.uniform(-3, 3, (6, 2)), RNG.normal(0, 4, (6, 2))])
REMEMBERING = [name for name, effect in OF_FREE_SWINGS.items() if effect.internal]
ABSOLUTE = CONSTANTS._replace(relative2=0.0)
EXACT = 1e-12


def typical(*names, factor=1.0):
    at = {"missed_counts": {"time_s": 0.1, "run": 0.0}}
    return effect_params(
        {n: {p.name: factor * p.typical for p in EFFECTS[n].amplitudes} | at.get(n, {}) for n in names}
    )


def compare(params, constants=CONSTANTS, layout=SEGMENTS, internal=None):
    """Compare many candidates in one call with each candidate in a separate call."""
    bases = BASE * RNG.uniform(0.95, 1.05, (len(params), 6))
    initial = INITIAL + RNG.normal(0, 0.01, (len(params), 6, 4))
    together = predict_batch(bases, params, constants, layout, initial, internal, arm=True)
    for i in range(len(params)):
        alone, internal_starts = read_segments(bases[i], params[i], constants, layout, initial[i], internal)
        np.testing.assert_allclose(together[i], alone, atol=EXACT, rtol=0)
        _, passed = predict_with_internal([bases[i]], [params[i]], constants, layout, [initial[i]])
        yield internal_starts, passed[0]


def test_every_effect_alone_and_none():
    for _ in compare(np.array([effect_params({}), *map(typical, OF_FREE_SWINGS)])):
        pass


def test_pairs_and_all_at_once():
    pairs = list(itertools.combinations(OF_FREE_SWINGS, 2))
    chosen = [pairs[i] for i in RNG.permutation(len(pairs))[:120]]
    everything = typical(*OF_FREE_SWINGS, factor=0.3)
    for _ in compare(np.array([everything, *(typical(*pair) for pair in chosen)])):
        pass


def test_pairs_with_internal_states_pass_them_on():
    own = {name: INTERNAL.index(f"{name}.{EFFECTS[name].internal[0].name}") for name in REMEMBERING}
    pairs = list(itertools.product(REMEMBERING, [*REMEMBERING, "latency_joint2", "clock_rate", "load_friction_joint2"]))
    for (one, _), (expected, result) in zip(pairs, compare(np.array([typical(*p) for p in pairs])), strict=True):
        columns = [own[one] + i for i in range(len(EFFECTS[one].internal))]
        np.testing.assert_allclose(result[:, columns], expected[:, columns], atol=EXACT)
        assert (result[1, columns] != 0).all()


def test_internal_states_that_are_held_still():
    given = RNG.uniform(-1, 1, (6, len(INTERNAL))) * [1, 1, 1e-3, 1e-3, 1e-2, 1, 1e-3, 1e-3, 1e-3]
    for _ in compare(np.array([typical(*REMEMBERING)]), internal=given):
        pass
    for _ in compare(
        np.array([typical("hysteresis_joint1")]), internal=given * [1, 1, 1, 0, 0, 1, 1, 1, 1]
    ):  # its arm is held
        pass


def test_an_absolute_encoder():
    for _ in compare(np.array([*map(typical, OF_FREE_SWINGS)]), ABSOLUTE):
        pass


def test_effects_that_differ_between_runs():
    each = np.array([*map(typical, OF_FREE_SWINGS)])
    for _ in compare(np.stack([each, each[::-1], np.roll(each, 7, axis=0)], axis=1)):
        pass


def test_steps_that_differ_between_segments():
    layout = segments(TIMES, SEGMENTS.run, SETUPS, step=[2.5e-3, 1e-3, 4e-3, 2.5e-3, 3e-3, 7e-4])
    for _ in compare(np.array([*map(typical, OF_FREE_SWINGS), typical(*REMEMBERING)]), layout=layout):
        pass


def test_a_candidate_has_the_same_bits_in_any_company():
    params = np.array([*map(typical, OF_FREE_SWINGS), *map(typical, OF_FREE_SWINGS)])
    bases, initial = BASE * RNG.uniform(0.95, 1.05, (len(params), 6)), np.repeat(INITIAL[None], len(params), 0)
    together = predict_batch(bases, params, CONSTANTS, SEGMENTS, initial)
    order = RNG.permutation(len(params))
    shuffled = predict_batch(bases[order], params[order], CONSTANTS, SEGMENTS, initial[order])
    np.testing.assert_array_equal(shuffled, together[order])
    for i in order[:10]:
        one = slice(i, i + 1)
        np.testing.assert_array_equal(
            predict_batch(bases[one], params[one], CONSTANTS, SEGMENTS, initial[one])[0], together[i]
        )


def test_a_set_with_internal_states_has_the_same_bits_in_few_lanes():
    params = np.array([typical("coulomb_joint1", name) for name in REMEMBERING])
    of_two_runs = segments(TIMES[:5], SEGMENTS.run[:5], SETUPS[:2])
    bases, initial = np.repeat(BASE[None], len(params), 0), np.repeat(INITIAL[None, :5], len(params), 0)
    together = predict_batch(bases, params, CONSTANTS, of_two_runs, initial, arm=True)
    for i in range(len(params)):
        one = slice(i, i + 1)
        alone = predict_batch(bases[one], params[one], CONSTANTS, of_two_runs, initial[one], arm=True)
        np.testing.assert_array_equal(alone[0], together[i])


def test_a_failed_candidate_spoils_none_that_comes_after_it_in_its_lane():
    params = np.array([typical("coulomb_joint1")] * (3 * LANES))
    bases = np.repeat(BASE[None], len(params), 0)
    bases[: LANES // 2] = np.nan
    bases[LANES // 2 : LANES] *= [1, 1, 50, 1, 1, 1]
    result = predict_batch(bases, params, CONSTANTS, SEGMENTS, np.repeat(INITIAL[None], len(params), 0))
    assert not np.isfinite(result[: LANES // 2]).any()
    np.testing.assert_array_equal(result[LANES:], np.broadcast_to(result[-1], result[LANES:].shape))


def test_tracks_hold_every_candidate_on_every_segment_once():
    params = np.array([effect_params({}), typical("hysteresis_joint1"), typical("coulomb_joint1"), effect_params({})])
    active = active_effects(params)[:, None]
    chained = np.array([[False], [True], [False], [False]])
    tracks = tracks_of(active, chained, SEGMENTS.run, SEGMENTS.chains)
    seen = [(c, s) for c, i, j in zip(*tracks[:3], strict=True) for s in range(i, j)]
    assert sorted(seen) == [(c, s) for c in range(4) for s in range(6)]
    assert (np.diff(tracks.edges) <= LANES).all()
    for block, (i, j) in enumerate(itertools.pairwise(tracks.edges)):
        assert (active[tracks.candidate[i:j], 0] == tracks.active[block]).all()
    assert sorted(tracks.last - tracks.first)[-3:] == [1, 2, 3]


@pytest.mark.parametrize("name", ["latency_joint2", "clock_rate"])
def test_invalid_instants_give_nan(name):
    params = np.array([typical(name, factor=np.nan), typical(name)])
    result = predict_batch([BASE] * 2, params, CONSTANTS, SEGMENTS, [INITIAL] * 2)
    assert np.isnan(result[0]).all()
    assert np.isfinite(result[1]).all()
