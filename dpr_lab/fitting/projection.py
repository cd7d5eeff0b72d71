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

from dpr_lab.arrays import Array, Flags, Integers
from dpr_lab.kernels import njit, subroutine

Indices = Sequence[int] | slice | Integers

RIDGE = 1e-10
"""Ridge on the diagonal of normal matrices of unit columns: a few hundred times their rounding error."""

MOST_STEPS = 100
"""Maximum number of steps of an active-set method per coordinate."""

TINY = 1e-140
"""Floor on the column norm; avoids overflow."""


@dataclass(frozen=True, slots=True)
class ColumnSpace:
    """Least-squares problem, represented by inner products.

    The products are those of the columns A and the residual e.
    """

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
        """Add rows of a prior, and scale all columns to unit norm.

        The rows are A (n, k) and e (n,).
        """
        H = self.H / self.scale[:, None] / self.scale + A.T @ A
        scale = 1 / np.maximum(np.sqrt(np.diag(H)), TINY)
        return ColumnSpace(scale, H * scale[:, None] * scale, (self.gradient / self.scale + A.T @ e) * scale)

    def given(self, held: Indices, columns: Indices) -> "ColumnSpace":
        """Project the columns `held` out of the problem of `columns`, in the same scales."""
        across = self.H[held][:, columns]
        out = np.linalg.solve(_ridged(self.H[held][:, held]), np.column_stack([across, self.gradient[held]]))
        H = self.H[columns][:, columns] - across.T @ out[:, :-1]
        return ColumnSpace(self.scale[columns], H, self.gradient[columns] - across.T @ out[:, -1])

    def given_sets(self, across: Array, within: Array, gradient: Array) -> "SmallSets":
        """Project the columns of this space out of many small sets of n columns.

        Args:
            across: (k, sets, n) inner products of the columns of this space with those of each set
            within: (sets, n, n) inner products within each set
            gradient: (sets, n) inner products with the residual
        """
        norm = np.sqrt(
            np.maximum(np.diagonal(within, axis1=1, axis2=2), 0.0)
        )  # rounding errors may make this difference too small
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
        return bounded_solution(H, self.gradient, *bounds / self.scale) * self.scale

    def reduction(self, x: Array) -> float:
        """Return the reduction of the squared residual |e|^2 by the coefficients x (k,)."""
        unit = x / self.scale
        return float(2 * unit @ self.gradient - unit @ _ridged(self.H) @ unit)

    def gain(self) -> float:
        """Return by how much the unbounded solution reduces the squared residual |e|^2."""
        return self.reduction(self.solution())

    def unabsorbed(self, order: Sequence[int], *, rounding: float = 1e-9) -> Array:
        """Return the (k,) share of each column's squared norm that is orthogonal to earlier columns.

        A column of which only rounding errors remain is not used in the projection of later columns.
        """
        return _unabsorbed(np.array(self.H, order="C"), np.asarray(order, dtype=np.int64), rounding)

    def covariance(self) -> Array:
        """Return the (k, k) covariance of the solution for white noise of unit variance."""
        return np.linalg.inv(_ridged(self.H)) * self.scale[:, None] * self.scale

    def cosine(self, direction: Array, columns: Indices, others: Indices) -> float:
        """Return the cosine between the vector A_c x and the span of the columns `others`.

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


def bounded_solution(H: Array, gradient: Array, lower: Array, upper: Array) -> Array:
    """Minimise x^T H x / 2 - gradient^T x within bounds by an active-set method.

    Coordinates that would cross a bound are fixed at this bound. Then the fixed coordinate with the largest reduction
    of the cost is released, until no release reduces the cost (Karush-Kuhn-Tucker conditions). These sets of fixed
    coordinates may recur. After 4 k steps, only the first coordinate that reaches a bound on a straight line from the
    last feasible point is therefore fixed. No step then increases the cost, and the number of steps is limited.

    Source: P. B. Stark & R. L. Parker (1995), Bounded-variable least-squares: an algorithm and applications,
    Computational Statistics 10, 129-141.

    Args:
        H: (k, k) symmetric positive definite
        gradient: (k,) right-hand side
        lower: (k,) lower bounds; -inf: no bound
        upper: (k,) upper bounds; inf: no bound

    Raises:
        numpy.linalg.LinAlgError: the matrix is singular.
    """
    x = np.empty(len(gradient))
    H, gradient, lower, upper = map(np.ascontiguousarray, (H, gradient, lower, upper))
    if not _bounded(H, gradient, lower, upper, x):
        raise np.linalg.LinAlgError("singular matrix")
    return x


@njit
def _bounded(H: Array, gradient: Array, lower: Array, upper: Array, x: Array) -> bool:
    """Write the result of `bounded_solution` to x; return False if the matrix is singular.

    Matrix products of Numba would import SciPy.
    """
    k = len(gradient)
    free, fixed = np.ones(k, dtype=np.bool_), np.zeros(k)
    if not _solve_free(H, gradient, free, x):
        return False
    if not _clip(lower, upper, free, fixed, x):
        return True
    for step in range(MOST_STEPS * k):
        if step == 4 * k:
            fixed[:] = np.minimum(np.maximum(fixed, lower), upper)
        x[:] = fixed
        if not _solve_free(H, gradient, free, x):
            return False
        if _advance(lower, upper, free, fixed, x) if step >= 4 * k else _clip(lower, upper, free, fixed, x):
            continue
        release, most = -1, RIDGE * np.abs(gradient).max()
        for i in range(k):
            if free[i] or lower[i] == upper[i]:
                continue
            slope = gradient[i]
            for j in range(k):
                slope -= H[i, j] * x[j]
            if (slope if fixed[i] <= lower[i] else -slope) > most:
                release, most = i, abs(slope)
        if release < 0:
            break
        free[release] = True
    x[:] = np.minimum(np.maximum(x, lower), upper)
    return True


@subroutine
def _clip(lower: Array, upper: Array, free: Flags, fixed: Array, x: Array) -> bool:
    """Fix all free coordinates that cross a bound at this bound; return whether there are any."""
    crossed = False
    for i in range(len(x)):
        if free[i] and (x[i] < lower[i] or x[i] > upper[i]):
            free[i], fixed[i], crossed = False, min(max(x[i], lower[i]), upper[i]), True
    return crossed


@subroutine
def _advance(lower: Array, upper: Array, free: Flags, feasible: Array, x: Array) -> bool:
    """Move the feasible point towards x until a free coordinate reaches a bound.

    This coordinate is fixed. The result is whether there is one.
    """
    share, first = 1.0, -1
    for i in range(len(x)):
        if free[i] and (x[i] < lower[i] or x[i] > upper[i]):
            part = (min(max(x[i], lower[i]), upper[i]) - feasible[i]) / (x[i] - feasible[i])
            if part < share or first < 0:
                share, first = part, i
    for i in range(len(x)):
        bound = min(max(x[i], lower[i]), upper[i])
        feasible[i] = bound if i == first else feasible[i] + share * (x[i] - feasible[i])
    if first >= 0:
        free[first] = False
    return first >= 0


@subroutine
def _solve_free(H: Array, gradient: Array, free: Flags, x: Array) -> bool:
    """Solve for the free coordinates of x, with the others given; return False if the matrix is singular."""
    inside = np.flatnonzero(free)
    n = len(inside)
    A = np.empty((n, n + 1))
    for i in range(n):
        A[i, n] = gradient[inside[i]]
        for j in range(len(x)):
            if not free[j]:
                A[i, n] -= H[inside[i], j] * x[j]
        for j in range(n):
            A[i, j] = H[inside[i], inside[j]]
    for i in range(n):
        pivot = i + np.argmax(np.abs(A[i:, i]))
        if A[pivot, i] == 0.0:
            return False
        for j in range(i, n + 1):
            A[i, j], A[pivot, j] = A[pivot, j], A[i, j]
        for row in range(i + 1, n):
            factor = A[row, i] / A[i, i]
            for j in range(i + 1, n + 1):
                A[row, j] -= factor * A[i, j]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            A[i, n] -= A[i, j] * A[j, n]
        A[i, n] /= A[i, i]
        x[inside[i]] = A[i, n]
    return True


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
