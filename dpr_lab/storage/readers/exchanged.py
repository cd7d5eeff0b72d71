"""Detect the frames in which a tracker exchanged the ends of the two rods.

A program that detects two equal marks in each frame does not know which mark is which: after an encounter of the marks,
or from frame to frame, elbow and tip may be exchanged. The distance between the marks does not reveal this. However,
the elbow moves on a circle about the pivot, and both marks move little from frame to frame. Among all ways to exchange
the marks, the one with the least sum of the following squares is chosen (Viterbi 1967, IEEE Trans. Inf. Theory 13,
260-269):

    (distance of the elbow from the circle / s)^2 + (step of both marks / v)^2

s and v are the medians of the distances from the circle and of the steps.
"""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.storage.readers.circle import SETTINGS as CIRCLE
from dpr_lab.storage.readers.circle import circle_of_one, most_of_a_circle


@dataclass(frozen=True, slots=True)
class ExchangeSettings:
    """Settings for detecting exchanged marks."""

    better: float = 3.0
    """Minimum ratio of the median distance of the elbow from the circle of the elbow to the median distance of the
    nearer mark from a circle through one mark per frame. Above it, the second circle is used."""
    alike: float = 2.0
    """Maximum ratio of the median distances of both ends from their circles for which the circles do not show which end
    is the elbow. Both rods then swing together about the hanging position, and the elbow is nearer to the pivot. The
    ratio was at most 1.4 in 80 simulated films in which the ends were confused."""
    frames: int = 3
    """Minimum number of exchanged frames."""
    most: float = 0.9
    """Maximum share of exchanged frames. Above it the columns are in the wrong order, which `--take` corrects."""
    proven: float = 0.5
    """Minimum share of the exchanged frames in which the point that was named elbow is off the circle, and the other
    point is on the circle."""


SETTINGS = ExchangeSettings()


def exchanged(elbow: Array, tip: Array, pivot: Array | None) -> Flags:
    """Detect the frames in which elbow and tip are exchanged.

    The result is a mask (n,); it is all False if the points do not prove an exchange.

    Args:
        elbow: (n, 2) coordinates of the point that is named elbow; NaN if it was not detected
        tip: (n, 2) coordinates of the other point
        pivot: (2,) coordinates of the pivot; None if it was not tracked
    """
    marks = np.stack([elbow, tip])
    none = np.zeros(len(elbow), dtype=np.bool_)
    known: Flags = np.asarray(np.isfinite(np.hstack([elbow, tip])).all(axis=1), dtype=np.bool_)
    if known.sum() < 3:
        return none
    off = _off_the_circle(marks, known, pivot)
    if off is None:
        return none
    nearest = max(float(np.median(off.min(axis=0)[known])), CIRCLE.rounding * float(np.nanmax(np.abs(marks))))
    on = off <= CIRCLE.near * nearest
    mask = _least(marks, off, nearest, known)
    proven = mask & on[1] & ~on[0]
    if mask.sum() < SETTINGS.frames or proven.sum() < SETTINGS.proven * mask.sum():
        return none
    inner, outer = (np.where(mask[:, None], *pair)[known] for pair in ((tip, elbow), (elbow, tip)))
    circle = most_of_a_circle(outer) if pivot is None else (pivot, None)
    if circle is not None:
        radius, radii = float(np.median(np.hypot(*(inner - circle[0]).T))), np.hypot(*(outer - circle[0]).T)
        spread = float(np.median(np.abs(radii - np.median(radii))))
        if spread < SETTINGS.alike * nearest and np.median(radii) < radius:
            mask = known & ~mask
    return mask if SETTINGS.frames <= mask.sum() <= SETTINGS.most * known.sum() else none


def _off_the_circle(marks: Array, known: Flags, pivot: Array | None) -> Array | None:
    """Return the distances (2, n) of both marks from the circle of the elbow, or None if there is no circle."""
    own_circle = most_of_a_circle(marks[0, known]) if pivot is None else (pivot, None)
    circle = circle_of_one(marks[:, known], pivot)
    if own_circle is None or circle is None:
        return None
    own_off, off = (np.hypot(*(marks - centre).transpose(2, 0, 1)) for centre in (own_circle[0], circle[0]))
    own_off, off = np.abs(own_off - np.median(own_off[0, known])), np.abs(off - circle[1])
    better = SETTINGS.better * np.median(off.min(axis=0)[known]) < np.median(own_off[0, known])
    return off if better else own_off


def _least(marks: Array, off: Array, nearest: float, known: Flags) -> Flags:
    """Return the mask (n,) of the exchanged frames for which the sum in the module description is smallest."""
    frames = np.flatnonzero(known)
    points, cost = marks[:, frames], np.minimum(off[:, frames] / nearest, CIRCLE.near) ** 2
    straight, crossed = (
        ((points[:, 1:] - previous[:, :-1]) ** 2).sum(axis=(0, 2)) for previous in (points, points[::-1])
    )
    usual = max(float(np.median(np.minimum(straight, crossed))), 1e-18)
    total, origins = cost[:, 0], []
    for k in range(1, len(frames)):
        stay, change = straight[k - 1] / usual, crossed[k - 1] / usual
        costs = total + np.array([[stay, change], [change, stay]])
        origins.append(costs.argmin(axis=1))
        total = costs.min(axis=1) + cost[:, k]
    state = int(total.argmin())
    mask = np.zeros(marks.shape[1], dtype=np.bool_)
    for frame, previous in zip(frames[::-1], [*origins[::-1], None], strict=True):
        mask[frame] = state == 1
        state = state if previous is None else int(previous[state])
    return mask
