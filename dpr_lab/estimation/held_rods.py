"""Detect intervals in which the rods are held: at rest although free rods would move."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.errors import RunError
from dpr_lab.estimation.noise import NOISE, ORDER, difference_std, highest
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class HeldSettings:
    """Thresholds for held rods."""

    still_rad: float = 0.02
    """Maximum excursion of a rod at rest within an interval, rad.

    A hand trembles by a few mrad. A free rod 0.1 rad away from its unstable equilibrium leaves this band within 0.1 s.
    """
    of_motion: float = 0.02
    """Maximum excursion of a rod at rest, relative to the largest excursion in the recording.

    The limit ensures that small swings do not count as rest.
    """
    noise: float = 10.0
    """Minimum width of the band of rest, in standard deviations of the readings.

    A thousand readings with white noise have a range of about 6.5 standard deviations.
    """
    swing: float = 1.5
    """Minimum excursion of a swing, in widths of the band of rest."""
    restart: float = 5.0
    """Minimum excursion of a new swing after a rest, in widths of the band of rest.

    The excursion of a decaying swing is smaller.
    """
    interval_s: float = 0.4
    """Minimum duration of a held interval, s.

    At a turning point both rods of 0.4 m are in the band for less than 0.2 s.
    """
    hanging_rad: float = 0.2
    """Maximum distance from hanging at which free rods may rest, rad; the offset caused by stiction is smaller."""
    shortest_rest_s: float = 0.03
    """Minimum duration for which a short rest before the release is removed, s.

    A rest is short if it is shorter than `interval_s`.
    """
    trembles: float = 8.0
    """Maximum excursion within a short rest, in standard deviations of the readings.

    The excursion at a turning point is larger.
    """
    fewest: int = 4
    """Minimum number of samples of a rest that is removed, and of a swing."""
    sure: float = 0.3
    """Minimum duration of a short rest, relative to the time from the release until the fall is visible.

    The limit is three standard deviations of the estimated instant of the release.
    """
    onset: float = 4.0
    """Maximum excursion of a rod at rest from its mean position, in standard deviations of the readings."""
    own_zero_s: float = 0.05
    """Maximum time from t = 0 of a table to the first visible motion for which t = 0 counts as the release, s.

    The start of a slow fall is visible only after a delay.
    """
    driven_share: float = 0.02
    """Fraction of the largest torque of the recording below which a torque counts as zero."""
    unclear: float = 0.25
    """Maximum width of the band of rest, relative to the excursion, for which rest and motion are distinguishable.

    Much noise or few readings make the band wider.
    """
    restless: float = 3.0
    """Maximum ratio of the standard deviation of readings at rest to the standard deviation of their white noise.

    Above this ratio the rods tremble.
    """
    arm_share: float = 0.1
    """Minimum excursion of a moving arm, or of a cart (a very long arm), relative to its largest excursion."""
    arm_steps: float = 2.5
    """Minimum excursion of a moving arm, in rounding steps of its readings.

    Readings at rest near an edge between two values can be wrong by one step in either direction.
    """
    readings: int = 20_000
    """Maximum number of readings used for the noise estimate."""
    bent: float = 5.0
    """Minimum significance of a turning point within a band as wide as the noise.

    The significance is the ratio of the curvature of the readings to the standard deviation of this curvature.
    """


HELD = HeldSettings()


@dataclass(frozen=True, slots=True)
class RodMotion:
    """Motion of the rods in a recording."""

    t: Array
    """(n,) increasing times, s; 0 may be the release."""
    rods: Array
    """(n, 2) absolute angles of the rods, 0 = upright, rad."""
    torques: Array | None = None
    """(n, 2) known torques, N m; None for a free swing."""
    arm: Array | None = None
    """(n,) angle of an arm with prescribed motion, rad; None for a clamped arm."""
    cart: Array | None = None
    """(n,) column that is possibly the position of a cart, in any unit."""
    origin: float | None = None
    """Time to which the option --start-s refers; None: the first sample."""


@dataclass(frozen=True, slots=True)
class FreePart:
    """Part of a recording in which the rods are free, given by indices of samples."""

    rest: int
    """Index of the first sample of the rest before the release; equal to `start` without a rest."""
    start: int
    """Index of the first sample of the motion, at the release."""
    stop: int
    """Index after the last sample of the free motion; the number of samples if the rods are not held again."""


def free_part(motion: RodMotion, name: str) -> FreePart:
    """Find the part of a recording in which the rods swing freely.

    Rods are held if both are at rest and then move without a known torque, or if they are at rest away from hanging.
    Driven rods that hang before their torque starts are free.

    Args:
        motion: motion of the rods in the recording
        name: name of the recording for messages

    Raises:
        RunError: the rods are at rest throughout, or are held between several swings; the message names the options
            that select a part.
    """
    t, n = motion.t, len(motion.t)
    if n < 2:
        return FreePart(0, 0, n)
    band, excursion = still_band(motion), float(np.ptp(motion.rods, axis=0).max())
    if excursion > 0 and band > HELD.unclear * excursion:
        return FreePart(0, 0, n)
    held = _held_intervals(motion, band)
    edges = [(0, 0), *held, (n, n)]
    swings = [(first, stop) for (_, first), (stop, _) in pairwise(edges) if _swings(motion, first, stop, band)]
    swings = [part for part in swings if not (_free(motion) and _lifted(motion, *part, band))] or swings
    if not swings:
        raise RunError(
            f"{name}: the rods are at rest during the whole recording ({t[-1] - t[0]:.4g} s), but a swing is needed."
            " Check the columns of the rods (--columns theta1=NAME,theta2=NAME), and the unit (--unit)"
        )
    if len(swings) > 1:
        origin = t[0] if motion.origin is None else motion.origin
        parts = "; ".join(f"--start-s {t[i] - origin:.5g} --duration-s {t[j - 1] - t[i]:.5g}" for i, j in swings)
        raise RunError(
            f"{name}: the recording contains {len(swings)} swings, between which the rods are held. Import each as a"
            f" separate run: {parts}. If the rods were not held, use --keep-rest"
        )
    ((first, stop),) = swings
    rest = next((begin for begin, end in held if end == first), first)
    if first == 0:
        rest, first = 0, _short_rest(motion, band)
    start = _onset(motion, rest, first)
    return FreePart(rest, start, stop) if start - rest >= HELD.fewest else FreePart(first, first, stop)


def free_part_of(run: Run) -> FreePart:
    """Find the part of a run in which the rods swing freely, as `free_part` does."""
    arm = run.theta[:, 0] if run.arm_mode != "clamped" else None
    return free_part(RodMotion(run.t, run.theta[:, 1:], run.torques, arm), str(run.file or run.name))


def refuse_held(runs: Sequence[Run]) -> None:
    """Check that the rods are not held during the swing of an imported table.

    Raises:
        RunError: the rods of a table are at rest throughout, or are held between several swings.
    """
    for run in runs:
        if run.keep_rest is False:
            free_part_of(run.swing)


def rest_fault(motion: RodMotion, part: FreePart) -> str:
    """Return the reason why the noise of the readings cannot be estimated from the rest before the release.

    The text is empty if the rest is suitable.
    """
    t, rods = motion.t[part.rest : part.start], motion.rods[part.rest : part.start]
    if len(t) < HELD.fewest:
        return "it is too short"
    noise = np.sqrt(np.mean(np.diff(rods, axis=0) ** 2, axis=0) / 2)
    if not noise.all():
        return "its readings are constant and do not show the noise"
    line = np.vander(t - t.mean(), 2)
    spread = np.std(rods - line @ np.linalg.lstsq(line, rods, rcond=None)[0], axis=0)
    return "" if (spread <= HELD.restless * noise).all() else "the rods were not completely still"


def still_band(motion: RodMotion) -> float:
    """Return the largest excursion of rods that count as at rest, rad."""
    excursion = float(np.ptp(motion.rods, axis=0).max()) if len(motion.t) else 0.0
    noise = float(_noise(motion).max())
    return max(min(HELD.still_rad, HELD.of_motion * excursion), HELD.noise * noise)


def _noise(motion: RodMotion) -> Array:
    """Return the (2,) standard deviation of the readings of both rods, rad."""
    samples = slice(HELD.readings)
    return difference_std(motion.t[samples], motion.rods[samples]) if len(motion.t) > ORDER else np.zeros(2)


def _held_intervals(motion: RodMotion, band: float) -> list[tuple[int, int]]:
    """Return the intervals in which the rods are held.

    Each interval consists of its first sample and the index after its last sample.
    """
    return [
        (first, stop)
        for first, stop in _still_intervals(motion, band)
        if not (_known_input(motion, first, stop, band))
        and not (band > HELD.still_rad and _turns(motion, first, stop))
        and (not _hangs(motion.rods[first:stop]) or (_free(motion) and _restarts(motion, stop, band)))
    ]


def _still_intervals(motion: RodMotion, band: float) -> list[tuple[int, int]]:
    n = len(motion.t)
    half_width = round(HELD.interval_s / float(np.median(np.diff(motion.t))) / 2)
    width = 2 * half_width + 1
    if not HELD.fewest <= width <= n:
        return []
    ranges = highest(motion.rods, width) + highest(-motion.rods, width)
    still = np.pad(ranges.max(axis=1) <= band, 2 * half_width)
    inside = highest(still, width)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    return [(int(first), int(stop)) for first, stop in edges.reshape(-1, 2)]


def _turns(motion: RodMotion, first: int, stop: int) -> bool:
    """Return whether an interval contains a turning point of a swing.

    A parabola is fitted to the angles. Its quadratic term must be significant and accelerate the rod towards hanging,
    and a fall from rest must not fit better. Near a turning point, a slow rod with noisy readings, for example from a
    video, stays within the band of rest (`still_band`) for a long time. It then looks like a rod at rest.
    """
    t, rods = motion.t[first:stop], motion.rods[first:stop]
    if not _free(motion) or len(t) < HELD.fewest:
        return False
    powers = np.vander(t - t.mean(), 3)
    (curvature, _, middle), precision = np.linalg.lstsq(powers, rods, rcond=None)[0], np.linalg.inv(powers.T @ powers)
    # 0 is upright: an acceleration towards hanging has the sign of the sine
    towards_hanging = curvature * np.sin(middle) > 0
    significant = np.abs(curvature) > HELD.bent * np.sqrt(precision[0, 0]) * _noise(motion)
    return bool((towards_hanging & significant).any()) and _fall(t, rods) == 0


def _fall(t: Array, rods: Array) -> int:
    """Return the first sample of a fall from rest, or 0.

    The result is 0 unless a fall describes the readings better than one parabola. In the model of a fall, the rods rest
    until t0 and have moved by alpha (t - t0)^2 / 2 at a later time t.
    """
    instants = range(HELD.fewest, len(t) - HELD.fewest)
    if not instants:
        return 0
    bases = [np.vander(t - t.mean(), 3), *(np.vander(np.maximum(t - t[k], 0.0) ** 2, 2) for k in instants)]
    misfits = [float(np.sum((rods - basis @ np.linalg.lstsq(basis, rods, rcond=None)[0]) ** 2)) for basis in bases]
    best = int(np.argmin(misfits))
    return instants[best - 1] if best else 0


def _restarts(motion: RodMotion, stop: int, band: float) -> bool:
    """Return whether rods that hang at rest swing again later.

    A decaying swing cannot do this.
    """
    later = motion.rods[stop:]
    return bool(len(later)) and float(np.ptp(later, axis=0).max()) > HELD.restart * band


def _free(motion: RodMotion) -> bool:
    return motion.torques is None and motion.arm is None


def _hangs(rods: Array) -> bool:
    deviation = (np.median(rods, axis=0) + 2 * np.pi) % (2 * np.pi) - np.pi
    return bool((np.abs(deviation) <= HELD.hanging_rad).all())


def _known_input(motion: RodMotion, first: int, stop: int, band: float) -> bool:
    """Return whether the motion in an interval has a known cause.

    The cause is a known torque, or the motion of the prescribed arm.
    """
    pushed = False
    if motion.torques is not None:
        largest = np.abs(motion.torques).max(axis=1)
        pushed = bool(np.median(largest[first:stop]) > HELD.driven_share * largest.max())
    arm = motion.cart if motion.arm is None else motion.arm
    if arm is None or len(motion.t) <= ORDER:
        return pushed
    noise = HELD.noise * float(difference_std(motion.t, arm[:, None])[0])
    changes = np.abs(np.diff(arm))
    # a few wrong readings do not increase the noise estimate, a median
    rounding = HELD.arm_steps * float(changes.min(initial=np.inf, where=changes > NOISE.rounding_rad))
    moves = max(noise, rounding, min(band, HELD.arm_share * float(np.ptp(arm))))
    return pushed or float(np.ptp(arm[first:stop])) > moves


def _swings(motion: RodMotion, first: int, stop: int, band: float) -> bool:
    """Return whether the rods move between two held intervals."""
    whole = first == 0 and stop == len(motion.t)
    if stop - first < (2 if whole else HELD.fewest):
        return False
    moved = float(np.ptp(motion.rods[first:stop], axis=0).max())
    known = motion.torques is not None or motion.arm is not None
    return moved > HELD.swing * band or (whole and known and moved > 0)


def _lifted(motion: RodMotion, first: int, stop: int, band: float) -> bool:
    """Return whether a hand seems to move the rods: monotonically from one held position to the next."""
    rods = motion.rods[first:stop]
    return stop < len(motion.t) and bool((np.ptp(rods, axis=0) <= np.abs(rods[-1] - rods[0]) + band).all())


def _short_rest(motion: RodMotion, band: float) -> int:
    """Return the number of samples of a short rest at the beginning, or 0.

    Rods that are released at t0 fall by alpha (t - t0)^2 / 2. If they have fallen by d at t1 and by 4 d at t2, then t0
    = 2 t1 - t2.
    """
    t, n = motion.t, len(motion.t)
    waits = not _free(motion) and _hangs(motion.rods[:1])
    if n < 3 * HELD.fewest or waits:
        return 0
    fallen = np.abs(motion.rods - motion.rods[: HELD.fewest].mean(axis=0)).max(axis=1)
    exceeded = [int(np.argmax(fallen > depth)) for depth in (band, 4 * band)]
    if not 0 < exceeded[0] < exceeded[1]:
        return 0
    if band > HELD.still_rad:
        return _fall(t[: exceeded[1]], motion.rods[: exceeded[1]])
    t1, t2 = (
        float(np.interp(depth, fallen[i - 1 : i + 1], t[i - 1 : i + 1])) - t[0]
        for depth, i in zip((band, 4 * band), exceeded, strict=True)
    )
    t0 = 2 * t1 - t2
    if t0 < max(HELD.shortest_rest_s, HELD.sure * (t1 - t0)):
        return 0
    samples = int(np.searchsorted(t, t[0] + t0))
    quiet = motion.rods[: max(2, int(0.8 * samples))]
    trembles = (np.ptp(quiet, axis=0) > HELD.trembles * _noise(motion)).any()
    if samples < HELD.fewest or trembles or _known_input(motion, 0, samples, band):
        return 0
    return samples


def _onset(motion: RodMotion, rest: int, first: int) -> int:
    """Return the index of the first sample of a motion.

    The rods are at rest at sample `rest`, and have moved at sample `first`.
    """
    t, rods = motion.t, motion.rods
    if first - rest < HELD.fewest:
        return first
    near = max(rest, int(np.searchsorted(t, t[first - 1] - HELD.interval_s)))
    quiet = rods[near : near + max(HELD.fewest, (first - near) // 2)]
    deviation = np.abs(rods[near:first] - quiet.mean(axis=0))
    limit = np.maximum(HELD.onset * quiet.std(axis=0), 1.5 * np.abs(quiet - quiet.mean(axis=0)).max(axis=0))
    resting = np.flatnonzero((deviation <= limit).all(axis=1))
    start = near + int(resting[-1]) + 1 if len(resting) else first
    if t[rest] < 0 <= t[start] <= HELD.own_zero_s:
        return int(np.searchsorted(t, 0.0))
    return start
