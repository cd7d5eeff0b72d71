"""A measured value under each candidate cause, and under none of them: probabilities, questions and refusals."""

import itertools
import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy import integrate

from dpr_lab.checks.update import _remedies, candidates, hypotheses, posterior, update
from dpr_lab.effects import EFFECTS
from dpr_lab.effects.units import UNITS, read_quantity
from dpr_lab.errors import RunError
from dpr_lab.gap.advice import bench_measurement
from dpr_lab.gap.advice.check_kind import CheckAnswer, OpenQuestion
from dpr_lab.gap.advice.measurement import CHECK, Predictions, predictions
from dpr_lab.gap.conclusion.causes import to_rule_out, to_simulator
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.result.checks import NONE_OF_THEM, PLUMB_LINE, Quantity
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import Exclusion
from dpr_lab.report.digits import NONE
from dpr_lab.report.gap.check_tables import check_table, how_to_record
from tests.a_diagnosis import CLOCK, LENGTH, SIZES, interval, made, measurement
from tests.thinned import thinned


def after(diagnosis: Diagnosis) -> dict[str, float]:
    return diagnosis.checks_done[-1].after


def test_each_member_of_a_class_can_be_measured() -> None:
    tilts = ("base_tilt", "encoder_offset_joint1")
    question = OpenQuestion(
        tilts[0], dict.fromkeys(tilts, 0.5), one_class=True, chosen=cast("Hypothesis", None), expected=()
    )
    level, encoder = bench_measurement.propose(question, [])
    assert level.text.endswith("(tilt), in mrad.")
    assert encoder.text.startswith("Read encoder 1")
    assert level.splits == encoder.splits == [*tilts]


def test_an_alternative_that_a_recording_separates_needs_no_measurement() -> None:
    question = OpenQuestion(
        "base_tilt", {"base_tilt": 0.6, "spring_joint1": 0.3}, False, cast("Hypothesis", None), expected=()
    )
    recording = question.check("recording", "Record a release.", question.causes, 0.5)
    assert bench_measurement.propose(question, [recording]) == []
    assert [check.measures for check in bench_measurement.propose(question, [])] == ["base_tilt"]


def test_a_value_that_agrees_with_the_fit_confirms_its_effect() -> None:
    result = update(made(), made().checks[0], CheckAnswer(value=0.0051, std=1e-4))
    assert after(result)[CLOCK] > 0.97
    assert result.verdict == "named"
    assert result.checks_done[0].log10_bayes_factor[CLOCK] > 1.5


def test_a_value_that_fits_no_candidate_is_questioned_and_if_confirmed_supports_another_cause() -> None:
    diagnosis = made()
    with pytest.raises(RunError, match=r"predicts 50 % for .*It is 99 times the estimate .*, 0.505 %") as refused:
        update(diagnosis, diagnosis.checks[0], CheckAnswer(value=0.5, std=1e-9))
    assert "--force" in str(refused.value)
    result = update(diagnosis, diagnosis.checks[0], CheckAnswer(value=0.5, std=1e-9, confirmed=True))
    assert after(result)[NONE_OF_THEM] > 0.999
    assert result.probabilities[NONE_OF_THEM] > 0.999
    assert result.verdict == "unexplained"
    assert result.sentence.startswith("After check 1-abcd")
    assert "none of the named effects explains the measured value" in result.sentence
    assert result.remedies == []


def test_both_candidates_measured_as_zero_leave_neither() -> None:
    first = update(made(), made().checks[0], CheckAnswer(value=0.0, std=1e-5))
    assert after(first)[LENGTH] > 0.9
    assert first.verdict == "named"
    second = update(first, first.checks[0], CheckAnswer(value=0.0, std=1e-4))
    assert second.checks_done[1].before == after(first)
    assert after(second)[NONE_OF_THEM] > 0.999
    assert second.verdict == "unexplained"


def test_zero_within_a_large_uncertainty_is_no_evidence() -> None:
    result = update(made(), made().checks[0], CheckAnswer(value=0.0, std=1.0))
    assert after(result)[CLOCK] == pytest.approx(0.49, abs=0.02)


def test_an_uncertainty_far_below_the_possible_has_no_further_effect() -> None:
    diagnosis = made()
    first, second = (
        after(update(diagnosis, diagnosis.checks[0], CheckAnswer(value=0.0052, std=std))) for std in (1e-6, 1e-15)
    )
    assert first == pytest.approx(second, rel=1e-3)


