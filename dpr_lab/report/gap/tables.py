"""Create the tables of a diagnosis, with notes on their columns."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects import EFFECTS
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.gap.result.causes import PROBABLE, NamedEffect, RivalEffect, nameable
from dpr_lab.gap.result.checks import NONE_OF_THEM
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.gap_size import Gap, Where
from dpr_lab.gap.screen.pieces import whole
from dpr_lab.report.angles import RADIANS, AngleUnit
from dpr_lab.report.digits import NONE, three
from dpr_lab.report.gap.sizes import sizes_cell
from dpr_lab.report.pages.page import PageTable, Rows, page_table
from dpr_lab.report.run_names import run_label
from dpr_lab.report.words import in_words, named, parameter_words, size_words
from dpr_lab.shown import percent

EFFECT_NOTE = (
    "Unique contribution: share of the excess chi-square that returns when this effect is removed and the"
    " others are refitted. The excess is proportional to the square of the gap. Effects can partly replace"
    " each other, so the shares need not add up to 100 %. Indistinguishable effects share one probability."
)
COMMON_NOTE = "The effects are added one at a time. The share is cumulative, and the sizes are those of the last fit."
STEP_NOTE = (
    "Gap: rms of a reading above the noise, over all joints, in segments of 0.5 s (longer for single rods)."
    " Effects are added one at a time, the largest contribution first. The excess explained is cumulative."
)
STANDING_NOTE = (
    "The first row of an effect states the probability of the effect and its indistinguishable effects. A richer form"
    " is not a separate alternative if its additional term is excluded, for example the drift of an offset. The"
    " probabilities in all rows of one effect add up to 100 %. If the cosine similarity is 1, both effects change the"
    " readings in the same way."
)
CLOSED_NOTE = (
    "Gap reduction: relative decrease of the rms above the noise. Each run is predicted from the other runs (a single"
    " run: each quarter from the other quarters). Free run: rms error over 2.6 s, even beyond the predictability"
    " horizon, from an initial state fitted to the first 0.3 s. The verdict and the uncertainty budget state the error"
    " up to the horizon. Bare model: rods with viscous friction, no effects."
)

ALONE = "none"
"""Cell for an effect that is distinguishable from all others."""

SPLIT = "these recordings"
"""Cell for an alternative that needs no check, because the recordings distinguish it."""


@dataclass(frozen=True, slots=True)
class AlternativeWords:
    """Thresholds for the table of alternatives."""

    improbable: float = 1e-3
    """Minimum probability that is printed as a number. A smaller probability is printed as `< 0.1 %`."""
    same_shape: float = 0.9995
    """Cosine similarity from which two effects have practically the same signature. The table states why an improbable
    alternative with such a similarity was rejected."""


ALTERNATIVE_WORDS = AlternativeWords()

_QUANTITIES = {
    "N m": ("torque (mN m)", 1e3),
    "N m s/rad": ("friction (mN m s/rad)", 1e3),
    "m": ("friction radius (mm)", 1e3),
}

_COORDINATES = {"time": "time since release (s)", "load": "joint force (N)"}
"""Axis labels; `load` is contained in diagnoses of older versions."""


def quantity(place: Where, angles: AngleUnit = RADIANS) -> tuple[str, float]:
    """Return the axis label for the values of a residual map, and the factor from SI to displayed units."""
    if place.unit == "rad":
        return f"encoder error ({angles.small})", angles.small_per_rad
    return _QUANTITIES.get(place.unit, (place.unit, 1.0))


def coordinate(place: Where, angles: AngleUnit = RADIANS) -> tuple[str, float]:
    """Return the axis label for the coordinate of a residual map, and the factor from SI to displayed units."""
    unit = angles.symbol.strip()
    if place.coordinate in ("angle", "speed"):
        return f"joint {place.coordinate} ({unit}{'/s' if place.coordinate == 'speed' else ''})", angles.per_rad
    return _COORDINATES.get(place.coordinate, place.coordinate), 1.0


def sentence(diagnosis: Diagnosis) -> str:
    """Return the verdict, with a description of each named effect."""
    return in_words(diagnosis.sentence)


def causes(diagnosis: Diagnosis) -> dict[str, NamedEffect]:
    """Return the named effects that are probable, by the description of their class."""
    return {
        " or ".join(map(named, nameable(effect.members, effect.odds))): effect
        for effect in diagnosis.effects
        if effect.probability >= PROBABLE
    }


@page_table("effect", "size, 90 % interval", "probability", style="prose")
def summary_table(diagnosis: Diagnosis, *, brief: bool = False) -> Rows:
    """Return one row for each named effect that is probable; `brief` is passed to `sizes_cell`."""
    return [
        (words, sizes_cell(diagnosis, effect, brief=brief), percent(effect.probability))
        for words, effect in causes(diagnosis).items()
    ]


@page_table("common effect alone", "size, 90 % interval", "share of the excess", caption=COMMON_NOTE, style="prose")
def common_table(diagnosis: Diagnosis, angles: AngleUnit = RADIANS) -> Rows:
    """Return one row for each effect of the fit of the common effects alone."""
    rows = [(" or ".join(map(named, e.members)), sizes_cell(diagnosis, e, angles), e.share) for e in diagnosis.common]
    return [(members, sizes, percent(share)) for members, sizes, share in rows]


@page_table(
    "effect",
    "indistinguishable effects",
    "probability",
    "unique contribution",
    "size, 90 % interval",
    caption=EFFECT_NOTE,
    style="prose",
)
def effect_table(diagnosis: Diagnosis, angles: AngleUnit = RADIANS) -> Rows:
    """Return one row for each effect of the corrected model."""
    return [
        (
            named(effect.name),
            ", ".join(named(name) for name in effect.members if name != effect.name) or ALONE,
            percent(effect.probability) + " (form untested)" * effect.untested,
            percent(effect.share, 1),
            sizes_cell(diagnosis, effect, angles),
        )
        for effect in diagnosis.effects
    ]


@page_table("effect", "indistinguishable effects", "unique contribution", caption=EFFECT_NOTE)
def contribution_table(diagnosis: Diagnosis) -> Rows:
    """Return one row for each effect of the corrected model."""
    return [(name, members, share) for name, members, _, share, _ in effect_table(diagnosis).rows]


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A named effect with its alternatives; if no effect is named, an effect that might be the cause."""

    name: str
    members: tuple[str, ...]
    probability: float
    alternatives: tuple[RivalEffect, ...]
    outside: float
    """Probability of a cause outside the library."""


