"""A run thinned for the diagnosis: block averages of what the encoders read, each with its own noise.

Averaging blocks of 5 ms keeps all that white encoder noise leaves to be known, and shifts a curved swing by
half its acceleration times the block's variance in time, which is taken off again:

    y = mean(theta) - alpha var(t) / 2

Where rods are so fast, or encoders so fine, that what this leaves is seen, the blocks are shorter.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.segments import STEP
from dpr_lab.errors import RunError
from dpr_lab.estimation.noise import rest_correlation
from dpr_lab.fitting.cut import MIN_SAMPLES, cut
from dpr_lab.gap.screen.sensor_faults import AXES, Finding, Screened, screen
from dpr_lab.rig import Rig
from dpr_lab.run import Run

Array = NDArray[np.float64]

RATE_HZ = 200.0
"""Of a thinned record: blocks of 5 ms, over which most swings are a parabola."""


@dataclass(frozen=True, slots=True)
class ThinningSettings:
    """What of a screened run is kept, and what is averaged."""

    after_release_s: float = 0.03
    """Start: before, the latch may still touch the rod, and an initial state lies 20 ms before its segment."""
    gap_s: float = 0.03
    """A longer hole ends a segment,"""
    gap_spacings: float = 1.5
    """or one of more than so many usual spacings, of a slow recording: a camera's frames are 33 ms apart."""
    averaged_from: float = 1.5
    """Times the blocks' rate: slower recordings are kept as they are."""
    bent: float = 0.092
    """Of (speed times a block)^4 rad: residual curvature bias of a block mean."""
    seen: float = 6.0
    """Largest such bias, in standard deviations of a block, at the highest speeds: 27 stood out, 7 did not."""
    fastest: float = 0.995
    """Quantile of the speed that counts as the highest."""
    turn: float = 0.1
    """Most that a rod may turn in a step of the integrator, rad."""
    least_kept: float = 0.5
    """Share of the usual number of trusted readings that a block must hold."""
    arm_moves: float = 5.0
    """Standard errors of the autocorrelation of neighbours, above which encoder 0 saw the arm move."""


THINNING = ThinningSettings()


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
    noise_correlation: float
    """Of the errors of neighbouring readings, seen at rest: what a filter or a tracker leaves."""
    step: float
    """Longest step for an integrator that follows these rods, s."""

    def without(self, t: Array, off: NDArray[np.bool_]) -> "Record":
        """Without the readings of some instants t (n,), each with a finding for the axes that are off, (n, 2)."""
        evidence = "one reading off the swing that fits all others"
        findings = [
            Finding("outlier", self.run.name, AXES[axis], float(t[i]), evidence)
            for i, axis in np.argwhere(off).tolist()
        ]
        kept = self.only(~np.isin(self.t, t[off.any(axis=1)]))
        return replace(kept, screened=replace(self.screened, findings=(*self.screened.findings, *findings)))

    def only(self, some: slice | NDArray[np.bool_]) -> "Record":
        """Some of its readings."""
        return replace(self, t=self.t[some], joints=self.joints[some], sigma=self.sigma[some])


def record(run: Run, rig: Rig, settings: ThinningSettings = THINNING) -> Record:
    """Screen a run and thin it to about 200 Hz.

    Raises:
        RunError: fewer samples after the release, or in a row, than a segment needs.
    """
    if (run.t >= settings.after_release_s).sum() < MIN_SAMPLES:
        raise RunError(f"{run.name}: fewer than {MIN_SAMPLES} samples after the release: nothing to diagnose")
    seen = screen(run, rig)
    run = seen.run
    fastest = _fastest(seen, settings.fastest)
    rate_hz = _block_rate(seen, fastest, run.rate_hz, settings)
    t, joints, sigma = _as_read(seen) if rate_hz is None else _blocks(seen, rate_hz, settings.least_kept)
    whole = np.isfinite(joints).all(axis=1) & (t >= settings.after_release_s)
    t, joints, sigma = t[whole], joints[whole], sigma[whole]
    apart = np.diff(t)
    usual = float(np.median(apart)) if len(apart) else 0.0
    holes = np.flatnonzero(apart > max(settings.gap_s, settings.gap_spacings * usual))
    breaks = np.sort(np.concatenate([[at for at, _ in seen.breaks], t[holes] + 1e-6]))
    if not cut(t, np.inf, breaks):
        raise RunError(f"{run.name}: nowhere {MIN_SAMPLES} trusted samples without a gap: nothing to diagnose")
    step = min(STEP, settings.turn / max(fastest, 1e-3))
    thinned = max(1, round(run.rate_hz / (rate_hz or run.rate_hz)))
    correlation = float(rest_correlation(run, rig, thinned).mean())
    return Record(run, seen, t, joints, sigma, breaks, _arm_moves(run, settings.arm_moves), correlation, step)


