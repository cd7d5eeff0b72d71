"""Preprocessed run: block means of the readings, with their noise.

The average over a block of 5 ms keeps all information if the encoder noise is white. In a curved swing the average is
shifted by half the acceleration alpha times the variance of the block's times. This shift is subtracted:

    y = mean(theta) - alpha var(t) / 2

The blocks are shorter if the remaining bias is significant, that is, for fast rods or fine encoders.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.dynamics.segments import STEP
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.errors import RunError
from dpr_lab.estimation.noise import NOISE, noise_floor, rest_correlation
from dpr_lab.fitting.cut import MIN_SAMPLES, cut
from dpr_lab.gap.result.finding import SensorFinding
from dpr_lab.gap.screen.sensor_faults import ALL_AXES, SCREEN, Screened, jitter_of, screen, with_arm
from dpr_lab.gap.screen.shutter import RollingShutter
from dpr_lab.identification.moving_arm.setup import setup_of
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.setup import Setup

AFTER_READING_S = 1e-6
"""Time from the last reading before an interruption to its break, s; shorter than any sampling interval."""

RATE_HZ = 200.0
"""Lowest block rate of averaged readings, Hz; over a block of 5 ms, most angles are parabolas in time."""


@dataclass(frozen=True, slots=True)
class ThinningSettings:
    """Settings of the selection and the averaging of readings."""

    after_release_s: float = 0.03
    """Time of the first reading that is used, s after the release.

    Before this time, the latch may touch the rod. The initial state of a segment lies 20 ms before its first reading.
    """
    gap_s: float = 0.03
    """Longest interruption that a segment may contain, s."""
    gap_spacings: float = 4.5
    """Longest interruption within a segment, in median sampling intervals, for slow recordings.

    The larger of the two limits applies. The frames of a camera are 33 ms apart, and a few of them may be lost.
    """
    averaged_from: float = 1.5
    """Ratio of the sampling rate to the block rate from which readings are averaged."""
    bent: float = 0.092
    """Coefficient of (speed times block length)^4 in the remaining curvature bias of a block mean, rad."""
    most_bias: float = 6.0
    """Maximum bias at the highest speeds, in standard deviations of a block mean. A bias of 27 was significant, a bias
    of 7 was not."""
    fastest: float = 0.995
    """Quantile of the speed that counts as the highest speed."""
    turn: float = 0.1
    """Maximum rotation of a rod in one step of the integrator, rad."""
    least_kept: float = 0.5
    """Minimum number of trusted readings in a block, relative to the median number."""
    distinct: float = 0.6
    """Fraction of distinct values among the differences of neighbouring readings below which the readings have a fixed
    step."""
    arm_moves: float = 5.0
    """Maximum lag-1 autocorrelation of encoder 0 for an arm that counts as at rest, in standard errors."""


THINNING = ThinningSettings()


@dataclass(frozen=True, slots=True)
class Record:
    """A preprocessed run, the input of the diagnosis."""

    run: Run
    screened: Screened
    t: Array
    """(n,) time since the release, s."""
    joints: Array
    """(n, 2) readings of the encoders of joints 1 and 2, rad; nan where a reading is not trusted."""
    sigma: Array
    """(n, 2) standard deviation of each reading, rad."""
    breaks: Array
    """Instants that no segment may span, s."""
    encoder0_moves: bool | None
    """Whether the arm moved according to encoder 0; None if encoder 0 was not recorded."""
    noise_correlation: float
    """Autocorrelation of the errors of neighbouring readings at rest, caused by a filter or a tracker."""
    step: float
    """Maximum step of the integrator for these rods, s."""
    setup: Setup
    """Mounted rods, known torques, and motion of the arm."""
    kicks: Array = field(default_factory=lambda: np.zeros(0))
    """Instants at which the rods were kicked, s; no free run continues across a kick."""
    shown: Array | None = None
    """(n, 2) readings before the correction of a rolling shutter, rad; None if no correction was made."""

    @property
    def readings(self) -> int:
        """Number of trusted readings of all joints, without those of an absent rod."""
        return int(np.count_nonzero(np.isfinite(self.joints) & np.isfinite(self.sigma)))

    @property
    def may_be_film(self) -> bool:
        """Whether the readings may come from a video.

        A film shows an undriven swing, and its angles have no fixed step.
        """
        run = self.run
        encoder = run.counts is not None or run.rate_hz >= SCREEN.colour_hz or self._rounded or self._counted
        return self.setup.free and not self.setup.arm_moves and (run.film_noise is not None or not encoder)

    @property
    def noise_measured(self) -> bool:
        """Whether the noise was measured, at rest or from the rod lengths in a video."""
        return self.run.film_noise is not None or len(self.run.rest) >= NOISE.rest_samples

    @property
    def _rounded(self) -> bool:
        """Whether differences of neighbouring readings take few values, as for a coarse encoder."""
        changes = np.round(np.diff(self.screened.joints[:, np.isfinite(self.screened.noise)], axis=0), 7)
        return any(len(np.unique(joint)) < THINNING.distinct * len(joint) for joint in changes.T)

    @property
    def _counted(self) -> bool:
        """Whether the readings of all rods differ by whole counts of the encoders in the rig file."""
        return bool(self.screened.on_grid[:2][np.isfinite(self.screened.noise[:2])].all())

    def with_shutter(self, shutter: RollingShutter, constants: RigConstants) -> "Record":
        """Correct the record for a rolling shutter.

        The correction replaces any previous one.
        """
        shown = self.joints if self.shown is None else self.shown
        joints = shutter.corrected(self.t, shown, constants, alone=self.setup.alone)
        return replace(self, joints=joints, shown=shown)

    def with_finding(self, name: str, evidence: str) -> "Record":
        """Add a fault of the whole run; it replaces a fault of the same name."""
        others = [finding for finding in self.screened.findings if finding.name != name]
        finding = SensorFinding(name, self.run.name, None, None, evidence)
        return replace(self, screened=replace(self.screened, findings=(*others, finding)))

    def without(self, t: Array, off: Flags) -> "Record":
        """Return a copy without outliers, with a finding for each of them.

        Args:
            t: (n,) times, s
            off: (n, axes) mask of the outliers
        """
        evidence = "an outlier: the model fits all other readings"
        findings = [
            SensorFinding("outlier", self.run.name, ALL_AXES[axis], float(t[i]), evidence)
            for i, axis in np.argwhere(off).tolist()
        ]
        return self.only(~np.isin(self.t, t[off.any(axis=1)])).with_findings(findings)

    def left_out(self, since: float, until: float) -> "Record":
        """Return a copy without the readings from `since` to `until`, s.

        No segment and no free run spans a finite end of this interval.
        """
        inside = (self.t >= since) & (self.t < until)
        edges = [edge for edge in (since, until) if np.isfinite(edge)]
        return replace(
            self.only(~inside), breaks=np.sort(np.append(self.breaks, edges)), kicks=np.append(self.kicks, edges)
        )

    def with_findings(self, findings: Iterable[SensorFinding]) -> "Record":
        """Return the record with additional findings."""
        return replace(self, screened=replace(self.screened, findings=(*self.screened.findings, *findings)))

    def only(self, samples: slice | Flags) -> "Record":
        """Return the record with only the selected samples."""
        shown = None if self.shown is None else self.shown[samples]
        return replace(self, t=self.t[samples], joints=self.joints[samples], sigma=self.sigma[samples], shown=shown)


def record(run: Run, rig: Rig) -> Record:
    """Preprocess a run: screen it, and average its readings over blocks.

    Raises:
        RunError: too few readings follow the release, or no sequence without an interruption is long enough.
    """
    if (run.t >= THINNING.after_release_s).sum() < MIN_SAMPLES:
        raise RunError(f"{run.name}: fewer than {MIN_SAMPLES} samples after the release: nothing to diagnose")
    screened = _screen_edges(run, rig) if run.at_edges else screen(run, rig)
    setup = setup_of(screened.run, rig)
    if setup.arm_moves:
        screened = with_arm(screened, rig)
    run, least_kept = screened.run, 0.0 if run.at_edges else THINNING.least_kept
    fastest = _fastest(screened)
    rate_hz = _block_rate(screened, fastest, run.rate_hz)
    t, joints, sigma = _as_read(screened) if rate_hz is None else _blocks(screened, rate_hz, least_kept)
    valid = np.isfinite(joints).all(axis=1) & (t >= THINNING.after_release_s)
    t, joints, sigma = t[valid], joints[valid], sigma[valid]
    interruptions = np.flatnonzero(~without_gap(run, t))
    breaks = np.sort(np.concatenate([[instant for instant, _ in screened.breaks], t[interruptions] + AFTER_READING_S]))
    if not cut(t, np.inf, breaks):
        raise RunError(
            f"{run.name}: no sequence of {MIN_SAMPLES} valid samples without an interruption: nothing to diagnose"
        )
    step = min(STEP, THINNING.turn / max(fastest, 1e-3))
    thinned = max(1, round(run.rate_hz / (rate_hz or run.rate_hz)))
    correlation = float(rest_correlation(run, rig, thinned).mean())
    moves = True if setup.arm_moves else _arm_moves(run)
    return Record(run, screened, t, joints, sigma, breaks, moves, correlation, step, setup)


def without_gap(run: Run, t: Array) -> Flags:
    """Return the (n - 1,) mask of the intervals without missing readings.

    The intervals are those between the (n,) times t, s. In a run with one row for each count, the intervals depend on
    the speed, so that no interval counts as an interruption.
    """
    intervals = np.diff(t)
    if run.at_edges or not len(intervals):
        return np.ones(len(intervals), dtype=np.bool_)
    longest = max(THINNING.gap_s, THINNING.gap_spacings * float(np.median(intervals)))
    return intervals <= longest


def _screen_edges(run: Run, rig: Rig) -> Screened:
    """Screen a run that has one row for each count (`dpr_lab.estimation.counted_rows`).

    The rows of such a run are not evenly spaced in time, and neighbouring rows differ by one count. Tests for missing
    rows, steps, outliers, and late or repeated readings presume an even clock and are omitted. Only the timing error is
    estimated.
    """
    t, noise = run.swing.t, noise_floor(run, rig).std_joint
    joints = rig.encoders.joint_angles.of_rods(run.swing.theta[:, 1:])
    jitter, findings = jitter_of(run, t, joints, noise)
    return Screened(
        run=run,
        t=t,
        joints=joints,
        keep=np.ones(joints.shape, dtype=np.bool_),
        breaks=(),
        noise=np.array([noise[0], np.inf]) if run.setup.alone else noise,
        jitter_s=jitter,
        count=np.zeros(2),
        dithered=np.ones(2, dtype=np.bool_),
        shared=np.ones(joints.shape),
        on_grid=np.zeros(2, dtype=np.bool_),
        findings=tuple(findings),
    )


def _fastest(screened: Screened) -> float:
    """Return a high quantile of the speeds of the joints, rad/s.

    Each speed is a difference over one block, so that noise has little influence.
    """
    t, trusted = screened.t, screened.keep.all(axis=1)
    stride = max(1, round(1 / RATE_HZ / float(np.median(np.diff(t)))))
    joints, instants = screened.joints[trusted][::stride], t[trusted][::stride]
    if len(instants) < 2:
        return 0.0
    return float(
        np.quantile(np.abs(np.diff(joints, axis=0) / np.diff(instants)[:, None]), THINNING.fastest, axis=0).max()
    )


def _block_rate(screened: Screened, fastest: float, rate_hz: float) -> float | None:
    """Return the lowest block rate, Hz, at which the bias of a mean is acceptable (`THINNING.most_bias`).

    The rate is `RATE_HZ` times a power of two. It is None if the readings must not be averaged.
    """
    blocks = RATE_HZ
    while rate_hz >= THINNING.averaged_from * blocks:
        noise = np.sqrt(screened.noise**2 * blocks / rate_hz + (screened.jitter_s * fastest) ** 2).min()
        if THINNING.bent * (fastest / blocks) ** 4 <= THINNING.most_bias * noise:
            return blocks
        blocks *= 2
    return None


def _as_read(screened: Screened) -> tuple[Array, Array, Array]:
    """Return times, readings and standard deviations without averaging.

    A reading that is not trusted is nan.
    """
    speed = np.gradient(screened.joints, screened.t, axis=0)
    sigma = np.sqrt(screened.noise**2 * screened.shared + (screened.jitter_s * speed) ** 2)
    return screened.t, np.where(screened.keep, screened.joints, np.nan), sigma


def _blocks(screened: Screened, rate_hz: float, least_kept: float) -> tuple[Array, Array, Array]:
    """Average times and readings over blocks; return the means and their standard deviations.

    A block lasts 1 / `rate_hz`, s. If the rounding errors are not independent (no dither), the standard deviations are
    larger.
    """
    number = np.floor(screened.t * rate_hz + 1e-6).astype(np.int64)
    edges = np.flatnonzero(np.diff(number, prepend=number[0] - 1))
    keep = screened.keep.all(axis=1).astype(float)
    counts = np.add.reduceat(keep, edges)
    with np.errstate(invalid="ignore", divide="ignore"):
        t = np.add.reduceat(keep * screened.t, edges) / counts
        mean = np.add.reduceat(keep[:, None] * screened.joints, edges) / counts[:, None]
        spread = (
            np.add.reduceat(keep * (screened.t - np.repeat(t, np.diff(edges, append=len(keep)))) ** 2, edges) / counts
        )
    good = (counts > 0) & (counts >= least_kept * np.median(counts))
    for instant, _ in screened.breaks:
        good &= number[edges] != np.floor(instant * rate_hz + 1e-6)
    t, mean, spread, counts = t[good], mean[good], spread[good], counts[good]
    speed = np.gradient(mean, t, axis=0) if len(t) > 1 else np.zeros_like(mean)
    passed = 1 + np.abs(speed) / rate_hz / np.where(screened.count > 0, screened.count, np.inf)
    different = np.add.reduceat(keep[:, None] / screened.shared, edges)[good]
    independent = np.where(screened.dithered, different, np.minimum(different, passed))
    sigma = np.sqrt(screened.noise**2 / independent + (screened.jitter_s * speed) ** 2 / counts[:, None])
    return t, mean - 0.5 * _curvature(t, mean, rate_hz) * spread[:, None], sigma


def _curvature(t: Array, values: Array, rate_hz: float) -> Array:
    """Estimate the (n, m) second derivative of (n, m) values from parabolas.

    Each parabola is fitted to seven neighbouring values at the rate `rate_hz`, Hz. At the ends of a sequence without
    interruptions, the nearest estimate is repeated; in sequences of fewer than seven values, the derivative is zero.
    Three values would suffice for the swing, but would correlate the noise of neighbouring averages.

    Source: Savitzky & Golay (1964), Smoothing and differentiation of data, Anal. Chem. 36, 1627-1639.
    """
    parabola = np.array([5.0, 0.0, -3.0, -4.0, -3.0, 0.0, 5.0]) / 42
    reach, curvature = len(parabola) // 2, np.zeros_like(values)
    interruptions = np.flatnonzero(np.diff(t) * rate_hz > 1.5) + 1
    for first, last in pairwise([0, *interruptions.tolist(), len(values)]):
        if last - first >= len(parabola):
            columns = [np.convolve(column, parabola, mode="valid") for column in values[first:last].T]
            curvature[first:last] = np.pad(np.stack(columns, axis=1), ((reach, reach), (0, 0)), mode="edge")
    return curvature * rate_hz**2


def _arm_moves(run: Run) -> bool | None:
    """Return whether the arm moves, or None if encoder 0 was not recorded.

    Neighbouring readings of a moving arm are correlated; white noise is not.
    """
    swing = run.swing.theta[:, 0]
    if run.arm_read is False or (run.counts is None and np.ptp(swing) == 0.0):
        return None
    deviation = swing - swing.mean()
    power = float(np.mean(deviation**2))
    covariance = float(np.mean(deviation[1:] * deviation[:-1]))
    return bool(power > 0.0 and covariance > THINNING.arm_moves / np.sqrt(len(deviation)) * power)
