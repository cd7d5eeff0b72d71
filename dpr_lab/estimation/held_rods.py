"""Detection of held rods: stretches of a recording at rest in which a free rod would move."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpr_lab.errors import RunError
from dpr_lab.estimation.noise import ORDER, difference_std
from dpr_lab.run import Run

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class HeldSettings:
    """Thresholds from which rods count as held."""

    still_rad: float = 0.02
    """Largest excursion of a rod at rest within a stretch. A hand trembles by a few mrad; a free rod 0.1 rad from its
    unstable equilibrium leaves this band within 0.1 s."""
    of_motion: float = 0.02
    """The same as a share of the largest excursion in the recording: small swings are no rest."""
    noise: float = 10.0
    """The band in standard deviations of the readings, at least: the excursion of white noise in a thousand of them."""
    swing: float = 1.5
    """Excursion of a swing, in widths of the band, at least."""
    restart: float = 5.0
    """Excursion after a rest, in widths of the band, at least: a swing that decays comes back from it with less."""
    stretch_s: float = 0.4
    """Shortest stretch that counts as held. At a turning point both rods of 0.4 m stay in the band for below 0.2 s."""
    hanging_rad: float = 0.2
    """Rods this close to hanging may rest by themselves: stiction offsets them by less."""
    shortest_rest_s: float = 0.03
    """Shortest rest before the release that is cut, where the rest is shorter than a stretch."""
    trembles: float = 8.0
    """Excursion within such a short rest, in standard deviations of the readings, at most; a turning point has more."""
    fewest: int = 4
    """Fewest samples of rest that are cut, and of a swing."""
    sure: float = 0.3
    """Shortest rest as a share of the time in which the fall becomes visible: three of its standard deviations."""
    onset: float = 4.0
    """Standard deviations about the rest that a rod at rest does not leave."""
    own_zero_s: float = 0.05
    """A table's own t = 0 is the release if the motion shows at most this long after it: slow falls show late."""
    driven_share: float = 0.02
    """Torques below this share of the recording's largest count as none."""
    unclear: float = 0.25
    """Share of the excursion from which the band is too wide to distinguish rest from motion: noise or few readings."""
    restless: float = 3.0
    """Standard deviation of a rest over that of its noise from reading to reading, above which the rods tremble."""
    readings: int = 20_000
    """Readings that the noise is estimated from, at most."""


HELD = HeldSettings()


@dataclass(frozen=True, slots=True)
class RodMotion:
    """Motion of the rods in a recording."""

    t: Array
    """(n,) s, increasing; 0 may be the release."""
    rods: Array
    """(n, 2) absolute angles of the rods, 0 = upright, rad."""
    torques: Array | None = None
    """(n, 2) known torques, N m; None of a free swing."""
    arm: Array | None = None
    """(n,) angle of an arm whose motion is prescribed, rad; None of a clamped one."""
    origin: float | None = None
    """Time from which the option --start-s counts; None: the first sample."""


@dataclass(frozen=True, slots=True)
class FreePart:
    """Where the rods of a recording are free, as indices of its samples."""

    rest: int
    """First sample of the rest before the release; `start` where there is none."""
    start: int
    """The release: the first sample of the motion."""
    stop: int
    """One past the last sample before the rods are held again; the number of samples where they are not."""


def free_part(motion: RodMotion, name: str, settings: HeldSettings = HELD) -> FreePart:
    """The part of a recording in which the rods swing by themselves.

    Rods are held where both stand still and then move without a known torque, or stand still away from hanging.
    Driven rods that hang and wait for their torque are free.

    Args:
        motion: the recording
        name: of the recording, for messages
        settings: when rods count as held

    Raises:
        RunError: the rods stand still throughout, or are held between several swings; names the options that cut.
    """
    t, n = motion.t, len(motion.t)
    if n < 2:
        return FreePart(0, 0, n)
    band, excursion = still_band(motion, settings), float(np.ptp(motion.rods, axis=0).max())
    if excursion > 0 and band > settings.unclear * excursion:
        return FreePart(0, 0, n)
    held = _held_stretches(motion, band, settings)
    edges = [(0, 0), *held, (n, n)]
    swings = [
        (first, stop) for (_, first), (stop, _) in pairwise(edges) if _swings(motion, first, stop, band, settings)
    ]
    if not swings:
        raise RunError(
            f"{name}: the rods stand still throughout ({t[-1] - t[0]:.4g} s): a swing is needed. Check which columns"
            " are the rods' (--columns theta1=NAME,theta2=NAME), and the unit (--unit)"
        )
    if len(swings) > 1:
        origin = t[0] if motion.origin is None else motion.origin
        parts = "; ".join(f"--start-s {t[i] - origin:.5g} --duration-s {t[j - 1] - t[i]:.5g}" for i, j in swings)
        raise RunError(
            f"{name}: the rods are held between {len(swings)} motions. Import each as a run of its own: {parts}; if"
            " they were free, --keep-rest"
        )
    ((first, stop),) = swings
    rest = next((begin for begin, end in held if end == first), first)
    if first == 0:
        rest, first = 0, _short_rest(motion, band, settings)
    start = _onset(motion, rest, first, settings)
    return FreePart(rest, start, stop) if start - rest >= settings.fewest else FreePart(first, first, stop)


