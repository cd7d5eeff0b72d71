"""The result of an advised check taken back into the diagnosis that advised it.

The candidates for one named effect are the members of its class, equally likely before, and the effects that could
stand in its place. With L_c how likely the result is under candidate c,

    p_c after  =  p_c before * L_c / (sum of the same over all candidates) * (sum of p_c before),

so that nothing else of the diagnosis moves, and nothing is fitted again but new recordings. A measured amplitude is
normal about the fitted one where the candidate has it, and about zero elsewhere; a recording has the predictive cost of
each candidate beside the other named effects, tempered as in `dpr_lab.gap.inference.posterior`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.errors import RunError
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.gap.data.record import record
from dpr_lab.gap.data.recordings import Recordings
from dpr_lab.gap.inference.posterior import CALIBRATION
from dpr_lab.gap.result.advise import has
from dpr_lab.gap.result.diagnosis import AdvisedCheck, CheckDone, Diagnosis, NamedEffect, RivalEffect
from dpr_lab.gap.selection.bare_model import fit_bare_model
from dpr_lab.gap.selection.hypothesis import Hypothesis, free_parameters, hypothesis, refit_with
from dpr_lab.gap.selection.score import score_test
from dpr_lab.gap.selection.steps import recorded
from dpr_lab.rig import Rig
from dpr_lab.run import Run, torque_kinds


@dataclass(frozen=True, slots=True)
class TakeBackSettings:
    """How a result counts."""

    fitted_error: float = 0.1
    """Of a fitted amplitude, relative, beyond its standard deviation: the model's own."""
    unfitted: float = 3.0
    """Standard deviation of an amplitude that was not fitted, in typical sizes."""
    dropped: float = 0.01
    """Probability, of its class, below which a member is no longer one."""
    iterations: int = 20
    """Of a fit to new recordings."""


SETTINGS = TakeBackSettings()


def find_check(diagnosis: Diagnosis, name: str) -> AdvisedCheck:
    """The check of an id.

    Raises:
        RunError: the diagnosis advised none of that id.
    """
    found = next((check for check in diagnosis.checks if check.id == name), None)
    if found is None:
        there = ", ".join(check.id for check in diagnosis.checks) or "none"
        raise RunError(f"this diagnosis advised no check {name!r}; there are: {there}")
    return found


def take_value(diagnosis: Diagnosis, check: AdvisedCheck, value: float, std: float) -> Diagnosis:
    """The diagnosis after a measurement.

    Args:
        diagnosis: which advised it
        check: what was measured
        value: the amplitude `check.quantity`, in its unit
        std: its standard uncertainty

    Raises:
        RunError: the check wants a recording.
    """
    if check.kind != "measurement":
        raise RunError(f"check {check.id} is a recording ({check.text}): give its run files, not a value")
    amplitude = check.amplitude.name
    size, spread = _expected(diagnosis, check)
    before = candidates(diagnosis, check.about)
    likely = {}
    for name in before:
        there = has(name, check.measures, amplitude)
        mean, variance = (size, spread**2 + std**2) if there else (0.0, std**2)
        likely[name] = -0.5 * ((value - mean) ** 2 / variance + np.log(variance))
    return _updated(diagnosis, check, before, likely, f"{amplitude} = {value:g} ± {std:g}")


def take_runs(diagnosis: Diagnosis, check: AdvisedCheck, runs: Sequence[Run], rig: Rig) -> Diagnosis:
    """The diagnosis after a recording.

    Args:
        diagnosis: which advised it
        check: what was recorded
        runs: the recordings
        rig: lengths, masses and encoders

    Raises:
        RunError: the check wants a measurement, or the runs cannot be fitted.
    """
    if check.kind != "recording":
        raise RunError(f"check {check.id} is a measurement ({check.text}): give --value and --std, not runs")
    before = candidates(diagnosis, check.about)
    fitted = _fitted(diagnosis, check.about, [name for name in before if name in _told(diagnosis, check)], runs, rig)
    best = min(fitted.values(), key=lambda item: item.cost)
    scale = 2 * best.residuals.inflation * CALIBRATION.temperature
    likely = {name: -(item.cost - best.cost) / scale for name, item in fitted.items()}
    # Members that this does not split are no more told apart by it than by what was recorded before.
    likely |= {name: likely[check.about] for name in before if name not in likely}
    driven = "".join(f", driven by {kind} torques" for kind in torque_kinds(runs))
    return _updated(diagnosis, check, before, likely, f"recorded: {', '.join(run.name for run in runs)}{driven}")


def candidates(diagnosis: Diagnosis, about: str) -> dict[str, float]:
    """Probability of each member of a named effect's class and of each effect that could stand in its place."""
    done = [item.after for item in diagnosis.checks_done if item.check.about == about]
    if done:
        return dict(done[-1])
    named = _named(diagnosis, about)
    found = dict.fromkeys(named.members, named.probability / len(named.members))
    return found | {item.name: item.probability for item in diagnosis.rivals if item.instead_of == about}


