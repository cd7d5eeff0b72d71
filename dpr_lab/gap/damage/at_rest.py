"""Detection of joints without a drive that move again after rest.

A free rod that stays within the noise for half a period of its small oscillation is at rest: friction holds it, or its
energy is below the noise. Whether it hangs exactly vertically is then a matter of friction. A later motion is caused by
a hand, a cable, a support that gives way, or a drift of the encoder's zero. A model fitted to these readings would need
friction that does not exist.
"""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.gap.screen.record import Record
from dpr_lab.gap.screen.sensor_faults import AXES, Finding
from dpr_lab.identification.misread.balance import periods
from dpr_lab.rig import Rig


@dataclass(frozen=True, slots=True)
class RestRules:
    """Thresholds for the detection of rods that move again after rest."""

    block_s: float = 0.05
    """Length of the blocks whose medians are compared, s."""
    fewest: int = 4
    """Minimum number of readings in a block of the recording at rest."""
    of_median: float = 1.25
    """Ratio of the standard deviations of median and mean of normal values, sqrt(pi / 2)."""
    periods: float = 0.55
    """Minimum time at rest, in slow periods of small oscillations.

    Within half a period a swing moves by its amplitude.
    """
    errors: float = 6.0
    """Maximum range of the medians of rods at rest, in standard deviations of a median."""
    moves: float = 3.0
    """Minimum size of a motion, in units of the larger of the permitted and the actual range at rest."""
    of_swing: float = 0.5
    """Maximum size of a motion relative to the previous swing; rods that swing farther were released again."""


REST = RestRules()


@dataclass(frozen=True, slots=True)
class Touch:
    """Motion of rods after they were at rest."""

    rest_s: float
    """Start of the time at rest, s."""
    at_s: float
    """Start of the motion, s."""
    axis: int
    """Index of the joint that moves farthest."""
    size: float
    """Largest distance of this joint from its angle at rest, rad."""


def touch(record: Record, slow_period_s: float) -> Touch | None:
    """Return the first motion after a free swing has come to rest, or None."""
    t, joints, sigma = _blocks(record)
    if len(t) < 2:
        return None
    width = max(3, int(np.ceil(REST.periods * slow_period_s / float(np.median(np.diff(t))))))
    if len(t) < width + 2:
        return None
    windows = np.lib.stride_tricks.sliding_window_view(joints, width, axis=0)
    ranges = np.ptp(windows, axis=2)
    still = (ranges < REST.errors * sigma).all(axis=1)
    if not still.any():
        return None
    rest = int(np.argmax(still))
    away = np.abs(joints - np.median(joints[rest : rest + width], axis=0))
    limit = REST.moves * np.maximum(REST.errors * sigma, ranges[rest])
    moved = (away > limit).any(axis=1) & (np.arange(len(t)) >= rest + width)
    moved &= np.append(moved[1:], False)  # a single block may contain outliers
    if not moved.any() or float(away[moved].max()) > REST.of_swing * float(np.ptp(joints[: rest + 1], axis=0).max()):
        return None
    first = int(np.argmax(moved))
    largest = (away[first:] / limit).max(axis=0)
    axis = int(np.argmax(largest))
    furthest = first + int(np.argmax(away[first:, axis]))
    size = float(joints[furthest, axis] - np.median(joints[rest : rest + width, axis]))
    return Touch(float(t[rest]), float(t[first - 1]), axis, size)


def without_touch(record: Record, rig: Rig) -> Record:
    """Return the part of a record before the first motion after rest.

    If there is no such motion, the record itself is returned.
    """
    driven = not record.run.setup.free or record.encoder0_moves
    touched = None if driven else touch(record, periods(rig)[0])
    if touched is None:
        return record
    evidence = (
        f"the rods rest from {touched.rest_s:.3g} s on, but later a reading changes by"
        f" {1e3 * touched.size:+.2g} mrad: a hand or a cable touches the rods, the mount gives way, or the"
        " zero of the encoder drifts; the later readings are excluded"
    )
    finding = Finding("touched_at_rest", record.run.name, AXES[touched.axis], touched.at_s, evidence, step=touched.size)
    return record.left_out(touched.at_s, np.inf).with_findings([finding])


def _blocks(record: Record) -> tuple[Array, Array, Array]:
    """Return times, medians (n, axes) and standard deviations (axes,), rad, of blocks."""
    length = max(REST.block_s, REST.fewest * float(np.median(np.diff(record.t))))
    number = np.floor((record.t - record.t[0]) / length).astype(np.int64)
    edges = np.flatnonzero(np.diff(number, prepend=-1))
    read = np.isfinite(record.sigma).all(axis=0)
    medians = np.array([np.median(part, axis=0) for part in np.split(record.joints[:, read], edges[1:])])
    in_block = float(np.median(np.diff(edges))) if len(edges) > 1 else 1.0
    independent = np.sqrt(in_block * (1 - min(record.noise_correlation, 0.9)))
    noise = REST.of_median * np.median(record.sigma[:, read], axis=0) / independent
    sigma = np.hypot(noise, record.screened.count[read] / REST.errors)
    return record.t[edges], medians, sigma
