"""A diagnosis as rows of text, and what its numbers mean."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dpr_lab.checks.wording import bayes_factor
from dpr_lab.effects import EFFECTS
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.gap.result.diagnosis import NONE_OF_THEM, AdvisedCheck, CheckDone, Diagnosis, RivalEffect, Where
from dpr_lab.gap.screen.pieces import whole
from dpr_lab.report.angles import RADIANS, AngleUnit
from dpr_lab.report.digits import NONE, three
from dpr_lab.report.gap.sizes import absolute_sentence, size_in_sentence, sizes_cell
from dpr_lab.report.tables import run_name
from dpr_lab.report.words import in_words, named, parameter_words, size_words
from dpr_lab.shown import listed

EFFECT_COLUMNS = ("effect", "cannot be told from", "probability", "excess without it", "size, 90 % interval")
STEP_COLUMNS = ("model", "gap left (mrad)", "excess explained")
STANDING_COLUMNS = ("place of", "what it can be", "probability", "likeness", "what tells it apart")
PLACE_COLUMNS = ("where", "by", "share of the excess", "what it looks like")
CLOSED_COLUMNS = ("run", "gap closed", "free run before (mrad)", "after (mrad)")
MOVED_COLUMNS = ("cause", "probability before", "after", "Bayes factor")
MOVED_NOTE = (
    "Bayes factor: how much more probable the result is under this cause than under all others together. Above 1 the"
    " result speaks for the cause, below 1 against it; beyond 20 or 1/20 strongly."
)
CHECK_COLUMNS = ("check", "kind", "what to do", "expected result", "splits", "expected bits")
CHECK_NOTE = (
    "Expected result: size and 90 % interval if the measured effect is the cause; otherwise about zero. To record it:"
    " dpr-lab check DIAGNOSIS.json CHECK RUN..., or for a measurement --value 'V UNIT' --std 'S UNIT'."
)
DETECTABLE_COLUMNS = ("effect", "least detectable size")
HORIZON_COLUMNS = ("horizon (s)", "gap before (mrad rms)", "gap after (mrad rms)")
MAP_COLUMNS = ("where", "by", "at", "value", "90 % reach")
FINDING_COLUMNS = ("finding", "run", "axis", "at (s)", "evidence")

EFFECT_NOTE = (
    "Excess: the gap above the noise, squared (half the gap is a quarter of the excess). Excess without it: what comes"
    " back when this effect alone is left out and the others are fitted again; effects stand in for each other in part,"
    " so these shares need not add up to 100 %. Effects that cannot be told apart share one probability."
)
STEP_NOTE = (
    "Gap: rms above the noise, both joints together (root of the sum of squares), segments of 0.5 s. Effects are added"
    " one at a time, the most telling first, so these shares do add up; the last is that of all effects together."
)
STANDING_NOTE = (
    "The probabilities of one place add up to 100 %. Likeness: cosine of what the two do to these readings, 1 is alike."
)
CLOSED_NOTE = (
    "Gap closed: by how much the rms falls, each release predicted from the others (a single one by quarters). Free"
    " run: 2.6 s from a start state that only the first 0.3 s fix."
)

ALONE = "no other"
"""What an effect cannot be told from where it can be told from all."""

SPLIT = "these recordings"


@dataclass(frozen=True, slots=True)
class AlternativeWords:
    """Which alternatives need a reason."""

    improbable: float = 1e-3
    """Probability below which only that is said."""
    same_shape: float = 0.9995
    """Cosine similarity that is shown as 1.000: an alternative that is improbable all the same needs a reason."""


ALTERNATIVE_WORDS = AlternativeWords()

_QUANTITIES = {
    "N m": ("torque (mN m)", 1e3),
    "N m s/rad": ("friction (mN m s/rad)", 1e3),
    "m": ("friction radius (mm)", 1e3),
}

_COORDINATES = {"time": "time since release (s)", "load": "joint force (N)"}


def quantity(place: Where, angles: AngleUnit = RADIANS) -> tuple[str, float]:
    """What a place's values are: label with unit, and factor to that unit."""
    if place.unit == "rad":
        return f"encoder error ({angles.small})", angles.small_per_rad
    return _QUANTITIES.get(place.unit, (place.unit, 1.0))


