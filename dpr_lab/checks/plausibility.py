"""Values that cannot be, and values that no candidate predicts."""

import numpy as np

from dpr_lab.effects import EFFECTS
from dpr_lab.errors import RunError
from dpr_lab.gap.advice.measurement import SETTINGS, Predictions
from dpr_lab.gap.result.diagnosis import AdvisedCheck, Diagnosis


def refuse_impossible(check: AdvisedCheck, value: float, std: float, largest: float) -> None:
    """Refuse a value or a standard uncertainty that no measurement of this quantity can give.

    Args:
        check: a measurement
        value: in the unit of the quantity
        std: likewise
        largest: of either

    Raises:
        RunError: it is not finite, too large, or of the wrong sign.
    """
    assert check.quantity is not None
    quantity = check.quantity
    if not np.isfinite(value):
        raise RunError(f"check {check.id}: the value of {quantity.name} must be a finite number, not {value:g}")
    if not (np.isfinite(std) and std > 0):
        raise RunError(f"check {check.id}: the standard uncertainty must be above 0 and finite, not {std:g}")
    if max(abs(value), std) > largest:
        raise RunError(
            f"check {check.id}: {value:g} ± {std:g} {quantity.unit} is no possible {quantity.name}:"
            f" more than {largest:.0e} {quantity.unit}. Check the number and its unit"
        )
    if check.amplitudes[0].sign == "positive" or len(check.amplitudes) > 1:
        if value < -SETTINGS.questioned * std:
            raise RunError(f"check {check.id}: {quantity.name} cannot be negative: {quantity.shown(value)}")


def question(diagnosis: Diagnosis, check: AdvisedCheck, value: float, predicted: Predictions) -> str:
    """What to check about a value that no candidate predicts, and how to confirm it."""
    assert check.quantity is not None
    quantity, estimate = check.quantity, predicted.estimate
    contradicts = f"check {check.id}: no candidate cause predicts a {quantity.name} of {quantity.shown(value)}."
    if estimate:
        low, high = map(quantity.shown, estimate.interval90)
        contradicts += (
            f" It is {value / estimate.value:.3g} times the estimate of this quantity, {quantity.shown(estimate.value)}"
            f" (90 % interval {low} to {high})."
        )
    confused = [
        f" Did you measure {name}, whose estimate is {quantity.shown(size)}?"
        for name, size in _same_unit(diagnosis, check)
        if abs(value - size) <= SETTINGS.questioned * SETTINGS.model_error * abs(size)
    ]
    return (
        f"{contradicts}{''.join(confused[:1])} Check what was measured, its unit and its sign. If the value is right,"
        " repeat the command with --force (in Python: confirmed=True)"
    )


def _same_unit(diagnosis: Diagnosis, check: AdvisedCheck) -> list[tuple[str, float]]:
    """The other fitted amplitudes of named effects in the unit of a check, in words, and their sizes."""
    assert check.quantity is not None
    return [
        (f"the {EFFECTS[effect.name].bench_quantity(p.name).words} of {EFFECTS[effect.name].words}", fitted.value)
        for effect in diagnosis.effects
        for p in EFFECTS[effect.name].amplitudes
        if p.unit == check.quantity.unit and (effect.name != check.measures or p.name not in check.quantity.parameters)
        if (fitted := effect.parameters.get(p.name)) and fitted.value
    ]
