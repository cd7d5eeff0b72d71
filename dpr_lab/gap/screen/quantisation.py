"""Quantisation of readings: size of a count, and independence of rounding errors."""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class QuantisationSettings:
    """Limits for readings on the grid of the counts, and for independent rounding errors."""

    still_counts: float = 0.2
    """Maximum noise before rounding, in counts, at which neighbouring readings have dependent rounding errors."""
    fewest_at_rest: int = 20
    """Minimum number of readings at rest for the detection of constant counts."""
    on_grid: float = 0.7
    """Minimum |mean of exp(2 pi i reading / count)| of readings on the grid of counts; an even distribution gives
    zero."""


QUANTISATION = QuantisationSettings()


def count_size(run: Run, rig: Rig) -> Array:
    """Return the (3,) smallest change of a reading of encoders 0, 1 and 2, rad; zero for a table of angles.

    The reading of a coarse encoder with a finer counter changes by several counts at a time.
    """
    if run.counts is None:
        return np.zeros(3)
    steps = np.gcd.reduce(np.diff(run.counts, axis=0), axis=0)
    return np.maximum(steps, 1) * np.abs(rig.radians_per_count)


def is_on_grid(run: Run, rig: Rig, joints: Array) -> Flags:
    """Return whether the readings of each joint differ by whole counts.

    The readings of an interpolated or filtered table do not.
    """
    if run.counts is not None:
        return np.ones(2, dtype=bool)
    turns = np.exp(2j * np.pi * joints / np.abs(rig.radians_per_count[1:]))
    return np.abs(turns.mean(axis=0)) > QUANTISATION.on_grid


def has_dither(run: Run, rig: Rig, count: Array, still: Flags) -> Flags:
    """Return a (2,) mask of the joints whose rounding errors are independent.

    The errors are independent if the noise before rounding is at least a fifth of a count at rest. If there are no
    readings at rest, independence is assumed, except for tables in which most readings equal the previous one.
    """
    if run.counts is None:
        readings = rig.encoders.joint_angles.of_rods(run.swing.theta[:, 1:])
        return changing(readings, still)
    rest = rig.encoders.joint_angles.of_rods(run.rest[:, 1:])
    if len(rest) < QUANTISATION.fewest_at_rest:
        return np.ones(2, dtype=bool)
    noise = np.std(np.diff(rest, axis=0), axis=0) / np.sqrt(2)
    return noise > QUANTISATION.still_counts * count


def changing(readings: Array, still: Flags) -> Flags:
    """Return an (m,) mask of the joints whose readings mostly differ from the previous one.

    The readings have the shape (n, m). Samples that the mask `still` marks are not considered.
    """
    changes = np.where(still[1:], np.nan, np.abs(np.diff(readings, axis=0)))
    moves = np.isfinite(changes).any(axis=0)
    return np.nanmedian(np.where(moves, changes, 0.0), axis=0) > 1e-12
