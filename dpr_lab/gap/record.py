"""A run thinned for the diagnosis: block averages of what the encoders read, each with its own noise.

Averaging blocks of 5 ms keeps all that white encoder noise leaves to be known, and shifts a curved swing by
half its acceleration times the block's variance in time, which is taken off again:

    y = mean(theta) - alpha var(t) / 2
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.readings import started
from dpr_lab.errors import RunError
from dpr_lab.gap.screen import Screened, screen
from dpr_lab.rig import Rig
from dpr_lab.run import Run

RATE_HZ = 200.0
MIN_SAMPLES = 8  # of a segment: twice its start state
AFTER_RELEASE = 0.03  # the latch may still touch the rod, and a start state lies 20 ms before its segment
GAP_S = 0.03  # a longer hole ends a segment
_PARABOLA = np.array([5.0, 0.0, -3.0, -4.0, -3.0, 0.0, 5.0]) / 42
NEAR_S, FEWEST_NEAR = 0.03, 6  # readings that a start state is guessed from
ARM_MOVES = 5.0  # standard errors of an autocorrelation


@dataclass(frozen=True, slots=True)
class Record:
    """One run as the diagnosis sees it."""

    run: Run
    screened: Screened
    t: NDArray[np.float64]
    """(n,) since the release, s."""
    joints: NDArray[np.float64]
    """(n, 2) readings of the encoders of joint 1 and 2, rad; nan where none is to be trusted."""
    sigma: NDArray[np.float64]
    """(n, 2) standard deviation of each, rad."""
    breaks: NDArray[np.float64]
    """Instants no segment may span, s."""
    arm_moves: bool | None
    """Whether encoder 0 saw the arm move; none where it was not recorded."""


def record(run: Run, rig: Rig) -> Record:
    """Screen a run and thin it to about 200 Hz.

    Raises:
        RunError: fewer than `MIN_SAMPLES` samples after the release.
    """
    if (run.t >= AFTER_RELEASE).sum() < MIN_SAMPLES:
        raise RunError(f"{run.name}: fewer than {MIN_SAMPLES} samples after the release: nothing to diagnose")
    seen = screen(run, rig)
    t, joints, sigma = _blocks(seen, run.rate_hz)
    whole = np.isfinite(joints).all(axis=1) & (t >= AFTER_RELEASE)
    t, joints, sigma = t[whole], joints[whole], sigma[whole]
    holes = np.flatnonzero(np.diff(t) > GAP_S)
    breaks = np.sort(np.concatenate([[at for at, _ in seen.breaks], t[holes] + 1e-6]))
    return Record(run, seen, t, joints, sigma, breaks, _arm_moves(run))


def _blocks(seen: Screened, rate_hz: float) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Means over blocks of 1 / `RATE_HZ`; without dither only as many readings count as the rod passed counts."""
    if rate_hz < 1.5 * RATE_HZ:
        speed = np.gradient(seen.joints, seen.t, axis=0)
        sigma = np.sqrt(seen.noise**2 + (seen.jitter_s * speed) ** 2)
        return seen.t, np.where(seen.keep, seen.joints, np.nan), sigma
    number = np.floor(seen.t * RATE_HZ + 1e-6).astype(np.int64)
    edges = np.flatnonzero(np.diff(number, prepend=number[0] - 1))
    keep = seen.keep.all(axis=1).astype(float)
    kept = np.add.reduceat(keep, edges)
    with np.errstate(invalid="ignore", divide="ignore"):
        t = np.add.reduceat(keep * seen.t, edges) / kept
        mean = np.add.reduceat(keep[:, None] * seen.joints, edges) / kept[:, None]
        spread = np.add.reduceat(keep * (seen.t - np.repeat(t, np.diff(edges, append=len(keep)))) ** 2, edges) / kept
    good = kept >= 0.5 * np.median(kept)
    for at, _ in seen.breaks:
        good &= number[edges] != np.floor(at * RATE_HZ + 1e-6)
    t, mean, spread, kept = t[good], mean[good], spread[good], kept[good]
    speed = np.gradient(mean, t, axis=0)
    alpha = _curvature(mean)
    passed = 1 + np.abs(speed) / RATE_HZ / np.where(seen.count > 0, seen.count, np.inf)
    independent = np.where(seen.dithered, kept[:, None], np.minimum(kept[:, None], passed))
    sigma = np.sqrt(seen.noise**2 / independent + (seen.jitter_s * speed) ** 2 / kept[:, None])
    return t, mean - 0.5 * alpha * spread[:, None], sigma


