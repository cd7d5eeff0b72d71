"""Equivalence tests against limits, with a significance level of 5 %, based on a diagnosis.

Two one-sided tests at 5 % each are equivalent to a comparison of the limits with the 90 % interval [l, u]:

    pass           [l, u] lies inside the limits
    fail           [l, u] lies outside the limits
    not decidable  otherwise, or if these recordings do not give a valid interval

The interval of a named effect comes from its fit. For any other effect, it is a -+ 1.645 s, with the amplitude a and
its standard deviation s from the score test of the corrected model, in which all amplitudes of the effect are estimated
together. If the scale b is uncertain, an absolute size is a ratio times b^k, and its interval covers both ends of the
interval of b. An effect that is present but not named changes the ratios and the sizes of named effects. The intervals
of these quantities therefore also cover those of the models with further effects that the recordings do not exclude
(`dpr_lab.gap.evidence.wider_models`).

The friction torque T(u) of a joint passes if |T(u)| + 1.645 s(u) is below the limit at every speed u up to the speed of
the limit. This is an intersection-union test, which needs no correction for the number of speeds. The friction fails if
|T(u)| exceeds the limit at some speed by more than s(u) sqrt(chi2_k(0.95)), the half width of a simultaneous band for
the k parameters of T. At joint 0 with a voltage drive, T contains the back-EMF. Friction alone is smaller, so the
friction limit can pass but not fail.

Sources: R. L. Berger (1982), Multiparameter hypothesis testing and acceptance sampling, Technometrics 24, 295-300.
H. Scheffe (1953), A method for judging all contrasts in the analysis of variance, Biometrika 40, 87-104.
D. J. Schuirmann (1987), A comparison of the two one-sided tests procedure and the power approach, J.
Pharmacokinetics and Biopharmaceutics 15, 657-680.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dpr_lab.acceptance.friction import inaccurate_speeds, largest_estimate, largest_friction
from dpr_lab.acceptance.limits import Limits, free_run_quantity, friction_quantity
from dpr_lab.acceptance.median_error import median90, what_decides
from dpr_lab.acceptance.ratios import undetermined
from dpr_lab.acceptance.reason import NONE, Obstacle, Reason, within
from dpr_lab.acceptance.scale import open_by_scale, with_scale
from dpr_lab.effects import EFFECTS
from dpr_lab.gap.evidence.joint_friction import laws_of
from dpr_lab.gap.result.causes import UNTESTED, NamedEffect
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.shown import listed, percent

SURE = 0.95
"""Minimum probability of the assumption on which a result is based: that the effect is the cause, if its limit fails,
or that it is not the cause, if its limit passes."""

NOT_OF_SPEED = tuple(
    f"{law}_joint{joint}" for law in ("load_friction", "hysteresis", "friction_drift") for joint in (0, 1, 2)
)
"""Friction effects whose torque is not a function of the joint's speed alone."""

Answer = Literal["pass", "fail", "not decidable"]
Range = tuple[float, float]
Bounds = tuple[float | None, float | None]

FIND_CAUSE = "no further release decides the limit until the diagnosis explains the gap; perform its checks first"
"""Remedy for a limit whose interval is not valid, because the gap is not explained."""

SECOND_RELEASE = "record a second release"
"""Remedy for a limit of an effect whose form one release does not test."""


@dataclass(frozen=True, slots=True)
class JudgedLimit:
    """Result of the test of one limit."""

    quantity: str
    """Name of the quantity: an amplitude such as `coulomb_joint2.torque_Nm`, or a ratio."""
    unit: str
    """SI unit of the numbers."""
    lower: float | None
    """Lower limit; None if there is no lower limit."""
    upper: float | None
    """Upper limit; None if there is no upper limit."""
    interval90: Range | None
    """90 % interval of the quantity; None if the recordings give no interval."""
    answer: Answer
    """Result of the test."""
    reason: str
    """Reason why the limit is not decidable, including the remedy; empty otherwise."""
    remedy: str = ""
    """Part of the reason that states how the limit can be decided, or why no further release decides it."""
    obstacle: Obstacle = ""
    """Kind of the reason: `interval` (too wide), `scale` (only b is uncertain), `cause` (uncertain), `alike`
    (indistinguishable), `recordings` (missing) or `diagnosis` (no valid intervals); empty if the limit is decided."""
    effects: tuple[str, ...] = ()
    """Effects that the reason names."""


