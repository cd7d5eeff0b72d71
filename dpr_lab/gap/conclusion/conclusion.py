"""The result of a diagnosis in words and numbers."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import EFFECTS, named_params
from dpr_lab.effects.drive_gain import DRIVE_GAIN
from dpr_lab.effects.effect import Effect, Params
from dpr_lab.effects.free_arm import FREE_ARM
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.disturbance import most_noise
from dpr_lab.fitting.estimate import ON_ELBOW, SCALE, UNKNOWN_RATIOS
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.advice.check_kind import NextStep
from dpr_lab.gap.advice.expected import expected_size
from dpr_lab.gap.bare_model import scale
from dpr_lab.gap.classes.families import families, families_sentence
from dpr_lab.gap.classes.posterior import EffectPosterior, probabilities
from dpr_lab.gap.conclusion.components import components
from dpr_lab.gap.conclusion.remedies import remedies
from dpr_lab.gap.conclusion.uncertainty import by_unseen_ratios
from dpr_lab.gap.conclusion.verdict import Verdict, listed_causes, sentence, verdict
from dpr_lab.gap.hypothesis.detectable import detectable
from dpr_lab.gap.result.diagnosis import (
    AdvisedCheck,
    Diagnosis,
    EffectSize,
    Gap,
    Interval,
    NamedEffect,
    RivalEffect,
    SearchStep,
    SensorFinding,
    Where,
)
from dpr_lab.gap.result.evidence import Evidence
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.screen.sensor_faults import ALL_AXES
from dpr_lab.gap.transfer.transfer import Transfer
from dpr_lab.gap.where.discrepancy import Discrepancy
from dpr_lab.gap.where.locate import Place, where_sentence
from dpr_lab.gap.which.selected import Selection, TracedTrial
from dpr_lab.identification.misread.tried import Description
from dpr_lab.identification.scaling.prior_spread import scale_of
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.shown import listed

Array = NDArray[np.float64]

PLACES_SHOWN = 6
"""Maps in a diagnosis, the one with the largest share first."""

SURELY = 3.0
"""Standard uncertainties of L1 beyond which the value in the rig file is wrong."""


@dataclass(frozen=True, slots=True)
class Findings:
    """Results of the stages of a diagnosis."""

    recordings: Recordings
    problem: Problem
    selection: Selection
    posteriors: tuple[EffectPosterior, ...]
    transfer: Transfer
    description: Description
    places: tuple[Place, ...]
    gap: Gap
    advice: tuple[NextStep, ...]
    covariance: Array
    """(free, free) covariance of the selected fit's values."""
    remainder: Discrepancy | None
    """The discrepancy term of the selected set; None if only noise remains."""
    cut: str
    """Segments of a long record; empty if it was not divided."""

    @property
    def intervals(self) -> dict[tuple[str, str], float]:
        """(effect, parameter) -> half width of the 90 % interval of a fitted value."""
        reach = NORMAL_Q90 * np.sqrt(np.diag(self.covariance))
        free = self.selection.chosen.fit.free
        return {(parameter.effect, parameter.name): float(r) for parameter, r in zip(free, reach, strict=True)}

    @property
    def absorbed(self) -> dict[str, dict[str, str]]:
        """Effect -> amplitude -> parameters that absorb it; an effect of the model is tested without it."""
        around, last = self.selection.tests_without, self.selection.final_test
        scores = {name: around[name].of(name) if name in around else last.of(name) for name in EFFECTS}
        return {name: dict(score.absorbed) for name, score in scores.items() if score is not None and score.absorbed}

    @property
    def scale(self) -> Scale:
        """Assumption of absolute sizes about b: fitted, or taken from the rig file."""
        unknown, intervals = self.selection.chosen.fit.estimate.ratios, self.intervals
        b = float(unknown[SCALE])
        if ("", "b") in intervals:
            reach = intervals["", "b"]
            return Scale(b=b, interval90=(max(b - reach, 1e-3 * b), b + reach), fixed_by="data")
        visible = [i for i, name in enumerate(UNKNOWN_RATIOS) if ("", name) in intervals]
        assumed = scale(self.selection.base.fit.estimate.ratios, self.recordings.rig)
        return scale_of(assumed.model_copy(update={"value": b}), unknown, self.recordings.rig, visible)


