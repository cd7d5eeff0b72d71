"""Fit of the constants that turn scores into probabilities: `dpr_lab.gap.hypothesis.calibration.CALIBRATION`.

Tuning trials of every kind are drawn. They do not use the out-of-library effects that are reserved for evaluation, or
the seeds of `benchmarks/diagnosis.py`. The trials are diagnosed with the current constants. Each effect that a
diagnosis considers gives a statement: its odds against each alternative, the share of the gap that it leaves, and
whether it was a cause. The new constants minimise the log loss of these statements. A weak prior centred on the current
constants limits the change if there are few trials. Paste the printed constants into the module, then run the
benchmark.

    python benchmarks/calibrate_diagnosis.py [--cases 30] [--quick] [--json]
"""

import math
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from _bars import at_most, options, show
from _trial_cases import Scored
from diagnosis import FIRST_SEED, GROUPS, campaign, trials_of
from scipy.optimize import minimize

from dpr_lab.gap.hypothesis.calibration import CALIBRATION, Calibration, odds_outside, probability_outside
from dpr_lab.trials.score import Claim
from dpr_lab.trials.summary import calibration_error

TUNING = [name for name in GROUPS if "held back" not in name]
SMALLEST, MOST = 1e-3, 0.2
"""Smallest probability in a logarithm, and largest probability of a cause outside the library if no gap is left."""

PULL = 1.0
"""Prior standard deviation of each fitted number about its current value.

The numbers are logarithms, so that a value of 1 is a factor of e.
"""


@dataclass(frozen=True, slots=True)
class Statement:
    """An effect that a diagnosis considers, with its scores."""

    log_odds: tuple[float, ...]
    """Log odds of each alternative, and of no effect, relative to the effect, at the current temperature."""
    left: float
    """Share of the excess that remains unexplained."""
    remainder: float
    """Unexplained excess in units of the noise, rms; zero if only noise is left."""
    unique: float
    """Share of the excess that only this effect explains."""
    true: bool


def statements(done: Sequence[Scored]) -> list[Statement]:
    """Create a statement for every effect that the diagnoses considered."""
    return [statement for scored in done for statement in _of(scored)]


def _of(scored: Scored) -> list[Statement]:
    result, true = scored.diagnosis, scored.true
    left = 1 - result["gap"]["explained_share"]
    remainder = 0.0 if result["verdict"] == "named" else math.sqrt(max(result["chi2_per_dof"] - 1, 0.0))
    made: list[Statement] = []
    for effect, is_cause in zip(result["effects"], true, strict=True):
        rivals = [rival["probability"] for rival in result["rivals"] if rival["instead_of"] == effect["name"]]
        without = max(0.0, 1 - effect["outside"] - effect["probability"] - sum(rivals))
        odds = tuple(math.log(max(p, 1e-12) / max(effect["probability"], 1e-12)) for p in (*rivals, without))
        made.append(Statement(odds, left, remainder, effect["share"], is_cause))
    return made


def probability(statement: Statement, tried: Calibration) -> float:
    """Probability of a statement under other constants."""
    colder = CALIBRATION.temperature / tried.temperature
    within = 1 / (1 + sum(math.exp(min(odds * colder, 50.0)) for odds in statement.log_odds))
    left = max(statement.left, tried.least_left)
    odds = odds_outside(left, statement.remainder, statement.unique, calibration=tried)
    return within * (1 - probability_outside(odds, tried))


def loss(numbers: np.ndarray, made: Sequence[Statement], start: np.ndarray) -> float:
    """Log loss of all statements, plus the penalty of the prior about the current constants."""
    tried = constants(numbers)
    p = np.clip([probability(statement, tried) for statement in made], SMALLEST, 1 - SMALLEST)
    result = np.where([statement.true for statement in made], np.log(p), np.log1p(-p))
    return float(0.5 * np.sum(((numbers - start) / PULL) ** 2) - np.sum(result))


def constants(numbers: np.ndarray) -> Calibration:
    """Convert the five fitted numbers to calibration constants."""
    temperature, half, steepness, imitates = np.exp(numbers[:4]).tolist()
    return replace(
        CALIBRATION,
        temperature=temperature,
        half_unexplained=half,
        steepness=steepness,
        imitates=imitates,
        outside_when_closed=MOST / (1 + math.exp(-float(numbers[4]))),
    )


def fitted(made: Sequence[Statement]) -> Calibration:
    """Find the constants with the smallest loss, starting from the current constants."""
    now = CALIBRATION
    share = min(now.outside_when_closed / MOST, 0.99)
    logs = np.log([now.temperature, now.half_unexplained, now.steepness, now.imitates])
    start = np.array([*logs, math.log(share / (1 - share))])
    return constants(minimize(loss, start, args=(made, start), method="Nelder-Mead").x)


def main() -> None:
    """Draw and diagnose the trials, fit the constants, and print them."""
    parser = options(__doc__)
    parser.add_argument("--cases", type=int, default=30, help="trials of each kind (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the first trial (default: %(default)s)")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes (default: all cores)")
    chosen = parser.parse_args()
    cases = trials_of(TUNING, 1 if chosen.quick else chosen.cases, chosen.seed)
    if max(case.seed for case in cases) >= FIRST_SEED:
        parser.error(f"seeds from {FIRST_SEED} on belong to the benchmark")
    made = statements(campaign(cases, chosen.workers, None))
    sets = {"in use": CALIBRATION, "fitted": fitted(made)}
    bars = []
    for name, tried in sets.items():
        claims = [Claim(probability(statement, tried), statement.true) for statement in made]
        bars.append(at_most(f"calibration error, constants {name}", calibration_error(claims), 0.05))
    title = f"Calibration on {len(made)} effects put forward in {len(cases)} trials"
    show(title, bars, chosen.json, constants={name: asdict(tried) for name, tried in sets.items()})
    if not chosen.json:
        print("\n".join(f"{name}: {tried}" for name, tried in sets.items()))


if __name__ == "__main__":
    main()