def _curvature(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, m) second derivative at `RATE_HZ`, from the parabola through seven neighbours; the ends repeat theirs.

    Three neighbours would do for the swing, but would make the noise of one average that of the next.
    """
    if len(values) < len(_PARABOLA):
        return np.zeros_like(values)
    inner = np.stack([np.convolve(column, _PARABOLA, mode="valid") for column in values.T], axis=1)
    reach = len(_PARABOLA) // 2
    return np.pad(inner, ((reach, reach), (0, 0)), mode="edge") * RATE_HZ**2


def _arm_moves(run: Run) -> bool | None:
    """Whether neighbouring readings of encoder 0 move together, as noise does not."""
    swing = run.swing.theta[:, 0]
    if run.counts is None and np.ptp(swing) == 0.0:
        return None
    away = swing - swing.mean()
    power = float(np.mean(away**2))
    alike = float(np.mean(away[1:] * away[:-1]))
    return bool(power > 0.0 and alike > ARM_MOVES / np.sqrt(len(away)) * power)


def cuts(item: Record, length: float) -> list[slice]:
    """Stretches of about equal length between breaks that cover a record; those too short for a fit are left out."""
    edges = [0, *np.searchsorted(item.t, item.breaks).tolist(), len(item.t)]
    found: list[slice] = []
    for first, last in pairwise(edges):
        if last - first < MIN_SAMPLES:
            continue
        t = item.t[first:last]
        count = max(1, round((t[-1] - t[0]) / length))
        inner = first + np.searchsorted(t, np.linspace(t[0], t[-1], count + 1)[1:-1])
        bounds = [first, *inner.tolist(), last]
        found += [slice(i, j) for i, j in pairwise(bounds) if j - i >= MIN_SAMPLES]
    return found


def _between(breaks: NDArray[np.float64], t: float) -> tuple[float, float]:
    """The breaks before and after an instant."""
    after = int(np.searchsorted(breaks, t, side="right"))
    edges = [-np.inf, *breaks.tolist(), np.inf]
    return edges[after], edges[after + 1]


def start_states(item: Record, stretches: Sequence[slice], absolute: bool) -> NDArray[np.float64]:
    """States where the segments of stretches start, from a local cubic through the readings; at the release, at rest.

    Args:
        item: the record
        stretches: from `cuts`
        absolute: whether the encoder of joint 2 reads theta2 itself

    Returns:
        (stretches, 4) theta1, theta2, omega1, omega2, rad and rad/s
    """
    states = np.zeros((len(stretches), 4))
    for row, stretch in zip(states, stretches, strict=True):
        at = started(float(item.t[stretch.start]))
        if at == 0.0 and len(item.run.rest):
            row[:2] = item.run.rest[:, 1:].mean(axis=0)
            continue
        first, last = np.searchsorted(item.t, _between(item.breaks, float(item.t[stretch.start])))
        near = np.arange(first, last)[np.abs(item.t[first:last] - at) < NEAR_S]
        if len(near) < FEWEST_NEAR:
            near = np.arange(max(first, stretch.start - 4), min(last, stretch.start + FEWEST_NEAR))
        powers = np.vander(item.t[near] - at, 4, increasing=True)
        value, slope = np.linalg.lstsq(powers, item.joints[near], rcond=None)[0][:2]
        turn = np.zeros(2) if absolute else np.array([0.0, 1.0])
        row[:2], row[2:] = value + turn * value[0], slope + turn * slope[0]
    return states