def coordinate(place: Where, angles: AngleUnit = RADIANS) -> tuple[str, float]:
    """What a place's knots are: label with unit, and factor to that unit."""
    unit = angles.symbol.strip()
    if place.coordinate in ("angle", "speed"):
        return f"joint {place.coordinate} ({unit}{'/s' if place.coordinate == 'speed' else ''})", angles.per_rad
    return _COORDINATES.get(place.coordinate, place.coordinate), 1.0


def sentence(diagnosis: Diagnosis, angles: AngleUnit = RADIANS) -> str:
    """The verdict in words, with the size of each effect that has a single one, and what absolute sizes assume."""
    sizes = {effect.name: size_in_sentence(diagnosis, effect, angles) for effect in diagnosis.effects}
    return in_words(diagnosis.sentence, sizes) + absolute_sentence(diagnosis, angles)


def effect_rows(diagnosis: Diagnosis, angles: AngleUnit = RADIANS) -> list[tuple[str, ...]]:
    """One row for each named effect."""
    return [
        (
            named(item.name),
            ", ".join(named(name) for name in item.members if name != item.name) or ALONE,
            f"{item.probability:.0%}",
            f"{item.share:.1%}",
            sizes_cell(diagnosis, item, angles),
        )
        for item in diagnosis.effects
    ]


@dataclass(frozen=True, slots=True)
class _Place:
    """A named effect's place in the model, or that of the closest one where none is named."""

    name: str
    members: tuple[str, ...]
    probability: float
    rivals: tuple[RivalEffect, ...]


def standing_rows(diagnosis: Diagnosis, most: int = 2, open_from: float = 0.05) -> list[tuple[str, ...]]:
    """What each named effect can be instead, how probable that is, and what tells it apart; up to 100 % in each.

    Args:
        diagnosis: the diagnosis
        most: so many rivals of each place are shown,
        open_from: and all that are at least so probable; the others are counted together
    """
    left = f"{1 - diagnosis.gap.explained_share:.1%} of the excess is left"
    checked = {
        done.check.about: done.after[NONE_OF_THEM] for done in diagnosis.checks_done if NONE_OF_THEM in done.after
    }
    rows: list[tuple[str, ...]] = []
    for place in _places(diagnosis):
        known = place.probability + sum(rival.probability for rival in place.rivals)
        outside = checked.get(place.name, min(diagnosis.probabilities[NONE_OF_THEM], max(1 - known, 0.0)))
        likeliest = [r for i, r in enumerate(place.rivals) if i < most or r.probability >= open_from]
        rest = 1 - outside - place.probability - sum(rival.probability for rival in likeliest)
        twins = _next_step(diagnosis, *place.members[:2]) if len(place.members) > 1 else ""
        could = " or ".join(map(named, place.members))
        rows.append((named(place.name), could, _sure(place.probability), NONE, twins or NONE))
        rows += [
            ("", named(r.name), _sure(r.probability), f"{r.cosine:.4f}", _split(diagnosis, place, r)) for r in likeliest
        ]
        rows.append(("", "another rival, or no effect", _sure(rest), NONE, SPLIT))
        rows.append(
            ("", "a cause outside the library", _sure(outside), NONE, "the checks" if place.name in checked else left)
        )
    return rows


def _places(diagnosis: Diagnosis) -> Iterator[_Place]:
    named = diagnosis.effects or [rival for rival in diagnosis.rivals if not rival.instead_of]
    for item in named:
        rivals = tuple(rival for rival in diagnosis.rivals if rival.instead_of == item.name)
        yield _Place(item.name, tuple(item.members), item.probability, rivals)