def conclude(findings: Findings, evidence: Evidence, seconds: float) -> Diagnosis:
    """Build the diagnosis; `seconds` is its computing time."""
    chosen, least = findings.selection.chosen, detectable(findings.selection.chosen, findings.selection.final_test)
    withheld = findings.description.withholds
    kind = verdict(findings.selection, findings.posteriors, findings.transfer, least, withheld=withheld)
    shown = findings.posteriors if kind == "named" else listed_causes(findings.posteriors)
    named = [_named(findings, posterior) for posterior in shown] if kind in ("named", "partly_explained") else []
    whole = families(findings.problem, findings.selection, named)
    at, residuals = chosen.fit.estimate, chosen.residuals
    return Diagnosis(
        verdict=kind,
        sentence=sentence(kind, findings.selection, findings.posteriors, findings.transfer, least, findings.description)
        + families_sentence(whole)
        + _remainder(findings, kind),
        hints=[findings.description.hint] if findings.description.hint else [],
        basis=findings.transfer.basis,
        transfer=_transfer(findings.transfer),
        withdrawn=list(findings.transfer.withdrawn),
        gap=findings.gap,
        where=[_where(place) for place in findings.places[:PLACES_SHOWN]],
        where_sentence=where_sentence(findings.places),
        effects=named,
        families=whole,
        rivals=[] if withheld else _rivals(findings.posteriors, closest=kind == "unexplained"),
        probabilities=dict(probabilities(findings.selection, () if withheld else findings.posteriors, kind)),
        detectable={name: dict(sizes) for name, sizes in least.items()},
        absorbed=findings.absorbed,
        sensor_findings=_sensor_findings(findings),
        remedies=remedies(
            named,
            named_params(at.params),
            findings.recordings.constants,
            {*findings.transfer.withdrawn, *findings.transfer.oversized},
        ),
        advice=[step.text for step in findings.advice],
        checks=_checks(findings, [effect.name for effect in named]),
        ratios=_ratios(findings),
        ratio_covariance=_ratio_covariance(findings).tolist(),
        determined=_determined(findings),
        p_over_b=float(at.ratios[ON_ELBOW]) if any(setup.alone for setup in findings.problem.segments.setups) else None,
        chi2_per_dof=residuals.chi2 / residuals.dof,
        exact_torques=findings.recordings.exact_torques,
        segments=len(findings.problem.segments),
        scale_b=float(at.ratios[SCALE]),
        scale=findings.scale,
        search=[_search_step(step) for step in findings.selection.trace],
        posterior=components(findings.problem, findings.selection, findings.recordings.rig, findings.remainder),
        model_effects=named_params(at.params),
        assumptions=[
            *([findings.cut] if findings.cut else []),
            *_assumptions(findings),
            *_unseen(least, findings.absorbed),
        ],
        evidence=evidence,
        seconds=seconds,
    )


def _search_step(step: TracedTrial) -> SearchStep:
    return SearchStep(
        move=step.move,
        before=list(step.before),
        tried=list(step.tried),
        criterion=step.criterion if np.isfinite(step.criterion) else None,
        change=step.change if np.isfinite(step.change) else None,
        accepted=step.accepted,
        reason=step.reason,
    )


def _ratios(findings: Findings) -> dict[str, Interval]:
    """The ratios; those that depend on the bounds of the rig file are not negative."""
    values = findings.selection.chosen.fit.estimate.ratios[: len(RATIOS)].tolist()
    reaches = np.array([findings.intervals.get(("", name), 0.0) for name in RATIOS])
    unseen = by_unseen_ratios(findings.problem, findings.selection.chosen, findings.recordings.rig)
    reaches = np.hypot(reaches, NORMAL_Q90 * np.sqrt(unseen)).tolist()
    floors = np.where(unseen > 0.0, 0.0, -np.inf).tolist()
    return {
        name: Interval(value=value, interval90=(max(value - reach, floor), value + reach))
        for name, value, reach, floor in zip(RATIOS, values, reaches, floors, strict=True)
    }


def _determined(findings: Findings) -> dict[str, Interval]:
    """Ratios that the recordings determine, of what hung on the rig: to b, or to a of the inner rod alone.

    A ratio of two fitted values moves with both; an unknown that is absolute here is divided by the assumed inertia.
    """
    setups, at = findings.problem.segments.setups, findings.selection.chosen.fit
    unknown, reach = at.estimate.ratios, findings.intervals
    alone = all(setup.mounting == "inner" for setup in setups)
    inertia = float(unknown[RATIOS.index("a/b")] - unknown[ON_ELBOW]) if alone else 1.0
    scale, letter = float(unknown[SCALE]) * inertia, "a" if alone else "b"
    ratios = {}
    for parameter in at.free:
        value = parameter.read(at.estimate)
        if parameter.block == "ratios" and parameter.place < len(RATIOS):
            name, per = f"{parameter.name.partition('/')[0]}/{letter}", inertia
        elif parameter.effect == FREE_ARM.name:
            name, per = ("A" if parameter.name.startswith("inertia") else "c0") + f"/{letter}", scale
        else:
            continue
        error = reach[parameter.effect, parameter.name]
        ratios[name] = Interval(value=value / per, interval90=((value - error) / per, (value + error) / per))
    return ratios


