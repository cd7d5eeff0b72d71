"""Drawn plants: kind, visibility, and equal recordings with and without the protocol."""

from itertools import product

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS, OF_FREE_SWINGS
from dpr_lab.effects.wrong_length import WRONG_LENGTH
from dpr_lab.errors import ConfigError
from dpr_lab.rig import MASSES
from dpr_lab.rig_tables import Parameter
from sim_device.plant.config import EncoderConfig, load_plant
from sim_device.plant.foreign import FOREIGN, FORMS, OUTSIDE
from sim_device.random_streams import RandomStream, generator
from sim_device.trials.draw import (
    NOT_DRAWN,
    alike,
    described,
    dirty,
    draw_plant,
    logger_fault,
    visible_effects,
)
from sim_device.trials.noiseless import plant_gap
from sim_device.trials.offline_recorder import record
from sim_device.trials.parameters import weighed
from sim_device.trials.request import FREE_SWINGS, LEVELS, EffectRequest, parse_request, with_kind
from tests.thinned import thinned


def drawn(wanted: EffectRequest, seed: int, rig):
    return draw_plant(wanted, load_plant("paper", seed), rig)


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    thinned(
        product(LEVELS, ["coulomb_joint1", "latency_joint2", "missed_counts", "encoder_eccentricity_joint2"]),
        11,
    ),
)
def test_one_effect_opens_a_gap_of_its_level(paper, case):
    level, name = case
    plant = drawn(EffectRequest("single", level, (name,)), 4, paper)
    lower, upper = LEVELS[level]
    assert list(plant.effects) == [name]
    assert 0.95 * lower < plant_gap(plant, paper) < 1.05 * upper


def test_without_effects_there_is_no_gap(paper):
    assert plant_gap(drawn(EffectRequest("clean"), 1, paper), paper) < 0.01


@pytest.mark.slow
def test_the_smaller_of_two_effects_is_a_fifth_as_visible(paper):
    plant = drawn(EffectRequest("pair"), 6, paper)
    large, small = (
        plant_gap(plant.model_copy(update={"effects": {name: values}}), paper) for name, values in plant.effects.items()
    )
    assert small / large == pytest.approx(0.2, rel=0.1)
    assert small > 1.9


@pytest.mark.long
def test_three_drawn_effects_are_different(paper):
    names = list(drawn(EffectRequest("triple"), 2, paper).effects)
    assert len(names) == 3
    assert not any(alike(one, other) for one in names for other in names if one != other)


def test_effects_that_a_swing_cannot_show_are_never_drawn():
    assert "rotor_inertia_joint1" not in visible_effects()
    assert set(OF_FREE_SWINGS) - set(visible_effects()) <= {"rotor_inertia_joint1", *NOT_DRAWN}


@pytest.mark.long
def test_the_plant_depends_on_the_seed_only(paper):
    one, same, other = (drawn(EffectRequest("single"), seed, paper) for seed in (11, 11, 12))
    assert one == same
    assert one.parameters != other.parameters


@pytest.mark.long
def test_a_drawn_plant_can_be_built_and_read_back(paper):
    plant = drawn(EffectRequest("form", effects=("power_drag_outer",)), 3, paper)
    assert type(plant).model_validate_json(plant.model_dump_json()) == plant


@pytest.mark.long
def test_foreign_effects_are_drawn_from_the_half_asked_for(paper):
    for text, held_back in (("outside:clear:held_back", True), ("outside:clear:tuning", False)):
        (name,) = drawn(parse_request(text), 3, paper).foreign
        assert FOREIGN[name].held_back == held_back


def test_both_lists_of_foreign_effects_have_eight_and_are_halved():
    for names in (FORMS, OUTSIDE):
        held = sum(FOREIGN[name].held_back for name in names)
        assert len(names) >= 8
        assert 2 * held == len(names)
    assert all(member in EFFECTS.values() for name in FORMS for member in FOREIGN[name].family)


@pytest.mark.parametrize("text", ["two", "single:big", "single:clear:gremlins"])
def test_impossible_draws_are_refused_with_the_reason(text):
    with pytest.raises(ConfigError, match="draw"):
        parse_request(text)


