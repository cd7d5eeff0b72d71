"""Which parameters moved between groups of runs, with simultaneous intervals.

Each parameter q of run k is taken for

    q_k = (mean of its group) + (what its pose adds) + e_k,    e_k independent, of one standard deviation s

where s is what runs of one group and pose differ by, or what neighbouring runs differ by where no group has several
runs; and never less than the noise of a run alone. Contrasts c of the groups' means are looked at: each group less the
first, and the mean of all groups after one less that of all up to it (a change point). One critical value holds for
all contrasts and all parameters together: the quantile of

    max |c . mean| / (s |c|)

over runs that differ by chance alone, drawn often enough (a single-step max-t test).

Source: Hothorn, Bretz & Westfall (2008), Biometrical Journal 50(3) 346-363, the single-step procedure; the drawing, the
independence of parameters (which errs towards no alarm) and the choice of contrasts are ours.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dpr_lab.drift.estimates import Estimates
from dpr_lab.errors import RunError

Array = NDArray[np.float64]

Basis = Literal["runs of one group", "neighbouring runs", "the noise of each run"]
"""What the scatter of a run was taken from."""


@dataclass(frozen=True, slots=True)
class DriftSettings:
    """When something is said to have moved."""

    false_alarms: float = 0.012
    """Probability that anything at all is said to have moved while nothing has: below 2 % in trials as well."""
    draws: int = 20_000
    """Of runs that differ by chance: the critical value is then good to a hundredth."""
    fewest_repeats: int = 2
    """Runs beyond one for each group and pose from which the scatter is taken from within groups."""
    fewest_neighbours: int = 6
    """Runs from which the scatter is taken from neighbours, where no group has several."""
    within: float = 1e-9
    """A contrast that the runs hold is met to this."""


SETTINGS = DriftSettings()


@dataclass(frozen=True, slots=True)
class Difference:
    """How far a parameter's mean lies from that of the first group."""

    group: int
    """Number of the group, from 0."""
    change: float
    """Mean of the group less that of the first, SI."""
    interval: tuple[float, float]
    """Simultaneous with those of all parameters, groups and change points, SI."""


@dataclass(frozen=True, slots=True)
class Moved:
    """What became of one parameter."""

    name: str
    """Name of the parameter."""
    first: float
    """Mean of the first group, at the mean pose, SI."""
    scatter: float
    """Standard deviation of one run, SI."""
    differences: tuple[Difference, ...]
    """Of every group but the first."""
    after: int
    """The group after which a change is likeliest."""
    step: float
    """The change there: mean of all groups after it less that of all up to it, SI."""
    step_interval: tuple[float, float]
    """Interval of the step, simultaneous with all others, SI."""
    between: tuple[str, str]
    """Names of the two groups that differ most: a later group and the first, or the last group before a change point
    and the first after it."""
    change: float
    """The change between them: of the group's mean, or of the mean of all groups after the change point, SI."""
    change_interval: tuple[float, float]
    """Interval of the change, simultaneous with all others, SI."""
    p: float
    """Probability that chance alone makes any parameter look as much moved."""
    moved: bool
    """Whether chance alone does not explain it."""


@dataclass(frozen=True, slots=True)
class Drift:
    """What changed between groups of runs."""

    groups: tuple[str, ...]
    """Names of the groups, in the order of time."""
    runs_of: tuple[int, ...]
    """How many runs each group has."""
    parameters: tuple[Moved, ...]
    """What became of each parameter."""
    basis: Basis
    """What the scatter of a run was taken from."""
    critical: float
    """Standard errors beyond which a contrast counts."""
    false_alarms: float
    """Probability that anything is said to have moved while nothing has."""

    @property
    def moved(self) -> tuple[Moved, ...]:
        """Those parameters that did."""
        return tuple(item for item in self.parameters if item.moved)


@dataclass(frozen=True, slots=True)
class _Design:
    """Linear maps of the runs' values."""

    contrasts: Array
    """(contrasts, runs): first each later group less the first, then the change points."""
    first: Array
    """(runs,) the first group's mean."""
    scatter: Array
    """(m, runs) residuals whose squares add up to `norm` variances; m = 0 where the scatter cannot be seen."""
    norm: float
    basis: Basis


