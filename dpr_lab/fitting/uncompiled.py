"""Numbers and functions of a fit that other packages use without Numba.

The bounded least squares runs in plain Python, so that the import of a table starts without a compiler.
`fitting.projection` compiles the same loops, whose results are bit-identical.
"""

from collections.abc import Callable

import numpy as np

from dpr_lab.arrays import Array, Flags

NORMAL_MAD = 1.482602218505602
"""Ratio of the standard deviation of a normal variable to the median of its absolute value."""

RIDGE = 1e-10
"""Ridge on the diagonal of normal matrices of unit columns: a few hundred times their rounding error."""

MOST_STEPS = 100
"""Maximum number of steps of an active-set method per coordinate."""


Loops = Callable[[Array, Array, Array, Array, Array], bool]
"""Form of `bounded`: plain Python, or compiled."""


def bounded_solution(H: Array, gradient: Array, lower: Array, upper: Array, loops: Loops | None = None) -> Array:
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
        loops: compiled form of `bounded`; None: plain Python

    Raises:
        numpy.linalg.LinAlgError: the matrix is singular.
    """
    x = np.empty(len(gradient))
    H, gradient, lower, upper = map(np.ascontiguousarray, (H, gradient, lower, upper))
    if not (loops or bounded)(H, gradient, lower, upper, x):
        raise np.linalg.LinAlgError("singular matrix")
    return x


def bounded(H: Array, gradient: Array, lower: Array, upper: Array, x: Array) -> bool:
    """Write the result of `bounded_solution` to x; return False if the matrix is singular.

    Loops are used because matrix products would import SciPy in the compiled form.
    """
    k = len(gradient)
    free, fixed = np.ones(k, dtype=np.bool_), np.zeros(k)
    if not solve_free(H, gradient, free, x):
        return False
    if not clip(lower, upper, free, fixed, x):
        return True
    for step in range(MOST_STEPS * k):
        if step == 4 * k:
            fixed[:] = np.minimum(np.maximum(fixed, lower), upper)
        x[:] = fixed
        if not solve_free(H, gradient, free, x):
            return False
        if advance(lower, upper, free, fixed, x) if step >= 4 * k else clip(lower, upper, free, fixed, x):
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


def clip(lower: Array, upper: Array, free: Flags, fixed: Array, x: Array) -> bool:
    """Fix each free coordinate that crosses a bound at this bound; return whether there was one."""
    crossed = False
    for i in range(len(x)):
        if free[i] and (x[i] < lower[i] or x[i] > upper[i]):
            free[i], fixed[i], crossed = False, min(max(x[i], lower[i]), upper[i]), True
    return crossed


def advance(lower: Array, upper: Array, free: Flags, feasible: Array, x: Array) -> bool:
    """Move the feasible point towards x until a free coordinate reaches a bound, and fix this coordinate.

    Returns:
        whether a coordinate reached a bound
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


def solve_free(H: Array, gradient: Array, free: Flags, x: Array) -> bool:
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
