"""Checks by a bench measurement: proposal, evaluation of the result, and refusal of impossible values."""

from collections.abc import Mapping, Sequence

import numpy as np

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.units import read_quantity, split_quantity
from dpr_lab.errors import RunError
from dpr_lab.gap.advice.check_kind import CheckAnswer, OpenQuestion, Result, expected_bits
from dpr_lab.gap.advice.measurement import CHECK, Predictions, excluded_size, has, predictions
from dpr_lab.gap.result.checks import AdvisedCheck, Quantity
from dpr_lab.gap.result.diagnosis import Diagnosis


def form(check: AdvisedCheck) -> str:
    """Return the command-line options for entering the result of a measurement."""
    unit = check.measurand.displayed_unit
    return f'--value "... {unit}" --std "... {unit}"'


def propose(question: OpenQuestion, proposed: Sequence[AdvisedCheck]) -> list[AdvisedCheck]:
    """Propose measurements for an open question.

    For a class, one measurement is proposed for each member. For an alternative, one is proposed if no recording
    distinguishes it from the named effect.
    """
    if question.one_class:
        return [_check(question, name) for name in question.causes]
    return [] if proposed else [_check(question, question.about)]


def _check(question: OpenQuestion, measured: str) -> AdvisedCheck:
    """Create a check that measures an amplitude of the effect `measured`.

    If the named effect may be a simpler form of this effect, the additional amplitude of the richer form is measured.
    Otherwise the first amplitude is measured.
    """
    effect = EFFECTS[measured]
    wider = effect.adds and not set(effect.nested).isdisjoint(question.causes)
    amplitude = next(p for p in effect.amplitudes if p.name == effect.adds) if wider else effect.amplitudes[0]
    probability = sum(p for name, p in question.causes.items() if has(name, measured, amplitude.name))
    bits = expected_bits([probability, sum(question.causes.values()) - probability], np.inf)
    quantity = Quantity.of(measured, amplitude.name)
    check = question.check("measurement", f"{effect.bench_check} Give the {quantity.label}.", question.causes, bits)
    return check.model_copy(update={"measures": measured, "quantity": quantity})


def result(diagnosis: Diagnosis, check: AdvisedCheck, answer: CheckAnswer, prior: Mapping[str, float]) -> Result:
    """Return the predictive densities of a measured value under the candidate causes.

    Raises:
        RunError: the value has no unit, is impossible, or is doubtful and was not confirmed.
    """
    value, std = _read(check, answer)
    predicted = predictions(diagnosis, check, prior)
    _refuse_impossible(check, value, std, predicted.largest)
    explained = predicted.nearest(value, std) <= CHECK.questioned
    if not answer.confirmed and (doubt := _question(diagnosis, check, value, explained, predicted)):
        raise RunError(doubt)
    words = f"{check.measurand.name} = {check.measurand.shown(value)} ± {check.measurand.shown(std)}"
    return Result(words, predicted.log_densities(value, std), value, std, explained)


def _read(check: AdvisedCheck, answer: CheckAnswer) -> tuple[float, float]:
    """Return the value and the standard uncertainty of an answer, in the SI unit of the quantity."""
    value, std = answer.value, answer.std
    assert value is not None
    assert std is not None
    unit, example = check.measurand.unit, check.measurand.shown(check.amplitudes[0].typical)
    try:
        if isinstance(std, str) and isinstance(value, str) and not split_quantity(std)[1]:
            std = f"{std} {split_quantity(value)[1]}"
        first, second = (read_quantity(x, unit, example) if isinstance(x, str) else float(x) for x in (value, std))
    except ValueError as error:
        raise RunError(f"check {check.id} asks for the {check.measurand.label}: {error}") from error
    return first, second


def _refuse_impossible(check: AdvisedCheck, value: float, std: float, largest: float) -> None:
    """Test whether a value and its standard uncertainty are possible for the measured quantity.

    Args:
        check: a measurement
        value: measured value in the SI unit of the quantity
        std: standard uncertainty in the same unit
        largest: upper limit of value and standard uncertainty

    Raises:
        RunError: a number is not finite, too large, or of the wrong sign.
    """
    quantity = check.measurand
    if not np.isfinite(value):
        raise RunError(f"check {check.id}: the value must be a finite number, not {value:g}")
    if not (np.isfinite(std) and std > 0):
        raise RunError(f"check {check.id}: the standard uncertainty must be above 0 and finite, not {std:g}")
    if max(abs(value), std) > largest:
        raise RunError(
            f"check {check.id}: {quantity.shown(value)} ± {quantity.shown(std)} is impossible for the {quantity.name}:"
            f" above the limit of {quantity.shown(largest)}. Check the number and its unit"
        )
    never_negative = check.amplitudes[0].sign == "positive" or len(check.amplitudes) > 1
    if never_negative and value < -CHECK.questioned * std:
        raise RunError(f"check {check.id}: {quantity.name} cannot be negative: {quantity.shown(value)}")


def _question(diagnosis: Diagnosis, check: AdvisedCheck, value: float, explained: bool, predicted: Predictions) -> str:
    """Return a message on a doubtful value, which states how to confirm it; empty for a plausible value.

    A value is doubtful if no candidate predicts it. If the recordings do not determine the measured quantity, a value
    is doubtful in two further cases: it equals the estimate of another quantity, or it is much larger than all fitted
    amplitudes with the same unit.
    """
    quantity, estimate, fitted = check.measurand, predicted.estimate, _same_unit(diagnosis, check)
    confused = [
        f" Did you measure {name}, whose estimate is {quantity.shown(size)}?"
        for name, size in fitted
        if abs(value - size) <= CHECK.questioned * CHECK.model_error * abs(size)
    ]
    name, size = max(fitted, key=lambda pair: abs(pair[1]), default=("", np.inf))
    larger = not estimate and abs(value) > CHECK.undetermined * abs(size)
    if explained and (estimate or not (confused or larger)):
        return ""
    contradicts = f"check {check.id}: no candidate cause predicts {quantity.shown(value)} for the {quantity.name}."
    if explained:
        size_limit = excluded_size(diagnosis, check)
        upper = f" They exclude only sizes of {quantity.shown(size_limit)} or more." if size_limit else ""
        contradicts = f"check {check.id}: the recordings do not determine the {quantity.name}.{upper}"
    if larger:
        contradicts += f" {quantity.shown(value)} is {abs(value / size):.3g} times {name}, {quantity.shown(size)}."
    elif estimate:
        low, high = map(quantity.shown, estimate.interval90)
        contradicts += (
            f" It is {value / estimate.value:.3g} times the estimate of this quantity, {quantity.shown(estimate.value)}"
            f" (90 % interval {low} to {high})."
        )
    return (
        f"{contradicts}{''.join(confused[:1])} Check what was measured, its unit and its sign. If the value is correct,"
        " repeat the command with --force (in Python: confirmed=True)"
    )


def _same_unit(diagnosis: Diagnosis, check: AdvisedCheck) -> list[tuple[str, float]]:
    """Return description and value of the other fitted amplitudes of named effects with the unit of a check."""
    return [
        (f"the {EFFECTS[effect.name].bench_quantity(p.name).words} of {EFFECTS[effect.name].words}", fitted.value)
        for effect in diagnosis.effects
        for p in EFFECTS[effect.name].amplitudes
        if p.unit == check.measurand.unit
        and (effect.name != check.measures or p.name not in check.measurand.parameters)
        if (fitted := effect.parameters.get(p.name)) and fitted.value
    ]