def _named(diagnosis: Diagnosis, about: str) -> NamedEffect:
    return next(effect for effect in diagnosis.effects if effect.name == about)


def _told(diagnosis: Diagnosis, check: AdvisedCheck) -> set[str]:
    """The named effect, what the check splits, and its alternatives: a recording may tell about any of them."""
    return {check.about, *check.splits, *(item.name for item in diagnosis.rivals if item.instead_of == check.about)}


def _expected(diagnosis: Diagnosis, check: AdvisedCheck) -> tuple[float, float]:
    """Amplitude that a check is expected to find where its effect is there, and its standard deviation."""
    parameter = check.amplitude
    for effect in diagnosis.effects:
        if effect.name == check.measures and parameter.name in effect.parameters:
            found = effect.parameters[parameter.name]
            low, high = found.interval90
            fitted = (high - low) / 2 / NORMAL_Q90
            return found.value, float(np.hypot(fitted, SETTINGS.fitted_error * found.value))
    return 0.0, SETTINGS.unfitted * parameter.typical


def _fitted(
    diagnosis: Diagnosis, about: str, names: Sequence[str], runs: Sequence[Run], rig: Rig
) -> dict[str, Hypothesis]:
    """Each candidate fitted to new runs, beside the other named effects."""
    recordings = Recordings(tuple(record(run, rig) for run in runs), rig, exact_torques=diagnosis.exact_torques)
    recordings, problem, bare = fit_bare_model(recordings, diagnosis.unknowns)
    others = {name: dict(values) for name, values in diagnosis.model_effects.items() if name != about}
    less = bare
    if others:
        at = replace(bare.fit.estimate, params=effect_params(others))
        free = free_parameters(at, tuple(others), problem)
        less = hypothesis(problem, others, fit(problem, at, free, iterations=SETTINGS.iterations))
    known = recorded(recordings.records, problem, less.fit)
    test = score_test(problem, less.fit, [EFFECTS[name] for name in names], known)
    scores = {name: test.of(name) for name in names}
    return {
        name: refit_with(problem, less, test, score, SETTINGS.iterations)
        for name, score in scores.items()
        if score is not None
    }


def _updated(
    diagnosis: Diagnosis,
    check: AdvisedCheck,
    before: Mapping[str, float],
    likely: Mapping[str, float],
    result: str,
) -> Diagnosis:
    """The diagnosis with the candidates' probabilities moved."""
    highest = max(likely[name] for name in before)
    weights = {name: p * float(np.exp(likely[name] - highest)) for name, p in before.items()}
    whole = sum(before.values()) / (sum(weights.values()) or 1.0)
    after = {name: whole * weight for name, weight in weights.items()}
    done = CheckDone(check=check, result=result, before=dict(before), after=after)
    effects, rivals = _standing(diagnosis, check.about, after)
    moved = {**diagnosis.probabilities, **after, check.about: _one(effects, check.about).probability}
    return diagnosis.model_copy(
        update={
            "effects": effects,
            "rivals": rivals,
            "probabilities": moved,
            "sentence": f"{diagnosis.sentence} {_told_sentence(done)}",
            "checks": [item for item in diagnosis.checks if item.id != check.id],
            "checks_done": [*diagnosis.checks_done, done],
        }
    )


def _standing(
    diagnosis: Diagnosis, about: str, after: Mapping[str, float]
) -> tuple[list[NamedEffect], list[RivalEffect]]:
    """Named effects and rivals; members of the class that a check split off are rivals from then on."""
    named = _named(diagnosis, about)
    whole = sum(after[name] for name in named.members)
    kept = [name for name in named.members if after[name] > SETTINGS.dropped * whole]
    kept = kept if about in kept else [about]
    split = [name for name in named.members if name not in kept]
    standing = named.model_copy(update={"members": kept, "probability": sum(after[name] for name in kept)})
    effects = [standing if effect.name == about else effect for effect in diagnosis.effects]
    rivals = [
        item.model_copy(update={"probability": after[item.name]}) if item.instead_of == about else item
        for item in diagnosis.rivals
    ]
    rivals += [
        RivalEffect.model_validate(
            {"name": name, "class": [name], "probability": after[name], "cosine": 1.0, "instead_of": about}
        )
        for name in split
    ]
    return effects, sorted(rivals, key=lambda item: -item.probability)


def _one(effects: Sequence[NamedEffect], name: str) -> NamedEffect:
    return next(effect for effect in effects if effect.name == name)


def _told_sentence(done: CheckDone) -> str:
    """What a check changed; where it speaks against the named effect, what to do."""
    about, best = done.check.about, max(done.after, key=lambda name: done.after[name])
    said = f"After check {done.check.id} ({done.result}): {best} {done.before[best]:.2f} -> {done.after[best]:.2f}."
    if best == about:
        return said
    return f"{said} It is now likelier than {about}: diagnose again with --without {about} to fit it."