def changes(
    found: Estimates, group: Sequence[int], names: Sequence[str], settings: DriftSettings = SETTINGS, seed: int = 0
) -> Drift:
    """Say which parameters moved.

    Args:
        found: what each run says, in the order of time
        group: of each run
        names: of the groups
        settings: when something is said to have moved
        seed: of the draws; same seed, same answer

    Raises:
        RunError: groups that share no pose with the others, so that they cannot be compared.
    """
    design = _design(np.asarray(group), found.poses, len(names), settings, names)
    nothing = _by_chance(design, len(found.names), settings, np.random.default_rng(seed))
    critical = float(np.quantile(nothing, 1 - settings.false_alarms))
    scatter = _scatter(design, found.values)
    noise = np.sqrt(np.mean(found.std**2, axis=0))
    s = np.maximum(scatter, noise)
    shifts, lengths = design.contrasts @ found.values, np.linalg.norm(design.contrasts, axis=1)
    parameters = []
    for k, name in enumerate(found.names):
        reach = critical * s[k] * lengths
        t = np.abs(shifts[:, k]) / (s[k] * lengths)
        steps = np.arange(len(names) - 1, len(t))
        at = int(steps[np.argmax(t[steps])])
        best = int(np.argmax(t))
        later = best + 1 if best < len(names) - 1 else best - len(names) + 2
        earlier = 0 if best < len(names) - 1 else later - 1
        intervals = [(float(x - r), float(x + r)) for x, r in zip(shifts[:, k], reach, strict=True)]
        parameters.append(
            Moved(
                name=name,
                first=float(design.first @ found.values[:, k]),
                scatter=float(s[k]),
                differences=tuple(
                    Difference(g, float(shifts[g - 1, k]), intervals[g - 1]) for g in range(1, len(names))
                ),
                after=at - len(names) + 1,
                step=float(shifts[at, k]),
                step_interval=intervals[at],
                between=(names[earlier], names[later]),
                change=float(shifts[best, k]),
                change_interval=intervals[best],
                p=float(np.mean(nothing >= t.max())),
                moved=bool(t.max() > critical),
            )
        )
    counts = tuple(int(np.sum(np.asarray(group) == g)) for g in range(len(names)))
    return Drift(tuple(names), counts, tuple(parameters), design.basis, critical, settings.false_alarms)


def _design(
    group: NDArray[np.int_], poses: Sequence[str], groups: int, settings: DriftSettings, names: Sequence[str]
) -> _Design:
    runs = len(group)
    kinds = sorted(set(poses))
    by_pose = np.array([[pose == kind for kind in kinds[1:]] for pose in poses], dtype=float).reshape(runs, -1)
    X = np.column_stack([group[:, None] == np.arange(groups), by_pose - by_pose.mean(axis=0)])
    inverse = np.linalg.pinv(X)
    counts = np.bincount(group, minlength=groups)
    L = np.zeros((2 * (groups - 1), X.shape[1]))
    for g in range(1, groups):
        L[g - 1, [0, g]] = -1.0, 1.0
        L[groups - 2 + g, :g] = -counts[:g] / counts[:g].sum()
        L[groups - 2 + g, g:groups] = counts[g:] / counts[g:].sum()
    lost = np.flatnonzero(np.abs(L @ inverse @ X - L).max(axis=1) > settings.within)
    if len(lost):
        raise RunError(
            f"the group {names[lost[0] % (groups - 1) + 1]} shares no pose with the others ({', '.join(kinds)}): what"
            " the model misses differs between poses, so record the same poses in every group"
        )
    residual = np.eye(runs) - X @ inverse
    free = runs - int(np.linalg.matrix_rank(X))
    first = inverse[0]
    if free >= settings.fewest_repeats:
        return _Design(L @ inverse, first, residual, float(free), "runs of one group")
    if runs >= settings.fewest_neighbours and len(kinds) == 1:
        steps = np.diff(np.eye(runs), axis=0) / np.sqrt(2)
        return _Design(L @ inverse, first, steps, runs - 1.0, "neighbouring runs")
    return _Design(L @ inverse, first, np.zeros((0, runs)), 1.0, "the noise of each run")


def _scatter(design: _Design, values: Array) -> Array:
    """(parameters,) standard deviation of one run; zero where it cannot be seen."""
    return np.sqrt(np.sum((design.scatter @ values) ** 2, axis=0) / design.norm)


def _by_chance(design: _Design, parameters: int, settings: DriftSettings, rng: np.random.Generator) -> Array:
    """(draws,) the largest contrast of any parameter, in standard errors, of runs that differ by chance alone."""
    drawn = rng.standard_normal((design.contrasts.shape[1], settings.draws * parameters))
    t = np.abs(design.contrasts @ drawn).T / np.linalg.norm(design.contrasts, axis=1)
    largest = t.max(axis=1)
    if len(design.scatter):
        largest /= _scatter(design, drawn)
    return largest.reshape(settings.draws, parameters).max(axis=1)