@page_table(
    "effect",
    "alternatives",
    "probability",
    "cosine similarity",
    "how to distinguish",
    caption=STANDING_NOTE,
    style="prose",
)
def standing_table(diagnosis: Diagnosis, most: int = 2, open_from: float = PROBABLE) -> Rows:
    """Return the alternatives of each named effect.

    The probabilities of an effect and its alternatives add up to 1.

    Args:
        diagnosis: the diagnosis
        most: number of alternatives shown per effect
        open_from: further alternatives are shown if they are at least this probable; the others share one row
    """
    remainder = f"{percent(1 - diagnosis.gap.explained_share, 1)} of the excess remains"
    checked = diagnosis.outside_by_checks
    rows: list[tuple[str, ...]] = []
    for candidate in _candidates(diagnosis):
        known = candidate.probability + sum(other.probability for other in candidate.alternatives)
        outside = checked.get(candidate.name, min(candidate.outside, max(1 - known, 0.0)))
        likeliest = [r for i, r in enumerate(candidate.alternatives) if i < most or r.probability >= open_from]
        others = 1 - outside - candidate.probability - sum(other.probability for other in likeliest)
        check = _check_between(diagnosis, *candidate.members[:2]) if len(candidate.members) > 1 else ""
        members = " or ".join(map(named, candidate.members))
        rows.append((named(candidate.name), members, _percent(candidate.probability), NONE, check or NONE))
        rows += [
            (
                "",
                named(r.name),
                _percent(r.probability),
                f"{r.cosine:.4f}",
                _how_to_distinguish(diagnosis, candidate, r),
            )
            for r in likeliest
        ]
        rows.append(("", "another alternative, or no effect", _percent(others), NONE, SPLIT))
        evidence = "the checks" if candidate.name in checked else remainder
        rows.append(("", "a cause outside the library", _percent(outside), NONE, evidence))
    return rows


