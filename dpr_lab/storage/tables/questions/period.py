"""Warn if a column is probably not an angle, or an angle in another unit.

The evidence is how the period of a single rod depends on the amplitude, the torque balance of two rods, or the
distance of a driven rod from its zero.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.identification.misread.balance import energy_fit, energy_zeros
from dpr_lab.identification.misread.torque_balance import torque_balance
from dpr_lab.shown import percent
from dpr_lab.storage.tables.columns import AXES, TO_RADIANS
from dpr_lab.storage.tables.interpreted import InterpretedTable, TableQuestion
from dpr_lab.storage.tables.readings import READ, unit_words


@dataclass(frozen=True, slots=True)
class PeriodSettings:
    """Limits for the amplitude dependence of the period."""

    fewest_periods: int = 6
    """Minimum number of periods from which the scatter of a period can be estimated."""
    smallest_share: float = 0.1
    """Minimum amplitude relative to the largest amplitude. The periods of smaller swings are disturbed by noise."""
    constant: float = 0.02
    """Relative decrease of the amplitude below which the amplitude counts as constant, so that its scale cannot be
    determined. Without friction, sampling alone changes the amplitude by up to 0.7 % at 30 rows per second."""
    overturned_rad: float = 3.0
    """Maximum amplitude of a swing, rad."""
    other_scale: float = 0.6
    """Maximum scale of the amplitude, or of its inverse, for a warning. A true angle has the scale 1; an unnoticed
    eccentricity of an encoder changes it by some tenths."""
    other_unit: float = 0.5
    """Maximum relative difference between the best scale and the scale of angles in rad."""
    small: float = 0.7
    """Maximum amplitude, in degrees, for a warning without evidence. The motion shows the unit of a larger swing."""
    significant: float = 25.0
    """Minimum difference between the sums of squares at the scale 1 and at the best scale, in units of the variance of
    a period. 25 corresponds to 5 standard deviations."""
    far_turns: float = 1.5
    """Minimum distance of all readings of a rod from the zero, in turns, for a warning."""
    driven: float = 0.7
    """Minimum energy residual with the best zeros for this warning. It is at most 0.5 for simulated free swings with
    readings rounded to 0.1 rad, and at least 0.8 for degrees of a driven rod that are read as radians."""
    means: int = 5
    """Number of steps of the arithmetic-geometric mean. Each step doubles the number of correct digits."""


SETTINGS = PeriodSettings()


@dataclass(frozen=True, slots=True)
class AmplitudeScale:
    """Scale of the amplitudes of a single rod that agrees with their periods."""

    best: float
    as_read: float
    """Difference of the sums of squares at the scale 1 and at the best scale, in units of a significant difference."""
    other_unit: float
    """Difference like `as_read`, at the scale that exchanges degrees and radians; infinite if it is impossible."""
    amplitudes: tuple[float, float]
    """Largest and smallest amplitude, rad."""


def amplitude_scale(table: InterpretedTable) -> AmplitudeScale | None:
    """Fit the scale of the amplitudes to their periods; None without sufficient periods.

    The period of a freely swinging rod is T = T0 / agm(1, cos(A/2)), where A is the amplitude, T0 the period of small
    swings and agm the arithmetic-geometric mean.
    """
    if table.rig.rods.number != 1 or not table.free:
        return None
    periods, amplitudes = swings(table.t[table.swing], table.theta[table.swing, 1])
    large = amplitudes > SETTINGS.smallest_share * amplitudes.max(initial=0.0)
    periods, amplitudes = periods[large], amplitudes[large]
    if len(periods) < SETTINGS.fewest_periods or amplitudes.max() > SETTINGS.overturned_rad:
        return None
    if np.ptp(amplitudes) < SETTINGS.constant * amplitudes.max():
        return None
    most = SETTINGS.overturned_rad / amplitudes.max()
    scales = np.concatenate([np.linspace(0.0, 1.0, 51), np.geomspace(1.0, most, 101)[1:]])
    sums = np.array([_sum_of_squares(periods, scale * amplitudes) for scale in scales])
    worse = (sums - sums.min()) * (len(periods) - 2) / (SETTINGS.significant * sums.min())
    as_read, other = np.interp([1.0, factor_of_other(table)], scales, worse, right=np.inf).tolist()
    return AmplitudeScale(float(scales[sums.argmin()]), as_read, other, (amplitudes.max(), amplitudes.min()))


def factor_of_other(table: InterpretedTable) -> float:
    """Return the factor of the angles if degrees and radians are exchanged; 1 for counts."""
    return {"deg": 1 / TO_RADIANS["deg"], "rad": TO_RADIANS["deg"]}.get(table.options.unit or "", 1.0)


def period_questions(table: InterpretedTable) -> list[TableQuestion]:
    """Warn if the periods of a rod are those of a swing with another amplitude.

    This occurs if positions in mm, or angles in another unit, are interpreted as degrees.
    """
    scale = amplitude_scale(table)
    if scale is None or SETTINGS.other_scale < scale.best < 1 / SETTINGS.other_scale or not scale.as_read > 1:
        return []
    larger, factor, unit = scale.best > 1, factor_of_other(table), table.options.unit
    share = f"{scale.best:.3g} times" if larger else f"{percent(scale.best)} of"
    sentence = "the amplitude decreases from {:.3g} to {:.3g} rad".format(*scale.amplitudes)
    sentence += f", but the period changes as in a swing with {share} these angles"
    near = abs(scale.best - factor) < SETTINGS.other_unit * factor if larger else scale.other_unit < 1
    words = unit_words(table) if near and unit != "counts" else ()
    if words and larger:
        probably = f"{sentence}: the angles are probably in rad ({' '.join(words)})"
        return [TableQuestion(probably, words, other_unit=True)]
    if unit == "counts" or larger:
        right = "counts_per_rev of the rig file" if unit == "counts" else "the unit of the angles (--unit, --scale)"
        return [TableQuestion(f"{sentence}: is {right} correct?")]
    option = f"; {' '.join(words)} for degrees" if words else ""
    return [
        TableQuestion(
            f"{sentence}: is the column an angle in {unit} (--unit, --scale{option}), and not the position of a point"
            " (export its x and y)? A spring that is stronger than gravity has the same effect"
        )
    ]


def small_questions(table: InterpretedTable) -> list[TableQuestion]:
    """Warn about a small swing in degrees that may be in radians."""
    amplitude = float(np.ptp(table.theta[table.swing, 1:], axis=0).max()) / 2 / TO_RADIANS["deg"]
    # the same number in rad would be the amplitude
    if table.options.unit != "deg" or table.prescribed or amplitude > SETTINGS.overturned_rad:
        return []
    words = unit_words(table)
    ratio = _residual_of_radians(table)
    if ratio <= READ.alike_balance and (scale := amplitude_scale(table)):
        ratio = np.inf if scale.other_unit - scale.as_read > 1 else ratio
    sentence = f"the amplitude of the swing is only {amplitude:.2g} degrees"
    if ratio < 1 / READ.alike_balance:
        doubt = TableQuestion(f"{sentence}, but the accelerations agree better with rad ({' '.join(words)})", words)
    elif ratio <= READ.alike_balance and amplitude < SETTINGS.small:
        doubt = TableQuestion(f"{sentence}: if the table is in rad, import it with {' '.join(words)}")
    else:
        return []
    return [doubt]


def degree_questions(table: InterpretedTable) -> list[TableQuestion]:
    """Warn about driven rods whose readings without a stated unit are too far from the zero for radians."""
    if (
        table.options.unit != "rad"
        or table.unit_stated
        or table.prescribed
        or (words := unit_words(table))[0] != "--unit"
    ):
        return []
    for axis in AXES[1 : 1 + table.rig.rods.number]:
        x = table.values[axis]
        nearest = float(np.abs(x).min()) / (2 * np.pi)
        whole = np.array_equal(x, np.round(x))  # `odd_notes` warns of whole numbers
        if nearest > SETTINGS.far_turns and np.ptp(x) < abs(x.mean()) and not whole and _is_driven(table):
            sentence = f"as an angle in rad, {axis} stays at least {nearest:.3g} turns from the zero, and gravity does"
            return [TableQuestion(f"{sentence} not explain its motion: is it in degrees ({' '.join(words)})?")]
    return []


def _is_driven(table: InterpretedTable) -> bool:
    """Check whether gravity, friction and known torques explain little of the energy, even with other zeros."""
    read = table.beginning()
    rods = read.theta[:, 1:]
    zeros = energy_zeros(read.t, rods, read.rig) or (0.0, 0.0)
    fit = energy_fit(read.t, rods + zeros, read.torques, read.rig)
    return fit is None or fit.residual > SETTINGS.driven


def _residual_of_radians(table: InterpretedTable) -> float:
    """Return the torque residual of angles in rad, relative to that in degrees; 1 if it is unknown."""
    read = table.beginning()
    rods = (read.rods(read.values, replace(read.options, unit=unit)) for unit in ("rad", "deg"))
    converted, as_read = (torque_balance(read.t, angles, read.torques, read.rig) for angles in rods)
    if converted is None or as_read is None or not (residual := as_read.residual()) > 0:
        return 1.0
    return converted.residual() / residual


def swings(t: Array, angle: Array) -> tuple[Array, Array]:
    """Return (k,) durations, s, and amplitudes of the periods.

    A period begins at an upward crossing of the median angle.
    """
    x = angle - np.median(angle)
    level = 0.5 * SETTINGS.smallest_share * np.abs(x).max(initial=0.0)  # noise crosses the median several times
    outside = np.flatnonzero(np.abs(x) > level)
    rises = np.flatnonzero((x[outside[:-1]] < 0) & (x[outside[1:]] > 0))
    below, above = outside[rises], outside[rises + 1]
    crossings = t[below] - x[below] * (t[above] - t[below]) / (x[above] - x[below])
    amplitudes = [0.5 * float(np.ptp(x[first : last + 1])) for first, last in pairwise(above)]
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