def _remainder(findings: Findings, kind: Verdict) -> str:
    """Size and location of the unmodelled remainder, if the verdict leaves one."""
    described = kind in ("partly_explained", "unexplained") and not findings.description.withholds
    return f" {findings.remainder.sentence}" if findings.remainder and described else ""


def _ratio_covariance(findings: Findings) -> NDArray[np.float64]:
    """(5, 5) covariance; zero for ratios that no run determines, which are those of the rig file."""
    free = findings.selection.chosen.fit.free
    mine = {parameter.place: i for i, parameter in enumerate(free) if parameter.block == "ratios"}
    whole = np.zeros((len(RATIOS), len(RATIOS)))
    seen = [i for i in range(len(RATIOS)) if i in mine]
    own = [mine[i] for i in seen]
    whole[np.ix_(seen, seen)] = findings.covariance[np.ix_(own, own)]
    return whole


def _checks(findings: Findings, named: Sequence[str]) -> list[AdvisedCheck]:
    """All checks of the advice, each once, with ids that are unique among diagnoses."""
    at = findings.selection.chosen.fit.estimate
    own = hashlib.sha256(at.ratios.tobytes() + at.params.tobytes()).hexdigest()[:4]
    each = {(check.kind, check.text, check.about): check for step in findings.advice for check in step.checks}
    each = {key: check for key, check in each.items() if check.about in named and check.expected_bits > 0}
    ranked, assumed = sorted(each.values(), key=lambda check: -check.expected_bits), findings.scale
    return [
        check.model_copy(update={"id": f"{k}-{own}", "expected": expected_size(findings.selection, assumed, check)})
        for k, check in enumerate(ranked, 1)
    ]


def _transfer(transfer: Transfer) -> dict[str, dict[str, Interval]]:
    return {
        effect: {run: Interval(value=share.estimate, interval90=share.interval90) for run, share in runs.items()}
        for effect, runs in transfer.effects.items()
    }


def _interval(value: float, reach: float) -> Interval:
    return Interval(value=value, interval90=(value - reach, value + reach))


def _where(place: Place) -> Where:
    return Where(
        site=place.site,
        coordinate=place.coordinate,
        share=place.share,
        sentence=place.sentence,
        knots=place.knots.tolist(),
        values=place.values.tolist(),
        std=place.std.tolist(),
        unit=place.unit,
    )


def _named(findings: Findings, posterior: EffectPosterior) -> NamedEffect:
    selection = findings.selection
    less, left = selection.without[posterior.name].residuals.excess, max(selection.chosen.residuals.excess, 0.0)
    whole = selection.base.residuals.excess
    values = named_params(selection.chosen.fit.estimate.params).get(posterior.name, {})
    errors = {name: findings.intervals.get((posterior.name, name), 0.0) for name in values}
    assumed = findings.scale
    return NamedEffect.model_validate(
        {
            "name": posterior.name,
            "class": list(posterior.members),
            "odds": dict(zip(posterior.members, posterior.odds, strict=False)),
            "probability": posterior.probability,
            "parameters": {
                name: _size(assumed, posterior.name, name, value, errors[name]) for name, value in values.items()
            }
            | _implied(EFFECTS[posterior.name], values, errors),
            "share": float(np.clip((less - left) / whole, 0.0, 1.0)) if whole > 0 else float(less > left),
        }
    )


def _implied(effect: Effect, values: Params, errors: Params) -> dict[str, Any]:
    """Quantities derived from an effect's parameters, whose errors are assumed to be independent."""
    if effect.implied is None:
        return {}
    sizes, squares = effect.implied(values), dict.fromkeys(effect.implied(values), 0.0)
    for name, error in errors.items():
        moved = effect.implied({**values, name: values[name] + error})
        for key in sizes:
            squares[key] += (moved.get(key, np.inf) - sizes[key]) ** 2
    reaches = {key: float(np.sqrt(square)) for key, square in squares.items() if np.isfinite(square)}
    ends = {key: (sizes[key] - reach, sizes[key] + reach) for key, reach in reaches.items()}
    return {key: EffectSize(value=sizes[key], interval90=ends[key], interval90_with_scale=ends[key]) for key in ends}