def test_dirty_encoders_have_at_least_one_fault():
    clean = EncoderConfig(noise_counts=(0.5, 0.5, 0.5))
    drawn = [dirty(generator(seed, RandomStream.DRAW)) for seed in range(40)]
    assert clean not in drawn
    assert {e.step_counts for e in drawn} == {1, 4}
    assert all(0.01 <= e.missing_share <= 0.02 for e in drawn if e.missing_share)


def test_any_kind_is_drawn_from_the_seed_and_the_level_stays():
    texts = {with_kind("any:subtle", seed) for seed in range(60)}
    assert texts == {f"{kind}:subtle" for kind in FREE_SWINGS}
    assert with_kind("any", 3) == with_kind("any", 3)
    assert with_kind("pair:clear", 3) == "pair:clear"


def test_a_weighed_rig_knows_its_masses_as_well_as_scales_do(paper):
    for seed in range(20):
        plant, rig = weighed(load_plant("paper", seed), paper)
        for name in ("m1", "m2", "mb"):
            known = rig.parameters[name]
            assert abs(known.measured - plant.parameters[name]) < 5 * known.std
        assert [name for name, p in rig.parameters.items() if p.measured is not None] == ["m1", "m2", "mb"]
    assert plant.parameters["m1"] != load_plant("paper").parameters["m1"]


def test_what_a_rig_file_has_measured_stays_measured(paper):
    m1 = Parameter(nominal=0.1, measured=0.104, std=1e-3)
    measured = paper.model_copy(update={"parameters": {**paper.parameters, "m1": m1}})
    plant, rig = weighed(load_plant("paper", 1), measured)
    assert rig.parameters["m1"] == m1
    assert plant.parameters["m1"] == load_plant("paper").parameters["m1"]


def encoders(paper, **changes):
    plant = load_plant("paper", 3)
    update = {"encoders": plant.encoders.model_copy(update=changes)}
    return record(plant.model_copy(update=update), paper, duration=2.0)[1]


def test_coarse_counters_move_by_their_step(paper):
    run = encoders(paper, noise_counts=0.0, step_counts=4)
    assert run.counts is not None
    assert (run.counts % 4 == 0).all()
    assert np.diff(np.unique(run.counts[:, 1])).min() == 4


def test_missing_samples_are_absent_and_the_others_stay_as_they_were(paper):
    whole, holed = encoders(paper), encoders(paper, missing_share=0.02)
    lost = len(whole.t) - len(holed.t)
    assert 20 < lost < 60
    assert holed.lost["tick_gap"] == lost
    assert np.array_equal(whole.counts[np.isin(whole.t, holed.t)], holed.counts)


def test_repeated_samples_have_the_value_of_the_one_before(paper):
    whole, doubled = encoders(paper).swing, encoders(paper, repeated_share=0.01).swing
    changed = np.flatnonzero((whole.counts != doubled.counts).any(axis=1))
    assert 8 < len(changed) < 40
    assert np.array_equal(doubled.counts[changed], whole.counts[changed - 1])


@pytest.mark.parametrize("ticks", [1, 3])
def test_late_samples_have_the_value_of_a_later_one(paper, ticks):
    whole, late = (
        encoders(paper, noise_counts=0.0, **fault).swing for fault in ({}, {"late_every": 7, "late_ms": float(ticks)})
    )
    at = np.arange(6, len(whole.t) - ticks, 7)
    rest = np.delete(np.arange(len(whole.t)), np.arange(6, len(whole.t), 7))
    assert np.abs(late.counts[at] - whole.counts[at + ticks]).max() <= 1
    assert np.array_equal(late.counts[rest], whole.counts[rest])


def test_stale_samples_repeat_the_one_before_in_a_cycle(paper):
    whole, stale = encoders(paper).swing, encoders(paper, stale_every=9).swing
    at = np.arange(8, len(whole.t), 9)
    assert np.array_equal(stale.counts[at], whole.counts[at - 1])


