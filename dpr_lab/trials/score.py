"""Score of one trial, from a comparison of the diagnosis with the hidden effects."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from pydantic import TypeAdapter

from dpr_lab.effects.missed_counts import MISSED_COUNTS
from dpr_lab.rig import Rig
from dpr_lab.trials.truth import Truth, assumed_inertia

NAMING = ("named", "partly_explained")
ADMITTING = ("unexplained", "partly_explained")
STEP = MISSED_COUNTS.name
CLAIMED = 0.5
"""Probability above which a wrongly named effect counts as a wrong claim."""

Json = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Cause:
    """A hidden effect of a plant."""

    name: str
    over_limit: float | None
    """Size relative to the minimum detectable size of the diagnosis; None if this size is unknown."""
    named: bool
    """Whether the diagnosis names the effect or a member of its class."""


@dataclass(frozen=True, slots=True)
class SizeError:
    """Error of one estimated amplitude of a named effect."""

    effect: str
    parameter: str
    relative: float
    """|estimate - true value|, divided by the largest true amplitude of the effect."""
    covered: bool
    """Whether the 90 % interval contains the true value."""
    leads: bool
    """Whether this amplitude is the largest amplitude of its effect."""


@dataclass(frozen=True, slots=True)
class Claim:
    """A statement of a diagnosis with a probability, and whether the statement is true."""

    probability: float
    true: bool


@dataclass(frozen=True, slots=True)
class TrialOutcome:
    """Outcome of one trial: the truth, the diagnosis and their comparison."""

    kind: str
    level: str
    seed: int
    truth: tuple[str, ...]
    """Names of the hidden effects, the largest effect first; an out-of-library effect has its own name."""
    held_back: bool
    verdict: str
    named: tuple[str, ...]
    """Named effects in the order of the diagnosis."""
    class_sizes: tuple[int, ...]
    """Number of effects in the class of each named effect. A class of the whole library would always be correct."""
    first: bool
    """Whether the first named effect is one of the causes."""
    top3: bool
    """Whether one of the causes is among the first three named effects and alternatives."""
    exact: bool
    """Whether the named effects are exactly the causes."""
    invented: bool
    """Whether at least one named effect is not a cause."""
    silent: bool
    """Whether the diagnosis reports no gap."""
    wrong_name: bool
    """Whether a named effect that is not a cause has a probability above `CLAIMED`."""
    admitted: bool
    """Whether the diagnosis reports that part of the gap is unexplained."""
    explained_share: float
    closed: float
    """Share of the gap that closes on held-out data; nan if it is unknown."""
    sizes: tuple[SizeError, ...]
    claims: tuple[Claim, ...]
    sensor_findings: tuple[str, ...]
    faults_missed: tuple[str, ...]
    """Encoder faults of the plant to which no sensor finding corresponds."""
    seconds: float
    seal: str = ""
    causes: tuple[Cause, ...] = ()
    """Hidden effects with their sizes relative to the minimum detectable sizes."""
    classes: tuple[tuple[str, ...], ...] = ()
    """Members of the class of each named effect; empty in an outcome of an older version."""

    @property
    def named_classes(self) -> tuple[tuple[str, ...], ...]:
        """Members of the class of each named effect; this effect comes first."""
        return self.classes or tuple((name,) for name in self.named)

    @property
    def grade(self) -> str:
        """Grade of the trial: `right`, `right in part`, `not named` or `wrong`."""
        if not self.truth or self.kind == "outside":
            right = self.admitted and not self.wrong_name if self.truth else self.silent
            return "right" if right else "wrong"
        if self.exact:
            return "right"
        if self.first and not self.wrong_name:
            return "right in part"
        return "wrong" if self.named else "not named"

    @property
    def is_true(self) -> bool:
        """Whether the statement of the diagnosis is true.

        "No gap", or a list of causes, is a statement only about effects above their minimum detectable sizes. It is
        true if the grade is `right`, or if no effect is named wrongly and each effect that is not named is below this
        size.
        """
        if self.grade == "right":
            return True
        small = all(cause.named or (cause.over_limit is not None and cause.over_limit < 1.0) for cause in self.causes)
        return bool(self.causes) and small and not self.invented and self.verdict in ("no_gap", "named")

    def to_json(self) -> dict[str, Any]:
        """Return the outcome as a dict, with None for numbers that are not finite; `read_outcome` is the inverse."""
        numbers = {name: value for name in _NUMBERS if math.isfinite(value := getattr(self, name))}
        return asdict(self) | dict.fromkeys(_NUMBERS) | numbers


_OUTCOME = TypeAdapter(TrialOutcome)
_NUMBERS = ("explained_share", "closed")


def read_outcome(saved: Mapping[str, Any]) -> TrialOutcome:
    """Restore an outcome from the dict that `TrialOutcome.to_json` returns.

    Unknown keys are ignored.

    Raises:
        KeyError: a number is missing
        ValidationError: another key is missing or has a wrong type
    """
    return _OUTCOME.validate_python({**saved, **{name: _number(saved[name]) for name in _NUMBERS}})


def score(
    diagnosis: Json, truth: Truth, rig: Rig, *, kind: str, level: str, seed: int, seconds: float, seal: str = ""
) -> TrialOutcome:
    """Score a diagnosis against the revealed truth.

    Args:
        diagnosis: output of `dpr-lab diagnose --json`
        truth: the revealed truth of the plant
        rig: the rig file of the diagnosis
        kind: the requested kind
        level: the requested visibility
        seed: seed of the draw
        seconds: duration of the diagnosis, s
        seal: the published seal
    """
    effects = _named(diagnosis)
    listed = [*effects, *(rival for rival in diagnosis["rivals"] if rival not in effects)]
    hits = [cause_named(effect, truth) for effect in effects]
    true_sizes = truth.sizes(rig, assumed_inertia(diagnosis, rig))
    findings = tuple(sorted({finding["name"] for finding in diagnosis["sensor_findings"]}))
    return TrialOutcome(
        kind=kind,
        level=level,
        seed=seed,
        truth=(*truth.effects, *([truth.foreign] if truth.foreign else [])),
        held_back=truth.held_back,
        verdict=diagnosis["verdict"],
        named=tuple(effect["name"] for effect in effects),
        class_sizes=tuple(len(effect["class"]) for effect in effects),
        classes=tuple((effect["name"], *(n for n in effect["class"] if n != effect["name"])) for effect in effects),
        first=bool(hits) and hits[0] is not None,
        top3=any(cause_named(effect, truth) is not None for effect in listed[:3]),
        exact=len(hits) == len(truth.answers) and None not in hits and len(set(hits)) == len(hits),
        invented=None in hits,
        silent=diagnosis["verdict"] == "no_gap" and not effects,
        wrong_name=any(not claim.true and claim.probability > CLAIMED for claim in _claimed(effects, hits)),
        admitted=diagnosis["verdict"] in ADMITTING or _candidates(diagnosis),
        explained_share=_number(diagnosis["gap"].get("explained_share")),
        closed=_number((diagnosis["gap"].get("closed_held_out") or {}).get("estimate")),
        sizes=tuple(_sizes(effects, true_sizes)),
        claims=tuple(_claims(diagnosis, effects, hits, truth)),
        sensor_findings=findings,
        faults_missed=tuple(fault for fault in _faults(truth) if fault not in findings),
        seconds=seconds,
        seal=seal,
        causes=tuple(_causes(diagnosis, hits, truth, true_sizes)),
    )


def _named(diagnosis: Json) -> list[Json]:
    """Return the effects that the diagnosis names, as dicts.

    A step of a reading that only the sensor screening detects counts as a named effect without a probability.
    """
    naming = diagnosis["verdict"] in NAMING or _candidates(diagnosis)
    effects: list[Json] = list(diagnosis["effects"]) if naming else []
    steps = any(finding["name"] == STEP for finding in diagnosis["sensor_findings"])
    if steps and all(effect["name"] != STEP for effect in effects):
        effects.append({"name": STEP, "class": [STEP], "probability": None, "parameters": {}})
    return effects


def _candidates(diagnosis: Json) -> bool:
    """Return whether the recordings show a gap whose cause they cannot determine."""
    return diagnosis["verdict"] == "inconclusive" and bool(diagnosis["effects"])


def _causes(
    diagnosis: Json, hits: Sequence[int | None], truth: Truth, sizes: Mapping[str, Mapping[str, float]]
) -> Iterator[Cause]:
    for number, name in enumerate(truth.effects):
        yield Cause(name, over_limit(sizes[name], diagnosis["detectable"].get(name, {})), number in hits)
    if truth.foreign is not None:
        yield Cause(truth.foreign, None, len(truth.effects) in hits)


def over_limit(sizes: Mapping[str, float], least: Mapping[str, float | None]) -> float | None:
    """Return the ratio of an effect's size to its minimum detectable size: the largest ratio of its amplitudes.

    The result is None if no minimum detectable size is known.
    """
    ratios = ((abs(size), least.get(name)) for name, size in sizes.items())
    return max((size / limit for size, limit in ratios if limit), default=None)


def _faults(truth: Truth) -> list[str]:
    """Return the sensor findings that the faulty encoders of the plant should cause."""
    hidden_faults = {
        "undithered_quantisation": truth.encoders["step_counts"] > 1,
        "jitter": truth.encoders["jitter_ms"] > 0,
        "repeated_sample": truth.encoders["repeated_share"] > 0 or truth.encoders.get("stale_every", 0) > 0,
        "periodic_delay": truth.encoders.get("late_every", 0) > 0,
        "gap": truth.encoders["missing_share"] > 0 or truth.encoders.get("lost_for_s", 0) > 0,
    }
    return [name for name, is_there in hidden_faults.items() if is_there]


def cause_named(effect: Json, truth: Truth) -> int | None:
    """Return the index of the true cause that is a named effect or a member of its class; None without one."""
    names = {effect["name"], *effect["class"]}
    return next((i for i, right in enumerate(truth.answers) if names.intersection(right)), None)


def _claims(diagnosis: Json, effects: Sequence[Json], hits: Sequence[int | None], truth: Truth) -> list[Claim]:
    """Return the statements of the diagnosis that have a probability.

    These are the named effects or, without any, the statement of no gap or of an unexplained gap. An inconclusive
    diagnosis without candidates states nothing.
    """
    if claimed := _claimed(effects, hits):
        return claimed
    if diagnosis["verdict"] == "inconclusive":
        return []
    true = {"no_gap": truth.clean, "unexplained": truth.outside}.get(diagnosis["verdict"], False)
    return [Claim(_number(diagnosis["probabilities"].get(diagnosis["verdict"]), 1.0), true)]


def _claimed(effects: Sequence[Json], hits: Sequence[int | None]) -> list[Claim]:
    stated = [(effect["probability"], hit is not None) for effect, hit in zip(effects, hits, strict=True)]
    return [Claim(probability, true) for probability, true in stated if probability is not None]


def _sizes(effects: Sequence[Json], true: Mapping[str, Mapping[str, float]]) -> list[SizeError]:
    """Compute the errors of the estimated amplitudes of correctly named effects.

    A true effect is omitted if only another member of its class is named, because its amplitudes have no estimate.
    """
    errors: list[SizeError] = []
    for effect in effects:
        amplitudes = true.get(effect["name"], {})
        largest = max((abs(value) for value in amplitudes.values()), default=0.0)
        for name, value in amplitudes.items():
            fitted = effect["parameters"].get(name)
            if fitted is not None and largest > 0.0:
                low, high = fitted["interval90"]
                error = abs(fitted["value"] - value) / largest
                errors.append(SizeError(effect["name"], name, error, low <= value <= high, abs(value) == largest))
    return errors


def _number(value: Any, otherwise: float = math.nan) -> float:
    return otherwise if value is None else float(value)