def _split(diagnosis: Diagnosis, place: _Place, rival: RivalEffect) -> str:
    """What to do next where that decides between them; else these recordings have done it, and by what."""
    if step := _next_step(diagnosis, place.name, rival.name):
        return step
    if rival.probability >= ALTERNATIVE_WORDS.improbable or rival.cosine < ALTERNATIVE_WORDS.same_shape:
        return SPLIT
    if rival.name in EFFECTS and place.name in EFFECTS[rival.name].nested:
        return f"{SPLIT}: a more general form; not needed, because the simpler one explains as much"
    return f"{SPLIT}: of the same shape to first order, but it fits worse when it is fitted"


def _next_step(diagnosis: Diagnosis, *names: str) -> str:
    """By its number, the first that speaks of all these effects; nothing where there is none."""
    numbers = (i for i, said in enumerate(diagnosis.advice, 1) if {*names} <= {*re.findall(r"\w+", said)})
    return next((f"next step {i}" for i in numbers), "")


def _sure(probability: float) -> str:
    if probability < ALTERNATIVE_WORDS.improbable:
        return "< 0.1%"
    return f"{probability:.0%}" if probability >= 0.1 else f"{probability:.1%}"


def step_rows(diagnosis: Diagnosis, angles: AngleUnit = RADIANS) -> list[tuple[str, ...]]:
    """The gap and the share of the excess explained, from the bare model to that with all effects."""
    gaps, explained = steps(diagnosis), diagnosis.gap.explained_share
    shares = [1 - (gap / gaps[0][1]) ** 2 if gaps[0][1] > 0 else 0.0 for _, gap in gaps[:-1]]
    shares += [explained] if len(gaps) > 1 else [0.0]
    return [
        (name, three(angles.small_per_rad * gap), f"{share:.1%}")
        for (name, gap), share in zip(gaps, shares, strict=True)
    ]


def steps(diagnosis: Diagnosis) -> list[tuple[str, float]]:
    """Each model from the bare one on, and the gap that it leaves, both joints, rad."""
    before = float(np.linalg.norm(list(diagnosis.gap.before_rad.values())))
    return [
        ("bare model", before),
        *((f"+ {named(step['effect'])}", float(step["rms_rad"])) for step in diagnosis.gap.waterfall),
    ]


def closed_sentence(diagnosis: Diagnosis) -> str:
    """How much of the gap closes on data that were not used; nothing where the model stays bare."""
    share, names = diagnosis.gap.closed_held_out, [named(step["effect"]) for step in diagnosis.gap.waterfall]
    if not names:
        return ""
    low, high = share.interval90
    return (
        f"With {listed(names)} {share.estimate:.1%} of the gap closes on data that took no part in the fit"
        f" (90 % interval {low:.1%} to {high:.1%})."
    )


def run_words(name: str, held_out: bool = False) -> str:
    """A run, or a piece of it, by its pose and when it was recorded, and whether it took no part in the fit."""
    return run_name(Path(f"{whole(name)}.mcap")) + name.removeprefix(whole(name)) + (" (held out)" if held_out else "")


def next_steps(diagnosis: Diagnosis) -> list[str]:
    """What to record or to check next; what to do with a remainder that has no name."""
    left = {
        "partly_explained": "The rest has another cause, or is another form of what is named: check that on the bench.",
        "unexplained": "No effect of the library is the cause: look on the bench where the gap lies, joint by joint.",
    }
    rest = [left[diagnosis.verdict]] if diagnosis.verdict in left else []
    return [*map(in_words, diagnosis.advice), *rest] or ["Nothing is left to be decided."]


def moved_rows(done: CheckDone) -> list[tuple[str, ...]]:
    """Probabilities before and after a check, the most probable cause first, in the columns `MOVED_COLUMNS`."""
    ranked = sorted(done.after, key=lambda name: -done.after[name])
    return [
        (
            "none of these effects" if name == NONE_OF_THEM else named(name),
            f"{done.before[name]:.3f}",
            f"{done.after[name]:.3f}",
            bayes_factor(done, name),
        )
        for name in ranked
    ]


def check_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """The recommended checks, in the columns `CHECK_COLUMNS`."""
    return [
        (
            check.id,
            check.kind,
            in_words(check.text),
            _expected(check),
            ", ".join(map(named, check.splits)),
            f"{check.expected_bits:.2f}",
        )
        for check in diagnosis.checks
    ]


