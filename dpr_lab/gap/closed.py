"""How far the gap shrinks once the named effects are in the model, on recordings that took no part in the fit."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.readings import pieces, readings
from dpr_lab.gap.heldout import folds, left_out
from dpr_lab.gap.hypothesis import Hypothesis
from dpr_lab.gap.problem import Point, Problem, problem
from dpr_lab.gap.record import Record
from dpr_lab.gap.shooting import fit
from dpr_lab.rig import Rig

Array = NDArray[np.float64]

BLOCK = 2  # neighbouring segments that are drawn together: residuals of one swing resemble each other
DRAWS = 400


@dataclass(frozen=True, slots=True)
class Closed:
    """Share of the gap above the noise floor that closes: 1 - rms after / rms before, not below -1."""

    estimate: float
    interval90: tuple[float, float]
    per_run: dict[str, float]


def closed_left_out(made: Problem, base: Hypothesis, chosen: Hypothesis, rng: np.random.Generator) -> Closed:
    """Each release as predicted from the others, its start states free."""
    fold = folds(made)
    return _closed(made, left_out(base.fit, fold), left_out(chosen.fit, fold), base, chosen, rng)


def closed_held_out(
    records: Sequence[Record],
    rig: Rig,
    working: Problem,
    base: Hypothesis,
    chosen: Hypothesis,
    rng: np.random.Generator,
) -> Closed:
    """Whole recordings that the diagnosis never saw; only their start states are fitted."""
    made, starts = problem(records, rig, working.length)
    before = fit(made, replace(base.fit.point, starts=starts), (), iterations=20)
    after = fit(made, replace(chosen.fit.point, starts=before.point.starts), (), iterations=20)
    return _closed(made, before.chi2_by_segment, after.chi2_by_segment, base, chosen, rng)


def _closed(
    made: Problem, before: Array, after: Array, base: Hypothesis, chosen: Hypothesis, rng: np.random.Generator
) -> Closed:
    noise = chosen.remainder.level * (2 * np.diff(made.offsets) - 4)
    above = np.stack([before - noise, after - noise])
    per_run = {made.records[r].run.name: _share(above[:, made.run == r]) for r in np.unique(made.run)}
    blocks = [slice(i, i + BLOCK) for i in range(0, len(made.run), BLOCK)]
    sums = np.stack([above[:, block].sum(axis=1) for block in blocks], axis=1)
    drawn = [_share(sums[:, rng.integers(0, len(blocks), len(blocks))]) for _ in range(DRAWS)]
    low, high = np.quantile(drawn, [0.05, 0.95])
    return Closed(_share(above), (float(low), float(high)), per_run)


def _share(above: Array) -> float:
    before, after = np.maximum(above.sum(axis=1), 0.0)
    return max(float(1 - np.sqrt(after / before)), -1.0) if before > 0 else 0.0


def free_run_errors(
    records: Sequence[Record], rig: Rig, point: Point, *, settle_s: float = 0.3, length_s: float = 2.6
) -> Array:
    """(records,) rms error of free runs, rad: start states from the first `settle_s`, then on for `length_s` unseen.

    Args:
        records: the runs; each gives one free run from its beginning
        rig: lengths, masses, encoders
        point: ratios and effects to simulate with
        settle_s: what the start state is fitted to, s
        length_s: how far the free run is compared, s
    """
    errors = []
    for item in records:
        head = item.t < item.t[0] + settle_s
        short = replace(item, t=item.t[head], joints=item.joints[head], sigma=item.sigma[head])
        made, starts = problem([short], rig, settle_s)
        begun = fit(made, replace(point, starts=starts), (), iterations=30).point
        unseen = (item.t >= item.t[0] + settle_s) & (item.t <= item.t[0] + length_s)
        t = np.concatenate([item.t[:1], item.t[unseen]])
        angles = readings(
            begun.base, begun.vector, made.known, pieces([t], [0], [item.run.added_mass]), begun.starts[:1]
        )
        errors.append(float(np.sqrt(np.mean((item.joints[unseen] - angles[1:]) ** 2))))
    return np.array(errors)
