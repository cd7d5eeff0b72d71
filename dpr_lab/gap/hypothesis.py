"""One explanation of the gap: a set of effects, fitted with ratios and start states, and what it leaves."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects import EFFECTS, SLICES, switched_off
from dpr_lab.gap.heldout import Remainder, folds, remainder, surprise
from dpr_lab.gap.problem import Point, Problem, Slot, carried, effect_slots, rod_slots
from dpr_lab.gap.score import Score, Scores
from dpr_lab.gap.shooting import Fit, fit, moved, start_steps
from dpr_lab.rig import MASSES

Array = NDArray[np.float64]

PRICE = 9.0  # chi2 units that one more parameter has to earn: log of some 1e4 samples


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A set of effects, fitted."""

    effects: tuple[str, ...]
    fit: Fit
    remainder: Remainder
    surprise: Array
    """(folds,) how badly each release is predicted by the others, in units of chi2."""

    @property
    def cost(self) -> float:
        """Held-out chi2 and the price of its parameters, in units of independent evidence it leaves."""
        scanned = sum(len(EFFECTS[name].shapes) for name in self.effects)
        return float(self.surprise.sum()) + PRICE * self.remainder.inflation * (len(self.fit.slots) + scanned)

    @property
    def key(self) -> frozenset[str]:
        """The set of its effects."""
        return frozenset(self.effects)


def hypothesis(problem: Problem, effects: Iterable[str], found: Fit) -> Hypothesis:
    """Judge a fit."""
    left = remainder(problem, found)
    return Hypothesis(tuple(effects), found, left, surprise(found, folds(problem), left.inflation))


def scale_visible(effects: Iterable[str], problem: Problem) -> bool:
    """Whether b is no mere scale: a known added mass, or friction by the force that weighed masses put on a joint."""
    weighed = all(problem.rig.parameters[name].measured is not None for name in MASSES)
    weighs = weighed and any(EFFECTS[name].stage == "load" for name in effects)
    return weighs or any(item.run.added_mass for item in problem.records)


def slots_of(point: Point, effects: Sequence[str], problem: Problem) -> tuple[Slot, ...]:
    """The ratios, b where it can be seen, and all that is free of some effects."""
    rods = rod_slots(point, scale_visible(effects, problem))
    return (*rods, *(slot for name in effects for slot in effect_slots(EFFECTS[name], refined=True)))


def added(problem: Problem, before: Hypothesis, scores: Scores, item: Score, iterations: int) -> Hypothesis:
    """Fit one effect more, from where its score puts it."""
    vector = before.fit.point.vector.copy()
    for at, value in item.shape:
        vector[at] = value
    point = replace(before.fit.point, vector=vector)
    first = fit(problem, point, item.slots, iterations=1, first=scores.part(item))
    effects = (*before.effects, item.effect.name)
    found = fit(problem, first.point, slots_of(first.point, effects, problem), iterations=iterations)
    return hypothesis(problem, effects, found)


def added_from_short(problem: Problem, short: tuple[Problem, Array], before: Hypothesis, item: Score) -> Hypothesis:
    """Fit one effect more to short segments first: slower, but it converges where the effect bends the swings far.

    Args:
        problem: the segments
        short: shorter segments of the same runs, and start states to begin with
        before: the fit without the effect
        item: the effect in the shape to start from
    """
    vector = before.fit.point.vector.copy()
    for at, value in item.shape:
        vector[at] = value
    cut, starts = short
    near = fit(cut, Point(before.fit.point.rods, vector, starts), item.slots, iterations=12)
    point = replace(near.point, starts=carried(cut, near.point, problem, before.fit.point.starts))
    effects = (*before.effects, item.effect.name)
    return hypothesis(problem, effects, fit(problem, point, slots_of(point, effects, problem), iterations=12))


def dropped(problem: Problem, before: Hypothesis, effect: str, bare: Hypothesis, iterations: int = 15) -> Hypothesis:
    """Fit without one effect, from where the linearised fit puts the others; the bare model's b where none is seen."""
    names = tuple(name for name in before.effects if name != effect)
    linear, point = before.fit.linear, before.fit.point
    fallen = np.zeros(len(before.fit.slots))
    for i, slot in enumerate(before.fit.slots):
        if slot.effect == effect and EFFECTS[effect].parameters[slot.at - SLICES[effect].start].role == "amplitude":
            fallen[i] = -slot.read(point)
    kept = [i for i, slot in enumerate(before.fit.slots) if slot.effect != effect]
    A = linear.A.reshape(-1, linear.A.shape[2])
    step = fallen.copy()
    step[kept] = np.linalg.lstsq(A[:, kept], linear.e.ravel() - A @ fallen, rcond=1e-10)[0]
    slots = [before.fit.slots[i] for i in kept]
    without = replace(point, vector=switched_off(point.vector, effect))
    guess = moved(without, slots, step[kept], start_steps(linear, step))
    if not problem.cost(guess) < 10 * problem.cost(without):
        guess = without
    if not scale_visible(names, problem):
        guess = replace(guess, rods=np.append(guess.rods[:-1], bare.fit.point.rods[-1]))
    return hypothesis(problem, names, fit(problem, guess, slots_of(guess, names, problem), iterations=iterations))