def _size(scale: Scale, effect: str, name: str, value: float, reach: float) -> EffectSize:
    """A fitted parameter with its ratio to b, and its absolute interval."""
    parameter, interval = next(p for p in EFFECTS[effect].parameters if p.name == name), (value - reach, value + reach)
    power = parameter.scale_power
    size = EffectSize(value=value, interval90=interval, interval90_with_scale=scale.absolute90(value, interval, power))
    if power == 0 or scale.fixed_by == "data":
        return size
    ratios = {"ratio": scale.ratio(value, power), "ratio_interval90": scale.ratio90(interval, power)}
    return size.model_copy(update=ratios | {"ratio_unit": parameter.ratio_unit})


def _rivals(posteriors: Sequence[EffectPosterior], closest: bool) -> list[RivalEffect]:
    """Alternatives of the named effects; without named effects, the closest effects first."""
    rivals = [
        _rival(other.name, other.members, other.probability, other.cosine, posterior.name)
        for posterior in posteriors
        for other in posterior.alternatives
    ]
    rivals = sorted(rivals, key=lambda other: (-other.probability, -other.cosine))
    if closest:
        rivals = [
            _rival(posterior.name, posterior.members, posterior.probability, 1.0, "") for posterior in posteriors
        ] + rivals
    return rivals


def _rival(name: str, members: Sequence[str], probability: float, cosine: float, instead_of: str) -> RivalEffect:
    fields = {"name": name, "class": list(members), "probability": probability, "cosine": cosine}
    return RivalEffect.model_validate(fields | {"instead_of": instead_of})


def _sensor_findings(findings: Findings) -> list[SensorFinding]:
    """Sensor faults, without the steps that a fitted effect explains."""
    values = named_params(findings.selection.chosen.fit.estimate.params)
    hidden = [0.0, 0.0, 0.0]
    for name, effect in EFFECTS.items():
        if effect.hides_step is not None and name in values:
            for joint in effect.joints:
                hidden[joint] = max(hidden[joint], effect.hides_step(values[name]))
    return [
        SensorFinding(name=f.name, run=f.run, axis=f.axis, at_s=f.at_s, evidence=f.evidence)
        for record in findings.recordings.records
        for f in record.screened.findings
        if f.step is None or f.axis not in ALL_AXES or abs(f.step) > hidden[ALL_AXES.index(f.axis)]
    ]


def _assumptions(findings: Findings) -> list[str]:
    records = findings.recordings.records
    made = [
        _length(findings),
        _scale(findings),
        "Encoder noise is white apart from the faults of the sensor screening; readings were averaged over 5 ms.",
        "The initial states of all segments are free; the first 30 ms after each release are excluded.",
    ]
    if findings.recordings.arm_moves:
        made.append(_arm(findings))
    elif all(record.arm_moves is False for record in records):
        made.append("According to encoder 0 the arm stood still, so a compliant arm was not considered.")
    elif any(record.arm_moves is None for record in records):
        made.append("The arm's angle was not recorded.")
    if findings.recordings.exact_torques:
        made.append(
            "The measured torques were assumed to be exact: the remainder is far above the influence of their noise."
        )
    return [*made, *_torque_noise(findings), *_zeros(findings), *_geared(findings), *_misleading(findings)]


def _torque_noise(findings: Findings) -> list[str]:
    """The noise of measured torques that the fits assume."""
    if findings.problem.disturbance is None or not (most := most_noise(findings.problem)).any():
        return []
    one, two = np.minimum(most, findings.recordings.torque_noise_Nm)
    text = f"Noise of the measured torques of joints 1 and 2, standard deviation: {one:.2g} and {two:.2g} N m"
    differences = "by differences of the recorded torques"
    likelier = f"; by maximum likelihood of the residuals, below {most[0]:.2g} and {most[1]:.2g} N m {differences}"
    return [f"{text}{likelier if np.isfinite(findings.recordings.torque_noise_Nm).all() else f', {differences}'}."]


def _zeros(findings: Findings) -> list[str]:
    """The fitted zeros of encoders that are set to zero before each recording."""
    runs, zeros = findings.recordings.records, 1e3 * findings.selection.chosen.fit.estimate.zeros
    each = [f"{record.run.name}: {own[0]:.3g} and {own[1]:.3g}" for record, own in zip(runs, zeros, strict=False)]
    text = "Encoders are zeroed before each recording; the zero errors of joints 1 and 2 were fitted, mrad"
    return [f"{text}: {'; '.join(each)}."] if each else []


