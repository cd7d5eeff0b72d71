"""Score test: predicted reduction of chi2 by each effect of a library.

Let e be the whitened residual, A the Jacobian of the fitted parameters, and C the Jacobian of a candidate. The initial
states are projected out of all three. The predicted reduction is that of the bounded least-squares problem

    min | e - A dp - C a |^2,    friction and other one-signed amplitudes non-negative.

The candidate is not simulated. The solution is the initial value of its nonlinear fit.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects.effect import Effect, Recorded, Shape
from dpr_lab.fitting.estimate import FreeParameter, effect_parameters
from dpr_lab.fitting.gauss_newton import Fit, RigPrior, bounds
from dpr_lab.fitting.linearise import Linearisation, linearise
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import ColumnSpace
from dpr_lab.fitting.response import TRAJECTORY, trajectory
from dpr_lab.gap.hypothesis.scan import ShapeScan
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """Result of the score test of one effect: predicted reduction of chi2, and amplitudes."""

    effect: Effect
    shape: Shape
    gain: float
    """Predicted reduction of chi2."""
    columns: tuple[int, ...]
    """Indices of the columns of the amplitudes that are not absorbed; of all amplitudes if all are absorbed."""
    free: tuple[FreeParameter, ...]
    """Parameters of `columns` after those of the fit."""
    amplitudes: Array
    """(columns,) amplitudes of the linear solution."""
    absorbed: Mapping[str, str] = field(default_factory=dict)
    """Name of the parameter that absorbs an amplitude, by the name of the amplitude."""

    @property
    def named_amplitudes(self) -> dict[str, float]:
        """Amplitudes of the linear solution, by name."""
        columns = self.free[len(self.free) - len(self.columns) :]
        return {p.name: float(value) for p, value in zip(columns, self.amplitudes, strict=True)}


@dataclass(frozen=True, slots=True, eq=False)
class ScoreTest:
    """Score test of a fit."""

    fit: Fit
    linear: Linearisation
    free: tuple[FreeParameter, ...]
    """Parameters of all columns: those of the fit, then those of the candidates."""
    space: ColumnSpace
    prior: RigPrior
    """Prior of all columns of the test."""
    ranking: tuple[Score, ...] = ()
    """Scores of all effects in their best shapes, best first."""
    shaped: Mapping[str, tuple[Score, ...]] = field(default_factory=dict)
    """Scores of all shapes of each effect, best first."""
    tested: frozenset[str] = frozenset()
    """Names of the tested effects. Effects without a shape in these recordings have no score."""

    @property
    def fitted_columns(self) -> tuple[int, ...]:
        """Columns of the fitted parameters."""
        return tuple(range(len(self.fit.free)))

    def best_score(self, effect: str) -> Score | None:
        """Return the best score of one effect; None if no shape of it was tested."""
        return self.shaped[effect][0] if effect in self.shaped else None

    def absorbs(self, effect: Effect, by: Effect) -> bool:
        """Return whether the fitted effect `by` absorbs an effect of one amplitude."""
        score = self.best_score(effect.name)
        if score is None or len(effect.parameters) > 1:
            return False
        return [parameter.name for parameter in by.parameters] == list(score.absorbed.values())

    def prior_of(self, columns: Sequence[int]) -> RigPrior:
        """Return the prior of the given columns, which must include those of the fit."""
        rows = columns if len(self.prior.A) else ()  # no prior without a rig file
        free = tuple(self.free[i] for i in columns)
        return replace(self.prior, free=free, A=self.prior.A[np.ix_(rows, columns)], e=self.prior.e[list(rows)])

    def projected(self, columns: Sequence[int]) -> ColumnSpace:
        """Return the space of columns with the fitted parameters projected out."""
        return self.space.projected_out(list(self.fitted_columns), list(columns))

    def cosine(self, target: Score, other: Score) -> float:
        """Return the cosine of the signature of `target` and the nearest direction in the space of `other`."""
        count = len(target.columns)
        direction = target.amplitudes if target.amplitudes.any() else self.space.scale[list(target.columns)]
        space = self.projected((*target.columns, *other.columns))
        return space.cosine(direction, slice(0, count), slice(count, None))

    def indistinguishable(self, first: Score, second: Score) -> bool:
        """Return whether each of two effects can imitate the other."""
        return min(self.cosine(first, second), self.cosine(second, first)) > THRESHOLDS.indistinguishable


def score_test(problem: Problem, fitted: Fit, library: Iterable[Effect], recorded: Recorded) -> ScoreTest:
    """Test every effect of a library against a fit.

    Args:
        problem: segments and noise
        fitted: fit to improve
        library: effects to test
        recorded: properties of the recordings from which shapes are proposed
    """
    library = tuple(library)
    reference = trajectory(problem, fitted.estimate, spacing=TRAJECTORY.coarse_s)
    scan = ShapeScan(problem, fitted, reference, recorded)
    candidates = [
        (effect, shape, effect_parameters(effect, overrides=shape, limits=problem.limits))
        for effect in library
        for shape in scan.shapes(effect)
    ]
    free = (*fitted.free, *(parameter for _, _, parameters in candidates for parameter in parameters))
    linear = linearise(problem, fitted.estimate, free)
    prior = RigPrior.at(problem, fitted.estimate, free, linear)
    test = ScoreTest(fitted, linear, free, ColumnSpace.of(*linear.flat), prior)
    tested: dict[str, list[Score]] = {}
    first = len(fitted.free)
    for effect, shape, parameters in candidates:
        columns = tuple(range(first, first + len(parameters)))
        first += len(parameters)
        tested.setdefault(effect.name, []).append(_score(test, effect, shape, columns))
    shaped = {name: tuple(sorted(items, key=lambda score: -score.gain)) for name, items in tested.items()}
    ranking = tuple(sorted((items[0] for items in shaped.values()), key=lambda score: (-score.gain, score.effect.name)))
    names = frozenset(effect.name for effect in library)
    return replace(test, ranking=ranking, shaped=shaped, tested=names)


def _score(test: ScoreTest, effect: Effect, shape: Shape, columns: tuple[int, ...]) -> Score:
    """Compute the score of one shape of an effect, from the amplitudes that are not absorbed."""
    fitted = test.fitted_columns
    prior = test.prior_of([*fitted, *columns])
    hidden = prior.absorbed(test.space.chosen([*fitted, *columns]))[len(fitted) :]
    absorbed = {test.free[columns[i]].name: _absorbing(test, columns, i) for i in np.flatnonzero(hidden).tolist()}
    if hidden.all():
        return Score(effect, shape, 0.0, columns, prior.free, np.zeros(len(columns)), absorbed)
    visible = tuple(columns[i] for i in np.flatnonzero(~hidden).tolist())
    gain, step = _bounded_solution(test, visible)
    free = (*test.fit.free, *(test.free[column] for column in visible))
    return Score(effect, shape, gain, visible, free, step[len(fitted) :], absorbed)


def _absorbing(test: ScoreTest, columns: tuple[int, ...], index: int) -> str:
    """Return the name of the parameter whose column is nearest to that of an absorbed amplitude."""
    overlaps = np.abs(test.space.H[columns[index]])
    nearest = max((*test.fitted_columns, *columns[:index]), key=lambda i: overlaps[i], default=None)
    return "initial states" if nearest is None or overlaps[nearest] == 0.0 else test.free[nearest].name


def _bounded_solution(test: ScoreTest, columns: Sequence[int]) -> tuple[float, Array]:
    """Solve the bounded least-squares problem of the fitted parameters and some amplitudes, with the prior.

    Returns:
        the reduction of chi2, and the (fitted + columns,) step, which is zero for absorbed parameters
    """
    rows = [*test.fitted_columns, *columns]
    prior, space = test.prior_of(rows), test.space.chosen(rows)
    room = bounds(test.fit.estimate, prior.free)
    room[:, list(test.fit.absorbed)] = 0.0
    step = space.with_prior(prior.A, prior.e).solution(room)
    return space.reduction(step), step


def joint_gain(test: ScoreTest, scores: Iterable[Score]) -> float:
    """Predict the reduction of chi2 by several effects together, each in the shape of its score."""
    return _bounded_solution(test, [column for score in scores for column in score.columns])[0]
