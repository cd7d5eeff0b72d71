"""Assembly of a plan: reasons for the releases, forecast, and causes that no release separates."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from dpr_lab.acceptance.judge import SURE
from dpr_lab.arrays import Array, Flags
from dpr_lab.effects import EFFECTS
from dpr_lab.gap.hypothesis.detectable import SIGMAS
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.planning.candidates import placements, repetition
from dpr_lab.planning.forecast import FORECAST, decision_probability, settled_probabilities
from dpr_lab.planning.information import horizon_s, informed
from dpr_lab.planning.knowledge import Knowledge
from dpr_lab.planning.limits import PlanLimits
from dpr_lab.planning.result import Detectable, Inseparable, LimitForecast, PairBits, Plan, PlannedRelease
from dpr_lab.planning.sequence import SequenceStep
from dpr_lab.planning.stopping import STOPPING, decided, enough_sentence, recorded_releases, undecided
from dpr_lab.planning.worth.criteria import OpenAmplitudes, detectable, library_bits, ratio_std, shown_ratio_std
from dpr_lab.planning.worth.objective import Gain, Objective, limit_forecasts
from dpr_lab.shown import counted, listed, percent

State = Literal["first", "record", "enough", "bench check"]


@dataclass(frozen=True, slots=True)
class Noticeable:
    """Minimum gains that the reason for a release states, in bits.

    For the ratios, it is the relative reduction of the standard deviations.
    """

    causes: float = 0.05
    library: float = 0.02
    limits: float = 0.1
    ratios: float = 0.02


NOTICEABLE = Noticeable()


def summed_up(objective: Objective, steps: Sequence[SequenceStep], limits: PlanLimits, seconds: float) -> Plan:
    """Compose the plan for a sequence of releases.

    Args:
        objective: the function that the plan maximises
        steps: the sequence
        limits: limits of the plan
        seconds: computing time, s
    """
    known = objective.known
    after = np.cumsum([known.information, *(step.information for step in steps)], axis=0)
    stds, gained = [ratio_std(known, F) for F in after], [objective.separated(F) for F in after]
    knowledge = [Objective.of(replace(known, information=F)) for F in after]
    alike = [inseparable_pairs(then, steps, d2) for then, d2 in zip(knowledge, gained, strict=True)]
    stuck = [inseparable(objective, pairs) for pairs in alike]
    gains = [separable_gain(objective, F, stuck[0]) for F in after]
    reasons = [
        reason_for(before, then, 1 < number <= STOPPING.fewest, known.diagnosis is not None)
        for number, (before, then) in enumerate(pairwise(gains), len(known.made) + 1)
    ]
    shares = [1 - float(np.exp(np.log(then / before).mean())) for before, then in pairwise(stds)]
    texts = [
        reason or f"reduces the standard deviations of the ratios by a further {percent(share)}"
        for reason, share in zip(reasons, shares, strict=True)
    ]
    state = _state(known, _names(stuck[0]))
    forecast = _forecast(objective, steps, gained[1:], alike[1:]) if state == "record" else [None] * len(steps)
    releases = [
        _planned(k, step, steps[: k - 1], after[k], objective, text, d2, decided)
        for k, (step, text, d2, decided) in enumerate(zip(steps, texts, gained[1:], forecast, strict=True), 1)
    ]
    return Plan(
        state=state,
        sentence=plan_sentence(state, known, releases, stuck, reasons),
        releases=releases,
        minutes=sum(release.minutes for release in releases),
        forecast=[decided for decided in forecast if decided is not None],
        ratio_std=shown_ratio_std(known, known.information),
        detectable=_detectable(known, after[-1]),
        inseparable=stuck[0],
        limits=_limits(known, steps, limits),
        assumptions=_assumptions(known, releases),
        seconds=seconds,
    )


def _limits(known: Knowledge, steps: Sequence[SequenceStep], limits: PlanLimits) -> list[LimitForecast]:
    """Return the forecast for each limit after all releases, with the release that decides the limit alone."""

    def after(chosen: Sequence[SequenceStep]) -> list[LimitForecast]:
        F = known.information + sum(step.information for step in chosen)
        return limit_forecasts(known, F, limits, [step.release for step in chosen])

    alone = [after([step]) for step in steps]
    forecasts = list[LimitForecast]()
    for k, forecast in enumerate(after(steps)):
        sufficient = {n: made[k].reach or 0.0 for n, made in enumerate(alone, 1) if made[k].decides}
        forecasts.append(
            forecast.model_copy(update={"release": min(sufficient, key=sufficient.__getitem__, default=None)})
        )
    return forecasts


def _planned(
    number: int,
    step: SequenceStep,
    earlier: Sequence[SequenceStep],
    F: Array,
    objective: Objective,
    reason: str,
    gained: list[Array],
    decided: float | None,
) -> PlannedRelease:
    release, known = step.release, objective.known
    repeats = repetition(release, [step.release for step in earlier], known.made, known.model.placement_rad)
    planned = PlannedRelease(
        number=number,
        text=release.words + ", arm clamped" * (release.arm == "held" and known.rig.arm.mode != "clamped") + repeats,
        reason=reason,
        theta1_rad=release.theta1,
        theta2_rad=float(release.start[1]),
        duration_s=release.duration_s,
        rate_hz=known.rig.link.rate_hz,
        mounted="both" if release.mounting == "clamped" else release.mounting,
        elbow="clamped" if release.mounting == "clamped" else "free",
        added_mass=release.added,
        arm=release.arm,
        signal=release.signal,
        input=None,
        minutes=step.minutes,
        horizon_s=horizon_s(release, known.model),
        pairs=[PairBits(causes=pair, bits=float(bits)) for pair, bits in objective.bits(gained).items()],
        library_bits=float(library_bits(known, F)),
        ratio_std=shown_ratio_std(known, F),
        decided=decided,
    )
    return planned.driven_by(release.torques)


def _forecast(
    objective: Objective,
    steps: Sequence[SequenceStep],
    gained: Sequence[Sequence[Array]],
    inseparable_by_step: Sequence[Sequence[Flags]],
) -> list[float | None]:
    """Return the probability that the causes are decided after each release; None before any recording.

    Causes that are inseparable after a release count as one cause.
    """
    diagnosis, pairs = objective.known.diagnosis, objective.pairs
    if diagnosis is None or not steps:
        return [None] * len(steps)
    if diagnosis.verdict == "no_gap":  # two releases decide a named cause although other effects are not excluded
        return [*settled_probabilities(_further_tests(objective.known, steps))]
    failed = recorded_releases(diagnosis) - 1  # there is no forecast for the first release
    confirmed = FORECAST.revealed if diagnosis.gap.remainder_Nm else FORECAST.confirmed
    return [
        decision_probability(pairs, d2, number, same, failed, confirmed)
        for number, (d2, same) in enumerate(zip(gained, inseparable_by_step, strict=True), 1)
    ]


def _further_tests(known: Knowledge, steps: Sequence[SequenceStep]) -> list[list[OpenAmplitudes]]:
    """Return the tested amplitudes after each planned release, for several placement errors."""
    rng = np.random.default_rng(1)  # another stream than that of the simulated score tests
    added = np.cumsum([_placed(known, step, rng) for step in steps], axis=0)
    return [
        [OpenAmplitudes.of(known, known.information + F, excluded=True) for F in path] for path in added.swapaxes(0, 1)
    ]


def _placed(known: Knowledge, step: SequenceStep, rng: np.random.Generator) -> list[Array]:
    """Return the information of a planned release for each of several random placement errors."""
    if step.release.torques is not None:
        return [step.information] * FORECAST.placements
    releases = placements(step.release, known.model.placement_rad, FORECAST.placements, rng)
    return [placed.information for placed in informed(releases, known.model)]


def _detectable(known: Knowledge, F: Array) -> list[Detectable]:
    names = [name for name in known.places if name not in known.always]
    matrices = known.information, F
    before, after = (detectable(known, matrix, SIGMAS, names, at_assumed_scale=True) for matrix in matrices)
    return [
        Detectable(
            effect=name,
            parameter=p.name,
            unit=p.unit,
            before=before[name][p.name],
            after=after[name][p.name],
            typical=p.typical,
        )
        for name in after
        for p in EFFECTS[name].amplitudes
    ]


def inseparable_pairs(
    objective: Objective, steps: Sequence[SequenceStep], earlier: Sequence[Array] = ()
) -> list[Flags]:
    """Return the (n, n) masks of the pairs of causes that even repeated releases do not separate.

    There is one mask for each named effect.

    Args:
        objective: the objective before the repeated releases
        steps: the planned releases; without any, no pair is inseparable
        earlier: (n, n) d^2 from planned releases before the repeated ones, for each named effect
    """
    if not steps:
        return [np.zeros(d2.shape, np.bool_) for d2 in earlier]
    F = objective.known.information + FORECAST.repeats * np.mean([step.information for step in steps], axis=0)
    later = objective.separated(F)
    pairs = [np.maximum(d2, before) for d2, before in zip(later, earlier or later, strict=True)]
    return [np.maximum(d2, d2.T) < FORECAST.separable for d2 in pairs]


def separable_gain(objective: Objective, F: Array, stuck: Sequence[Inseparable]) -> Gain:
    """Return the gain without pairs of causes that no release separates, with the rules of a diagnosis."""
    pairs, bits = [{*pair.causes} for pair in stuck], objective.bits(objective.separated(F))
    return replace(objective.gain(F), causes={causes: bits[causes] for causes in bits if {*causes} not in pairs})


def inseparable(objective: Objective, inseparable_pairs: Sequence[Flags]) -> list[Inseparable]:
    """Return the pairs of causes that the releases do not separate, with their bench checks.

    Args:
        objective: the objective
        inseparable_pairs: (n, n) pairs of inseparable causes, for each named effect
    """
    stuck = list[Inseparable]()
    for pairs, of_effect in zip(objective.pairs, inseparable_pairs, strict=True):
        best = int(np.argmax(pairs.probabilities))
        cause, others = pairs.names[best], set(np.flatnonzero(of_effect[best])) - {best}
        if pairs.probabilities[best] < SURE:
            check = EFFECTS[cause].bench_check
            stuck += [Inseparable(causes=(cause, pairs.names[other]), check=check) for other in sorted(others)]
    return stuck


def _names(stuck: Sequence[Inseparable]) -> list[str]:
    return list(dict.fromkeys(name for pair in stuck for name in pair.causes))


def _state(known: Knowledge, together: Collection[str]) -> State:
    if known.diagnosis is None:
        return "first"
    if decided(known.diagnosis):
        return "enough"
    return "bench check" if together and decided(known.diagnosis, together) else "record"


def plan_sentence(
    state: State,
    known: Knowledge,
    releases: Sequence[PlannedRelease],
    stuck: Sequence[list[Inseparable]],
    reasons: Sequence[str],
) -> str:
    """Return the main sentence of a plan.

    Args:
        state: state of the plan
        known: the current knowledge
        releases: the planned releases
        stuck: pairs of causes that no further release separates, before the first release and after each release
        reasons: result of `reason_for` for each planned release
    """
    diagnosis = known.diagnosis
    if diagnosis is not None and state == "enough":
        return enough_sentence(diagnosis, known.open_limits, "release 1" if releases else "a further release")
    if not releases:
        return "No release fits the budget."
    note = only_ratios_sentence(reasons, state == "record")
    if state == "first":
        needed = max((k for k, reason in enumerate(reasons, 1) if reason), default=len(releases))
        bits = releases[needed - 1].library_bits
        share = f"{percent(bits)} of" if bits < 0.995 else "nearly all"
        verb = "is" if needed == 1 else "are"
        count = counted(needed, "release")
        return f"Before any recording: {count} {verb} expected to distinguish {share} the effects of the library.{note}"
    if state == "bench check":
        pairs = listed([f"{a} and {b}" for a, b in (pair.causes for pair in stuck[0])])
        return (
            f"Even {FORECAST.repeats} more releases on this rig would not distinguish {pairs}: perform this bench"
            f" check. {stuck[0][0].check}"
        )
    chances = [release.decided or 0.0 for release in releases]
    number = next((k for k, chance in enumerate(chances, 1) if chance >= FORECAST.likely), len(chances))
    advice = "Record release 1, diagnose and plan again. " if len(chances) > 1 else ""
    if diagnosis is not None:
        advice += _answered(diagnosis, releases[0], stuck[0])
        reason = undecided(diagnosis, _names(stuck[0]))
        advice = f"{reason[:1].upper()}{reason[1:]}. {advice}"
    classes: dict[str, list[str]] = {}
    for first, second in (pair.causes for pair in stuck[number]):
        classes.setdefault(first, [first]).append(second)
    apart = f", except {listed([f'between {listed(causes)}' for causes in classes.values()])}," if classes else ""
    more = counted(number, "more release")
    return f"{advice}With {more} the probability that the causes are decided{apart} is {chances[number - 1]:.2f}.{note}"


def _answered(diagnosis: Diagnosis, release: PlannedRelease, stuck: Sequence[Inseparable]) -> str:
    """Return a sentence on the recommended checks whose result the first release gives too; empty if there are none."""
    pairs = [{*pair.causes} for pair in stuck]
    noticeable = [{*pair.causes} for pair in release.pairs if pair.bits >= NOTICEABLE.causes]
    recordings = [check for check in diagnosis.checks if check.release and check.informative]
    checks = [check.id for check in recordings if {*check.splits} in noticeable and {*check.splits} not in pairs]
    return (
        f"The recording of release 1 is also the result of check {listed(checks)} (dpr-lab check). " if checks else ""
    )


def _assumptions(known: Knowledge, releases: Sequence[PlannedRelease]) -> list[str]:
    angle, inflation, arm = known.model.placement_rad, f"{known.model.inflation:.2g}", list[str]()
    if not known.always:
        unused = known.rig.arm.mode == "driven" and known.rig.motor is not None
        hint = " The plan may drive the arm if a limits file contains `input` in [arm]." if unused else ""
        arm = [f"The arm is held.{hint}"]
    elif any(release.arm != "held" for release in releases):
        arm = ["The arm starts at rest at theta0 = 0 and is held until the release."]
    inflated = (
        f"The information of each reading is divided by the variance inflation {inflation}, because the residual of"
        " the model exceeds the noise."
    )
    return [
        *arm,
        "The model is linearised about the current estimate.",
        f"The rods are placed by hand with a standard deviation of {angle:.2g} rad (half the tolerance of the rig's"
        " poses). The information of a release is averaged over such placement errors.",
        "Effects that occurred only once, such as lost counts, are not considered.",
        *[inflated] * (inflation != "1"),
    ]


def reason_for(before: Gain, after: Gain, needed: bool = False, diagnosed: bool = True) -> str:
    """Return the reason for a release: its contribution in addition to the previous releases.

    The text is empty if the accuracy of the ratios is the only noticeable contribution.

    Args:
        before: expected information before the release
        after: expected information after the release
        needed: whether the stopping rule requires this release
        diagnosed: whether there are recordings whose causes are named
    """
    parts = ["verifies the result of the first release with another swing"] if needed else []
    added = {pair: bits - before.causes.get(pair, 0.0) for pair, bits in after.causes.items()}
    if added and max(added.values()) >= NOTICEABLE.causes:
        (first, second), bits = max(added.items(), key=lambda bits_by_pair: bits_by_pair[1])
        parts.insert(0, f"separates {first} from {second} ({bits:.2f} bits)")
    if after.open_effects - before.open_effects >= NOTICEABLE.causes:
        parts.insert(0, "tests the effects that are not excluded yet")
    if after.library - before.library >= NOTICEABLE.library:
        parts.append(_distinguishes(float(before.library), float(after.library), diagnosed))
    if after.limits - before.limits >= NOTICEABLE.limits:
        parts.append("tests the limits more accurately")
    return "; ".join(parts)


def _distinguishes(before: float, after: float, diagnosed: bool) -> str:
    """Return a clause on the share of the effects that a release distinguishes.

    The clause states the increase of this share due to the release, computed from the rounded shares of the table. If
    the share before the release is small, it states the share after the release. Both shares are between 0 and 1.
    """
    effects = "the effects that are not named so far" if diagnosed else "the effects of the library"
    if before < NOTICEABLE.library:
        return f"distinguishes {percent(after)} of {effects}"
    return f"distinguishes {percent(round(after, 2) - round(before, 2))} more of {effects}"


def only_ratios_sentence(reasons: Sequence[str], undecided: bool) -> str:
    """Return a sentence on the releases that only improve the accuracy of the ratios; empty if there are none.

    Args:
        reasons: result of `reason_for` for each release
        undecided: whether causes are undecided, so that such a release may become necessary
    """
    numbers = [str(k) for k, reason in enumerate(reasons, 1) if not reason]
    if not numbers:
        return ""
    several = len(numbers) > 1
    in_a_row = len(numbers) > 2 and int(numbers[-1]) - int(numbers[0]) == len(numbers) - 1
    which = f" Release{'s' * several} {f'{numbers[0]} to {numbers[-1]}' if in_a_row else listed(numbers)}"
    if undecided and "1" not in numbers:
        need, earlier = ("are", "them") if several else ("is", "it")
        return f"{which} {need} necessary only if causes are still undecided before {earlier}."
    return f"{which} only improve{'' if several else 's'} the accuracy of the ratios."