@pytest.mark.parametrize(
    ("value", "std", "message"),
    [
        (math.nan, 1e-4, "must be a finite number, not nan"),
        (math.inf, 1e-4, "must be a finite number, not inf"),
        (1e308, 1e-4, "is impossible for the rate error of the device's clock"),
        (0.005, 1e308, "is impossible for the rate error of the device's clock"),
        (0.005, 0.0, "uncertainty must be above 0 and finite, not 0"),
        (0.005, -1.0, "uncertainty must be above 0 and finite, not -1"),
        (0.005, math.nan, "uncertainty must be above 0 and finite, not nan"),
    ],
)
def test_impossible_numbers_are_refused_with_a_sentence(value: float, std: float, message: str) -> None:
    diagnosis = made()
    with pytest.raises(RunError, match=message):
        update(diagnosis, diagnosis.checks[0], CheckAnswer(value=value, std=std, confirmed=True))


def friction() -> Diagnosis:
    """A diagnosis that names Stribeck friction or Coulomb friction of joint 2."""
    name, simple = "stribeck_joint2", "coulomb_joint2"
    parameters = {"torque_Nm": interval(0.0061), "extra_at_rest_Nm": interval(0.0005, 0.1)}
    effect = {"name": name, "class": [name, simple], "probability": 0.9, "parameters": parameters, "share": 0.9}
    check = {**measurement(CLOCK, name, 1), "measures": name, "splits": [name, simple], "expected": None}
    check |= {"quantity": "extra_at_rest_Nm, N m"}
    return made(effects=[effect], checks=[check], model_effects={}, remedies=[])


def test_a_value_of_the_other_torque_is_recognised() -> None:
    diagnosis = friction()
    assert diagnosis.checks[0].quantity == Quantity.of("stribeck_joint2", "extra_at_rest_Nm")
    expected = r"predicts 6.1 mN m for .*It is 12.2 times the estimate of this quantity, 0.5 mN m .*"
    with pytest.raises(RunError, match=expected + r"Did you measure the Coulomb friction torque while sliding of"):
        update(diagnosis, diagnosis.checks[0], CheckAnswer(value=0.0061, std=1e-4))


def test_a_value_of_another_quantity_is_questioned_where_the_one_to_measure_is_not_determined() -> None:
    name, simple = "coulomb_joint2", "stribeck_joint2"
    effect = {"name": name, "class": [name, simple], "probability": 0.98, "share": 0.9}
    check = {**measurement(CLOCK, name, 1), "measures": simple, "splits": [name, simple], "expected": None}
    effect |= {"parameters": {"torque_Nm": interval(0.00091)}}
    check |= {"quantity": "extra_at_rest_Nm, N m"}
    diagnosis = made(effects=[effect], checks=[check], model_effects={}, remedies=[])
    asked = r"do not determine the extra friction torque at rest.*Did you measure the Coulomb friction torque of"
    with pytest.raises(RunError, match=asked):
        update(diagnosis, diagnosis.checks[0], CheckAnswer(value=0.0009, std=5e-5))
    with pytest.raises(RunError, match=r"6 mN m is 6.59 times the Coulomb friction torque of .*, 0.91 mN m"):
        update(diagnosis, diagnosis.checks[0], CheckAnswer(value=0.006, std=1e-4))
    limit = Exclusion(effect=simple, parameter="extra_at_rest_Nm", size=1.06e-3, estimate=0.0, confidence=0.999)
    limited = diagnosis.model_copy(update={"evidence": SimpleNamespace(exclusions=[limit])})
    with pytest.raises(
        RunError, match=r"at rest, joint 2\. They exclude only sizes of 1.06 mN m or more\. Did you measure"
    ):
        update(limited, limited.checks[0], CheckAnswer(value=0.001, std=2e-4))
    assert check_table(limited).rows[0][3] == "below 1.06 mN m"
    assert "provided that all named effects act" in check_table(limited).caption
    assert check_table(diagnosis).rows[0][3] == NONE
    assert '--value "... mN m" --std "... mN m" (measurement)' in how_to_record(limited, "d.json")  # no number to copy
    confirmed = CheckAnswer(value=0.0009, std=5e-5, confirmed=True)
    assert update(diagnosis, diagnosis.checks[0], confirmed).checks_done
    assert update(diagnosis, diagnosis.checks[0], CheckAnswer(value=0.0004, std=5e-5)).checks_done


def test_the_command_states_the_unit_of_each_measurement() -> None:
    options = '--value "... %" --std "... %" (check 1-abcd) or --value "... mm" --std "... mm" (check 2-abcd).'
    assert how_to_record(made(), "d.json").endswith(f"followed by {options}")


