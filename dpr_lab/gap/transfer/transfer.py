"""Whether named effects carry over: how each improves the prediction of recordings that took no part in its fit.

The chosen set is set against itself without the effect, both fitted to the same runs, on each run left out. With

    d_s = chi2_s(without) - chi2_s(with)

for each segment s of it, neighbours taken together, an effect carries over where d is above zero beyond chance (its
sum, or its signed ranks), and below zero beyond chance on no run, and where it closes no less than half of the share
of the gap that it closes in the fitted recordings. Effects that make the free run of held-out runs worse are not
confirmed. An effect that does not carry over explains the fitted recordings only.

The sum alone is blind to a fall of every segment that is largest in a few: its spread is then as large as itself. The
signed ranks see that it falls everywhere.

Source: Wilcoxon (1945), Individual comparisons by ranking methods, Biometrics Bulletin 1, 80-83.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.limits import at_limit
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.classes.posterior import EffectPosterior
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.transfer.free_run import FreeRuns
from dpr_lab.gap.transfer.out_of_sample import BOOTSTRAP, GapReduction, Unseen, left_out, reduction, share
from dpr_lab.gap.which.selected import Selection

Array = NDArray[np.float64]

Basis = Literal["one release", "releases left out", "held-out runs"]


@dataclass(frozen=True, slots=True)
class TransferSettings:
    """Settings of the test on held-out recordings."""

    beyond_chance: float = NORMAL_Q90
    """Standard errors of a sum of falls: one in twenty by chance."""
    kept: float = 0.5
    """Of the share that an effect closes in the fitted recordings, at least, where there is a gap to close."""
    gap_from: float = 0.25
    """Excess chi2 over that of the noise from which a share says more of the effect than of the noise."""
    unproven: float = 0.5
    """Factor of the probability of an effect that does not carry over or cannot be so large: at most one half."""
    worse: float = 1.25
    """Factor by which the error of free runs on held-out runs grows that the named effects must not exceed."""
    followed_rad: float = 0.3
    """Error of a free run before, up to which it is compared: beyond, chaos has decided it."""
    wildest: float = 1e12
    """chi2 that a segment counts at most: of one that cannot be followed."""


TRANSFER = TransferSettings()


@dataclass(frozen=True, slots=True)
class Transfer:
    """Performance of the named effects on held-out recordings."""

    basis: Basis
    closed: GapReduction
    """By all effects together."""
    closing: tuple[tuple[str, float, float], ...]
    """Effect added, "" for none; gap left, rms of a reading, rad; share closed so far: on what took no part."""
    left_out: Mapping[str, GapReduction]
    """The same of each fitted run as predicted from the others."""
    held_out: Mapping[str, GapReduction]
    """The same of each run held out."""
    effects: Mapping[str, Mapping[str, GapReduction]]
    """Effect -> run -> share closed by it, of the gap that stays without it."""
    withdrawn: tuple[str, ...]
    """Effects that do not carry over."""
    oversized: tuple[str, ...]
    """Effects of a size that no rig has."""
    worse_free_run: tuple[float, float] | None
    """Error of free runs on held-out runs without and with the effects, rms, rad, where the effects make it worse; else
    None."""

    def judged(self, posteriors: Sequence[EffectPosterior]) -> tuple[EffectPosterior, ...]:
        """The same effects; at most one half where they do not carry over, are too large, or spoil free runs."""
        doubtful = {*self.withdrawn, *self.oversized}
        if self.worse_free_run:
            doubtful |= {item.name for item in posteriors}
        return tuple(
            replace(item, probability=TRANSFER.unproven * item.probability) if item.name in doubtful else item
            for item in posteriors
        )


def transfer(
    recordings: Recordings,
    unseen: Unseen | None,
    problem: Problem,
    selection: Selection,
    freely: Mapping[str, FreeRuns],
    rng: np.random.Generator,
) -> Transfer:
    """Test the chosen effects on held-out recordings.

    Args:
        recordings: the fitted runs
        unseen: runs held out; none: each fitted run is left out in turn
        problem: the segments of the fitted runs
        selection: the chosen set of effects
        freely: all recordings as the models before and after run along them
        rng: of the bootstrap
    """
    basis: Basis = "held-out runs" if unseen else "releases left out"
    if not unseen and len(recordings.records) == 1:
        basis = "one release"
    apart = unseen or left_out(recordings, problem)
    models: dict[str, Hypothesis] = {"": selection.base, **selection.without}
    chi2 = {name: _bounded(apart.chi2(item)) for name, item in models.items()}
    chosen = _bounded(apart.chi2(selection.chosen))
    noise = np.asarray(selection.chosen.residuals.level * apart.dof, dtype=np.float64)
    above = {name: np.stack([values - noise, chosen - noise]) for name, values in chi2.items()}
    shares = {name: _by_run(apart, pair, rng) for name, pair in above.items()}
    left = shares[""] if not unseen else _fitted(recordings, problem, selection, rng)
    withdrawn = [
        name
        for name, less in selection.without.items()
        if not (_helps(apart, chi2[name] - chosen) and _keeps(above[name], noise, less, selection.chosen))
    ]
    return Transfer(
        basis=basis,
        closed=reduction(above[""], rng),
        closing=tuple(_closing(apart, selection, above[""], noise)),
        left_out=left,
        held_out=shares[""] if unseen else {},
        effects={name: shares[name] for name in selection.without},
        withdrawn=() if basis == "one release" else tuple(withdrawn),
        oversized=at_limit(selection.chosen.fit.estimate.params, recordings.prior.limits),
        worse_free_run=worse_free_run(freely["before"].errors_rad, freely["after"].errors_rad, unseen.names)
        if unseen
        else None,
    )


def worse_free_run(
    before: Mapping[str, float], after: Mapping[str, float], held_out: Collection[str]
) -> tuple[float, float] | None:
    """Error of free runs before and after, rms over the held-out runs, where the effects make it worse; else None.

    Segments and free runs must agree: a name that closes the gap of segments and spoils the free run is not confirmed.

    Args:
        before: run -> rms error of the free run of the bare model, rad
        after: the same with the effects; a run that cannot be followed is missing
        held_out: names of the runs that took no part in the fit
    """
    names = [name for name in held_out if before.get(name, np.inf) < TRANSFER.followed_rad]
    if not names:
        return None
    errors = [[runs.get(name, np.pi) for name in names] for runs in (before, after)]
    rms = [float(np.sqrt(np.mean(np.square(values)))) for values in errors]
    return (rms[0], rms[1]) if rms[1] > TRANSFER.worse * rms[0] else None


def _closing(unseen: Unseen, selection: Selection, ends: Array, noise: Array) -> Iterator[tuple[str, float, float]]:
    """One effect after the other, from what the bare model leaves above the noise to what all leave: `ends`."""
    between = [_bounded(unseen.chi2(item)) - noise for _, item in selection.path[:-1]]
    left = [ends[0], *between, *([ends[1]] if selection.path else [])]
    for name, above in zip(["", *(name for name, _ in selection.path)], left, strict=True):
        rms = unseen.noise_rad * np.sqrt(max(float(above.sum()), 0.0) / unseen.dof.sum())
        yield name, float(rms), share(np.stack([ends[0], above]))


def _fitted(
    recordings: Recordings, problem: Problem, selection: Selection, rng: np.random.Generator
) -> dict[str, GapReduction]:
    apart = left_out(recordings, problem)
    noise = np.asarray(selection.chosen.residuals.level * apart.dof, dtype=np.float64)
    above = [_bounded(apart.chi2(item)) - noise for item in (selection.base, selection.chosen)]
    return _by_run(apart, np.stack(above), rng)


def _bounded(chi2: Array) -> Array:
    return np.minimum(np.nan_to_num(chi2, nan=np.inf), TRANSFER.wildest)


def _by_run(unseen: Unseen, above: Array, rng: np.random.Generator) -> dict[str, GapReduction]:
    return {name: reduction(above[:, own], rng) for name, own in unseen.runs}


def _helps(unseen: Unseen, fall: Array) -> bool:
    """Whether chi2 falls beyond chance on all, and rises beyond chance on none."""
    whole, spread = _sum(fall)
    each = [_sum(fall[own]) for _, own in unseen.runs]
    beyond_chance = whole > spread or (whole > 0.0 and _signed_rank(fall) > TRANSFER.beyond_chance)
    return beyond_chance and all(total > -reach for total, reach in each)


def _keeps(above: Array, noise: Array, less: Hypothesis, chosen: Hypothesis) -> bool:
    """Whether an effect closes about as much as in the fitted recordings; (2, segments) chi2 above the noise."""
    if above[0].sum() < TRANSFER.gap_from * noise.sum():
        return True
    fitted = np.array([[less.residuals.excess], [chosen.residuals.excess]])
    return share(above) >= TRANSFER.kept * share(fitted)


def _signed_rank(fall: Array) -> float:
    """Standard errors of Wilcoxon's signed-rank sum of blocks of segments from zero."""
    blocks = _blocks(fall)
    ranks = 1.0 + np.argsort(np.argsort(np.abs(blocks)))
    n = len(blocks)
    return float((ranks * np.sign(blocks)).sum() / np.sqrt(n * (n + 1) * (2 * n + 1) / 6))


def _blocks(fall: Array) -> Array:
    """Sums over neighbouring segments: they resemble each other."""
    return np.add.reduceat(fall, np.arange(0, len(fall), BOOTSTRAP.block))


def _sum(fall: Array) -> tuple[float, float]:
    """Sum over segments, and how far chance may take it."""
    blocks = _blocks(fall)
    spread = np.sqrt(len(blocks) * np.var(blocks, ddof=1)) if len(blocks) > 1 else np.inf
    return float(fall.sum()), float(TRANSFER.beyond_chance * spread)
