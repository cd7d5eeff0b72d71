"""Warn if a column is probably not an angle.

The evidence is how the period of a single rod depends on the amplitude.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.shown import percent
from dpr_lab.storage.tables.columns import TO_RADIANS
from dpr_lab.storage.tables.interpreted import InterpretedTable, TableQuestion


@dataclass(frozen=True, slots=True)
class PeriodSettings:
    """Limits for the amplitude dependence of the period."""

    fewest_periods: int = 6
    """Minimum number of periods from which the scatter of a period can be estimated."""
    smallest_share: float = 0.1
    """Minimum amplitude relative to the largest amplitude. The periods of smaller swings are disturbed by noise."""
    constant: float = 0.02
    """Relative decrease of the amplitude below which the amplitude counts as constant, and its period shows nothing.

    Without friction, sampling alone changes the amplitude by up to 0.7 % at 30 rows per second."""
    overturned_rad: float = 3.0
    """Maximum amplitude of a swing, rad."""
    other_scale: float = 0.6
    """Maximum scale of the amplitude for a warning. A true angle has the scale 1; an unnoticed eccentricity of an
    encoder changes it by some tenths."""
    significant: float = 25.0
    """Minimum difference between the sums of squares at the scale 1 and at the best scale, in units of the variance of
    a period. 25 corresponds to 5 standard deviations."""
    means: int = 5
    """Number of steps of the arithmetic-geometric mean. Each step doubles the number of correct digits."""


SETTINGS = PeriodSettings()


def period_questions(table: InterpretedTable) -> list[TableQuestion]:
    """Warn if the period of a column depends too little on its amplitude.

    The period of a freely swinging rod is T = T0 / agm(1, cos(A/2)), where A is the amplitude, T0 the period of small
    swings and agm the arithmetic-geometric mean. A position in mm that is read as degrees has the period of another
    amplitude.
    """
    unit = table.options.unit
    if table.rig.rods.number != 1 or not table.free or unit not in TO_RADIANS:
        return []
    periods, amplitudes = swings(table.t[table.swing], table.theta[table.swing, 1])
    large = amplitudes > SETTINGS.smallest_share * amplitudes.max(initial=0.0)
    periods, amplitudes = periods[large], amplitudes[large]
    if len(periods) < SETTINGS.fewest_periods or amplitudes.max() > SETTINGS.overturned_rad:
        return []
    if np.ptp(amplitudes) < SETTINGS.constant * amplitudes.max():
        return []
    scales = np.linspace(0.0, 1.0, 51)
    sums = np.array([_sum_of_squares(periods, scale * amplitudes) for scale in scales])
    best = int(sums.argmin())
    variance = sums[best] / (len(periods) - 2)
    if scales[best] > SETTINGS.other_scale or not sums[-1] - sums[best] > SETTINGS.significant * variance:
        return []
    return [
        TableQuestion(
            f"the amplitude decreases from {amplitudes.max():.3g} to {amplitudes.min():.3g} rad, but the period changes"
            f" as in a swing with {percent(float(scales[best]))} of these angles: is the column an angle in {unit}"
            " (--unit, --scale), and not the position of a point (export its x and y)? A spring that is stronger than"
            " gravity has the same effect"
        )
    ]


def swings(t: Array, angle: Array) -> tuple[Array, Array]:
    """Return (k,) durations, s, and amplitudes of the periods.

    A period begins at an upward crossing of the median angle.
    """
    x = angle - np.median(angle)
    up = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    crossings = t[up] - x[up] * (t[up + 1] - t[up]) / (x[up + 1] - x[up])
    amplitudes = [0.5 * float(np.ptp(x[first : last + 1])) for first, last in pairwise(up)]
    return np.diff(crossings), np.array(amplitudes)


def _sum_of_squares(periods: Array, amplitudes: Array) -> float:
    """Return the sum of squared differences of measured and theoretical periods, s^2.

    The period T0 of small swings is fitted.
    """
    # the elliptic integral of scipy.special would delay each start of `import table`
    larger, smaller = np.ones_like(amplitudes), np.cos(amplitudes / 2)
    for _ in range(SETTINGS.means):
        larger, smaller = 0.5 * (larger + smaller), np.sqrt(larger * smaller)
    shape = 1 / larger
    small = (shape @ periods) / (shape @ shape)
    return float(np.sum((periods - small * shape) ** 2))