def free_part_of(run: Run, settings: HeldSettings = HELD) -> FreePart:
    """The part of a run in which the rods swing by themselves; errors as of `free_part`."""
    arm = run.theta[:, 0] if run.arm_mode != "clamped" else None
    return free_part(RodMotion(run.t, run.theta[:, 1:], run.torques, arm), str(run.file or run.name), settings)


def refuse_held(runs: Sequence[Run], settings: HeldSettings = HELD) -> None:
    """Make sure that no imported table holds rods that are held within its swing.

    Raises:
        RunError: the rods of one stand still throughout, or are held between several swings.
    """
    for run in runs:
        if run.keep_rest is False:
            free_part_of(run.swing, settings)


def rest_is_quiet(motion: RodMotion, part: FreePart, settings: HeldSettings = HELD) -> bool:
    """Whether the rest before the release shows the noise of the readings alone, not the tremble of a hand."""
    t, rods = motion.t[part.rest : part.start], motion.rods[part.rest : part.start]
    if len(t) < settings.fewest:
        return False
    line = np.vander(t - t.mean(), 2)
    spread = np.std(rods - line @ np.linalg.lstsq(line, rods, rcond=None)[0], axis=0)
    noise = np.sqrt(np.mean(np.diff(rods, axis=0) ** 2, axis=0) / 2)
    return bool((spread <= settings.restless * noise).all())


def still_band(motion: RodMotion, settings: HeldSettings = HELD) -> float:
    """Excursion of rods that counts as rest, rad."""
    excursion = float(np.ptp(motion.rods, axis=0).max()) if len(motion.t) else 0.0
    noise = float(_noise(motion, settings).max())
    return max(min(settings.still_rad, settings.of_motion * excursion), settings.noise * noise)


def _noise(motion: RodMotion, settings: HeldSettings) -> Array:
    """(2,) standard deviation of the readings, rad."""
    few = slice(settings.readings)
    return difference_std(motion.t[few], motion.rods[few]) if len(motion.t) > ORDER else np.zeros(2)


def _held_stretches(motion: RodMotion, band: float, settings: HeldSettings) -> list[tuple[int, int]]:
    """First sample, and one past the last, of each stretch in which the rods are held."""
    return [
        (first, stop)
        for first, stop in _still_stretches(motion, band, settings)
        if not (_known_input(motion, first, stop, band, settings))
        and (
            not _hangs(motion.rods[first:stop], settings) or (_free(motion) and _restarts(motion, stop, band, settings))
        )
    ]