def test_a_result_has_the_unit_of_the_expected_result() -> None:
    diagnosis = friction()
    (done,) = update(diagnosis, diagnosis.checks[0], CheckAnswer(value="0.4 mN m", std="0.05")).checks_done
    assert done.result == "extra friction torque at rest, joint 2 = 0.4 mN m ± 0.05 mN m"
    assert done.value == pytest.approx(4e-4)
    assert diagnosis.checks[0].measurand.label.endswith("(S), in mN m")
    for effect in EFFECTS.values():
        quantity = Quantity.of(effect.name, effect.amplitudes[0].name)
        _, of_joint, joint = effect.name.rpartition("_joint")
        assert not of_joint or quantity.name.endswith(f", joint {joint}")
        if quantity.unit in UNITS:
            assert read_quantity(quantity.shown(0.002), quantity.unit, "") == pytest.approx(0.002), effect.name


@pytest.mark.parametrize(
    ("measured", "value", "remedies"),
    [
        (0, SIZES[CLOCK], [f"For {CLOCK}: divide.", "Level the base."]),
        (0, 0.0, ["Level the base."]),
        (1, 0.0, [f"For {CLOCK}: divide.", "Level the base."]),
    ],
)
def test_a_settled_class_has_no_cause_left_to_rule_out(measured: int, value: float, remedies: list[str]) -> None:
    first = f"For {CLOCK}: divide (first rule out {LENGTH}, which these recordings cannot exclude)."
    diagnosis = made(remedies=[first, "Level the base."])
    assert update(diagnosis, diagnosis.checks[measured], CheckAnswer(value=value, std=1e-4)).remedies == remedies
    assert update(diagnosis, diagnosis.checks[0], CheckAnswer(value=0.005, std=3e-3)).remedies == diagnosis.remedies


def test_a_measurement_of_the_last_candidate_tests_it_against_any_other_cause() -> None:
    diagnosis, camera = made(), PLUMB_LINE
    diagnosis = diagnosis.model_copy(update={"advice": [camera, *(check.sentences for check in diagnosis.checks)]})
    result = update(diagnosis, diagnosis.checks[0], CheckAnswer(value=0.0, std=1e-4))
    p = after(result)[LENGTH]
    assert p > 0.9
    (left,) = result.checks
    entropy = -p * math.log2(p) - (1 - p) * math.log2(1 - p)
    assert left.expected_bits == pytest.approx(entropy, rel=1e-2)
    assert left.informative
    assert result.advice == [camera, left.sentences]  # a check of the camera has no result to record


def test_friction_is_not_negative() -> None:
    diagnosis = friction()
    with pytest.raises(RunError, match="cannot be negative"):
        update(diagnosis, diagnosis.checks[0], CheckAnswer(value=-0.0005, std=1e-5, confirmed=True))
    assert update(diagnosis, diagnosis.checks[0], CheckAnswer(value=-1e-5, std=1e-5)).checks_done


def densities(diagnosis: Diagnosis) -> tuple[Predictions, dict[str, float]]:
    check = diagnosis.checks[0]
    return predictions(diagnosis, check, candidates(diagnosis, check.about)), hypotheses(diagnosis, check.about)


def integrated(y: float, u: float, size: Any) -> float:
    """Density of a measured y by numerical integration over the true amplitude, whose density is `size`."""
    from scipy.stats import norm  # slow to import

    def integrand(true: float) -> float:
        return float(norm.pdf(y, true, u) * size.pdf(true))

    near = [size.mean() + k * size.std() for k in (-9, -3, 0, 3, 9)] if math.isfinite(size.std()) else [0.0]
    pieces = sorted({*near, *(y + k * u for k in (-30, -5, 0, 5, 30))})
    return sum(integrate.quad(integrand, a, b, limit=200)[0] for a, b in itertools.pairwise(pieces))


