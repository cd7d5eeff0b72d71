"""Linear least squares, and the reduction of the residual by sets of columns.

    min_x  | e - A x |^2

Columns are scaled to unit norm, so that units have no influence. A small ridge is added to the diagonal of every normal
matrix. Without the ridge, collinear columns would have large coefficients of opposite sign. With the ridge, they share
the reduction.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dpr_lab.arrays import Array, Integers
from dpr_lab.fitting.uncompiled import RIDGE, advance, bounded, bounded_solution, clip, solve_free
from dpr_lab.kernels import njit, subroutine

Indices = Sequence[int] | slice | Integers

TINY = 1e-140
"""Floor on the column norm; avoids overflow."""

for _part in (clip, advance, solve_free):  # `bounded` calls these, so that its compiled form contains them
    subroutine(_part)
COMPILED = njit(bounded)
"""Compiled form of `bounded`."""


@dataclass(frozen=True, slots=True)
class ColumnSpace:
    """Least-squares problem with the columns A and the residual e, represented by their inner products."""

    scale: Array
    """(k,) reciprocal norm of each column."""
    H: Array
    """(k, k) normal matrix of the columns at unit norm."""
    gradient: Array
    """(k,) inner products of the columns, at unit norm, with the residual."""

    @classmethod
    def of(cls, A: Array, e: Array) -> "ColumnSpace":
        """Create the least-squares problem from columns (..., k) and a residual (...)."""
        flat = A.reshape(e.size, A.shape[-1])
        H = flat.T @ flat
        scale = 1 / np.maximum(np.sqrt(np.diag(H)), TINY)
        return cls(scale, H * scale[:, None] * scale, (flat.T @ e.ravel()) * scale)

    def __len__(self) -> int:
        return len(self.scale)

    def chosen(self, columns: Indices) -> "ColumnSpace":
        """Return the problem with only some of the columns."""
        return ColumnSpace(self.scale[columns], self.H[columns][:, columns], self.gradient[columns])

    def with_prior(self, A: Array, e: Array) -> "ColumnSpace":
        """Add the rows A (n, k) and e (n,) of a prior, and scale all columns to unit norm."""
        H = self.H / self.scale[:, None] / self.scale + A.T @ A
        scale = 1 / np.maximum(np.sqrt(np.diag(H)), TINY)
        return ColumnSpace(scale, H * scale[:, None] * scale, (self.gradient / self.scale + A.T @ e) * scale)

    def projected_out(self, held: Indices, columns: Indices) -> "ColumnSpace":
        """Return the problem of `columns` with the columns `held` projected out, in the same scales."""
        across = self.H[held][:, columns]
        out = np.linalg.solve(_ridged(self.H[held][:, held]), np.column_stack([across, self.gradient[held]]))
        H = self.H[columns][:, columns] - across.T @ out[:, :-1]
        return ColumnSpace(self.scale[columns], H, self.gradient[columns] - across.T @ out[:, -1])

    def projected_out_of_sets(self, across: Array, within: Array, gradient: Array) -> "SmallSets":
        """Project the columns of this space out of many small sets of n columns.

        Args:
            across: (k, sets, n) inner products of the columns of this space with those of each set
            within: (sets, n, n) inner products within each set
            gradient: (sets, n) inner products with the residual
        """
        squares = np.diagonal(within, axis1=1, axis2=2)
        norm = np.sqrt(np.maximum(squares, 0.0))  # rounding errors may make this difference too small
        scale = 1 / np.maximum(norm, TINY)
        across = across * self.scale[:, None, None] * scale
        flat = across.reshape(len(self), scale.size)
        out = np.linalg.solve(_ridged(self.H), np.column_stack([flat, self.gradient]))
        taken = np.einsum("ksi,ksj->sij", across, out[:, :-1].reshape(across.shape))
        H = within * scale[:, :, None] * scale[:, None] - taken + RIDGE * np.eye(within.shape[1])
        return SmallSets(scale, H, gradient * scale - np.einsum("ksi,k->si", across, out[:, -1]))

    def solution(self, bounds: Array | None = None, damping: float = 0.0) -> Array:
        """Return the (k,) least-squares solution within its lower and upper bounds (2, k)."""
        H = _ridged(self.H, RIDGE + damping)
        if bounds is None:
            return np.asarray(np.linalg.solve(H, self.gradient), dtype=np.float64) * self.scale
        lower, upper = bounds / self.scale
        return bounded_solution(H, self.gradient, lower, upper, COMPILED) * self.scale

    def reduction(self, x: Array) -> float:
        """Return the reduction of the squared residual |e|^2 by the coefficients x (k,)."""
        unit = x / self.scale
        return float(2 * unit @ self.gradient - unit @ _ridged(self.H) @ unit)

    def gain(self) -> float:
        """Return the reduction of the squared residual |e|^2 by the unbounded solution."""
        return self.reduction(self.solution())

    def unabsorbed(self, order: Sequence[int], *, rounding: float = 1e-9) -> Array:
        """Return the (k,) share of each column's squared norm that is orthogonal to the columns before it.

        Args:
            order: indices of the columns in their order
            rounding: share up to which a column counts as zero, and is not used in the projection of later columns
        """
        return _unabsorbed(np.array(self.H, order="C"), np.asarray(order, dtype=np.int64), rounding)

    def covariance(self) -> Array:
        """Return the (k, k) covariance of the solution for white noise of unit variance."""
        return np.linalg.inv(_ridged(self.H)) * self.scale[:, None] * self.scale

    def cosine(self, direction: Array, columns: Indices, others: Indices) -> float:
        """Return the cosine of the angle between the vector A_c x and the span of the columns `others`.

        A_c are the columns `columns`, and x is `direction`.
        """
        x = direction / self.scale[columns]
        overlap = self.H[others][:, columns] @ x
        length = float(x @ self.H[columns][:, columns] @ x)
        reached = float(overlap @ np.linalg.lstsq(self.H[others][:, others], overlap, rcond=1e-9)[0])
        return float(np.sqrt(min(max(reached / length, 0.0), 1.0))) if length > 0 else 0.0


class SmallSets(NamedTuple):
    """Least-squares problems of many small sets of n columns, represented by inner products as in `ColumnSpace`."""

    scale: Array
    """(sets, n) reciprocal norm of each column, before the columns of a model are projected out."""
    H: Array
    """(sets, n, n) normal matrices in this scale, with the ridge."""
    gradient: Array
    """(sets, n) inner products of the columns, in this scale, with the residual."""

    def gains(self, *, positive: bool) -> Array:
        """Return the (sets,) reduction of |e|^2 by each set; negative coefficients are zero if `positive` is true."""
        x = np.linalg.solve(self.H, self.gradient[:, :, None])[:, :, 0]
        if positive:
            x = np.maximum(x, 0.0)
        return 2 * np.einsum("si,si->s", x, self.gradient) - np.einsum("si,sij,sj->s", x, self.H, x)


def _ridged(H: Array, ridge: float = RIDGE) -> Array:
    return H + ridge * np.eye(len(H))


@njit
def _unabsorbed(H: Array, order: Integers, rounding: float) -> Array:
    """Compute `ColumnSpace.unabsorbed`; H is overwritten."""
    remaining = np.zeros(len(H))
    for i in order:
        remaining[i] = max(H[i, i], 0.0)
        if remaining[i] > rounding:
            for j in range(len(H)):
                if j != i:
                    H[j] -= H[j, i] / H[i, i] * H[i]
    return remaining
