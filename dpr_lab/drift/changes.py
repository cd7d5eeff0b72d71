"""Test for significant changes of parameters between groups of runs, with simultaneous intervals.

The model of the parameter q of run k is

    q_k = (mean of its group) + (effect of its pose) + e_k,    e_k independent, of standard deviation s.

s is estimated from runs of the same group and pose, or from successive runs if no group has several runs. It is at
least the standard deviation due to the noise of a single run. Contrasts c of the group means are tested: each group
minus the first group, and for each change point the mean of all later groups minus the mean of all earlier groups. One
critical value applies to all contrasts and all parameters simultaneously: the quantile of

    max |c . mean| / (s |c|)

over simulated runs without a change (single-step max-t test).

Source: Hothorn, Bretz & Westfall (2008), Biometrical Journal 50(3) 346-363, the single-step procedure. The simulation,
the assumed independence of parameters (conservative) and the choice of contrasts are not from this source.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dpr_lab.arrays import Array
from dpr_lab.drift.estimates import Estimates
from dpr_lab.errors import RunError

Basis = Literal["runs of one group", "neighbouring runs", "the noise of each run"]
"""Data from which the standard deviation of the values of one run is estimated."""


@dataclass(frozen=True, slots=True)
class DriftSettings:
    """Settings of the test for drift."""

    false_alarms: float = 0.012
    """Family-wise error rate: probability of any significant change without drift. In trials it is below 2 %."""
    draws: int = 20_000
    """Number of simulated data sets. The critical value is then accurate to about 0.01."""
    fewest_repeats: int = 2
    """Minimum degrees of freedom for an estimate of the standard deviation from runs of one group and pose."""
    fewest_neighbours: int = 6
    """Minimum number of runs for an estimate of the standard deviation from successive runs."""
    within: float = 1e-9
    """Numerical tolerance of the test whether the runs determine a contrast."""


SETTINGS = DriftSettings()


@dataclass(frozen=True, slots=True)
class Difference:
    """Difference of a parameter's mean between a group and the first group."""

    group: int
    """Index of the group."""
    change: float
    """Mean of the group minus mean of the first group, SI units."""
    interval: tuple[float, float]
    """Interval of `change`, SI units. Its confidence holds simultaneously for all parameters, groups and change
    points."""


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """Result of the test for one parameter."""

    name: str
    """Name of the parameter."""
    first: float
    """Mean of the first group at the mean pose, SI units."""
    scatter: float
    """Standard deviation of the value of one run, SI units."""
    differences: tuple[Difference, ...]
    """Differences of each later group from the first group."""
    after: int
    """Index of the last group before the most significant change point."""
    step: float
    """Mean of all groups after the change point minus mean of all groups before it, SI units."""
    step_interval: tuple[float, float]
    """Interval of `step`, simultaneous with all other intervals, SI units."""
    between: tuple[str, str]
    """Names of the two groups of the most significant contrast: the first and a later group, or the groups before and
    after a change point."""
    change: float
    """Value of the most significant contrast, SI units."""
    change_interval: tuple[float, float]
    """Interval of `change`, simultaneous with all other intervals, SI units."""
    p: float
    """Adjusted p-value: probability that any parameter has a contrast this large without drift."""
    moved: bool
    """Whether the change is significant."""


@dataclass(frozen=True, slots=True)
class Drift:
    """Result of the test for all parameters."""

    groups: tuple[str, ...]
    """Names of the groups, in chronological order."""
    runs_of: tuple[int, ...]
    """Number of runs of each group."""
    parameters: tuple[ParameterChange, ...]
    """Result for each parameter."""
    basis: Basis
    """Data from which the standard deviation of a run was estimated."""
    critical: float
    """Critical value of a contrast, in standard errors."""
    false_alarms: float
    """Family-wise error rate."""

    @property
    def moved(self) -> tuple[ParameterChange, ...]:
        """Parameters with a significant change."""
        return tuple(parameter for parameter in self.parameters if parameter.moved)


@dataclass(frozen=True, slots=True)
class _Design:
    """Linear maps from the values of the runs to contrasts, mean of the first group, and residuals."""

    contrasts: Array
    """(contrasts, runs) weights: each later group minus the first, then the change points."""
    first: Array
    """(runs,) weights of the mean of the first group."""
    scatter: Array
    """(m, runs) weights of m residuals, whose sum of squares estimates `norm` times the variance of one run.

    m is 0 if the variance cannot be estimated.
    """
    norm: float
    """Degrees of freedom of the residuals, or their number for successive runs."""
    basis: Basis
    """Source of the residuals."""


