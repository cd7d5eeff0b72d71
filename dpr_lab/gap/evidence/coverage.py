"""Coverage of the recordings: the angles and speeds for which a model is valid."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.gap.result.evidence import Occupancy
from dpr_lab.gap.screen.record import Record, without_gap
from dpr_lab.gap.screen.recordings import Recordings

RODS = ("inner", "outer")


@dataclass(frozen=True, slots=True)
class MapSettings:
    """Settings of the cells of an occupancy map."""

    angles: int = 24
    """Number of cells by angle. Each covers 15 degrees, less than the period of any effect that depends on the
    angle."""
    speeds: int = 16
    """Number of cells by speed, from minus to plus the largest speed of the rod."""


MAP = MapSettings()


def coverage(fitted: Recordings, held_out: Recordings) -> dict[str, Occupancy]:
    """Return the time, s, that each rod spent at each angle and speed.

    Rods that are not mounted or do not move are omitted.
    """
    to_rods = fitted.rig.encoders.joint_angles.to_rods
    occupancy: dict[str, Occupancy] = {}
    for rod in RODS:
        of_rod = [list(_motion(rod, part.records, to_rods)) for part in (fitted, held_out)]
        fastest = max((float(np.abs(speed).max(initial=0.0)) for part in of_rod for _, speed, _ in part), default=0.0)
        if fastest > 0.0:
            edges = (np.linspace(0, 2 * np.pi, MAP.angles + 1), fastest * np.linspace(-1, 1, MAP.speeds + 1))
            maps = [_seconds(part, edges) for part in of_rod]
            occupancy[rod] = Occupancy(
                angle_edges_rad=edges[0].tolist(),
                speed_edges_rad_per_s=edges[1].tolist(),
                fitted_s=maps[0].tolist(),
                held_out_s=maps[1].tolist(),
            )
    return occupancy


def _motion(
    rod: str, records: Sequence[Record], to_rods: Callable[[Array], Array]
) -> Iterator[tuple[Array, Array, Array]]:
    """Yield angles, rad, speeds, rad/s, and durations, s, of a rod for each recording in which it is mounted.

    A single rod is in the first column of the readings.
    """
    for record in records:
        mounting = record.setup.mounting
        if mounting in (rod, "both", "clamped"):
            theta = to_rods(record.joints[:, :2])[:, 0 if mounting == rod else RODS.index(rod)]
            near, step = without_gap(record.run, record.t), np.diff(record.t)
            yield (0.5 * (theta[1:] + theta[:-1]))[near], (np.diff(theta) / step)[near], step[near]


def _seconds(spent: Sequence[tuple[Array, Array, Array]], edges: tuple[Array, Array]) -> Array:
    seconds = np.zeros((len(edges[0]) - 1, len(edges[1]) - 1))
    for theta, speed, step in spent:
        seconds += np.histogram2d(np.mod(theta, 2 * np.pi), speed, bins=edges, weights=step)[0]
    return np.round(seconds, 4)
