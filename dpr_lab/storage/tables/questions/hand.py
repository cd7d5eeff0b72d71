"""Warn if a hand moves the rod at the beginning of a table."""

import math
from dataclasses import dataclass

import numpy as np

from dpr_lab.identification.misread.balance import periods
from dpr_lab.storage.tables.interpreted import InterpretedTable, TableQuestion


@dataclass(frozen=True, slots=True)
class HandSettings:
    """Limits below which the acceleration of a rod shows that a hand moves it."""

    window: float = 0.2
    """Duration over which the acceleration is estimated, in periods of small swings."""
    steps: int = 8
    """Number of starts within this duration at which the acceleration is estimated."""
    fewest_rows: int = 6
    """Minimum number of rows in this duration."""
    away: float = 0.5
    """Minimum absolute sine of the angle. Near hanging and upright, gravity also accelerates a free rod little."""
    share: float = 0.25
    """Maximum acceleration of a rod moved by a hand, relative to the acceleration by gravity."""


HAND = HandSettings()


def hand_questions(table: InterpretedTable) -> list[TableQuestion]:
    """Warn if a single rod accelerates less at the beginning than gravity alone would accelerate it."""
    if table.rig.rods.number != 1 or not table.free:
        return []
    t, angle = table.t[table.looked_at], table.theta[table.looked_at, 1]
    period, held = periods(table.rig)[0], 0
    ends = np.searchsorted(t, t + HAND.window * period)
    for first in range(0, len(t), max(1, int(ends[0]) // HAND.steps)):
        last = int(ends[first])
        if last - first < HAND.fewest_rows:
            return []  # too few rows, or the rod never accelerates as gravity requires
        parabola = np.polyfit(t[first:last] - t[first], angle[first:last], 2)
        sine = abs(math.sin(angle[first:last].mean()))
        if sine < HAND.away or 2 * abs(parabola[0]) > HAND.share * sine * (2 * np.pi / period) ** 2:
            break
        held = last
    if not held:
        return []
    begins = f"{math.ceil(100 * (t[held - 1] - table.t[0] + table.options.start_s)) / 100:g}"
    return [
        TableQuestion(
            f"until {begins} s, the rod accelerates less than gravity alone would accelerate it. If a hand moved it,"
            f" exclude this part (--start-s {begins})"
        )
    ]