def _highest(values: NDArray[Any], width: int) -> NDArray[Any]:
    """(n - width + 1, ...) maxima of windows of so many rows of (n, ...); those of half a width are combined."""
    if width == 1:
        return values
    half = -(-width // 2)
    of_halves = _highest(values, half)
    return np.maximum(of_halves[: len(of_halves) - width + half], of_halves[width - half :])


def _still_stretches(motion: RodMotion, band: float, settings: HeldSettings) -> list[tuple[int, int]]:
    n = len(motion.t)
    half_width = round(settings.stretch_s / float(np.median(np.diff(motion.t))) / 2)
    width = 2 * half_width + 1
    if not settings.fewest <= width <= n:
        return []
    ranges = _highest(motion.rods, width) + _highest(-motion.rods, width)
    still = np.pad(ranges.max(axis=1) <= band, 2 * half_width)
    inside = _highest(still, width)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    return [(int(first), int(stop)) for first, stop in edges.reshape(-1, 2)]


def _restarts(motion: RodMotion, stop: int, band: float, settings: HeldSettings) -> bool:
    """Whether rods that hang at rest swing later; a swing that decays does not."""
    later = motion.rods[stop:]
    return bool(len(later)) and float(np.ptp(later, axis=0).max()) > settings.restart * band


def _free(motion: RodMotion) -> bool:
    return motion.torques is None and motion.arm is None


def _hangs(rods: Array, settings: HeldSettings) -> bool:
    away = (np.median(rods, axis=0) + 2 * np.pi) % (2 * np.pi) - np.pi
    return bool((np.abs(away) <= settings.hanging_rad).all())


def _known_input(motion: RodMotion, first: int, stop: int, band: float, settings: HeldSettings) -> bool:
    """Whether a known torque acts in a stretch, or its arm moves."""
    pushed = False
    if motion.torques is not None:
        largest = np.abs(motion.torques).max(axis=1)
        pushed = bool(np.median(largest[first:stop]) > settings.driven_share * largest.max())
    return pushed or (motion.arm is not None and float(np.ptp(motion.arm[first:stop])) > band)


def _swings(motion: RodMotion, first: int, stop: int, band: float, settings: HeldSettings) -> bool:
    """Whether the rods move between two held stretches."""
    whole = first == 0 and stop == len(motion.t)
    if stop - first < (2 if whole else settings.fewest):
        return False
    moved = float(np.ptp(motion.rods[first:stop], axis=0).max())
    known = motion.torques is not None or motion.arm is not None
    return moved > settings.swing * band or (whole and known and moved > 0)


def _short_rest(motion: RodMotion, band: float, settings: HeldSettings) -> int:
    """Number of samples before the release in a rest at the beginning that is shorter than a stretch.

    Rods that are let go at t0 fall by alpha (t - t0)^2 / 2. The times t1 and t2 at which they have fallen by d and 4 d
    give t0 = 2 t1 - t2.
    """
    t, n = motion.t, len(motion.t)
    waits = not _free(motion) and _hangs(motion.rods[:1], settings)
    if n < 3 * settings.fewest or waits or band > settings.still_rad:
        return 0
    fallen = np.abs(motion.rods - motion.rods[: settings.fewest].mean(axis=0)).max(axis=1)
    seen = [int(np.argmax(fallen > depth)) for depth in (band, 4 * band)]
    if not 0 < seen[0] < seen[1]:
        return 0
    t1, t2 = (
        float(np.interp(depth, fallen[i - 1 : i + 1], t[i - 1 : i + 1])) - t[0]
        for depth, i in zip((band, 4 * band), seen, strict=True)
    )
    t0 = 2 * t1 - t2
    if t0 < max(settings.shortest_rest_s, settings.sure * (t1 - t0)):
        return 0
    samples = int(np.searchsorted(t, t[0] + t0))
    quiet = motion.rods[: max(2, int(0.8 * samples))]
    trembles = (np.ptp(quiet, axis=0) > settings.trembles * _noise(motion, settings)).any()
    if samples < settings.fewest or trembles or _known_input(motion, 0, samples, band, settings):
        return 0
    return samples


def _onset(motion: RodMotion, rest: int, first: int, settings: HeldSettings) -> int:
    """First sample of the motion, where the rods rest from sample `rest` on and have moved by `first`."""
    t, rods = motion.t, motion.rods
    if first - rest < settings.fewest:
        return first
    near = max(rest, int(np.searchsorted(t, t[first - 1] - settings.stretch_s)))
    quiet = rods[near : near + max(settings.fewest, (first - near) // 2)]
    away = np.abs(rods[near:first] - quiet.mean(axis=0))
    limit = np.maximum(settings.onset * quiet.std(axis=0), 1.5 * np.abs(quiet - quiet.mean(axis=0)).max(axis=0))
    resting = np.flatnonzero((away <= limit).all(axis=1))
    start = near + int(resting[-1]) + 1 if len(resting) else first
    if t[rest] < 0 <= t[start] <= settings.own_zero_s:
        return int(np.searchsorted(t, 0.0))
    return start
