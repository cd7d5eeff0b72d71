"""Least-squares map of a free torque or encoder error, without the directions that the ratios absorb.

Let M be the columns of the hat functions with the initial states projected out, and P M the same columns with the
ratios also projected out. After this projection, a direction m of the map retains the share s = |P M m|^2 / |M m|^2 of
its influence on the readings. The directions are those of the generalised eigenproblem

    (P M)^T P M m = s M^T M m.

A direction with a small share is undetermined, and is omitted. For a torque as a function of speed, for example,
viscous friction absorbs a straight line. The share of this direction is of the order 1e-5 instead of zero, because of
numerical errors and of speeds outside the knots.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.fitting.linearise import Linearisation
from dpr_lab.fitting.projection import ColumnSpace
from dpr_lab.fitting.uncompiled import RIDGE
from dpr_lab.gap.where.coordinates import beyond_fit


@dataclass(frozen=True, slots=True)
class MapRules:
    """Settings of the fit and of the description of a residual map."""

    absorbed: float = 1e-3
    """Maximum share of its squared influence on the readings that an absorbed direction keeps."""
    mostly: float = 0.75
    """Minimum share of the chi-square reduction that a symmetric or slow part must reach, to describe the map."""


MAP = MapRules()


@dataclass(frozen=True, slots=True)
class ResidualMap:
    """Least-squares map in d independent directions, each of which has a whitened amplitude."""

    knots: Array
    """(k,) coordinates of the hat functions that influence the readings."""
    e: Array
    """(d,) amplitudes, with the standard deviation of the whitened readings."""
    directions: Array
    """(k, d) values of the map for unit amplitudes."""
    amplitudes: Array
    """(d, k) amplitudes of a map, for a value of one at each knot."""

    @property
    def values(self) -> Array:
        """(k,) least-squares values."""
        return self.directions @ self.e

    @property
    def std(self) -> Array:
        """(k,) standard deviations of the values for white noise of unit variance."""
        return np.linalg.norm(self.directions, axis=1)

    @property
    def gain(self) -> float:
        """Reduction of the squared residual by the map."""
        return float(self.e @ self.e)

    def gain_of(self, maps: Array) -> float:
        """Return the reduction of the squared residual by a sum of given maps (k, n)."""
        return ColumnSpace.of(self.amplitudes @ maps, self.e).gain()

    def trend(self, shape: Array) -> float:
        """Return the least-squares factor of a map (k,), divided by its standard deviation."""
        return float(ColumnSpace.of(self.amplitudes @ shape[:, None], self.e).gradient[0])


def residual_map(linear: Linearisation, fitted: Sequence[int], columns: Array, knots: Array) -> ResidualMap:
    """Fit a residual map to the columns (segments, m, k) of its hat functions.

    Hat functions without influence on the readings are omitted.
    """
    visited = np.any(columns != 0.0, axis=(0, 1))
    columns = columns[:, :, visited]
    alone, space = ColumnSpace.of(columns, linear.e).H, beyond_fit(linear, fitted, columns)
    lower = np.linalg.cholesky(alone + RIDGE * np.eye(len(space)))
    share, vectors = np.linalg.eigh(np.linalg.solve(lower, np.linalg.solve(lower, space.H).T))
    vectors = np.linalg.solve(lower.T, vectors)
    determined = share > MAP.absorbed
    vectors, root = vectors[:, determined], np.sqrt(share[determined])
    return ResidualMap(
        knots=knots[visited],
        e=vectors.T @ space.gradient / root,
        directions=space.scale[:, None] * vectors / root,
        amplitudes=root[:, None] * (vectors.T @ alone) / space.scale,
    )
