"""Reproducible share of the gap: each recording is predicted from the other recordings.

The mean squared residual of the bare model on a held-out recording is divided into shares that are removed one after
the other:

    explained          by the corrected model, fitted to the other recordings
    unmodelled         by free torques and encoder errors, also fitted to the other recordings
    varying            by model parameters that differ between recordings, fitted to the recording itself
    not reproducible   the rest above the noise
    noise              the noise of the readings

All shares are computed by linear algebra on the fits (`dpr_lab.gap.hypothesis.cross_validation`). A single recording is
divided into quarters, which show changes within the recording but not changes between recordings.

A parameter varies if its values d in the recordings scatter more than their errors allow,

    Q = d^T cov(d)^-1 d  >  R - 1 + 3 sqrt(2 (R - 1)) + 2 log k

for R recordings and k parameters. The errors are estimated from the scatter of the scores of segments (a sandwich
estimate), so that a disturbance of one segment does not count as a varying parameter.

Source: P. J. Huber (1967), The behavior of maximum likelihood estimates under nonstandard conditions; W. G. Cochran
(1954), The combination of estimates from different experiments, Biometrics 10, 101-129, for Q.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from dpr_lab.arrays import Array, Flags, Integers
from dpr_lab.fitting.cut import carried
from dpr_lab.fitting.gauss_newton import Fit, fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import TINY
from dpr_lab.gap.hypothesis.cross_validation import PRIOR, Fold, folds, left_out_chi2, scaled_columns, split
from dpr_lab.gap.hypothesis.residuals import residual_statistics
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.mounted_ratios import ratio_of
from dpr_lab.gap.result.gap_budget import GapBudget, VaryingParameter
from dpr_lab.gap.screen.recordings import LENGTHS, Recordings
from dpr_lab.gap.transfer.out_of_sample import block
from dpr_lab.gap.where.discrepancy import DISCREPANCY, discrepancy_columns
from dpr_lab.gap.where.locate import SIGNIFICANT
from dpr_lab.gap.which.selected import Selection
from dpr_lab.setup import only_inner


@dataclass(frozen=True, slots=True)
class RepeatabilityRules:
    """Limits and settings of the division into shares."""

    segments: int = 3
    """Minimum number of segments of each recording; fewer segments show no scatter."""
    varying: int = 3
    """Maximum number of varying parameters. A larger number would fit any residual."""
    beyond_chance: float = 2.0
    """Minimum improvement of the prediction by free torques, in standard errors of a sum over segments."""
    iterations: int = 8
    """Maximum number of iterations of the fits to all recordings, including the held-out ones."""
    far: float = 100.0
    """Maximum mean squared weighted residual for which segments of the working length are used."""
    unfollowed: float = 1e300
    """chi2 that is used for a segment whose simulation overflows."""
    singular: float = 1e-9
    """Relative size of a singular value up to which it counts as zero."""


REPEATABILITY = RepeatabilityRules()


def gap_budget(recordings: Recordings, everything: Recordings, problem: Problem, selection: Selection) -> GapBudget:
    """Divide the mean squared residual of the bare model into shares.

    Args:
        recordings: the fitted runs
        everything: the fitted and the held-out runs
        problem: segments of the fitted runs
        selection: the selected set of effects
    """
    before, after = selection.bare.fit, selection.chosen.fit
    if len(everything.records) > len(recordings.records):
        problem, before, after = _fitted_to_all(everything, problem, before, after)
    names = [record.run.name for record in everything.records]
    followed = np.isfinite(before.linear.chi2_by_segment) & np.isfinite(after.linear.chi2_by_segment)
    fold = folds(problem)
    residuals = residual_statistics(problem, after)
    noise = residuals.level * float(problem.evidence_by_segment[followed].sum())
    total = float(left_out_chi2(before, fold)[followed].sum())
    if residual_statistics(problem, before).z < SIGNIFICANT or not followed.any() or total <= noise:
        return budget_of(
            [total] * 4, noise, names, (), "There is no gap above the noise whose repeatability could be computed."
        )
    parts = _Linearised.of(problem, after, fold, followed)
    explained = parts.left_out_chi2()
    if fold.max() == 0 or min(np.bincount(fold[followed], minlength=fold.max() + 1)) < REPEATABILITY.segments:
        parts_of_data = "Recordings" if len(recordings.records) > 1 else "Quarters of a recording"
        fewer = f"with fewer than {REPEATABILITY.segments} segments of {everything.working_length:.2g} s"
        reason = f"{parts_of_data} {fewer} do not show which part of the gap is reproducible."
        return budget_of([total, *[float(explained.sum())] * 3], noise, names, (), reason)
    if residuals.z > THRESHOLDS.noise_floor:
        parts = parts.with_discrepancy(discrepancy_columns(problem, after))
    unmodelled = parts.left_out_chi2()
    varying = parts.varying()
    by_chance = sum(parameter.chance for parameter in varying)
    freed = float(parts.left_out_chi2([parameter.column for parameter in varying]).sum()) + by_chance
    levels = [total, float(explained.sum()), float(unmodelled.sum()), freed]
    return budget_of(levels, noise, names, _shown(varying, everything, problem, after), "")


def _shown(
    varying: Sequence["_Varying"], everything: Recordings, problem: Problem, after: Fit
) -> list[VaryingParameter]:
    """Return the varying parameters with their values in each recording.

    Parameters of the rods are stated as ratios to b, or to a if only the inner rod is mounted.
    """
    names, alone = [record.run.name for record in everything.records], only_inner(problem.segments.setups)
    shown = []
    for varied in varying:
        parameter, quarters = after.free[after.inside[varied.column]], range(1, len(varied.own) + 1)
        of_rods = parameter.block == "ratios"
        ratio = ratio_of(parameter, after.estimate, everything.rig, alone=alone) if of_rods else None
        name, common, per = ratio or (parameter.name, parameter.read(after.estimate), 1.0)
        unit = PRIOR * parameter.size / per
        spread, error = np.std(varied.own, ddof=1), np.sqrt(np.mean(varied.std**2))
        labels = names if len(names) > 1 else [f"{names[0]}, quarter {quarter}" for quarter in quarters]
        shown.append(
            VaryingParameter(
                effect=parameter.effect,
                name=name,
                values=dict(zip(labels, (common + unit * varied.own).tolist(), strict=True)),
                std=float(unit * error),
                spread=float(unit * np.sqrt(max(spread**2 - error**2, 0.0))),
                sigmas=float(np.sqrt(varied.scatter / (len(varied.own) - 1))),
            )
        )
    return shown


def budget_of(
    levels: Sequence[float], noise: float, names: Sequence[str], varying: Sequence[VaryingParameter], undecided: str
) -> GapBudget:
    """Compute the shares of the gap from the chi2 after each step.

    Args:
        levels: chi2 of the bare model, of the corrected model, with free torques and encoder errors, and with
            parameters fitted to each recording
        noise: chi2 of the noise
        names: names of the recordings
        varying: parameters that differ between recordings
        undecided: reason why the shares are not determined; otherwise empty
    """
    finite = np.nan_to_num([*levels, 0.0], nan=noise, posinf=REPEATABILITY.unfollowed)
    falling = np.minimum.accumulate(np.maximum(finite, noise))
    total = max(float(falling[0]), np.finfo(np.float64).tiny)
    explained, unmodelled, own_parameters = (np.abs(np.diff(falling[:4])) / total).tolist()
    remaining = float(falling[3] - falling[4]) / total
    return GapBudget(
        basis="pieces of one recording" if len(names) == 1 else "recordings",
        explained=explained,
        varying=own_parameters,
        unmodelled=unmodelled,
        not_reproducible=remaining,
        noise=max(1 - explained - own_parameters - unmodelled - remaining, 0.0),
        parameters=list(varying),
        undecided=undecided,
    )


def _fitted_to_all(everything: Recordings, known: Problem, *models: Fit) -> tuple[Problem, Fit, Fit]:
    """Fit two models to all recordings, starting from their fits to a part of the recordings.

    If the rig was changed between the recordings, the phases in long segments are so wrong that the residual is no
    longer linear in the ratios. Short segments are used for such recordings.
    """
    for length in (everything.working_length, LENGTHS.first):
        problem, initial = everything.cut(length)
        refitted = []
        for model in models:
            first = carried(known.segments, model.estimate.initial, problem.segments, initial)
            estimate = model.estimate.changed(initial=first, zeros=np.zeros((0, 2)))
            free = tuple(parameter for parameter in model.free if parameter.block != "zeros")
            refitted.append(fit(problem, estimate, free, iterations=REPEATABILITY.iterations))
        if min(model.chi2 for model in refitted) < REPEATABILITY.far * problem.read.sum():
            break
    before, after = refitted
    return problem, before, after


@dataclass(frozen=True, slots=True)
class _Varying:
    """A parameter that differs between recordings, with its deviations from the common value."""

    column: int
    own: Array
    """(recordings,) deviation of each recording's value from the common value, in units of the column."""
    std: Array
    """(recordings,) standard deviations of the deviations, in the same units."""
    scatter: float
    """Q: reduction of chi2 by separate values for the recordings, divided by the variance inflation."""
    chance: float
    """Reduction of chi2 that is expected from a fit of noise alone."""