@dataclass(frozen=True, slots=True)
class Acceptance:
    """Results of the tests of all limits, from one diagnosis."""

    answer: Answer
    """Overall result: `fail` if any limit fails, else `not decidable` if any limit is not decidable, else `pass`."""
    sentence: str
    """Sentence of the underlying diagnosis."""
    limits: tuple[JudgedLimit, ...]
    """Results in the order of the file."""
    recordings: tuple[str, ...] = ()
    """Releases that are expected to decide further limits, in the recommended order."""
    would_decide: tuple[str, ...] = ()
    """Quantities for which these releases are expected to decide whether the limit is met. Each quantity is assumed to
    be at half its limit, or at the centre of its range; the error of free runs at the median of the recordings."""


def judge(diagnosis: Diagnosis, limits: Limits, free_run_rad: Mapping[str, float] | None = None) -> Acceptance:
    """Test every limit.

    Args:
        diagnosis: the diagnosis of the recordings, with its evidence
        limits: the limits of the rig
        free_run_rad: error of a free run over the horizon of the limit by the name of the run, rad, not finite if the
            simulation failed; None if there is no limit for free runs
    """
    free = _free_run(diagnosis, limits, free_run_rad or {})
    judged = (*_effects(diagnosis, limits), *_frictions(diagnosis, limits), *_ratios(diagnosis, limits), *free)
    answers = {limit.answer for limit in judged}
    overall: Answer = "fail" if "fail" in answers else "not decidable" if "not decidable" in answers else "pass"
    return Acceptance(overall, diagnosis.sentence, judged)


def _effects(diagnosis: Diagnosis, limits: Limits) -> Iterator[JudgedLimit]:
    for name, amplitudes in limits.effects.items():
        for parameter, limit in amplitudes.items():
            quantity, bounds = f"{name}.{parameter}", (-limit.max, limit.max)
            interval, further = _widened(diagnosis, quantity, _size(diagnosis, name, parameter), bounds)
            answer = _answer(interval, *bounds)
            reason = _untrusted(diagnosis) or _confused(diagnosis, name)
            if interval is None:
                reason = reason or _unseen(diagnosis, name, parameter)
            if answer == "not decidable" and interval is not None:
                reason = reason or further or _open_size(diagnosis, name, parameter, bounds)
            if answer == "fail":
                reason = reason or _unsure(diagnosis, name)
            yield _judged(quantity, limit.unit, bounds, interval, answer, reason or further)


def _frictions(diagnosis: Diagnosis, limits: Limits) -> Iterator[JudgedLimit]:
    for joint, limit in limits.friction.items():
        still = Reason(f"{joint} does not move in these recordings", "record releases in which it moves", "recordings")
        interval, reason, bounds = None, still, (None, limit.max)
        curve = diagnosis.evidence.friction.get(joint) if diagnosis.evidence else None
        if curve is not None:
            reached = curve.speed_rad_per_s[-1]
            faster = "record a faster swing, or lower speed_rad_s"
            slow = Reason(f"{joint} reaches only {reached:.3g} rad/s", faster, "recordings")
            reason = slow if limit.speed_rad_s > reached else NONE
            interval = None if reason else with_scale(diagnosis.scale, largest_friction(curve, limit, SURE), 1)
        reason = _untrusted(diagnosis) or reason or _other_friction(diagnosis, int(joint[-1]))
        answer = _answer(interval, *bounds)
        if curve is not None and curve.back_emf and answer != "pass":
            back_emf = "the torque contains the back-EMF of the voltage drive"
            reason = reason or Reason(back_emf, "record releases with a free arm", "alike")
        if curve is not None and answer == "not decidable" and not reason:
            known, best = largest_friction(curve, limit, SURE), largest_estimate(curve, limit)
            reason = _only_scale(diagnosis.scale, bounds, known, best, 1)
            if not reason and (cause := inaccurate_speeds(curve, limit)):
                reason = within(f", because {cause}")
        yield _judged(friction_quantity(joint, limit), limit.unit, bounds, interval, answer, reason)


