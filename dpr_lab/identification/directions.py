"""Parameter directions that recordings and measured values do not determine.

Information is represented by whitened rows. A row contains the changes of one reading, in standard deviations, for
relative changes of the parameters. A direction is free (undetermined) if a change of 100 % along it changes all
readings together by less than one standard deviation.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.identification.prior_update import UNREACHED

SEEN = 1.0
"""Minimum singular value of a determined direction, in standard deviations per 100 % of change."""


def _decompose(rows: Array) -> tuple[Array, Array]:
    """Compute singular values and right singular vectors of matrices.

    The shapes are (..., m, n) of the matrices, (..., n) of the values and (..., n, n) of the vectors. If m < n, the
    last n - m singular values are zero.
    """
    _, s, Vt = np.linalg.svd(rows)
    missing = np.zeros((*s.shape[:-1], Vt.shape[-1] - s.shape[-1]))
    return np.concatenate([s, missing], axis=-1), Vt


def free_directions(rows: Array) -> Array:
    """Return an orthonormal basis (n, k) of the directions that whitened rows (m, n) do not determine."""
    s, Vt = _decompose(rows)
    return Vt[s < SEEN].T


def spread(rows: Array, least: float = SEEN) -> Array:
    """Compute the relative standard deviation (n,) of each parameter from whitened rows.

    The value is inf if the parameter has a component in a free direction. A direction is free if its singular value is
    smaller than `least`.
    """
    s, Vt = _decompose(rows)
    std = np.linalg.norm(Vt[s >= least].T / s[s >= least], axis=1)
    return np.where(np.linalg.norm(Vt[s < least], axis=0) > UNREACHED, np.inf, std)


def simple_basis(free: Array, names: Sequence[str]) -> list[dict[str, float]]:
    """Find the sparsest basis of the free directions.

    Each direction is scaled so that its largest change is 1 %. Directions are added one at a time: each is the sparsest
    direction that is independent of the previous ones. Source: T. F. Coleman & A. Pothen (1986), The null space problem
    I.
    """
    basis: list[Array] = []
    for direction in _simple_directions(free, names):
        if np.linalg.matrix_rank(np.array([*basis, direction]), tol=1e-6) > len(basis):
            basis.append(direction)
        if len(basis) == len(free.T):
            break
    return [_readable(direction, names) for direction in basis]


def _simple_directions(free: Array, names: Sequence[str]) -> Iterator[Array]:
    """Generate candidate directions, the simplest first.

    The first candidate is the common scale of masses, inertias and friction, if this scale is a free direction.
    Directions of few parameters follow.
    """
    scaled = np.array([name[0] in "mcJAf" or name in ("k0", "kt") for name in names], dtype=np.float64)
    scale = scaled / np.linalg.norm(scaled)
    if np.linalg.norm(scale - free @ (free.T @ scale)) < UNREACHED:
        yield scale
    for count in range(len(free) - 1, 0, -1) if free.size else ():
        subsets = list(combinations(range(len(free)), count))[::-1]
        s, Vt = _decompose(free[np.array(subsets)])
        yield from Vt[np.sum(s < 1e-6, axis=1) == 1, -1] @ free.T
    yield from free.T


def _readable(direction: Array, names: Sequence[str]) -> dict[str, float]:
    largest = np.max(np.abs(direction))
    takes_part = np.abs(direction) > 1e-6 * largest
    sign = np.sign(direction[takes_part][0])
    changes = 0.01 * sign * direction / largest
    return {name: float(changes[i]) for i, name in enumerate(names) if takes_part[i]}


def described(direction: Mapping[str, float]) -> str:
    """Format a free direction as text, for example `m1, m2 +1 %, l2 -0.5 %`."""
    names_by_change: dict[str, list[str]] = {}
    for name, change in direction.items():
        names_by_change.setdefault(f"{100 * change:+.2g} %", []).append(name)
    return ", ".join(f"{', '.join(names)} {change}" for change, names in names_by_change.items())
