"""Score test: how much every effect of the library promises, from one linearised fit.

With A the slopes of what is fitted already and C those of a candidate (start states projected out of both), the fall of
chi2 that the candidate promises is that of the bounded least-squares problem

    min | e - A dp - C a |^2,    friction and other one-signed amplitudes not below zero.

Nothing is integrated again for it, and its solution is where the nonlinear fit of that candidate starts.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import Effect
from dpr_lab.gap.problem import Problem, Slot, effect_slots
from dpr_lab.gap.response import course
from dpr_lab.gap.scan import Shape, shapes
from dpr_lab.gap.shooting import Fit, Linear, bounded_solution, linearise

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Score:
    """What one effect, in its best shape, promises."""

    effect: Effect
    shape: Shape
    gain: float
    """Fall of chi2."""
    columns: tuple[int, ...]
    """Of its amplitudes, among the columns of `Scores`."""
    slots: tuple[Slot, ...]
    """Those of the fit and the effect's amplitudes."""
    step: Array
    """(slots,) the linear solution."""


@dataclass(frozen=True, slots=True)
class Scores:
    """A fit linearised with the columns of a whole library."""

    fit: Fit
    linear: Linear
    slots: tuple[Slot, ...]
    """Of all columns: those of the fit, then those of the candidates."""
    scale: Array
    """(columns,) one over the norm of each."""
    H: Array
    """Normal matrix of the columns at unit norm."""
    gradient: Array
    ranking: tuple[Score, ...]
    """Best first; of several shapes of an effect the best."""
    shaped: Mapping[str, tuple[Score, ...]]
    """All shapes of each effect, the best first."""

    @property
    def active(self) -> tuple[int, ...]:
        """Columns of the fit itself."""
        return tuple(range(len(self.fit.slots)))

    def of(self, effect: str) -> Score | None:
        """The best of one effect; none where it was not scored."""
        return self.shaped[effect][0] if effect in self.shaped else None

    def part(self, item: Score) -> Linear:
        """The linearisation with one candidate's columns beside the fit's."""
        chosen = [*self.active, *item.columns]
        full = self.linear
        return Linear(full.residual, full.e, full.A[:, :, chosen], full.slopes[:, :, chosen], full.Q, full.R)

    def solve(self, chosen: Sequence[int]) -> tuple[Array, float]:
        """The bounded step of the chosen columns, and the fall of chi2."""
        chosen = list(chosen)
        scale = self.scale[chosen]
        H = self.H[np.ix_(chosen, chosen)] + 1e-10 * np.eye(len(chosen))
        gradient = self.gradient[chosen]
        lower = np.array([self.slots[i].lower - self.slots[i].read(self.fit.point) for i in chosen]) / scale
        x = bounded_solution(H, gradient, lower)
        return x * scale, float(2 * x @ gradient - x @ H @ x)


def score(problem: Problem, found: Fit, library: Iterable[Effect]) -> Scores:
    """Score every effect.

    Args:
        problem: what was measured
        found: the fit to improve
        library: the effects to try
    """
    along = course(problem, found.point)
    groups: list[tuple[Effect, Shape, tuple[Slot, ...]]] = []
    for effect in library:
        scanned = shapes(effect, problem, found, along)
        groups += [(effect, shape, effect_slots(effect, overrides=shape)) for shape in scanned]
    columns = (*found.slots, *(slot for _, _, slots in groups for slot in slots))
    linear = linearise(problem, found.point, columns)
    A = linear.A.reshape(-1, linear.A.shape[2])
    scale = 1 / np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    A = A * scale
    scores = Scores(found, linear, columns, scale, A.T @ A, A.T @ linear.e.ravel(), (), {})
    tried: dict[str, list[Score]] = {}
    first = len(found.slots)
    for effect, shape, slots in groups:
        mine = tuple(range(first, first + len(slots)))
        first += len(slots)
        step, gain = scores.solve([*scores.active, *mine])
        tried.setdefault(effect.name, []).append(Score(effect, shape, gain, mine, (*found.slots, *slots), step))
    shaped = {name: tuple(sorted(items, key=lambda item: -item.gain)) for name, items in tried.items()}
    ranking = tuple(sorted((items[0] for items in shaped.values()), key=lambda item: -item.gain))
    return replace(scores, ranking=ranking, shaped=shaped)


def imitation(scores: Scores, target: Score, other: Score) -> float:
    """Cosine between what `target` does and the nearest that `other` can do, the fit's own columns projected out."""
    active, mine, theirs = list(scores.active), list(target.columns), list(other.columns)
    H = _projected(scores.H, active, mine + theirs)
    amplitudes = target.step[len(active) :] / scores.scale[mine]
    if not amplitudes.any():
        amplitudes = np.ones(len(mine))
    k = len(mine)
    length = amplitudes @ H[:k, :k] @ amplitudes
    overlap = H[k:, :k] @ amplitudes
    reached = overlap @ np.linalg.lstsq(H[k:, k:], overlap, rcond=1e-9)[0]
    return float(np.sqrt(min(max(reached / length, 0.0), 1.0))) if length > 0 else 0.0


def _projected(H: Array, active: Sequence[int], chosen: Sequence[int]) -> Array:
    inner = H[np.ix_(active, active)] + 1e-12 * np.eye(len(active))
    across = H[np.ix_(active, chosen)]
    return H[np.ix_(chosen, chosen)] - across.T @ np.linalg.solve(inner, across)
