"""Reproducible share of the gap on rigs with known truth, simulated by SciPy."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.gap_budget import GapBudget
from dpr_lab.gap.transfer.repeatability import budget_of
from dpr_lab.report.gap.summary import repeatability_bar, repeatability_sentences
from dpr_lab.shown import percent
from tests.background_rigs import Law, law, record, recordings, rig_and_base
from tests.thinned import candidates

POSES = ("X1", "X2", "X3")
FRICTION = ("coulomb", "stribeck", "friction", "hysteresis", "load")
SMOOTH = ("spring", "air_drag", "encoder_offset", "latency", "base_tilt")


def each_its_own(laws: Sequence[Law], seed: int, **library: str) -> Diagnosis:
    """Diagnose recordings of one rig, each with another effect."""
    rng = np.random.default_rng(seed)
    rig, base = rig_and_base(rng)
    runs = [record(rig, base, [own], rng, pose) for pose, own in zip(POSES, laws, strict=True)]
    names = {k: EFFECTS[k] for k in library} if library else EFFECTS
    return diagnose([replace(run, name="swing") for run in runs], rig, library=names)


def of(diagnosis: Diagnosis) -> GapBudget:
    budget = diagnosis.gap.budget
    assert budget is not None
    shares = [budget.explained, budget.varying, budget.unmodelled, budget.not_reproducible, budget.noise]
    assert sum(shares) == pytest.approx(1.0)
    return budget


def test_shares_sum_to_one_for_any_remainder() -> None:
    for levels in ([5.0, 9.0, 1.0, -3.0], [np.inf, 2.0, np.nan, 1.0], [0.0, 0.0, 0.0, 0.0]):
        budget = budget_of(levels, 2.0, ["a", "b"], (), "")
        shares = [budget.explained, budget.varying, budget.unmodelled, budget.not_reproducible, budget.noise]
        assert sum(shares) == pytest.approx(1.0)
        assert min(shares) >= 0


@pytest.mark.parametrize(
    ("verdict", "explained", "stated"), [("named", 0.8, True), ("named", 0.9, False), ("partial", 0.8, False)]
)
def test_a_named_cause_with_a_share_below_all_states_what_the_share_is_of(verdict, explained, stated) -> None:
    shares = {"varying": 0.0, "unmodelled": 0.0, "not_reproducible": 0.9 - explained, "noise": 0.1}
    budget = GapBudget(basis="recordings", explained=explained, **shares)
    gap = SimpleNamespace(budget=budget, closed_held_out=SimpleNamespace(held_out={}))
    diagnosis: Any = SimpleNamespace(verdict=verdict, gap=gap)
    text = " ".join(repeatability_sentences(diagnosis))
    share = percent(explained / 0.9)
    assert text.startswith(f"Fitted to the other recordings, the corrected model explains {share} of the mean")
    assert ("A fit to all recordings leaves only noise." in text) == stated


def test_the_share_of_a_model_without_confirmed_causes_is_not_that_of_causes() -> None:
    budget = GapBudget(basis="recordings", explained=0.5, varying=0.0, unmodelled=0.4, not_reproducible=0.0, noise=0.1)
    gap = SimpleNamespace(budget=budget, closed_held_out=SimpleNamespace(held_out={}))
    diagnosis: Any = SimpleNamespace(verdict="unexplained", gap=gap, model_effects={"spring_joint1": {}})
    assert "whose effects are not confirmed as causes, explains 56 %" in repeatability_sentences(diagnosis)[0]


@pytest.mark.slow
def test_a_clean_rig_has_only_noise() -> None:
    rig, runs, _ = recordings(1, [])
    diagnosis = diagnose(runs, rig, library=candidates("coulomb", *SMOOTH))
    budget = of(diagnosis)
    assert budget.noise > 0.98
    assert budget.of_reproducible is None
    assert (repeatability_bar(diagnosis), repeatability_sentences(diagnosis)) == (None, [])


@pytest.mark.slow
def test_a_named_effect_explains_all_that_is_reproducible() -> None:
    rig, runs, _ = recordings(2, [law("coulomb", 0, 4)])
    diagnosis = diagnose(runs, rig, library=candidates("coulomb", *SMOOTH))
    budget = of(diagnosis)
    assert budget.explained > 0.8
    assert budget.of_reproducible == pytest.approx(1.0, abs=0.02)
    assert budget.parameters == []
    bar = repeatability_bar(diagnosis)
    assert bar is not None
    assert sum(share for _, share in bar.parts) == pytest.approx(1.0)
    assert "% of the mean squared gap, and 100 % of its reproducible part" in repeatability_sentences(diagnosis)[0]
    assert (diagnosis.gap.remainder_Nm, diagnosis.gap.remainder_rad) == ({}, {})
    assert "remainder" not in diagnosis.sentence


@pytest.mark.slow
def test_pieces_of_a_single_recording_serve_and_say_so() -> None:
    rig, runs, _ = recordings(2, [law("coulomb", 0, 4)])
    diagnosis = diagnose(runs[:1], rig, library=candidates("coulomb", *SMOOTH))
    assert of(diagnosis).basis == "pieces of one recording"
    assert of(diagnosis).of_reproducible == pytest.approx(1.0, abs=0.02)
    assert "cannot show differences between releases" in repeatability_sentences(diagnosis)[1]


@pytest.mark.long
def test_a_parameter_drawn_for_each_recording_varies() -> None:
    result = each_its_own([law("coulomb", 0, size) for size in (4, 5, 6)], 3, coulomb_joint1="")
    budget = of(result)
    assert budget.varying > 0.1
    assert budget.not_reproducible < 0.02
    (parameter,) = budget.parameters
    assert (parameter.effect, parameter.name) == ("coulomb_joint1", "torque_Nm")
    assert parameter.spread == pytest.approx(1e-3, rel=0.1)
    assert list(parameter.values) == ["swing", "swing (2)", "swing (3)"]
    assert np.diff([*parameter.values.values()]) == pytest.approx([1e-3, 1e-3], rel=0.1)
    assert parameter.sigmas > 10
    sentence = repeatability_sentences(result)[1]
    assert sentence.startswith("Between recordings torque of Coulomb friction, joint 1 [coulomb_joint1] varies from 3.")
    assert re.search(
        r"from 3\.\d+ mN m \(.*\) in swing to 5\.\d+ mN m \(.*\) in swing \(3\)\. Its scatter is", sentence
    )
    assert "the standard deviation of the true value is 1.0" in sentence


@pytest.mark.slow
def test_a_law_outside_the_library_is_reproducible_and_unmodelled(few_readings: Callable[[str], None]) -> None:
    few_readings("no interpretation is expected")
    rig, runs, _ = recordings(4, [law("coulomb", 0, 4)])
    library = {name: effect for name, effect in candidates(*SMOOTH).items() if not name.startswith(FRICTION)}
    diagnosis = diagnose(runs, rig, library=library)
    assert diagnosis.verdict in ("unexplained", "partly_explained")
    assert all(effect.probability < 0.5 for effect in diagnosis.effects)
    budget = of(diagnosis)
    assert budget.unmodelled > 0.5
    assert budget.not_reproducible < 0.1
    assert budget.of_reproducible is not None
    assert budget.of_reproducible < 0.5


@pytest.mark.long
def test_a_disturbance_of_each_recording_alone_is_not_reproducible() -> None:
    laws = [law("wander", 0, 2, seed) for seed in range(3)]
    budget = of(each_its_own(laws, 5, **dict.fromkeys(candidates("coulomb", *SMOOTH), "")))
    assert budget.not_reproducible > 0.5
    assert budget.unmodelled < 0.05


@pytest.mark.slow
def test_too_few_segments_cannot_decide() -> None:
    rig, runs, _ = recordings(2, [law("coulomb", 0, 8)], seconds=2.0)
    diagnosis = diagnose(runs[:1], rig, library=candidates("coulomb", *SMOOTH))
    assert of(diagnosis).undecided.startswith("Quarters of a recording with fewer than 3 segments")
    assert of(diagnosis).of_reproducible is None
    assert "do not show which part of the gap is reproducible" in repeatability_sentences(diagnosis)[0]


def test_a_budget_without_decided_shares_has_a_part_of_the_gap_if_effects_explain_one() -> None:
    def of_gap(explained: float, undecided: str) -> float | None:
        shares = {"explained": explained, "not_reproducible": 0.5 - explained, "undecided": undecided}
        return GapBudget(basis="recordings", varying=0.0, unmodelled=0.0, noise=0.5, **shares).of_gap

    assert of_gap(0.0, "too few segments") is None
    assert of_gap(0.2, "too few segments") == pytest.approx(0.4)
    assert of_gap(0.0, "") == 0.0