def _geared(findings: Findings) -> list[str]:
    """Effects that are in the model because the rig is known to have them."""
    names = [name for name in findings.selection.chosen.effects if name in findings.selection.expected]
    joints = listed([f"joint {joint}" for joint in findings.recordings.rig.joints.geared])
    are = "is" if len(names) == 1 else "are"
    return (
        [f"The rig file has a geared motor on {joints}: {listed(names)} {are} in the model at any size."]
        if names
        else []
    )


def _misleading(findings: Findings) -> list[str]:
    """Effects that are excluded because they worsen the prediction of held-out runs."""
    names = findings.selection.misleading
    was = "was" if len(names) == 1 else "were"
    text = (
        "excluded from the model, because the prediction of the held-out runs is better without. These runs"
        " therefore influenced the selection."
    )
    return [f"{listed(names)} {was} {text}"] if names else []


def _length(findings: Findings) -> str:
    """The length L1: as measured, or fitted within its uncertainty."""
    rig, at = findings.recordings.rig, findings.selection.chosen.fit.estimate
    if rig.rig.L1_std is None:
        return f"L1 = {rig.L1:g} m and g = {rig.g:g} m/s^2 are as measured."
    name = next(name for name in findings.problem.always if EFFECTS[name].corrects == "L1")
    (added,) = named_params(at.params).get(name, {"": 0.0}).values()
    reach = max(findings.intervals[key] for key in findings.intervals if key[0] == name)
    text = (
        f"L1 is given as {rig.L1:g} m with a standard uncertainty of {rig.rig.L1_std:g} m and fitted:"
        f" {rig.L1 + added:.5g} m +- {reach:.2g} m (90 %), at g = {rig.g:g} m/s^2 and by the device's clock."
    )
    return text if abs(added) < SURELY * rig.rig.L1_std else f"{text} This contradicts the uncertainty in the file."


def _unseen(least: Mapping[str, Mapping[str, float | None]], absorbed: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Sentences on effects that are undetectable at any size, and on those that base parameters absorb."""
    blind = {name: absorbed.get(name, {}) for name, sizes in least.items() if sizes and not any(sizes.values())}
    twins = {name: listed(sorted(set(by.values()) & {*RATIOS, "p/b", "b"})) for name, by in blind.items()}
    alike = [f"{name} is indistinguishable from {twin}" for name, twin in twins.items() if twin]
    hidden = [name for name, twin in twins.items() if not twin]
    return [
        *(
            [f"In these recordings {listed(alike)}. Effects that a base parameter absorbs are not fitted."]
            if alike
            else []
        ),
        *([f"Undetectable at any size in these recordings: {', '.join(hidden)}."] if hidden else []),
    ]


def _arm(findings: Findings) -> str:
    """What is taken for granted of an arm that moves."""
    rig, setups = findings.recordings.rig, findings.problem.segments.setups
    text = "The arm's angle is read, and its inertia and viscous friction are fitted"
    if not any(setup.torques and setup.torques.on_arm is not None for setup in setups):
        return f"{text}; no torque acts on it but friction, springs and the rods."
    kind = rig.motor.input if rig.motor else "torque"
    if DRIVE_GAIN.name in findings.problem.always:
        return f"{text}; so is the torque over the {kind}: the rig file does not measure the motor's constants."
    known = "the motor's constants of the rig file" if kind != "torque" else "that it is a torque in N m"
    if any(setup.torques and setup.torques.scaled for setup in setups):
        return f"{text}; the {kind} is known by {known}, which fixes the scale of all torques."
    return f"{text}; the {kind} is known by {known}, and the rods by their measured values, so that an error shows."


def _scale(findings: Findings) -> str:
    """Source of the scale of all torques."""
    if drives := [
        setup.torques for setup in findings.problem.segments.setups if setup.torques and setup.torques.scaled
    ]:
        kinds = " and ".join(sorted({drive.kind for drive in drives} - {""}))
        return f"The known torques{f', as {kinds},' if kinds else ''} fix the scale of all torques."
    if any(setup.added for setup in findings.problem.segments.setups):
        return "The known added mass fixes the scale of all torques."
    if ("", "b") in findings.intervals:
        return "Friction that follows the load of weighed masses fixes the scale of all torques."
    assumed = findings.scale
    return assumed.sentence if assumed.known else f"{assumed.sentence} A release with a known added mass fixes b."