@pytest.mark.parametrize(("y", "u"), [(0.005, 2e-4), (0.0, 1e-4), (0.0042, 5e-4), (0.02, 1e-3), (-0.3, 0.01)])
def test_the_update_is_that_of_numerical_integration(y: float, u: float) -> None:
    from scipy.stats import cauchy, norm

    predicted, prior = densities(made())
    size, background = SIZES[CLOCK], 0.1 * 1e-3
    spread = math.hypot(0.02 * size / 1.6448536, 0.1 * size)
    little, broad = norm(0, background), cauchy(0, 3 * size)
    by_hand = {
        CLOCK: integrated(y, u, norm(size, spread)),
        LENGTH: integrated(y, u, little),
        NONE_OF_THEM: 0.5 * integrated(y, u, little) + 0.5 * integrated(y, u, broad),
    }
    logs = predicted.log_densities(y, u)
    for name, density in by_hand.items():
        if density > 1e-60:
            assert math.exp(logs[name]) == pytest.approx(density, rel=1e-4), name
    probabilities, factors = posterior(prior, logs)
    whole = sum(prior[name] * density for name, density in by_hand.items())
    for name, density in by_hand.items():
        assert probabilities[name] == pytest.approx(prior[name] * density / whole, rel=1e-3, abs=1e-12)
        others = [other for other in prior if other != name]
        average = sum(prior[o] * by_hand[o] for o in others) / sum(prior[o] for o in others)
        if min(density, average) > 1e-60:
            assert 10 ** factors[name] == pytest.approx(density / average, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("u", thinned([1e-4, 1e-9, 1e-2], 3))
def test_the_density_of_a_cause_outside_the_candidates_is_proper(u: float) -> None:
    predicted, _ = densities(made())
    y = np.sinh(np.linspace(-25, 25, 40_001)) * 1e-7
    y = np.concatenate([y, np.linspace(-5, 5, 20_001) * max(u, 1e-4)])
    y.sort()
    density = np.exp([predicted.log_densities(float(v), u)[NONE_OF_THEM] for v in y])
    assert integrate.trapezoid(density, y) == pytest.approx(1.0, abs=2e-3)


@pytest.mark.slow
def test_probabilities_are_calibrated_where_truth_is_drawn_from_the_model() -> None:
    """Of all results after which a hypothesis has the probability p, it is true in a share p."""
    predicted, prior = densities(made())
    rng, names = np.random.default_rng(11), list(prior)
    prior = {CLOCK: 0.4, LENGTH: 0.3, NONE_OF_THEM: 0.3}
    given, true = [], []
    for _ in range(3000):
        cause = names[rng.choice(3, p=list(prior.values()))]
        u = float(np.exp(rng.uniform(np.log(1e-5), np.log(1e-2))))
        size = predicted.candidates.get(cause, predicted.background)
        amplitude = rng.normal(size.mean, size.std)
        if cause == NONE_OF_THEM and rng.random() < CHECK.elsewhere:
            amplitude = predicted.scale * rng.standard_cauchy()
        probabilities, _ = posterior(prior, predicted.log_densities(rng.normal(amplitude, u), u))
        given += [probabilities[name] for name in names]
        true += [name == cause for name in names]
    p, hit = np.array(given), np.array(true)
    for low, high in zip(np.linspace(0, 0.9, 10), np.linspace(0.1, 1, 10), strict=True):
        inside = (p >= low) & (p <= high)
        spread = max(np.sqrt((p[inside] * (1 - p[inside])).sum()), 1.0)
        assert abs(hit[inside].sum() - p[inside].sum()) < 4 * spread, (low, inside.sum())


def test_every_effect_states_the_quantity_to_measure() -> None:
    for effect in EFFECTS.values():
        measured = {effect.amplitudes[0].name, *([effect.adds] if effect.adds else [])}
        for name in measured:
            quantity = effect.bench_quantity(name)
            assert quantity.words != name, effect.name
            assert {*quantity.parameters} <= {amplitude.name for amplitude in effect.amplitudes}
        for quantity in effect.quantities:
            assert len({p.unit for p in effect.amplitudes if p.name in quantity.parameters}) == 1


def test_a_refuted_effect_is_not_added_to_the_simulator() -> None:
    first = made().effects[0].model_copy(update={"name": "coulomb_joint1", "members": ["coulomb_joint1"]})
    second = first.model_copy(update={"name": "air_drag_outer", "members": ["air_drag_outer"]})
    diagnosis = made().model_copy(update={"effects": [first, second], "remedies": to_simulator([first, second])})
    assert "coulomb_joint1 and air_drag_outer" in diagnosis.remedies[0]
    done: Any = SimpleNamespace(after={"coulomb_joint1": 0.1, "stribeck_joint1": 0.9})
    assert _remedies(diagnosis, done, first) == to_simulator([second])


def test_a_member_that_becomes_possible_leaves_the_numbers_of_the_remedy_as_they_are() -> None:
    names = ["encoder_offset_joint1", "base_tilt"]
    (cause,) = made().effects
    before, after = (
        cause.model_copy(update={"name": names[0], "members": names, "odds": dict(zip(names, odds, strict=True))})
        for odds in ((1.0, 5e-5), (0.97, 0.03))
    )
    diagnosis = made().model_copy(update={"effects": [before], "remedies": [f"For {names[0]}: subtract 0.5 mrad."]})
    done: Any = SimpleNamespace(after={names[0]: 0.95, names[1]: 0.03})
    assert _remedies(diagnosis, done, after) == diagnosis.remedies


def test_a_member_without_probability_need_not_be_ruled_out() -> None:
    (cause,) = made().effects
    odds = {"encoder_offset_joint1": 0.9, "base_tilt": 0.1, "encoder_eccentricity_joint1": 4e-28}
    shared = cause.model_copy(update={"name": "encoder_offset_joint1", "members": [*odds], "odds": odds})
    assert to_rule_out(shared) == " (first rule out base_tilt, which these recordings cannot exclude)"