def open_table(diagnosis: Diagnosis) -> PageTable | None:
    """Return the alternatives of each named effect that has a probable alternative; None without such an effect."""
    names = {alternative.instead_of for alternative in diagnosis.rivals if alternative.probability >= PROBABLE}
    effects = [effect for effect in diagnosis.effects if effect.name in names]
    shown = effects or (names and not diagnosis.effects)
    return standing_table(diagnosis.model_copy(update={"effects": effects}), most=0) if shown else None


def _candidates(diagnosis: Diagnosis) -> Iterator[_Candidate]:
    closest = [alternative for alternative in diagnosis.rivals if not alternative.instead_of]
    for effect in diagnosis.effects or closest:
        alternatives = tuple(r for r in diagnosis.rivals if r.instead_of == effect.name)
        outside = effect.outside if isinstance(effect, NamedEffect) else None
        outside = diagnosis.probabilities[NONE_OF_THEM] if outside is None else outside
        yield _Candidate(effect.name, tuple(effect.members), effect.probability, alternatives, outside)


def _how_to_distinguish(diagnosis: Diagnosis, candidate: _Candidate, alternative: RivalEffect) -> str:
    """Return the check that distinguishes two effects, or the reason why no check is needed."""
    if check := _check_between(diagnosis, candidate.name, alternative.name):
        return check
    if alternative.probability >= ALTERNATIVE_WORDS.improbable or alternative.cosine < ALTERNATIVE_WORDS.same_shape:
        return SPLIT
    if alternative.name in EFFECTS and candidate.name in EFFECTS[alternative.name].nested:
        return f"{SPLIT}: a more general form, which is not needed because the simpler form explains as much"
    return f"{SPLIT}: same shape to first order, but a worse fit"


def _check_between(diagnosis: Diagnosis, *names: str) -> str:
    """Return the first check that distinguishes all given effects; empty without such a check."""
    return next((f"check {check.id}" for check in diagnosis.checks if {*names} <= {*check.splits}), "")


def _percent(probability: float) -> str:
    if probability < ALTERNATIVE_WORDS.improbable:
        return "< 0.1 %"
    return percent(probability) if probability >= 0.1 else percent(probability, 1)


@page_table(
    "model",
    "gap, fitted recordings (mrad)",
    "excess explained",
    caption=STEP_NOTE,
    style="prose",
    title="Excess chi-square of the fitted recordings",
)
def step_table(diagnosis: Diagnosis, angles: AngleUnit = RADIANS) -> Rows:
    """Return one row for each model, from the bare to the full model.

    A row contains the gap and the cumulative explained share of the excess.
    """
    gaps, explained = steps(diagnosis), diagnosis.gap.explained_share
    shares = [1 - (gap / gaps[0][1]) ** 2 if gaps[0][1] > 0 else 0.0 for _, gap in gaps[:-1]]
    shares += [explained] if len(gaps) > 1 else [0.0]
    return [
        (name, three(angles.small_per_rad * gap), percent(share, 1))
        for (name, gap), share in zip(gaps, shares, strict=True)
    ]


def steps(diagnosis: Diagnosis) -> list[tuple[str, float]]:
    """Return label and gap, rad, of each model, from no effect to all effects."""
    return [
        ("bare model", per_reading(diagnosis.gap, "before_rad")),
        *(
            # older files: root sum of squares
            (f"+ {named(step['effect'])}", float(step.get("gap_rad", step["rms_rad"] / 2**0.5)))
            for step in diagnosis.gap.waterfall
        ),
    ]


def per_reading(gap: Gap, of: str) -> float:
    """Return the rms of `floor_rad`, `before_rad` or `after_rad` over the joints with readings, rad."""
    read = [size for joint, size in getattr(gap, of).items() if gap.floor_rad[joint] > 0.0]
    return float(np.linalg.norm(read)) / max(len(read), 1) ** 0.5