def _open_size(diagnosis: Diagnosis, effect: str, parameter: str, bounds: Bounds) -> Reason:
    """Return the reason why only the uncertainty of the scale b leaves the limit of an amplitude undecided, if so."""
    known, quantity = diagnosis.model_copy(update={"scale": None}), f"{effect}.{parameter}"
    interval, _ = _widened(known, quantity, _size(known, effect, parameter), bounds)
    if interval is None:
        return NONE
    fitted = [named.parameters[parameter].value for named in diagnosis.effects if named.name == effect]
    best = fitted[0] if fitted else sum(interval) / 2
    return _only_scale(diagnosis.scale, bounds, interval, best, _power(effect, parameter))


def _only_scale(scale: Scale | None, bounds: Bounds, interval: Range, best: float, power: int) -> Reason:
    """Return the reason why only the uncertainty of the scale b leaves a limit undecided, if so.

    This is the case if a known b would decide the limit, but an exact estimate of the ratio to b would not.

    Args:
        scale: the scale
        bounds: lower and upper limit
        interval: 90 % interval of the quantity for a known scale
        best: best estimate of the quantity
        power: power of the scale in the quantity
    """
    if scale is None or _answer(interval, *bounds) == "not decidable":
        return NONE
    exact = with_scale(scale, (best, best), power)
    return open_by_scale(scale) if _answer(exact, *bounds) == "not decidable" else NONE


def _other_friction(diagnosis: Diagnosis, joint: int) -> Reason:
    """Return the reason why the friction torque of a joint may not be a function of the speed alone.

    Either a named friction effect also depends on other quantities, or it is uncertain whether a named effect is a
    friction law of this joint.
    """
    laws = {*laws_of(joint)}
    for named in diagnosis.effects:
        if named.name in NOT_OF_SPEED and named.name.endswith(f"joint{joint}"):
            other = f"the torque of {named.name}, which is named, does not depend on the speed alone"
            return Reason(other, obstacle="alike", effects=(named.name,))
        sure = sum(probability for name, probability in named.candidates.items() if name in laws)
        alternatives = [rival for rival in diagnosis.rivals if rival.instead_of == named.name]
        sure += sum(rival.probability for rival in alternatives if rival.name in laws)
        if 1 - SURE < sure < SURE:
            law = f"a friction law of joint {joint} is {percent(sure)}"
            return _uncertain(f"the probability that {named.name} is {law}", named)
    return NONE


def _ratios(diagnosis: Diagnosis, limits: Limits) -> Iterator[JudgedLimit]:
    for name, limit in limits.ratios.items():
        stated = diagnosis.stated_ratios.get(name)
        interval, further = _widened(diagnosis, name, stated.interval90 if stated else None, limit.bounds)
        reason = _untrusted(diagnosis) or undetermined(diagnosis, name)
        reason = reason or next(filter(None, map(_doubted, diagnosis.effects)), NONE)
        answer = _answer(interval, *limit.bounds)
        yield _judged(name, limit.unit, limit.bounds, interval, answer, reason or further)


