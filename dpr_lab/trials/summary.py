"""Many trials: how often the diagnosis is right, how honest its probabilities are, how well it measures."""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dpr_lab.trials.score import Claim, Outcome

BINS = 10
"""Of equal width, in the reliability table."""


def share(outcomes: Sequence[Outcome], holds: Callable[[Outcome], bool]) -> float:
    """Share of the trials for which something holds; nan without trials."""
    return float(np.mean([holds(outcome) for outcome in outcomes])) if outcomes else float("nan")


def reliability(claims: Sequence[Claim]) -> list[dict[str, float]]:
    """Of each bin of stated probability that is not empty: how many claims, their mean probability, how many held."""
    table: list[dict[str, float]] = []
    place = np.minimum((np.array([claim.probability for claim in claims]) * BINS).astype(int), BINS - 1)
    for number in range(BINS):
        inside = [claim for claim, bin_number in zip(claims, place, strict=True) if bin_number == number]
        if inside:
            stated, true = (float(np.mean(v)) for v in zip(*((c.probability, c.true) for c in inside), strict=True))
            table.append({"claims": len(inside), "stated": stated, "true": true})
    return table


def calibration_error(claims: Sequence[Claim]) -> float:
    """Expected calibration error: mean distance of stated probability and truth over the bins, by their claims.

    Source: Naeini, Cooper & Hauskrecht (2015), Obtaining well calibrated probabilities using Bayesian binning, AAAI.
    """
    table = reliability(claims)
    weight = sum(row["claims"] for row in table)
    return sum(row["claims"] * abs(row["stated"] - row["true"]) for row in table) / weight if weight else float("nan")


def brier(claims: Sequence[Claim]) -> float:
    """Mean squared distance of stated probability and truth."""
    return float(np.mean([(claim.probability - claim.true) ** 2 for claim in claims])) if claims else float("nan")


def summary(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Everything that is scored, over all trials given; shares of none are nan."""
    found = [o for o in outcomes if o.truth]
    nothing = [o for o in outcomes if not o.truth]
    sizes = [size for o in outcomes for size in o.sizes]
    leading = [size.relative for size in sizes if size.leads]
    claims = [claim for o in outcomes for claim in o.claims]
    closed = [o.closed for o in outcomes if o.named and np.isfinite(o.closed)]
    return {
        "trials": len(outcomes),
        "first": share(found, lambda o: o.first),
        "top3": share(found, lambda o: o.top3),
        "exact": share(found, lambda o: o.exact),
        "invented": share(found, lambda o: o.invented),
        "wrong_name": share(outcomes, lambda o: o.wrong_name),
        "admitted": share(found, lambda o: o.admitted),
        "false_alarms": share(nothing, lambda o: not o.silent),
        "faults_missed": share(outcomes, lambda o: bool(o.faults_missed)),
        "explained_share": _median([o.explained_share for o in found]),
        "size_error": _median(leading),
        "size_error_p90": float(np.quantile(leading, 0.9)) if leading else float("nan"),
        "interval_coverage": float(np.mean([size.covered for size in sizes])) if sizes else float("nan"),
        "gap_closed": _median(closed),
        "calibration_error": calibration_error(claims),
        "brier": brier(claims),
        "reliability": reliability(claims),
        "class_size": _median([float(size) for o in outcomes for size in o.class_sizes]),
        "seconds": _median([o.seconds for o in outcomes]),
        "seconds_max": max((o.seconds for o in outcomes), default=float("nan")),
        "confusion": confusion(outcomes),
    }


def confusion(outcomes: Sequence[Outcome]) -> dict[str, dict[str, int]]:
    """What was there, by its first name -> what was named first (or the verdict) -> how often."""
    table: dict[str, Counter[str]] = {}
    for o in outcomes:
        table.setdefault(o.truth[0] if o.truth else "nothing", Counter())[o.named[0] if o.named else o.verdict] += 1
    return {name: dict(counted.most_common()) for name, counted in sorted(table.items())}


def _median(values: Sequence[float]) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.median(finite)) if finite else float("nan")