def run_words(name: str, held_out: bool = False) -> str:
    """Return the label of a run or of a part of a run.

    The label contains the pose, the time of the recording, and a mark for held-out data.
    """
    return run_label(whole(name)) + name.removeprefix(whole(name)) + (" (held out)" if held_out else "")


@page_table("place", "coordinate", "share of the excess", "shape", style="prose")
def place_table(diagnosis: Diagnosis, count: int = 4) -> Rows:
    """Return the `count` locations that explain most of the excess chi-square."""
    return [
        (in_words(place.site), place.coordinate, percent(place.share), in_words(place.sentence))
        for place in diagnosis.where[:count]
    ]


def place_map(place: Where, angles: AngleUnit = RADIANS, unknown: float = 1e3) -> tuple[Array, Array, Array]:
    """Return knots, values and half widths of the 90 % intervals of a residual map, in displayed units.

    A knot is outside the recorded range if its standard deviation exceeds `unknown` times the largest value of the map.
    Value and half width are then NaN.
    """
    (_, factor), (_, knot_factor) = quantity(place, angles), coordinate(place, angles)
    knots, values, std = knot_factor * np.array(place.knots), np.array(place.values), np.array(place.std)
    known = np.where(std < unknown * np.abs(values).max(initial=0.0), factor, np.nan)
    return knots, known * values, NORMAL_Q90 * (known * std)


@page_table(
    "segment length (s)",
    "gap, bare model (mrad rms)",
    "gap, corrected model (mrad rms)",
    title="Gap by segment length, fitted recordings",
)
def horizon_table(diagnosis: Diagnosis) -> Rows:
    """Return one row for each segment length, with the gaps of the bare and the corrected model."""
    by_length = diagnosis.gap.by_horizon.items()
    return [(length, *(three(1e3 * gaps[name]) for name in ("before", "after"))) for length, gaps in by_length]


@page_table(
    "place", "coordinate", "coordinate value", "quantity", "value", "90 % half width", title="Values of the maps"
)
def map_table(diagnosis: Diagnosis, count: int = 4) -> Rows:
    """Return the knots of the `count` most important residual maps."""
    return [
        (in_words(place.site), coordinate(place)[0], three(knot), quantity(place)[0], three(value), three(half_width))
        for place in diagnosis.where[:count]
        for knot, value, half_width in zip(*(values.tolist() for values in place_map(place)), strict=True)
    ]


@page_table(
    "run",
    "gap reduction",
    "free run, bare model (mrad)",
    "free run, corrected model (mrad)",
    caption=CLOSED_NOTE,
    style="prose",
)
def closed_table(diagnosis: Diagnosis, angles: AngleUnit = RADIANS, most: int | None = None) -> Rows:
    """Return the gap reduction by run; held-out runs are marked.

    Args:
        diagnosis: the diagnosis
        angles: the unit of angles
        most: maximum number of runs. The runs with the smallest reduction are selected, the smallest first. None: all
            runs in their order
    """
    gap, closed = diagnosis.gap, diagnosis.gap.closed_held_out
    shares = {name: (run_words(name), share) for name, share in closed.per_run.items()}
    shares |= {name: (run_words(name, held_out=True), share) for name, share in closed.held_out.items()}
    if most is not None:
        shares = dict(sorted(shares.items(), key=lambda entry: entry[1][1])[:most])
    rows = []
    for name, (label, share) in shares.items():
        free_run = gap.free_run_rad.get(name, {})
        errors = (free_run.get(key) for key in ("before", "after"))
        before, after = (NONE if rms is None else three(angles.small_per_rad * rms) for rms in errors)
        rows.append((label, percent(share, 1) if gap.waterfall else NONE, before, after))
    return rows


@page_table("effect", "minimum detectable size", style="prose")
def detectable_table(diagnosis: Diagnosis, angles: AngleUnit = RADIANS) -> Rows:
    """Return the minimum detectable size of every effect in these recordings."""
    return [
        (
            named(name),
            ", ".join(
                f"{parameter_words(name, p)} {'not detectable' if size is None else size_words(name, p, angles, size)}"
                for p, size in sizes.items()
            ),
        )
        for name, sizes in diagnosis.detectable.items()
    ]