def _free_run(diagnosis: Diagnosis, limits: Limits, errors: Mapping[str, float]) -> Iterator[JudgedLimit]:
    """Test the median of the free-run errors of the releases."""
    if (limit := limits.free_run) is None:
        return
    reason, interval = _wrong_description(diagnosis), None
    failed = [name for name, error in errors.items() if not np.isfinite(error)]
    if failed:
        fails = f"the simulation of {listed(failed)} fails before {limit.horizon_s:g} s"
        reason = reason or Reason(fails, "choose a shorter horizon_s", "recordings")
    elif len(errors) < 2:
        few = f"fewer than two recordings contain an undisturbed swing of {limit.horizon_s:g} s"
        reason = reason or Reason(few, "record them", "recordings")
    else:
        interval = median90([*errors.values()])
    answer = _answer(interval, None, limit.max)
    if answer == "not decidable" and not reason:
        reason = what_decides(diagnosis, limit, [*errors.values()])
    yield _judged(free_run_quantity(limit), limit.unit, (None, limit.max), interval, answer, reason)


def _judged(
    quantity: str,
    unit: str,
    bounds: Bounds,
    interval: Range | None,
    answer: Answer,
    reason: Reason,
) -> JudgedLimit:
    if not reason and answer == "not decidable":
        reason = within()
    answer = "not decidable" if reason else answer
    detail = reason.text, reason.remedy, reason.obstacle, tuple(filter(EFFECTS.__contains__, reason.effects))
    return JudgedLimit(quantity, unit, *bounds, interval, answer, *detail)


def _answer(interval: Range | None, lower: float | None, upper: float | None) -> Answer:
    if interval is None:
        return "not decidable"
    low, high = interval
    if (lower is None or lower < low) and (upper is None or high < upper):
        return "pass"
    outside = (upper is not None and low > upper) or (lower is not None and high < lower)
    return "fail" if outside else "not decidable"


def _size(diagnosis: Diagnosis, effect: str, parameter: str) -> Range | None:
    """Return the 90 % interval of an amplitude, including the uncertainty of the scale.

    The result is None if there is no valid interval.
    """
    for named in diagnosis.effects:
        if named.name == effect:
            size = named.parameters.get(parameter)
            if size is None or size.interval90[0] == size.interval90[1]:  # the amplitude was not fitted
                return None
            return (diagnosis.scale and size.interval90_with_scale) or size.interval90
    for tested in diagnosis.evidence.exclusions if diagnosis.evidence else ():
        if (tested.effect, tested.parameter) == (effect, parameter) and tested.interval90 is not None:
            return with_scale(diagnosis.scale, tested.interval90, _power(effect, parameter))
    return None


def _widened(
    diagnosis: Diagnosis, quantity: str, interval: Range | None, bounds: Bounds
) -> tuple[Range | None, Reason]:
    """Extend an interval to include those of the models with further effects.

    If only the extended interval leaves the limit undecided, the reason names the further effects.
    """
    alone, reason = _answer(interval, *bounds), NONE
    name, _, parameter = quantity.partition(".")
    fitted = not parameter or any(named.name == name for named in diagnosis.effects)
    for model in diagnosis.evidence.wider_models if diagnosis.evidence else ():
        if fitted and not model.intervals90 and alone != "not decidable":
            words = "together are" if len(model.effects) > 1 else "is"
            absent = "the interval is valid only without them, and these recordings do not exclude them"
            alike = f"{listed(model.effects)} {words} indistinguishable from the fitted values: {absent}"
            reason = reason or Reason(alike, obstacle="alike", effects=tuple(model.effects))
        if interval is None or quantity not in model.intervals90:
            continue
        other = model.intervals90[quantity]
        if parameter:
            other = with_scale(diagnosis.scale, other, _power(name, parameter))
        interval = min(interval[0], other[0]), max(interval[1], other[1])
        if not reason and _answer(interval, *bounds) != alone:
            further = f"common effects of undetectable sizes are present ({listed(model.effects)})"
            if model.probability is not None:
                further = f"{listed(model.effects)} is present (probability {percent(model.probability)})"
            reason = within(f" if {further}", effects=tuple(model.effects))
    return interval, reason


