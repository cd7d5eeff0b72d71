"""Test the named effects on held-out recordings: each must improve their prediction.

The selected set and the set without one effect are fitted to the same runs and compared on each held-out run. Let

    d_s = chi2_s(without) - chi2_s(with)

for each segment s, with neighbouring segments grouped. An effect carries over to held-out data under three conditions:

1. d is significantly positive, by its sum or by its signed ranks. If there are fewer than four groups, a reduction of
   chi2 by a large factor is also significant.
2. d is significantly negative in no run.
3. The share of the gap that the effect closes is not significantly below half of that in the fitted recordings.

An effect that fails this test explains only the fitted recordings. Effects that worsen the free runs are not confirmed;
held-out runs are used for this test if there are any. If there is only one release, its quarters are held out in turn.
An effect that fails the test on quarters is not withdrawn, but is not certain.

No effect is certain if all effects together increase the gap of the data that were not fitted, or if one recording
alone has a remainder (`dpr_lab.gap.transfer.lone_recording`). If there are fewer segments than quarters, no held-out
test is possible. No effect is then refuted, and no effect is certain.

The sum alone has little power if the reduction is largest in a few segments, because its scatter is then as large as
the sum. The signed ranks detect a reduction in all segments.

Source: Wilcoxon (1945), Individual comparisons by ranking methods, Biometrics Bulletin 1, 80-83.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.gap.classes.posterior import EffectPosterior
from dpr_lab.gap.hypothesis.cross_validation import FOLDS
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.residuals import ResidualStatistics
from dpr_lab.gap.result.diagnosis import Basis
from dpr_lab.gap.result.evidence import Closing
from dpr_lab.gap.result.saved import Interval
from dpr_lab.gap.state import Fitted, Selected
from dpr_lab.gap.transfer.free_run import FreeRunError, FreeSwings, expected_errors
from dpr_lab.gap.transfer.lone_recording import lone_recording
from dpr_lab.gap.transfer.out_of_sample import OutOfSample, block_starts, left_out_prediction, reduction, share
from dpr_lab.gap.transfer.outcome import TRANSFER, Transfer, WorseFreeRun
from dpr_lab.gap.which.selected import Selection

Rows = slice | Flags
"""Selection of segments."""


def transfer(state: Selected, swings: Mapping[str, FreeSwings]) -> Transfer:
    """Test the selected effects on held-out recordings, or by leave-one-run-out cross-validation.

    Args:
        state: state with the selected set of effects
        swings: free runs of the models before and after correction along all recordings
    """
    recordings, problem, selection = state.fitted.recordings, state.fitted.problem, state.selection
    held_out, rng = state.fitted.held_out_prediction, np.random.default_rng(state.fitted.request.seed)
    test = _Test(held_out or left_out_prediction(recordings, problem), selection.chosen.residuals, rng)
    tested = held_out is not None or len(test.data.dof) >= FOLDS.quarters
    before, after = test.above_noise(selection.bare), test.above_noise(selection.chosen)
    of_set = np.stack([before, after])
    of_effects = {
        name: np.stack([test.above_noise(model), after]) for name, model in selection.without_substitute.items()
    }
    by_run = test.by_run(of_set)
    by_effect_and_run = {name: test.by_run(pair) for name, pair in of_effects.items()}
    of_fitted_runs = by_run
    if held_out:
        of_fitted_runs = replace(test, data=left_out_prediction(recordings, problem)).of_set(selection)
    closed = test.reduction(of_set)
    failed = tuple(_failed(test, selection, of_effects, closed)) if tested else ()
    basis = _basis(state.fitted)
    one_release = basis == "one release"
    return Transfer(
        basis=basis,
        tested=tested,
        closed=closed,
        gap_ratio=float(np.sqrt(max(before.sum(), 0.0) / max(test.noise.sum(), 1.0))),
        closing=tuple(_closing(test, selection, of_set)),
        left_out=of_fitted_runs,
        held_out=by_run if held_out else {},
        effects=by_effect_and_run,
        withdrawn=() if one_release else failed,
        unproven=failed if one_release else (),
        oversized=selection.oversized,
        worse_free_run=_worse_free_run(state, swings),
        lone=lone_recording(problem, selection.chosen, [record.run.name for record in recordings.records]),
        too_short=one_release and test.groups < TRANSFER.least_groups,
    )


def _basis(fitted: Fitted) -> Basis:
    """Return the kind of data that are not fitted."""
    if fitted.held_out_prediction:
        return "held-out runs"
    return "one release" if len(fitted.recordings.records) == 1 else "releases left out"


def judged(
    outcome: Transfer, posteriors: Sequence[EffectPosterior], *, forced: bool, remainder: bool
) -> tuple[EffectPosterior, ...]:
    """Return the effects with their final probabilities.

    The probability of an effect that fails a test is reduced.

    The quarters of a single release are few and differ in amplitude. An effect that fails the test on quarters, or
    that cannot be tested, is still probable if it leaves only noise (decision 96).

    Args:
        outcome: results on held-out recordings
        posteriors: the effects with their probabilities in the fitted recordings
        forced: whether a force that is not described probably acts
        remainder: whether a remainder above the noise is left
    """
    untested, everything = not outcome.tested, {posterior.name for posterior in posteriors}
    alone = outcome.basis == "one release"
    not_validated = everything if alone and untested else outcome.unproven
    failed = outcome.worse_free_run or outcome.lone or outcome.closed.value < 0.0 or (untested and not alone)
    factors = dict.fromkeys(not_validated, TRANSFER.unproven if remainder else TRANSFER.weakly_tested)
    factors |= dict.fromkeys(everything if failed or forced else outcome.withdrawn, TRANSFER.unproven)
    factors |= dict.fromkeys(outcome.oversized, TRANSFER.oversized)
    return tuple(
        replace(posterior, probability=factors.get(posterior.name, 1.0) * posterior.probability)
        for posterior in posteriors
    )


@dataclass(frozen=True, slots=True)
class _Test:
    """Test on data that were not fitted: excess chi2, and closed share of the gap."""

    data: OutOfSample
    residuals: ResidualStatistics
    """Residuals of the selected set, which contain the level of the noise."""
    rng: np.random.Generator
    """Random generator of the bootstrap."""

    @property
    def noise(self) -> Array:
        """(segments,) expected chi2 of the noise."""
        return np.asarray(self.residuals.level * self.data.dof, dtype=np.float64)

    @property
    def groups(self) -> int:
        """Number of groups of neighbouring segments, the independent values of the test."""
        return len(block_starts(self.data.run, self.data.block))

    def above_noise(self, model: Hypothesis) -> Array:
        """Return the (segments,) chi2 of a model above the noise."""
        return np.minimum(np.nan_to_num(self.data.chi2(model), nan=np.inf), TRANSFER.wildest) - self.noise

    def reduction(self, pair: Array, rows: Rows = slice(None)) -> Interval:
        """Return the share of the gap that closes in some segments.

        Args:
            pair: (2, segments) excess chi2 without and with the effects
            rows: the segments
        """
        uncertainty = float(np.sqrt(self.residuals.independent_noise * self.noise[rows].sum()))
        return reduction(pair[:, rows], uncertainty, self.rng, self.data.block, self.data.run[rows])

    def by_run(self, pair: Array) -> dict[str, Interval]:
        """Return the closed share of the gap of each run.

        Args:
            pair: (2, segments) excess chi2 without and with the effects
        """
        return {name: self.reduction(pair, rows) for name, rows in self.data.runs}

    def of_set(self, selection: Selection) -> dict[str, Interval]:
        """Return the share of the gap that the selected set closes in each run."""
        return self.by_run(np.stack([self.above_noise(model) for model in (selection.bare, selection.chosen)]))

    def carries_over(self, pair: Array, least: float) -> bool:
        """Return whether an effect improves the prediction and closes enough of the gap.

        The closed share of the gap must be at least `least` if it is measurable.
        """
        helps = _helps(self.data, pair + self.noise)
        if not helps or pair[0].sum() < TRANSFER.gap_from * self.noise.sum():
            return helps
        return self.reduction(pair).interval90[1] >= least


def _failed(test: _Test, selection: Selection, pairs: Mapping[str, Array], closed: Interval) -> Iterator[str]:
    """Yield the effects that do not carry over.

    Args:
        test: data that were not fitted
        selection: the selected set of effects
        pairs: (2, segments) excess chi2 without and with each effect
        closed: share of the gap that all effects together close
    """
    least_kept = TRANSFER.kept * (_of_fitted(closed, selection) if closed.value >= TRANSFER.comparable else 1.0)
    for name, smaller in selection.without_substitute.items():
        if not test.carries_over(pairs[name], least_kept * _share_of_fitted(smaller, selection.chosen)):
            yield name


def _helps(test: OutOfSample, chi2: Array) -> bool:
    """Return whether an effect significantly reduces chi2 in total and increases it in no run.

    Args:
        test: data that were not fitted
        chi2: (2, segments) chi2 without and with the effect
    """
    reductions = chi2[0] - chi2[1]
    blocks = _blocks(test, reductions)
    total, tolerance = _sum(blocks)
    by_run = [_sum(_blocks(test, reductions, rows)) for _, rows in test.runs]
    beyond_chance = total > tolerance or (total > 0.0 and _signed_rank(blocks) > TRANSFER.beyond_chance)
    if test.whole_runs and len(blocks) < TRANSFER.least_groups:
        without, remaining = chi2.sum(axis=1)
        beyond_chance = beyond_chance or bool(without > TRANSFER.clear * remaining)
    return beyond_chance and all(of_run > -tolerance_of_run for of_run, tolerance_of_run in by_run)


def _blocks(test: OutOfSample, reductions: Array, rows: Rows = slice(None)) -> Array:
    """Sum reductions over groups of neighbouring segments, whose residuals are correlated."""
    return np.add.reduceat(reductions[rows], block_starts(test.run[rows], test.block))


def _sum(blocks: Array) -> tuple[float, float]:
    """Return the sum over groups of segments, and the minimum sum that is significant."""
    spread = np.sqrt(len(blocks) * np.var(blocks, ddof=1)) if len(blocks) > 1 else np.inf
    return float(blocks.sum()), float(TRANSFER.beyond_chance * spread)


def _signed_rank(blocks: Array) -> float:
    """Return Wilcoxon's signed-rank sum over groups of segments, divided by its standard error.

    Groups without a difference are omitted, and equal differences have the mean of their ranks.
    """
    blocks = blocks[blocks != 0.0]
    if not len(blocks):
        return 0.0
    _, place, count = np.unique(np.abs(blocks), return_inverse=True, return_counts=True)
    ranks = (np.cumsum(count) - (count - 1) / 2)[place]
    return float((ranks * np.sign(blocks)).sum() / np.sqrt(np.sum(ranks**2)))


def _of_fitted(closed: Interval, selection: Selection) -> float:
    """Return the ratio of the closed share of the held-out gap to that of the fitted gap."""
    fitted = _share_of_fitted(selection.bare, selection.chosen)
    return float(np.clip(closed.value / max(fitted, TRANSFER.least_fitted), 0.0, 1.0))


def _share_of_fitted(smaller: Hypothesis, chosen: Hypothesis) -> float:
    """Return by which share the chosen set reduces the gap of the smaller set."""
    return share(np.array([[smaller.residuals.excess], [chosen.residuals.excess]]))


def _closing(test: _Test, selection: Selection, ends: Array) -> Iterator[Closing]:
    """Yield the remaining gap and closed share of each set up to the selected one.

    `ends` contains the chi2 above the noise of these two sets.
    """
    between = [test.above_noise(model) for _, model in selection.path[:-1]]
    remaining = [ends[0], *between, *([ends[1]] if selection.path else [])]
    for name, above in zip(["", *(name for name, _ in selection.path)], remaining, strict=True):
        rms = test.data.noise_rad * np.sqrt(max(float(above.sum()), 0.0) / test.data.dof.sum())
        yield Closing(effect=name, left_rad=float(rms), closed=share(np.stack([ends[0], above])))


def _worse_free_run(state: Selected, swings: Mapping[str, FreeSwings]) -> WorseFreeRun | None:
    """Compare the free runs along the held-out recordings or, if there are none, along the fitted recordings."""
    before, after = (swings[name].runs.errors for name in ("before", "after"))
    noise = expected_errors(swings["before"], state.selection.bare.residuals.independent_noise)
    held_out = state.fitted.held_out_prediction
    return worse_free_run(before, after, noise, held_out.names if held_out else before)


def worse_free_run(
    before: Mapping[str, FreeRunError],
    after: Mapping[str, FreeRunError],
    noise: Mapping[str, FreeRunError],
    compared: Collection[str],
) -> WorseFreeRun | None:
    """Return the free-run errors before and after correction if they increase, otherwise None.

    Segments and free runs must agree: an effect that closes the gap of segments but worsens the free run is not
    confirmed. Each run is compared up to the time at which chaos dominates the error of the bare model. An increase
    that the noise of the first readings explains does not count. The errors are geometric means over the runs, which
    compare the ratios of the errors. The most chaotic run, whose error is by far the largest, therefore does not decide
    alone.

    Source: Fleming & Wallace (1986), How not to lie with statistics, Communications of the ACM 29, 218-221.

    Args:
        before: error of the free run of the bare model, by run
        after: error of the free run with the effects, by run; half a turn where it cannot be simulated
        noise: part of `before` that is expected from the noise of the first readings
        compared: names of the runs
    """
    squares, ends = [], []
    for name in compared:
        end = before[name].followed_s(TRANSFER.followed_rad) if name in before else 0.0
        if end >= TRANSFER.followed_s:
            errors = [runs[name].until(end).squares for runs in (before, after, noise)]
            squares.append([float(np.mean(np.where(np.isfinite(of), of, np.pi**2))) for of in errors])
            ends.append(end)
    if not ends:
        return None
    logs = np.log(np.maximum(squares, np.finfo(np.float64).tiny))
    of_before, of_after, of_noise = np.exp(np.mean(logs, axis=0)).tolist()
    if of_after <= TRANSFER.worse**2 * of_before + TRANSFER.unpredictable**2 * of_noise:
        return None
    return WorseFreeRun(of_before**0.5, of_after**0.5, max(ends))
