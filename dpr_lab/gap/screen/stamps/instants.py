"""Sampling times: jitter of time stamps, and readings that are periodically late.

Two faults of data loggers are detected without a model:

    stamp_jitter     Samples are taken at an even rate and receive their time stamps on arrival. The sixth differences
                     of the angles are then smaller on even times than on the stamps. Uneven stamps that are correct
                     give smaller differences than even times and are kept.
    periodic_delay   Every n-th reading is taken a constant time after its stamp (a multiplexer, a buffer that is
                     written to disk). The error of this reading is the product of delay and speed, in both joints.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dpr_lab.arrays import Array, Flags, Integers, neighbours
from dpr_lab.estimation.noise import ORDER, difference_weights
from dpr_lab.fitting.uncompiled import NORMAL_MAD


@dataclass(frozen=True, slots=True)
class InstantSettings:
    """Limits of the tests of time stamps."""

    uneven: float = 1e-3
    """Maximum standard deviation of the stamps about an even clock for stamps that count as even, in periods."""
    widest: float = 0.5
    """Maximum difference between a stamp and the even clock if no sample is missing, in periods."""
    drift: int = 50
    """Number of samples on either side from which the median offset of the clock is computed."""
    usual_jitter: float = 3.0
    """Maximum deviation of a stamp that is used for the clock, in standard deviations of the jitter."""
    wander: float = 0.5
    """Maximum scatter of the median offset about a straight line for a steady clock, relative to the jitter."""
    likelihood: float = 6.0
    """Minimum log-likelihood ratio for even instants, nats."""
    fewest: int = 48
    """Minimum number of readings for the tests of time stamps."""
    fast: float = 0.4
    """Fraction of the windows that are compared: those with the fastest motion. At rest, all instants are
    equivalent."""
    cycle: int = 64
    """Maximum interval between two late readings in a periodic pattern, in samples."""
    significance: float = 8.0
    """Minimum periodic delay, in standard errors."""
    contrast: float = 2.0
    """Minimum ratio of the delay of the late reading to the largest other delay in the cycle."""
    likely: float = 0.3
    """Minimum significance of a cycle that is fitted, relative to the most significant cycle."""
    unshared: float = 0.15
    """Quantile of the scatter over all cycle lengths that counts as the scatter due to jitter. A small quantile
    excludes the cycle lengths in which late readings increase the scatter."""
    least: float = 0.1
    """Minimum delay, in periods; a smaller delay counts as noise."""
    outliers: int = 5
    """Number of possible outliers: the late readings of largest influence, which a test leaves out (decision 98)."""
    remaining: float = 4.0
    """Minimum periodic delay without the possible `outliers`, in standard errors."""
    wild: float = 8.0
    """Limit to which the error of a single reading is clipped in the search for a cycle, in standard deviations."""
    usual: float = 0.98
    """Quantile of the errors that replaces the limit `wild` if it is larger, because many readings may be late."""
    reach: int = 4
    """Number of samples on either side for the estimate of the speed."""


INSTANTS = InstantSettings()


@dataclass(frozen=True, slots=True)
class PeriodicDelay:
    """Periodic delay: every `cycle`-th reading is taken `delay_s` after its stamp."""

    cycle: int
    """Number of samples from one late reading to the next, including lost samples."""
    delay_s: float
    std_s: float
    """Standard error of the delay, s."""
    late: Flags
    """(n,) mask of the late readings."""


def even_instants(t: Array, joints: Array) -> Array | None:
    """Return evenly spaced times if the angles are smoother there than at the time stamps.

    The sixth divided differences on the stamps and on even times are compared in windows of seven samples. Even times
    are chosen if their log-likelihood ratio is large enough,

        sum over joints of  k / 7 ln(rms on stamps / rms on even times)

    for k windows, of which one in seven is independent. Large differences are clipped to the same limit on stamps and
    on even times, because a wrong reading affects both.

    Args:
        t: (n,) stamps, s
        joints: (n, m) angles, rad

    Returns:
        (n,) times, s; None if the stamps are even, or correct
    """
    if len(t) < INSTANTS.fewest:
        return None
    period, even, continuous = _even_clock(t)
    near = continuous | (np.abs(t - even) < INSTANTS.widest * period)
    if not near.any() or np.std((t - even)[near]) < INSTANTS.uneven * period:
        return None
    windows = sliding_window_view(t, ORDER + 1)
    angles = sliding_window_view(joints, ORDER + 1, axis=0)
    on_stamps = np.abs(np.einsum("wmj,wj->wm", angles, difference_weights(windows, period)))
    on_even = np.abs(angles @ difference_weights(np.arange(ORDER + 1.0)[None], 1.0)[0])
    speed = np.abs(joints[ORDER:] - joints[:-ORDER]) / (ORDER * period)
    without_loss = sliding_window_view(continuous, ORDER + 1).all(axis=1)
    without_loss |= np.abs(np.diff(windows, axis=1) - period).max(axis=1) < INSTANTS.widest * period
    counts = without_loss[:, None] & (speed > 0.0) & (speed >= np.quantile(speed, 1 - INSTANTS.fast, axis=0))
    if _likelihood_ratio(on_stamps, on_even, counts) < INSTANTS.likelihood:
        return None
    instants = np.where(near, even, t)
    return instants if (np.diff(instants) > 0.0).all() else None


def _likelihood_ratio(on_stamps: Array, on_even: Array, counts: Flags) -> float:
    """Return the log-likelihood ratio of even sampling instants to the time stamps, nats.

    Args:
        on_stamps: (w, m) absolute finite differences of each window and joint on the time stamps
        on_even: (w, m) absolute finite differences on evenly spaced times
        counts: (w, m) mask of the windows to use
    """
    ratio = 0.0
    for stamped, even in ((on_stamps[k, m], on_even[k, m]) for m, k in enumerate(counts.T) if k.any()):
        most = INSTANTS.wild * NORMAL_MAD * max(float(np.median(stamped)), float(np.median(even)))
        powers = [float(np.mean(np.minimum(differences, most) ** 2)) for differences in (stamped, even)]
        if min(powers) > 0.0:
            ratio += len(even) / (ORDER + 1) * 0.5 * float(np.log(powers[0] / powers[1]))
    return ratio


def _even_clock(t: Array) -> tuple[float, Array, Flags]:
    """Fit an even clock to the stamps; return its period, its times, and a mask.

    The period and the (n,) times are in s. The (n,) mask is true in parts without a lost sample. Stamps may come in
    bursts, so the period is the median over many samples. After a lost sample, the times continue one period later. If
    no samples are lost and the clock is steady, the times are a straight line through all stamps, which has the least
    noise.
    """
    index, drift = np.arange(len(t)), min(INSTANTS.drift, len(t) // 4)
    period = float(np.median(t[drift:] - t[:-drift])) / drift
    offset = t - index * period
    wandering = _median_of_neighbours(offset, drift)
    jitter = NORMAL_MAD * float(np.median(np.abs(offset - wandering)))
    usual = np.abs(offset - wandering) <= INSTANTS.usual_jitter * jitter
    steady = np.polyval(np.polyfit(index[usual], offset[usual], 1), index)
    if np.std(wandering - steady) < INSTANTS.wander * jitter:
        return period, index * period + steady, np.ones(len(t), dtype=bool)
    spread = np.ptp(neighbours(wandering, drift), axis=1)
    return period, index * period + wandering, np.asarray(spread < INSTANTS.widest * period)


def periodic_delay(t: Array, joints: Array) -> PeriodicDelay | None:
    """Return the most significant periodic delay, or None.

    Let r = W theta be the divided differences of windows of seven readings. If reading i is late by d, r = W_i d
    omega_i. Therefore

        d_i = (W^T r)_i / ((W^T W)_ii omega_i),    with the information (W^T W)_ii omega_i^2 / sigma^2.

    The delays are averaged with these weights over every n-th reading, for each n and each position in the cycle. The
    likely cycles are fitted by least squares; the most significant delay is returned.

    Args:
        t: (n,) times, s
        joints: (n, m) angles, rad
    """
    if len(t) < 4 * INSTANTS.cycle:
        return None
    windows, period = sliding_window_view(t, ORDER + 1), float(np.median(np.diff(t)))
    dense = np.ptp(windows, axis=1) < 1.5 * ORDER * period
    weights = np.where(dense[:, None], difference_weights(windows, period), 0.0)
    power = _to_samples(weights**2, len(t))
    score, information = np.zeros(len(t)), np.zeros(len(t))
    usable: list[tuple[Array, Array]] = []
    for angle in joints.T:
        differences = _differences(angle, weights)
        std = NORMAL_MAD * float(np.median(np.abs(differences[dense]))) if dense.any() else 0.0
        if std <= 0.0:
            continue
        speed = _speed(t, angle)
        usable.append((differences / std, speed / std))
        error = _to_samples(weights * differences[:, None], len(t))
        most = np.maximum(INSTANTS.wild * std * np.sqrt(power), np.quantile(np.abs(error), INSTANTS.usual))
        score += speed * np.clip(error, -most, most) / std**2
        information += speed**2 * power / std**2
    ticks = _ticks(t, period)
    by_cycle = {cycle: _by_position(ticks % cycle, cycle, score, information) for cycle in range(2, INSTANTS.cycle + 1)}
    # random jitter increases the scatter in all cycles, a late reading only in related cycles
    spreads = [NORMAL_MAD * np.median(np.abs(z - np.median(z))) for cycle, z in by_cycle.items() if cycle > ORDER]
    scatter = max(1.0, float(np.quantile(spreads, INSTANTS.unshared)))
    places = {cycle: _largest(z) for cycle, z in by_cycle.items()}
    largest = max(size for size, _ in places.values())
    if largest < INSTANTS.significance * scatter:
        return None
    # a late reading also affects the windows of its neighbours, and so other cycles: the best fit is the right one
    likely = [(cycle, first) for cycle, (size, first) in places.items() if size > INSTANTS.likely * largest]
    fits = [_delayed(cycle, ticks % cycle == first, usable, weights) for cycle, first in likely]
    fits = [fit for fit in fits if _without_outliers(fit, score, information) > INSTANTS.remaining * scatter]
    best = max(fits, key=lambda fit: abs(fit.delay_s) / fit.std_s, default=None)
    return best if best and abs(best.delay_s) >= INSTANTS.least * period else None


def _ticks(t: Array, period: float) -> Integers:
    """Return the (n,) sample numbers, in which lost samples are counted.

    A long interval is caused by a lost sample unless a neighbouring interval is short, as after a late stamp.
    """
    spacing = np.diff(t)
    around = neighbours(spacing, 1).sum(axis=1)
    lost = (spacing > 1.5 * period) & (around > 3.5 * period)
    return np.append(0, np.cumsum(np.where(lost, np.rint(spacing / period), 1.0))).astype(np.int64)


def _delayed(cycle: int, late: Flags, usable: list[tuple[Array, Array]], weights: Array) -> PeriodicDelay:
    """Return the delay of every `cycle`-th reading, by least squares over the divided differences.

    Args:
        cycle: number of samples from one late reading to the next
        late: (n,) mask of these readings
        usable: divided differences (windows,) and speed (n,) of each joint, in standard deviations
        weights: (windows, 7) weights of the divided differences
    """
    shapes = [(differences, _differences(speed * late, weights)) for differences, speed in usable]
    known = sum(float(shape @ shape) for _, shape in shapes)
    delay = sum(float(differences @ shape) for differences, shape in shapes) / known
    return PeriodicDelay(cycle, delay, known**-0.5, late)


def _without_outliers(fit: PeriodicDelay, score: Array, information: Array) -> float:
    """Return the significance of a delay without the late readings that have the largest influence."""
    others = np.argsort(-np.abs(score[fit.late]))[INSTANTS.outliers :]
    known = max(float(information[fit.late][others].sum()), np.finfo(float).tiny)
    return float(np.sign(fit.delay_s) * score[fit.late][others].sum() / known**0.5)


def _by_position(position: Integers, cycle: int, score: Array, information: Array) -> Array:
    """Return the delay at each position of a cycle, (cycle,), divided by its standard error."""
    known = np.maximum(np.bincount(position, information, cycle), np.finfo(float).tiny)
    return np.bincount(position, score, cycle) / np.sqrt(known)


def _largest(z: Array) -> tuple[float, int]:
    """Return the size and the position of the largest delay among (cycle,) delays.

    The size is 0 if other delays in the cycle are nearly as large.
    """
    size = np.abs(z)
    first = int(np.argmax(size))
    separation = np.abs((np.arange(len(z)) - first + len(z) // 2) % len(z) - len(z) // 2)
    elsewhere = size[separation > ORDER // 2]  # a late reading also affects the windows of its neighbours
    stands_out = not len(elsewhere) or size[first] > INSTANTS.contrast * elsewhere.max()
    return (float(size[first]) if stands_out else 0.0), first


def _differences(values: Array, weights: Array) -> Array:
    return np.einsum("wj,wj->w", sliding_window_view(values, ORDER + 1), weights)


def _to_samples(values: Array, samples: int) -> Array:
    """Sum (windows, 7) values over all windows that contain each sample."""
    total = np.zeros(samples)
    for position in range(ORDER + 1):
        total[position : samples - ORDER + position] += values[:, position]
    return total


def _speed(t: Array, angle: Array) -> Array:
    """Estimate the (n,) speed from distant neighbours, so that one wrong instant has little influence."""
    speed, reach = np.gradient(angle, t), INSTANTS.reach
    speed[reach:-reach] = (angle[2 * reach :] - angle[: -2 * reach]) / (t[2 * reach :] - t[: -2 * reach])
    return speed


def _median_of_neighbours(values: Array, half: int) -> Array:
    """Return the (n,) median of each value and `half` neighbours on either side."""
    padded = np.pad(values, half, mode="reflect", reflect_type="odd")
    return np.median(sliding_window_view(padded, 2 * half + 1), axis=1)
