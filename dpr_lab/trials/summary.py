"""Scores of many trials: success rates, calibration of probabilities, errors of sizes."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from dpr_lab.trials.score import Cause, Claim, SizeError, TrialOutcome


def share(outcomes: Sequence[TrialOutcome], holds: Callable[[TrialOutcome], bool]) -> float:
    """Return the share of trials with a property, or nan without trials."""
    return float(np.mean([holds(outcome) for outcome in outcomes])) if outcomes else float("nan")


def reliability(claims: Sequence[Claim]) -> list[dict[str, float]]:
    """Compute the reliability table, one row per bin of stated probability.

    The ten bins have equal width. A row contains the number of claims, their mean probability `stated`, the share
    `true` of true claims, and its 90 % interval from `low` to `high`. Empty bins have no row.
    """
    table: list[dict[str, float]] = []
    bins = 10
    bin_of = np.minimum((np.array([claim.probability for claim in claims]) * bins).astype(int), bins - 1)
    for number in range(bins):
        inside = [claim for claim, bin_number in zip(claims, bin_of, strict=True) if bin_number == number]
        if inside:
            stated, true = (float(np.mean(v)) for v in zip(*((c.probability, c.true) for c in inside), strict=True))
            low, high = wilson90(sum(claim.true for claim in inside), len(inside))
            table.append({"claims": len(inside), "stated": stated, "true": true, "low": low, "high": high})
    return table


def calibration_error(claims: Sequence[Claim]) -> float:
    """Compute the expected calibration error of claims.

    The error is the mean distance between stated probability and observed frequency in each bin, weighted by the number
    of claims.

    Source: Naeini, Cooper & Hauskrecht (2015), Obtaining well calibrated probabilities using Bayesian binning, AAAI.
    """
    table = reliability(claims)
    weight = sum(row["claims"] for row in table)
    return sum(row["claims"] * abs(row["stated"] - row["true"]) for row in table) / weight if weight else float("nan")


def error_if_exact(claims: Sequence[Claim], draws: int = 200) -> float:
    """Simulate the expected calibration error of a perfectly calibrated forecast with the same probabilities.

    The outcomes of the claims are drawn with the stated probabilities. The error is above zero by chance, mainly in
    bins with few claims. A forecast is miscalibrated only if its error exceeds this value.

    Source: J. Broecker & L. A. Smith (2007), Increasing the reliability of reliability diagrams, Weather and
    Forecasting 22, 651-661.
    """
    rng = np.random.default_rng(0)
    outcomes = rng.random((draws, len(claims))) < [claim.probability for claim in claims]
    drawn = ([replace(claim, true=true) for claim, true in zip(claims, row, strict=True)] for row in outcomes.tolist())
    return float(np.mean([calibration_error(row) for row in drawn])) if claims else float("nan")


def brier(claims: Sequence[Claim]) -> float:
    """Compute the Brier score: the mean squared difference between stated probability and outcome."""
    return float(np.mean([(claim.probability - claim.true) ** 2 for claim in claims])) if claims else float("nan")


def wilson90(held: int, of: int) -> tuple[float, float]:
    """Compute the 90 % Wilson score interval of a proportion `held` / `of`."""
    from scipy.stats import binomtest  # slow import

    interval = binomtest(held, of).proportion_ci(0.9, method="wilson")
    return float(interval.low), float(interval.high)


def summary(outcomes: Sequence[TrialOutcome]) -> dict[str, Any]:
    """Compute all scores of the given trials; a share is nan without applicable trials.

    Named effects are scored only if the library contains the cause. Otherwise, the correct result is an unexplained
    gap.
    """
    sizes = [size for o in outcomes for size in o.sizes]
    claims = [claim for o in outcomes for claim in o.claims]
    seconds = [o.seconds for o in outcomes]
    shares = {name: (_among(outcomes, whom), holds) for name, (whom, holds) in SHARES.items()}
    return {
        "trials": len(outcomes),
        **{name: share(group, holds) for name, (group, holds) in shares.items()},
        "of": {name: len(group) for name, (group, _) in shares.items()},
        "interval90": {
            name: wilson90(sum(map(holds, group)), len(group)) if group else None
            for name, (group, holds) in shares.items()
        },
        "explained_share": _median([o.explained_share for o in outcomes if o.truth]),
        **size_errors(sizes),
        "gap_closed": _median([o.closed for o in outcomes if o.named]),
        "calibration_error": calibration_error(claims),
        "brier": brier(claims),
        "reliability": reliability(claims),
        "class_size": _median([float(size) for o in outcomes for size in o.class_sizes]),
        "seconds": _median(seconds),
        "seconds_p90": _quantile(seconds, 0.9),
        "seconds_max": max(seconds, default=float("nan")),
        "confusion": confusion(outcomes),
        "by_kind": by_kind(outcomes),
        "by_effect": by_effect(outcomes),
        "by_size": by_size(outcomes),
        "astray": [astray(o) for o in outcomes if o.grade != "right"],
    }


SHARES: dict[str, tuple[str, Callable[[TrialOutcome], bool]]] = {
    "first": ("nameable", lambda o: o.first),
    "top3": ("nameable", lambda o: o.top3),
    "exact": ("nameable", lambda o: o.exact),
    "invented": ("nameable", lambda o: o.invented),
    "false_alarms": ("clean", lambda o: not o.silent),
    "unexplained_recall": ("outside", lambda o: o.admitted),
    "wrong_name": ("all", lambda o: o.wrong_name),
    "faults_missed": ("all", lambda o: bool(o.faults_missed)),
}
"""Shares in the summary: for each key, the group of trials (`_among`), and the property that is counted."""


def _among(outcomes: Sequence[TrialOutcome], whom: str) -> list[TrialOutcome]:
    groups: dict[str, Callable[[TrialOutcome], bool]] = {
        "all": lambda o: True,
        "clean": lambda o: not o.truth,
        "outside": lambda o: o.kind == "outside",
        "nameable": lambda o: bool(o.truth) and o.kind != "outside",
    }
    return [o for o in outcomes if groups[whom](o)]


def size_errors(sizes: Sequence[SizeError]) -> dict[str, float]:
    """Compute statistics of the errors of amplitudes.

    Median and 90th percentile refer to the largest amplitude of each effect, and the coverage of the intervals to all
    amplitudes.
    """
    leading = [size.relative for size in sizes if size.leads]
    return {
        "size_error": _median(leading),
        "size_error_p90": _quantile(leading, 0.9),
        "interval_coverage": float(np.mean([size.covered for size in sizes])) if sizes else float("nan"),
    }


def by_kind(outcomes: Sequence[TrialOutcome]) -> list[dict[str, Any]]:
    """Compute the scores by requested kind and level, with one row for each combination."""
    groups: dict[tuple[str, str], list[TrialOutcome]] = {}
    for o in outcomes:
        groups.setdefault((o.kind, o.level), []).append(o)
    return [
        {"kind": kind, "level": level, "trials": len(group)}
        | {name: share(_among(group, whom), holds) for name, (whom, holds) in SHARES.items()}
        for (kind, level), group in sorted(groups.items())
    ]


def by_effect(outcomes: Sequence[TrialOutcome]) -> list[dict[str, Any]]:
    """Compute the scores by hidden effect, with one row for each effect.

    `named` and the errors of sizes count every trial with the effect; `first` and `exact` count the trials in which the
    effect is the largest.
    """
    rows: list[dict[str, Any]] = []
    for name in sorted({cause.name for o in outcomes for cause in o.causes}):
        with_effect = [o for o in outcomes if name in o.truth]
        leads = [o for o in with_effect if o.truth[0] == name]
        rows.append(
            {
                "effect": name,
                "trials": len(with_effect),
                **_naming([cause for o in with_effect for cause in o.causes if cause.name == name], leads),
                **size_errors([size for o in with_effect for size in o.sizes if size.effect == name]),
            }
        )
    return rows


def by_size(
    outcomes: Sequence[TrialOutcome], limits: Sequence[float] = (0.0, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
) -> list[dict[str, Any]]:
    """Compute the scores by size of the hidden effect, one row per range of sizes.

    Sizes are relative to the minimum detectable size. `limits` contains the lower ends of the ranges. The last range
    has no upper end (`to` is None). `named` counts every effect; `first` and `exact` count the trials in which the
    largest effect has this size.
    """
    rows: list[dict[str, Any]] = []
    for low, high in pairwise([*limits, math.inf]):
        inside = [c for o in outcomes for c in o.causes if _within(c, low, high)]
        leads = [o for o in outcomes if o.causes and _within(o.causes[0], low, high)]
        if inside:
            rows.append(
                {
                    "from": low,
                    "to": None if math.isinf(high) else high,
                    "effects": len(inside),
                    **_naming(inside, leads),
                }
            )
    return rows


def _naming(causes: Sequence[Cause], leads: Sequence[TrialOutcome]) -> dict[str, float]:
    """Return the share `named` of the causes that are named, and the shares `first` and `exact` of the trials."""
    named = float(np.mean([cause.named for cause in causes]))
    return {"named": named, "first": share(leads, lambda o: o.first), "exact": share(leads, lambda o: o.exact)}


def astray(outcome: TrialOutcome) -> dict[str, Any]:
    """Describe a trial with an incorrect result, and the arguments that reproduce it."""
    names = ("kind", "level", "seed", "truth", "named", "verdict", "grade")
    return {name: getattr(outcome, name) for name in names}


def _within(cause: Cause, low: float, high: float) -> bool:
    return cause.over_limit is not None and low <= cause.over_limit < high


def confusion(outcomes: Sequence[TrialOutcome]) -> dict[str, dict[str, int]]:
    """Count the trials by largest true effect and by first named effect.

    If no effect is named, the verdict replaces the name.
    """
    table: dict[str, Counter[str]] = {}
    for o in outcomes:
        table.setdefault(o.truth[0] if o.truth else "nothing", Counter())[o.named[0] if o.named else o.verdict] += 1
    return {name: dict(counted.most_common()) for name, counted in sorted(table.items())}


def with_nulls(scores: Any) -> Any:
    """Replace each nan in nested scores, a score without applicable trials, by None, because JSON has no nan."""
    if isinstance(scores, Mapping):
        return {name: with_nulls(score) for name, score in scores.items()}
    if isinstance(scores, list):
        return [with_nulls(score) for score in scores]
    return None if isinstance(scores, float) and math.isnan(scores) else scores


def _median(values: Sequence[float]) -> float:
    return _quantile(values, 0.5)


def _quantile(values: Sequence[float], share: float) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.quantile(finite, share)) if finite else float("nan")