def changes(
    estimates: Estimates, group: Sequence[int], names: Sequence[str], settings: DriftSettings = SETTINGS, seed: int = 0
) -> Drift:
    """Determine which parameters changed significantly between groups.

    Args:
        estimates: estimates of each run, in chronological order
        group: index of the group of each run
        names: names of the groups
        settings: settings of the test
        seed: seed of the simulation; the same seed gives the same result

    Raises:
        RunError: a group shares no pose with the other groups, so the groups are not comparable.
    """
    design = _design(np.asarray(group), estimates.poses, settings, names)
    null = _null_distribution(design, len(estimates.names), settings, np.random.default_rng(seed))
    critical = float(np.quantile(null, 1 - settings.false_alarms))
    scatter = _scatter(design, estimates.values)
    noise = np.sqrt(np.mean(estimates.std**2, axis=0))
    std = np.maximum(scatter, noise)
    shifts, lengths = design.contrasts @ estimates.values, np.linalg.norm(design.contrasts, axis=1)
    parameters = []
    for k, name in enumerate(estimates.names):
        half_widths = critical * std[k] * lengths
        t = np.abs(shifts[:, k]) / (std[k] * lengths)
        steps = np.arange(len(names) - 1, len(t))
        step = int(steps[np.argmax(t[steps])])
        best = int(np.argmax(t))
        later = best + 1 if best < len(names) - 1 else best - len(names) + 2
        earlier = 0 if best < len(names) - 1 else later - 1
        intervals = [(float(x - r), float(x + r)) for x, r in zip(shifts[:, k], half_widths, strict=True)]
        parameters.append(
            ParameterChange(
                name=name,
                first=float(design.first @ estimates.values[:, k]),
                scatter=float(std[k]),
                differences=tuple(
                    Difference(g, float(shifts[g - 1, k]), intervals[g - 1]) for g in range(1, len(names))
                ),
                after=step - len(names) + 1,
                step=float(shifts[step, k]),
                step_interval=intervals[step],
                between=(names[earlier], names[later]),
                change=float(shifts[best, k]),
                change_interval=intervals[best],
                p=float(np.mean(null >= t.max())),
                moved=bool(t.max() > critical),
            )
        )
    counts = tuple(int(np.sum(np.asarray(group) == g)) for g in range(len(names)))
    return Drift(tuple(names), counts, tuple(parameters), design.basis, critical, settings.false_alarms)


def _design(group: NDArray[np.int_], poses: Sequence[str], settings: DriftSettings, names: Sequence[str]) -> _Design:
    runs, groups = len(group), len(names)
    distinct = sorted(set(poses))
    by_pose = np.array([[pose == other for other in distinct[1:]] for pose in poses], dtype=float).reshape(runs, -1)
    X = np.column_stack([group[:, None] == np.arange(groups), by_pose - by_pose.mean(axis=0)])
    inverse = np.linalg.pinv(X)
    counts = np.bincount(group, minlength=groups)
    L = np.zeros((2 * (groups - 1), X.shape[1]))
    for g in range(1, groups):
        L[g - 1, [0, g]] = -1.0, 1.0
        L[groups - 2 + g, :g] = -counts[:g] / counts[:g].sum()
        L[groups - 2 + g, g:groups] = counts[g:] / counts[g:].sum()
    not_estimable = np.flatnonzero(np.abs(L @ inverse @ X - L).max(axis=1) > settings.within)
    if len(not_estimable):
        raise RunError(
            f"the group {names[not_estimable[0] % (groups - 1) + 1]} shares no pose with the others"
            f" ({', '.join(distinct)}). Estimates differ between poses, so record the same poses in every group"
        )
    residual = np.eye(runs) - X @ inverse
    dof = runs - int(np.linalg.matrix_rank(X))
    first = inverse[0]
    if dof >= settings.fewest_repeats:
        return _Design(L @ inverse, first, residual, float(dof), "runs of one group")
    if runs >= settings.fewest_neighbours and len(distinct) == 1:
        steps = np.diff(np.eye(runs), axis=0) / np.sqrt(2)
        return _Design(L @ inverse, first, steps, runs - 1.0, "neighbouring runs")
    return _Design(L @ inverse, first, np.zeros((0, runs)), 1.0, "the noise of each run")


def _scatter(design: _Design, values: Array) -> Array:
    """Return the (parameters,) standard deviations of one run; zero if they cannot be estimated."""
    return np.sqrt(np.sum((design.scatter @ values) ** 2, axis=0) / design.norm)


def _null_distribution(design: _Design, parameters: int, settings: DriftSettings, rng: np.random.Generator) -> Array:
    """Simulate runs without drift; return the (draws,) largest contrast of any parameter in standard errors."""
    simulated = rng.standard_normal((design.contrasts.shape[1], settings.draws * parameters))
    t = np.abs(design.contrasts @ simulated).T / np.linalg.norm(design.contrasts, axis=1)
    largest = t.max(axis=1)
    if len(design.scatter):
        largest /= _scatter(design, simulated)
    return largest.reshape(settings.draws, parameters).max(axis=1)