@pytest.mark.long
def test_the_seed_alone_decides_on_the_background(paper):
    first, again, other = (drawn(EffectRequest("background"), seed, paper) for seed in (3, 3, 4))
    assert first == again != other


@pytest.mark.long
def test_an_effect_with_background_is_the_most_visible_of_several(paper):
    first = drawn(EffectRequest("background"), 3, paper)
    assert any(name.startswith("encoder_offset") for name in first.effects)
    longer = first.effects[WRONG_LENGTH.name]["added_m"]
    assert 0.0 < abs(longer) < 0.02 * paper.L1
    visible = {name: values for name, values in first.effects.items() if name != WRONG_LENGTH.name}
    name, *small = visible
    small = [one for one in small if not one.startswith("encoder_offset")]
    assert 2 <= len(small) <= 6
    gaps = [plant_gap(first.model_copy(update={"effects": {n: v}}), paper) for n, v in visible.items()]
    assert gaps[0] > 1.9
    assert max(gaps[1:]) < 0.7
    assert not any(alike(one, two) for one in small for two in (name, *small) if one != two)


def test_with_background_the_masses_are_known_to_one_per_cent(paper, monkeypatch):
    monkeypatch.setattr("sim_device.trials.draw.sized", lambda plant, rig, name, unit, gap: unit)  # of its effects
    plant, rig = weighed(load_plant("paper", 3), paper)
    drawn_plant = draw_plant(EffectRequest("background"), plant, rig)
    rig_file = described(EffectRequest("background"), rig)
    for name in MASSES:
        known = rig_file.parameters[name]
        assert known.std == pytest.approx(0.01 * known.measured)
        assert 0.0 < abs(drawn_plant.parameters[name] / known.measured - 1) < 0.04
    assert described(EffectRequest("single"), rig) is rig


def test_stretches_of_a_swing_are_repeated_or_lost(paper):
    whole = encoders(paper).swing
    stale = encoders(paper, stale_every=4, stale_from_s=1.0, stale_for_s=0.5).swing
    first = int(np.searchsorted(whole.t, 1.0))
    at = np.flatnonzero((stale.counts != whole.counts).any(axis=1))
    last = np.searchsorted(whole.t, 1.5)
    assert set(at.tolist()) <= set(range(first, last)) & set(range(3, len(whole.t), 4))
    assert len(at) > 0.9 * (last - first) / 4
    assert np.array_equal(stale.counts[at], whole.counts[at - 1])
    lost = encoders(paper, lost_from_s=1.0, lost_for_s=0.3).swing
    assert not np.any((lost.t >= 1.0) & (lost.t < 1.3 - 1e-9))
    assert len(whole.t) - len(lost.t) == round(0.3 * whole.rate_hz)


def test_a_logger_fails_in_one_of_six_ways_or_in_two():
    kinds = [logger_fault(generator(seed, RandomStream.DRAW)).model_dump(exclude_defaults=True) for seed in range(80)]
    alone = [
        {"late_every", "late_ms"},
        {"stale_every"},
        {"stale_every", "stale_from_s", "stale_for_s"},
        {"repeated_share"},
        {"jitter_ms"},
        {"lost_from_s", "lost_for_s"},
    ]
    drawn_kinds = [set(kind) for kind in kinds]
    assert all(one in drawn_kinds for one in alone)
    together = [kind for kind in drawn_kinds if kind not in alone]
    assert 10 < len(together) < 45
    assert all(any(kind == one | other for one in alone for other in alone) for kind in together)


def test_jitter_reads_the_swing_a_little_earlier_or_later(paper):
    still, shaken = (encoders(paper, noise_counts=0.0, jitter_ms=ms).swing for ms in (0.0, 0.2))
    speed = np.gradient(still.theta[:, 1], still.t)
    fast = np.abs(speed) > 3.0
    shift = (shaken.theta - still.theta)[fast, 1] / speed[fast]
    assert np.std(shift) == pytest.approx(2e-4, rel=0.1)
    assert abs(np.mean(shift)) < 3e-5