def _fastest(seen: Screened, quantile: float) -> float:
    """Highest speed of a joint, rad/s, over spacings of a block: noise and single faults make none."""
    t, trusted = seen.t, seen.keep.all(axis=1)
    apart = max(1, round(1 / RATE_HZ / float(np.median(np.diff(t)))))
    some, at = seen.joints[trusted][::apart], t[trusted][::apart]
    if len(at) < 2:
        return 0.0
    return float(np.quantile(np.abs(np.diff(some, axis=0) / np.diff(at)[:, None]), quantile, axis=0).max())


def _block_rate(seen: Screened, fastest: float, rate_hz: float, settings: ThinningSettings) -> float | None:
    """The lowest rate at which a block's mean is as good as its noise, twice `RATE_HZ` and so on; none: as read."""
    blocks = RATE_HZ
    while rate_hz >= settings.averaged_from * blocks:
        noise = np.sqrt(seen.noise**2 * blocks / rate_hz + (seen.jitter_s * fastest) ** 2).min()
        if settings.bent * (fastest / blocks) ** 4 <= settings.seen * noise:
            return blocks
        blocks *= 2
    return None


def _as_read(seen: Screened) -> tuple[Array, Array, Array]:
    """Instants, readings (nan where none is to be trusted) and their standard deviations."""
    speed = np.gradient(seen.joints, seen.t, axis=0)
    sigma = np.sqrt(seen.noise**2 + (seen.jitter_s * speed) ** 2)
    return seen.t, np.where(seen.keep, seen.joints, np.nan), sigma


def _blocks(seen: Screened, rate_hz: float, least_kept: float) -> tuple[Array, Array, Array]:
    """Means over blocks of 1 / `rate_hz`; without dither only as many readings count as the rod passed counts."""
    number = np.floor(seen.t * rate_hz + 1e-6).astype(np.int64)
    edges = np.flatnonzero(np.diff(number, prepend=number[0] - 1))
    keep = seen.keep.all(axis=1).astype(float)
    kept = np.add.reduceat(keep, edges)
    with np.errstate(invalid="ignore", divide="ignore"):
        t = np.add.reduceat(keep * seen.t, edges) / kept
        mean = np.add.reduceat(keep[:, None] * seen.joints, edges) / kept[:, None]
        spread = np.add.reduceat(keep * (seen.t - np.repeat(t, np.diff(edges, append=len(keep)))) ** 2, edges) / kept
    good = (kept > 0) & (kept >= least_kept * np.median(kept))
    for at, _ in seen.breaks:
        good &= number[edges] != np.floor(at * rate_hz + 1e-6)
    t, mean, spread, kept = t[good], mean[good], spread[good], kept[good]
    speed = np.gradient(mean, t, axis=0)
    passed = 1 + np.abs(speed) / rate_hz / np.where(seen.count > 0, seen.count, np.inf)
    independent = np.where(seen.dithered, kept[:, None], np.minimum(kept[:, None], passed))
    sigma = np.sqrt(seen.noise**2 / independent + (seen.jitter_s * speed) ** 2 / kept[:, None])
    return t, mean - 0.5 * _curvature(t, mean, rate_hz) * spread[:, None], sigma


def _curvature(t: Array, values: Array, rate_hz: float) -> Array:
    """(n, m) second derivative at a rate, from the parabola through seven neighbours.

    The ends of what is even repeat theirs, and stretches too short for one have none.

    Three neighbours would do for the swing, but would make the noise of one average that of the next.

    Source: Savitzky & Golay (1964), Smoothing and differentiation of data, Anal. Chem. 36, 1627-1639.
    """
    parabola = np.array([5.0, 0.0, -3.0, -4.0, -3.0, 0.0, 5.0]) / 42
    reach, found = len(parabola) // 2, np.zeros_like(values)
    holes = np.flatnonzero(np.diff(t) * rate_hz > 1.5) + 1
    for first, last in pairwise([0, *holes.tolist(), len(values)]):
        if last - first >= len(parabola):
            columns = [np.convolve(column, parabola, mode="valid") for column in values[first:last].T]
            found[first:last] = np.pad(np.stack(columns, axis=1), ((reach, reach), (0, 0)), mode="edge")
    return found * rate_hz**2


def _arm_moves(run: Run, standard_errors: float) -> bool | None:
    """Whether neighbouring readings of encoder 0 move together, as noise does not."""
    swing = run.swing.theta[:, 0]
    if run.arm_read is False or (run.counts is None and np.ptp(swing) == 0.0):
        return None
    away = swing - swing.mean()
    power = float(np.mean(away**2))
    alike = float(np.mean(away[1:] * away[:-1]))
    return bool(power > 0.0 and alike > standard_errors / np.sqrt(len(away)) * power)