@dataclass(frozen=True, slots=True)
class _Linearised:
    """Linearised fit by segments: residuals, columns of the model, and columns of free torques and encoder errors."""

    X: Array
    """(segments, m, k) whitened columns."""
    e: Array
    """(segments, m) whitened residuals."""
    fold: Integers
    precision: Array
    """(k,) inverse prior variance of the coefficient of each column."""
    own: tuple[int, ...]
    """Columns of encoder zeros, which are free in every recording, like the initial states."""
    candidates: tuple[int, ...]
    """Columns of parameters that may vary."""
    by_fold: list[Fold]
    """Normal equations of each recording."""
    block: int = 1
    """Number of neighbouring segments that count as one independent value."""

    @classmethod
    def of(cls, problem: Problem, fit: Fit, fold: Integers, followed: Flags) -> Self:
        """Create the linearised fit; segments that cannot be simulated contribute nothing."""
        inside = [fit.free[i] for i in fit.inside]
        A = np.where(followed[:, None, None], scaled_columns(fit, fit.inside), 0.0)
        e = np.where(followed[:, None], fit.linear.e, 0.0)
        zeros = [i for i, parameter in enumerate(inside) if parameter.block == "zeros"]
        columns = tuple(i for i in zeros if len(np.unique(fold[_used(A[:, :, i])])) == 1)
        others = tuple(i for i in range(len(inside)) if i not in columns and _used(A[:, :, i]).any())
        return cls(A, e, fold, np.ones(len(inside)), columns, others, split(A, e, fold), block(problem))

    def left_out_chi2(self, freed: Sequence[int] = ()) -> Array:
        """Return the (segments,) chi2 of the prediction from the other recordings.

        The coefficients of the columns `freed` have a separate value in each recording, unlike in
        `cross_validation.left_out_chi2`.
        """
        removed = [*self.own, *freed]
        parts, chi2 = [_without(part, removed) for part in self.by_fold], np.zeros(len(self.e))
        H, gradient = sum((part.H for part in parts), np.diag(self.precision)), sum(part.gradient for part in parts)
        for part in parts:
            X, e = self.X[part.segments], self.e[part.segments]
            error = e - X @ np.linalg.solve(H - part.H, gradient - part.gradient)
            if removed:
                columns = X[:, :, removed]
                flat = columns.reshape(error.size, -1)
                error = error - columns @ np.linalg.lstsq(flat, error.ravel(), rcond=REPEATABILITY.singular)[0]
            chi2[part.segments] = np.sum(error**2, axis=1)
        return chi2

    def with_discrepancy(self, columns: Array) -> Self:
        """Return the fit with additional free torques and encoder errors, if they improve the prediction.

        Of the tested prior variances of these terms, the one with the best prediction is used.
        """
        columns = np.where(_used(self.e)[:, None, None], columns, 0.0)
        X, before, best = np.concatenate([self.X, columns], axis=2), self.left_out_chi2(), self
        by_fold, least = split(X, self.e, self.fold), before
        for ridge in DISCREPANCY.ridges:
            precision = np.concatenate([self.precision, np.full(columns.shape[2], ridge)])
            wider = replace(self, X=X, precision=precision, by_fold=by_fold)
            chi2 = wider.left_out_chi2()
            blocks = np.add.reduceat(before - chi2, np.arange(0, len(chi2), self.block))
            chance = REPEATABILITY.beyond_chance * float(np.std(blocks)) * len(blocks) ** 0.5
            if chi2.sum() < least.sum() and blocks.sum() > chance:
                best, least = wider, chi2
        return best

    def varying(self) -> list[_Varying]:
        """Return the parameters that significantly differ between recordings, most significant first."""
        chosen: list[_Varying] = []
        while len(chosen) < REPEATABILITY.varying:
            others = [i for i in self.candidates if i not in [parameter.column for parameter in chosen]]
            common = np.concatenate([self.X, *(self._local(parameter.column) for parameter in chosen)], axis=2)
            flat = common.reshape(self.e.size, -1)
            normal = flat.T @ flat + np.diag(np.append(self.precision, np.ones(flat.shape[1] - len(self.precision))))
            tried = [self._scatter(i, flat, normal) for i in others]
            best, free = max(tried, key=lambda parameter: parameter.scatter, default=None), int(self.fold.max())
            if best is None or best.scatter < free + 3 * (2 * free) ** 0.5 + 2 * np.log(len(tried)):
                break
            chosen.append(best)
        return chosen

    def _local(self, column: int) -> Array:
        """Split the column of a parameter into one column per recording, (segments, m, recordings)."""
        of_recording = self.fold[:, None, None] == np.arange(int(self.fold.max()) + 1)
        return np.where(of_recording, self.X[:, :, [column]], 0.0)

    def _scatter(self, column: int, common: Array, normal: Array) -> _Varying:
        """Fit a separate value of one parameter to each recording.

        The coefficients of the (rows, k) columns `common` are equal in all recordings. `normal` is the normal matrix of
        these columns.
        """
        stacked = np.concatenate([self._local(column), self.e[:, :, None]], axis=2)
        flat = stacked.reshape(len(common), -1)
        projected = (flat - common @ np.linalg.solve(normal, common.T @ flat)).reshape(stacked.shape)
        L, e = projected[:, :, :-1], projected[:, :, -1]
        runs = L.shape[2]
        # differences between recordings do not depend on the common value
        contrasts = np.linalg.svd(np.ones((1, runs)))[2][1:].T
        H, gradient = np.einsum("smi,smj->ij", L, L), np.einsum("smi,sm->i", L, e)
        inverse = np.linalg.pinv(contrasts.T @ H @ contrasts, rcond=REPEATABILITY.singular, hermitian=True)
        V = contrasts @ inverse @ contrasts.T
        values = V @ gradient
        scores = np.einsum("smi,sm->si", L, e - L @ values)
        meat = scores.T @ scores * len(scores) / (len(scores) - runs)
        size = max(float(np.trace(V @ meat)) / (runs - 1), 1.0)
        std = np.sqrt(np.maximum(np.maximum(np.diag(V @ meat @ V), np.diag(V)), TINY))
        return _Varying(column, values, std, float(gradient @ values) / size, size * runs)


def _without(part: Fold, removed: Sequence[int]) -> Fold:
    """Eliminate the columns that are fitted to a recording alone from the normal equations of this recording."""
    if not removed:
        return part
    H, gradient = part.H, part.gradient
    taken = H[:, removed] @ np.linalg.pinv(H[np.ix_(removed, removed)], rcond=REPEATABILITY.singular, hermitian=True)
    return replace(part, H=H - taken @ H[removed], gradient=gradient - taken @ gradient[removed])


def _used(values: Array) -> Flags:
    return np.abs(values).sum(axis=1) > 0
