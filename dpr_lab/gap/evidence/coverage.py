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
    """Number of cells by angle. Each cell covers 15 degrees, which is less than the period of any effect that depends
    on the angle."""
    speeds: int = 16
    """Number of cells by speed, from the fastest rotation in one direction to the fastest in the other."""


MAP = MapSettings()


def coverage(fitted: Recordings, held_out: Recordings) -> dict[str, Occupancy]:
    """Return the seconds that each rod spent at each angle and speed.

    Rods that never swung freely are omitted.
    """
    joints = fitted.rig.encoders.joint_angles
    spent = [[_spent(record, joints.to_rods) for record in part.records] for part in (fitted, held_out)]
    occupancy: dict[str, Occupancy] = {}
    for rod in RODS:
        of_rod = [list(_of(rod, part)) for part in spent]
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


Spent = tuple[str, Array, Array, Array]
"""Mounting of a run, and the motion of its rods.

The arrays are (n, 2) angles, rad, (n, 2) speeds, rad/s, and (n,) durations, s.
"""


def _spent(record: Record, to_rods: Callable[[Array], Array]) -> Spent:
    theta = to_rods(record.joints[:, :2])
    near = without_gap(record.run, record.t)
    step = np.diff(record.t)[near]
    speed = (np.diff(theta, axis=0) / np.diff(record.t)[:, None])[near]
    return record.setup.mounting, (0.5 * (theta[1:] + theta[:-1]))[near], speed, step


def _of(rod: str, spent: Sequence[Spent]) -> Iterator[tuple[Array, Array, Array]]:
    """Yield angles, speeds and durations of a rod for each recording in which it swung.

    If only one rod is mounted, its values are in the first column of a recording.
    """
    for mounting, theta, speed, step in spent:
        if mounting in (rod, "both", "clamped"):
            column = 0 if mounting == rod else RODS.index(rod)
            yield theta[:, column], speed[:, column], step


def _seconds(spent: Sequence[tuple[Array, Array, Array]], edges: tuple[Array, Array]) -> Array:
    seconds = np.zeros((len(edges[0]) - 1, len(edges[1]) - 1))
    for theta, speed, step in spent:
        seconds += np.histogram2d(np.mod(theta, 2 * np.pi), speed, bins=edges, weights=step)[0]
    return np.round(seconds, 4)