def _power(effect: str, parameter: str) -> int:
    """Return the exponent of the scale b in an amplitude."""
    return next(amplitude.scale_power for amplitude in EFFECTS[effect].amplitudes if amplitude.name == parameter)


def _untrusted(diagnosis: Diagnosis) -> Reason:
    """Return the reason why the intervals of a diagnosis are not valid, if they are not."""
    if reason := _wrong_description(diagnosis):
        return reason
    if diagnosis.only_uncertain and (untested := [named for named in diagnosis.effects if named.untested]):
        return _uncertain("the cause is uncertain", untested[0])
    cause, remedy = {
        "inconclusive": (
            "the recordings cannot show a gap, or cannot determine its cause",
            "record longer releases",
        ),
        "unexplained": ("no effect explains the gap, so the intervals are not valid", FIND_CAUSE),
        "partly_explained": ("part of the gap is unexplained, so the intervals are not valid", FIND_CAUSE),
    }.get(diagnosis.verdict, ("", ""))
    return Reason(cause, remedy, "diagnosis")


def _wrong_description(diagnosis: Diagnosis) -> Reason:
    """Return the first hint at a wrong description of the recordings, if there is one."""
    wrong = "the description of the recordings is probably wrong"
    return Reason(wrong, diagnosis.hints[0], "diagnosis") if diagnosis.hints else NONE


def _confused(diagnosis: Diagnosis, effect: str) -> Reason:
    """Return the reason why an effect that is not named may be the cause, if it may be."""
    if any(named.name == effect for named in diagnosis.effects):
        return NONE
    for named in diagnosis.effects:
        if effect in named.members:
            return _alike(named.name)
    for rival in diagnosis.rivals:
        if effect in (rival.name, *rival.members) and rival.probability > 1 - SURE:
            is_cause = f"the probability that this effect is the cause instead of {rival.instead_of}"
            return Reason(f"{is_cause} is {percent(rival.probability)}", obstacle="cause", effects=(rival.instead_of,))
    if effect in diagnosis.withdrawn:
        return Reason("named, but not confirmed on other recordings", "record more releases", "recordings")
    return NONE


def _doubted(named: NamedEffect) -> Reason:
    """Return the reason why a ratio depends on an uncertain named effect, if the class of the effect is uncertain."""
    if named.probability >= SURE:
        return NONE
    only = f"{named.name} has a probability of only {percent(named.probability)}"
    return _uncertain(f"the ratios depend on the cause, and {only}", named)


def _uncertain(cause: str, named: NamedEffect) -> Reason:
    """Return a reason that concerns the uncertainty of a named effect; a second release tests an untested form."""
    if not named.untested:
        return Reason(cause, obstacle="cause", effects=(named.name,))
    return Reason(f"{cause}, {UNTESTED}", SECOND_RELEASE, "recordings", (named.name,))


def _alike(other: str) -> Reason:
    return Reason(f"indistinguishable from {other}", obstacle="alike", effects=(other.partition(".")[0],))


def _unseen(diagnosis: Diagnosis, effect: str, parameter: str) -> Reason:
    if any(named.name == effect for named in diagnosis.effects):
        return Reason("this amplitude was not fitted and has no interval", obstacle="alike")
    if other := diagnosis.absorbed.get(effect, {}).get(parameter):
        return _alike(other)
    several = "the effect is not named, and the recordings do not give an interval for every amplitude of the effect"
    unseen = several if len(EFFECTS[effect].amplitudes) > 1 else "the effect does not change these recordings"
    return Reason(unseen, obstacle="recordings")


def _unsure(diagnosis: Diagnosis, effect: str) -> Reason:
    """Return the reason why a named effect that exceeds its limit may not be the cause, if it is uncertain."""
    for named in diagnosis.effects:
        if named.name == effect and (probability := named.candidates[effect]) < SURE:
            return _uncertain(f"the probability that this effect is the cause is {percent(probability)}", named)
    return NONE
