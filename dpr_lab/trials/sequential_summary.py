"""Scores of sequential trials by strategy: numbers of releases, shares of correct results, calibration of forecasts."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dpr_lab.trials.campaign import TRIALS
from dpr_lab.trials.next_release import SEQUENTIAL
from dpr_lab.trials.score import Claim
from dpr_lab.trials.summary import brier, calibration_error, error_if_exact, wilson90

Outcome = Mapping[str, Any]


def read_strategies(folder: Path, n: int) -> list[dict[str, Outcome]]:
    """Read the results, by strategy, of the first `n` trials in the folder of a campaign."""
    file = folder / TRIALS
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []  # no results if every trial failed
    trials = [json.loads(line) for line in lines if line]
    return [trial["strategies"] for trial in trials if trial["number"] < n]


def sequential_summary(trials: Sequence[Mapping[str, Outcome]]) -> dict[str, dict[str, Any]]:
    """Return the scores of each strategy.

    If the causes of a plant remain undecided, the number of releases counts as the maximum plus one.
    """
    names = list(dict.fromkeys(name for trial in trials for name in trial))
    return {name: _of_strategy([trial[name] for trial in trials if name in trial]) for name in names}


def _of_strategy(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    counts = [SEQUENTIAL.most + 1 if outcome["recordings"] is None else outcome["recordings"] for outcome in outcomes]
    stopped = [outcome for outcome in outcomes if outcome["recordings"] is not None]
    right, true = (sum(outcome[key] for outcome in stopped) for key in ("right", "true"))
    looks = [look for outcome in outcomes for look in outcome["looks"]]
    claims = [claim for outcome in outcomes for claim in forecast_claims(outcome["looks"])]
    seconds = [look["plan_seconds"] for look in looks if look["plan_seconds"] is not None]
    return {
        "trials": len(outcomes),
        "median_releases": float(np.median(counts)),
        "mean_releases": float(np.mean(counts)),
        "mean_minutes": float(np.mean([outcome["minutes"] for outcome in outcomes])),
        "decided": len(stopped) / len(outcomes),
        "right_when_stopped": right / len(stopped) if stopped else float("nan"),
        "right_interval90": wilson90(right, len(stopped)) if stopped else None,
        "true_when_stopped": true / len(stopped) if stopped else float("nan"),
        "forecasts": len(claims),
        "forecast_calibration_error": calibration_error(claims),
        "forecast_error_if_exact": error_if_exact(claims),
        "forecast_brier": brier(claims),
        "plan_seconds": float(np.median(seconds)) if seconds else float("nan"),
    }


def forecast_claims(looks: Sequence[Mapping[str, Any]]) -> Iterator[Claim]:
    """Yield each forecast probability that k more releases are sufficient, together with the observed result.

    The releases also count as sufficient if only a bench check can distinguish the remaining causes, because a forecast
    counts causes that no release separates as one cause. If a trial ends at the maximum number of releases, forecasts
    for later releases are omitted.

    Args:
        looks: states after each release, with `forecast`, `decided` and `bench_check`
    """
    for first, look in enumerate(looks):
        for k, probability in enumerate(look["forecast"], 1):
            later = looks[first : first + k]
            ended = later[-1]["decided"] or later[-1]["bench_check"]
            if len(later) == k or ended:
                yield Claim(probability, ended)