def _expected(check: AdvisedCheck) -> str:
    """The expected result of a measurement with its interval."""
    if check.quantity is None or check.expected is None:
        return NONE
    ends = check.expected.value, *check.expected.interval90
    return size_words(check.measures, check.quantity.parameters[0], RADIANS, *ends)


def place_rows(diagnosis: Diagnosis, count: int = 4) -> list[tuple[str, ...]]:
    """The places that explain most."""
    return [
        (in_words(item.site), item.coordinate, f"{item.share:.0%}", in_words(item.sentence))
        for item in diagnosis.where[:count]
    ]


def place_map(
    place: Where, angles: AngleUnit = RADIANS, unknown: float = 1e3
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Knots of a place's map, its values there and how far their 90 % intervals reach, in the units shown.

    Value and reach are NaN at a knot that the recordings do not reach: one whose standard deviation is `unknown` times
    the largest value of the map.
    """
    (_, factor), (_, along) = quantity(place, angles), coordinate(place, angles)
    knots, values, std = along * np.array(place.knots), np.array(place.values), np.array(place.std)
    known = np.where(std < unknown * np.abs(values).max(initial=0.0), factor, np.nan)
    return knots, known * values, NORMAL_Q90 * (known * std)


def horizon_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """The gap above the noise by length of a segment."""
    by_length = diagnosis.gap.by_horizon.items()
    return [(length, *(three(1e3 * gaps[name]) for name in ("before", "after"))) for length, gaps in by_length]


def map_rows(diagnosis: Diagnosis, count: int = 4) -> list[tuple[str, ...]]:
    """Every knot of the maps of the places that explain most."""
    return [
        (in_words(place.site), coordinate(place)[0], three(at), f"{three(value)} {quantity(place)[0]}", three(reach))
        for place in diagnosis.where[:count]
        for at, value, reach in zip(*(values.tolist() for values in place_map(place)), strict=True)
    ]


def closed_rows(diagnosis: Diagnosis, angles: AngleUnit = RADIANS) -> list[tuple[str, ...]]:
    """How far the gap closes, by run; runs held out by hand are marked."""
    gap, closed = diagnosis.gap, diagnosis.gap.closed_held_out
    shares = {name: (run_words(name), share) for name, share in closed.per_run.items()}
    shares |= {name: (run_words(name, held_out=True), share) for name, share in closed.held_out.items()}
    rows = []
    for name, (label, share) in shares.items():
        free = gap.free_run_rad.get(name, {})
        both = (free.get(key) for key in ("before", "after"))
        before, after = (NONE if rms is None else three(angles.small_per_rad * rms) for rms in both)
        rows.append((label, f"{share:.1%}" if gap.waterfall else NONE, before, after))
    return rows


def detectable_rows(diagnosis: Diagnosis, angles: AngleUnit = RADIANS) -> list[tuple[str, ...]]:
    """Least detectable size of every effect on these recordings."""
    return [
        (
            named(name),
            ", ".join(
                f"{parameter_words(p)} {'not visible' if size is None else size_words(name, p, angles, size)}"
                for p, size in sizes.items()
            ),
        )
        for name, sizes in diagnosis.detectable.items()
    ]


def finding_rows(diagnosis: Diagnosis, most: int = 3) -> list[tuple[str, ...]]:
    """Sensor faults; of those that say the same of an axis but for the instant the first alone, beyond so many."""
    alike: dict[tuple[str, ...], list[str]] = {}
    for item in diagnosis.sensor_findings:
        kind = (named(item.name), run_words(item.run), in_words(item.axis or NONE), item.evidence)
        alike.setdefault(kind, []).append(NONE if item.at_s is None else f"{item.at_s:.3f}")
    rows: list[tuple[str, ...]] = []
    for (*where, evidence), at in alike.items():
        if len(at) > most:
            rows.append((*where, at[0], f"{evidence.rstrip('.')}; {len(at)} times, first here"))
        else:
            rows += [(*where, instant, evidence) for instant in at]
    return rows
