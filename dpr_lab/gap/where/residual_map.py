"""Least-squares map of a free-form torque or encoder error, without the directions that the ratios absorb.

Let M be the responses of the readings to the hat functions, with the initial states projected out, and P the projection
that removes the responses to the ratios. A map with the values m retains the share s = |P M m|^2 / |M m|^2 of its
squared influence on the readings. The directions m are the eigenvectors of

    (P M)^T P M m = s M^T M m.

A direction with a small share is undetermined and is omitted. For example, viscous friction absorbs a torque that is
proportional to the speed. The share of this direction is about 1e-5 instead of zero, because of numerical errors and of
speeds outside the knots.
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
    """Maximum share s of a direction that counts as absorbed."""
    mostly: float = 0.75
    """Minimum share of the reduction of chi-square by which a symmetric, antisymmetric or slowly varying part describes
    the map."""


MAP = MapRules()


@dataclass(frozen=True, slots=True)
class ResidualMap:
    """Least-squares map in d independent directions with amplitudes of unit variance."""

    knots: Array
    """(k,) coordinates of the hat functions that influence the readings."""
    e: Array
    """(d,) amplitudes, each with a standard deviation of one."""
    directions: Array
    """(k, d) values of the map for unit amplitudes."""
    amplitudes: Array
    """(d, k) amplitudes of the map that is one at a knot and zero at the others, for each knot."""

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
        """Return the reduction of the squared residual by the best linear combination of (k, n) maps."""
        return ColumnSpace.of(self.amplitudes @ maps, self.e).gain()

    def trend(self, shape: Array) -> float:
        """Return the least-squares amplitude of a (k,) map, divided by its standard deviation."""
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
