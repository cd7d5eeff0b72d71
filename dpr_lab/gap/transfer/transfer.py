"""Test the selected effects on held-out data: each must improve the prediction.

The selected set and the set without one effect are fitted to the same runs, and compared on each held-out run. If there
are no held-out runs, each fitted run is left out in turn, or each quarter of a single run. Let

    d_s = chi2_s(without) - chi2_s(with)

for each segment s, with neighbouring segments grouped. An effect carries over to held-out data under three conditions:

1. d is significantly positive, by its sum or by its signed ranks. If there are fewer than four groups, a reduction of
   chi2 by a large factor is also significant.
2. d is significantly negative in no run.
3. The share of the gap that the effect closes is not significantly below half of that in the fitted recordings.

An effect that fails explains only the fitted recordings and is withdrawn. If it fails on quarters of one release, it is
not withdrawn, but its probability is reduced. No effect is certain if all together increase the gap or the errors of
the free runs (`worse_free_run`), if one recording alone has a remainder (`lone_recording`), or if there are too few
segments for a test. One release of a single rod does not test the form of an effect with several parameters.

If a few segments have most of the reduction, the scatter of the sum is large. The signed ranks then still detect a
reduction that occurs in all segments.

Source: Wilcoxon (1945), Individual comparisons by ranking methods, Biometrics Bulletin 1, 80-83.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.effects import EFFECTS
from dpr_lab.gap.classes.posterior import EffectPosterior
from dpr_lab.gap.hypothesis.cross_validation import FOLDS
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.residuals import ResidualStatistics
from dpr_lab.gap.result.diagnosis import Basis
from dpr_lab.gap.result.evidence import Closing
from dpr_lab.gap.result.saved import Interval
from dpr_lab.gap.state import Fitted, Selected
from dpr_lab.gap.transfer.free_run import FreeRuns
from dpr_lab.gap.transfer.lone_recording import lone_recording
from dpr_lab.gap.transfer.out_of_sample import OutOfSample, block_starts, left_out_prediction, reduction, share
from dpr_lab.gap.transfer.outcome import TRANSFER, Transfer
from dpr_lab.gap.transfer.worse_free_run import worse_free_run
from dpr_lab.gap.which.selected import Selection

Rows = slice | Flags
"""Selection of segments."""


def transfer(state: Selected, simulated: Mapping[str, FreeRuns]) -> Transfer:
    """Test the selected effects on held-out runs or, without any, by cross-validation of the fitted runs.

    `simulated` contains the free runs along all recordings, `before` and `after` the correction.
    """
    recordings, problem, selection = state.fitted.recordings, state.fitted.problem, state.selection
    held_out, chosen = state.fitted.held_out_prediction, selection.chosen
    rng = np.random.default_rng(state.fitted.request.seed)
    test = _Test(held_out or left_out_prediction(recordings, problem), chosen.residuals, rng)
    tested = held_out is not None or len(test.data.dof) >= FOLDS.quarters
    of_set = test.excess(selection.bare, chosen)
    of_effects = {name: test.excess(model, chosen) for name, model in selection.without_substitute.items()}
    by_run = test.by_run(of_set)
    by_effect_and_run = {name: test.by_run(pair) for name, pair in of_effects.items()}
    left_out = by_run
    if held_out:
        others = replace(test, data=left_out_prediction(recordings, problem))
        left_out = others.by_run(others.excess(selection.bare, chosen))
    closed = test.reduction(of_set)
    failed = tuple(_failed(test, selection, of_effects, closed)) if tested else ()
    basis, noise = _basis(state.fitted), selection.bare.residuals.independent_noise
    one_release = basis == "one release"
    errors = {name: runs.errors for name, runs in simulated.items()}
    return Transfer(
        basis=basis,
        tested=tested,
        closed=closed,
        gap_ratio=float(np.sqrt(max(of_set[0].sum(), 0.0) / max(test.noise.sum(), 1.0))),
        closing=tuple(_closing(test, selection)),
        left_out=left_out,
        held_out=by_run if held_out else {},
        effects=by_effect_and_run,
        withdrawn=() if one_release else failed,
        unproven=failed if one_release else (),
        oversized=selection.oversized,
        worse_free_run=worse_free_run(
            errors["before"],
            errors["after"],
            simulated["before"].expected_errors(noise),
            held_out.names if held_out else errors["before"],
        ),
        untested=untested(state.fitted, state.posteriors),
        lone=lone_recording(problem, chosen, [record.run.name for record in recordings.records]),
        too_short=one_release and test.groups < TRANSFER.least_groups,
    )


def _basis(fitted: Fitted) -> Basis:
    """Return the kind of held-out data."""
    if fitted.held_out_prediction:
        return "held-out runs"
    return "one release" if len(fitted.recordings.records) == 1 else "releases left out"


def untested(fitted: Fitted, posteriors: Sequence[EffectPosterior]) -> tuple[str, ...]:
    """Return the effects whose form the recordings do not test.

    These are the effects of several parameters, including shapes, if there is only one release of a single rod. The
    pieces of a long recording are one release.
    """
    releases = 1 if fitted.division else len(fitted.recordings.records) + len(fitted.held_out.records)
    if releases > 1 or not all(setup.alone for setup in fitted.problem.segments.setups):
        return ()
    return tuple(p.name for p in posteriors if all(len(EFFECTS[name].parameters) > 1 for name in p.members))


def judged(
    outcome: Transfer, posteriors: Sequence[EffectPosterior], *, forced: bool, remainder: bool
) -> tuple[EffectPosterior, ...]:
    """Return the effects with their probabilities after the tests.

    The quarters of a single release are few and differ in amplitude. An effect that leaves only noise therefore remains
    probable even if it fails the test on quarters or cannot be tested (decision 96). This does not apply to a set of
    several effects that cannot be tested (decision 110).

    Args:
        outcome: results on held-out recordings
        posteriors: the effects with their probabilities in the fitted recordings
        forced: whether a force that the model lacks probably acts
        remainder: whether a remainder above the noise is left
    """
    no_test, everything = not outcome.tested, {posterior.name for posterior in posteriors}
    one_release = outcome.basis == "one release"
    not_validated = everything if one_release and no_test else outcome.unproven
    improbable = remainder or (no_test and len(posteriors) > 1)
    failed = outcome.worse_free_run or outcome.lone or outcome.closed.value < 0.0 or (no_test and not one_release)
    limits = (
        (not_validated, TRANSFER.unproven if improbable else TRANSFER.weakly_tested),
        (outcome.untested, TRANSFER.untested),
        (everything if failed or forced else outcome.withdrawn, TRANSFER.unproven),
        (outcome.oversized, TRANSFER.oversized),
    )
    factors = {name: min([1.0, *(limit for names, limit in limits if name in names)]) for name in everything}
    return tuple(
        replace(
            posterior,
            probability=factors[posterior.name] * posterior.probability,
            untested=posterior.name in outcome.untested and factors[posterior.name] == TRANSFER.untested,
        )
        for posterior in posteriors
    )


@dataclass(frozen=True, slots=True)
class _Test:
    """Comparison of models without and with some effects, on data that were not fitted.

    A pair, (2, segments), contains the chi2 above the noise of both models in each segment.
    """

    data: OutOfSample
    residuals: ResidualStatistics
    """Residuals of the selected set, which contain the level of the noise."""
    rng: np.random.Generator
    """Random numbers of the bootstrap."""

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

    def excess(self, without: Hypothesis, chosen: Hypothesis) -> Array:
        """Return the (2, segments) excess chi2 of the models without and with some effects."""
        return np.stack([self.above_noise(without), self.above_noise(chosen)])

    def reduction(self, pair: Array, rows: Rows = slice(None)) -> Interval:
        """Return the share of the gap that closes in the given segments."""
        uncertainty = float(np.sqrt(self.residuals.independent_noise * self.noise[rows].sum()))
        return reduction(pair[:, rows], uncertainty, self.rng, self.data.block, self.data.run[rows])

    def by_run(self, pair: Array) -> dict[str, Interval]:
        """Return the share of the gap that closes in each run."""
        return {name: self.reduction(pair, rows) for name, rows in self.data.runs}

    def carries_over(self, pair: Array, least: float) -> bool:
        """Return whether an effect improves the prediction and closes the share `least` of a measurable gap."""
        helps = _helps(self.data, pair + self.noise)
        if not helps or pair[0].sum() < TRANSFER.gap_from * self.noise.sum():
            return helps
        return self.reduction(pair).interval90[1] >= least


def _failed(test: _Test, selection: Selection, pairs: Mapping[str, Array], closed: Interval) -> Iterator[str]:
    """Yield the effects that do not improve the held-out predictions.

    Args:
        test: the held-out data
        selection: the selected set
        pairs: excess chi2 without and with each effect
        closed: share of the gap that all effects close on the held-out data
    """
    ratio = _relative_to_fitted(closed, selection) if closed.value >= TRANSFER.comparable else 1.0
    for name, smaller in selection.without_substitute.items():
        if not test.carries_over(pairs[name], TRANSFER.kept * ratio * _fitted_share(smaller, selection.chosen)):
            yield name


def _helps(test: OutOfSample, chi2: Array) -> bool:
    """Return whether an effect significantly reduces (2, segments) chi2 in total and increases it in no run."""
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
    """Return Wilcoxon's signed-rank sum over groups with a difference, divided by its standard error.

    Equal differences have the mean of their ranks.
    """
    blocks = blocks[blocks != 0.0]
    if not len(blocks):
        return 0.0
    _, place, count = np.unique(np.abs(blocks), return_inverse=True, return_counts=True)
    ranks = (np.cumsum(count) - (count - 1) / 2)[place]
    return float((ranks * np.sign(blocks)).sum() / np.sqrt(np.sum(ranks**2)))


def _relative_to_fitted(closed: Interval, selection: Selection) -> float:
    """Return the ratio, 0 to 1, of the share closed on held-out data to the share closed in the fitted recordings."""
    fitted = _fitted_share(selection.bare, selection.chosen)
    return float(np.clip(closed.value / max(fitted, TRANSFER.least_fitted), 0.0, 1.0))


def _fitted_share(smaller: Hypothesis, chosen: Hypothesis) -> float:
    """Return the share by which the chosen set reduces the gap of the smaller set."""
    return share(np.array([[smaller.residuals.excess], [chosen.residuals.excess]]))


def _closing(test: _Test, selection: Selection) -> Iterator[Closing]:
    """Yield the remaining gap and the closed share of each nested set, up to the selected one."""
    for name, model in [("", selection.bare), *selection.path]:
        pair = test.excess(selection.bare, model)
        rms = test.data.noise_rad * np.sqrt(max(float(pair[1].sum()), 0.0) / test.data.dof.sum())
        yield Closing(effect=name, left_rad=float(rms), closed=share(pair))
