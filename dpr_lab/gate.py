"""The quality gate: what a recording must show before anything is fitted to it.

A run that fails a check is kept and marked, never thrown away: `degraded`, with the reasons.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.rig import Pose, Rig
from dpr_lab.run import Run

REST_WINDOW_S = 1.0
MAX_REST_SPEED = 0.02  # rad/s; a rod held by hand drifts faster, one held by the latch does not
MAX_REST_SPREAD_FLOOR_COUNTS = 2.0
REST_SPREAD_OVER_NOISE = 4.0
RELEASE_WINDOW_S = 0.02
MIN_RELEASE_SAMPLES = 8
MAX_RELEASE_SPEED = 0.2  # rad/s; the fit over 20 ms is itself uncertain by about 0.03 rad/s
MAX_LOST_SHARE = 1e-3
MAX_GAP_PERIODS = 10
MAX_JITTER_PERIODS = 0.05
SPEED_MARGIN = 1.5
SIGMAS = 5.0  # what coarse counts may add to a speed is nobody's push and no jump
MIN_TRAVEL_COUNTS = 16
MAX_HANG_ERROR = 0.02  # rad; dry friction of a small bearing holds a rod within a milliradian of hanging
RODS = ("inner rod", "outer rod")


@dataclass(frozen=True, slots=True)
class Check:
    """One question put to a recording, and its answer."""

    name: str
    ok: bool
    measured: float
    limit: float
    unit: str
    sentence: str
    """What was found and, where the check failed, what to do."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The gate's answer: every check that could be made."""

    checks: tuple[Check, ...]
    notes: tuple[str, ...] = ()
    """What to know about the recording although no check fails by it."""

    @property
    def ok(self) -> bool:
        """Whether every check passed."""
        return all(check.ok for check in self.checks)

    @property
    def reasons(self) -> tuple[str, ...]:
        """The sentences of the checks that failed."""
        return tuple(check.sentence for check in self.checks if not check.ok)

    @property
    def sentence(self) -> str:
        """`ok`, or `degraded` with the reasons; and the notes."""
        return "; ".join(["ok" if self.ok else f"degraded: {'; '.join(self.reasons)}", *self.notes])

    def to_json(self) -> dict[str, Any]:
        """The verdict as plain JSON values."""
        return {"ok": self.ok, "checks": [asdict(check) for check in self.checks], "notes": list(self.notes)}


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the checks look at."""

    run: Run
    rig: Rig
    pose: Pose | None
    duration: float
    """How long the recording was asked to be, s."""
    hanging: tuple[float, float] | None = None
    """How far the rods hung off straight down before they were raised, rad."""


def judge(run: Run, rig: Rig, duration: float = 0.0, hanging: tuple[float, float] | None = None) -> Verdict:
    """Put a recording through every check that applies to it.

    Args:
        run: the recording; its time starts at the release
        rig: the rig it was recorded on, for the pose, the noise and the fastest speed possible
        duration: how long it was asked to be, s; 0 when that was open
        hanging: how far the rods hung off straight down before they were raised, rad; None when that was not seen

    Returns:
        The verdict. A check without data to judge, such as the rest of an imported table, is left out.
    """
    pose = rig.poses.get(run.pose) if run.pose is not None else None
    evidence = Evidence(run, rig, pose, duration, hanging)
    return Verdict(tuple(check for question in CHECKS if (check := question(evidence)) is not None))


def rest_motion(t: NDArray[np.float64], theta: NDArray[np.float64]) -> tuple[float, float]:
    """How much the rods moved while held.

    Args:
        t: (n,) time, s
        theta: (n, 3) angles, rad

    Returns:
        Fastest drift of a rod (slope of a straight line), rad/s, and widest spread about that line (rms), rad.
    """
    time = t - t.mean()
    rods = theta[:, 1:] - theta[:, 1:].mean(axis=0)
    slope = time @ rods / max(float(time @ time), np.finfo(float).tiny)
    spread = np.sqrt(np.mean((rods - np.outer(time, slope)) ** 2, axis=0))
    return float(np.abs(slope).max()), float(spread.max())


def pose_error(theta: NDArray[np.float64], pose: Pose) -> NDArray[np.float64]:
    """How far the rods are from a pose, whole turns aside.

    Args:
        theta: (..., 3) absolute angles, rad
        pose: the pose asked for

    Returns:
        (..., 2) signed error of inner and outer rod in [-pi, pi), rad
    """
    return (theta[..., 1:] - pose.theta[1:] + np.pi) % (2 * np.pi) - np.pi


def rest_spread_limit(rig: Rig) -> float:
    """The widest spread of a rod at rest: a few times the encoder noise, at least two counts, rad."""
    counts = max(REST_SPREAD_OVER_NOISE * rig.encoders.noise_counts, MAX_REST_SPREAD_FLOOR_COUNTS)
    return counts * float(np.abs(rig.radians_per_count[1:]).max())


def fastest_possible(rig: Rig) -> NDArray[np.float64]:
    """(2,) the fastest the rods can turn when let go at rest from anywhere, rad/s.

    All potential energy E = 2 (e1 + e2) in one rod: omega_i^2 = 2 E (M^-1)_ii, largest with the rods in line,
    where M^-1 = [b, a] / (a b - d^2) on its diagonal.
    """
    a, b, d, e1, _, _ = base_parameters(rig.nominal, rig.rig.L1, rig.rig.g)
    energy = 2 * (e1 + d * rig.rig.g / rig.rig.L1)
    return np.sqrt(2 * energy * np.array([b, a]) / (a * b - d * d))


def _rest(evidence: Evidence) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    run = evidence.run
    window = (run.t < 0) & (run.t >= -REST_WINDOW_S)
    return (run.t[window], run.theta[window]) if np.count_nonzero(window) >= MIN_RELEASE_SAMPLES else None


def _hanging_before(evidence: Evidence) -> Check | None:
    """Where the rods hung before they were raised: a wrong zero, or counts lost before, show there."""
    if evidence.hanging is None:
        return None
    error = np.abs(evidence.hanging)
    rod, worst = RODS[int(error.argmax())], float(error.max())
    sentence = (
        f"before it was raised the {rod} hung {worst:.3f} rad off straight down (limit {MAX_HANG_ERROR}):"
        " lost counts, or a wrong zero in the rig file"
    )
    return Check("hanging_before", worst <= MAX_HANG_ERROR, worst, MAX_HANG_ERROR, "rad", sentence)


def _rest_speed(evidence: Evidence) -> Check | None:
    rest = _rest(evidence)
    if rest is None:
        return None
    speed, _ = rest_motion(*rest)
    sentence = f"before the release the rods drifted at {speed:.3f} rad/s (limit {MAX_REST_SPEED}): hold them still"
    return Check("rest_speed", speed <= MAX_REST_SPEED, speed, MAX_REST_SPEED, "rad/s", sentence)


def _rest_spread(evidence: Evidence) -> Check | None:
    rest = _rest(evidence)
    if rest is None:
        return None
    _, spread = rest_motion(*rest)
    limit = rest_spread_limit(evidence.rig)
    sentence = f"before the release the rods shook by {spread:.5f} rad rms (limit {limit:.5f}): let them settle"
    return Check("rest_spread", spread <= limit, spread, limit, "rad", sentence)


def _pose(evidence: Evidence) -> Check | None:
    rest = _rest(evidence)
    if rest is None or evidence.pose is None:
        return None
    error = np.abs(pose_error(rest[1], evidence.pose)).mean(axis=0)
    rod, worst, limit = RODS[int(error.argmax())], float(error.max()), evidence.pose.tolerance
    sentence = f"the {rod} was {worst:.3f} rad off the pose (limit {limit}): place it closer"
    return Check("pose", worst <= limit, worst, limit, "rad", sentence)


def _release_speed(evidence: Evidence) -> Check | None:
    """The speed w of theta(t) = theta_rest + w t + alpha t^2 / 2 over the first 20 ms, theta_rest over those before."""
    rest, swing = _rest(evidence), evidence.run.swing
    if rest is None or len(swing.t) < MIN_RELEASE_SAMPLES:
        return None
    n = max(MIN_RELEASE_SAMPLES, int(np.searchsorted(swing.t, RELEASE_WINDOW_S)))
    t, rods = swing.t[:n], swing.theta[:n, 1:] - rest[1][-n:, 1:].mean(axis=0)
    A = np.stack([t, t * t / 2], axis=1)
    coefficients, *_ = np.linalg.lstsq(A, rods, rcond=None)
    speed = float(np.abs(coefficients[0]).max())
    uncertain = float(_reading_std(evidence.rig).max() * np.sqrt(np.linalg.pinv(A.T @ A)[0, 0]))
    limit = max(MAX_RELEASE_SPEED, SIGMAS * uncertain)
    sentence = f"the rods left at {speed:.2f} rad/s (limit {limit:.2g}): let go without a push"
    return Check("release_speed", speed <= limit, speed, limit, "rad/s", sentence)


def _reading_std(rig: Rig) -> NDArray[np.float64]:
    """(2,) standard deviation of a reading of either rod, noise and rounding, rad."""
    return np.abs(rig.radians_per_count[1:]) * np.sqrt(rig.encoders.noise_counts**2 + 1 / 12)


def _lost(evidence: Evidence) -> Check | None:
    run = evidence.run
    lost = {cause: n for cause, n in run.lost.items() if n}
    share = sum(lost.values()) / max(1, len(run.t) + sum(lost.values()))
    causes = ", ".join(f"{cause} {n}" for cause, n in lost.items()) or "none"
    sentence = f"lost by cause: {causes}, {100 * share:.2f} % of the samples (limit {100 * MAX_LOST_SHARE:g} %)"
    return Check("lost", share <= MAX_LOST_SHARE, share, MAX_LOST_SHARE, "1", sentence + ": check cable and rate")


def _gap(evidence: Evidence) -> Check | None:
    steps = np.diff(evidence.run.t) * evidence.run.rate_hz
    if not len(steps):
        return None
    worst = float(steps.max()) - 1
    sentence = f"the longest gap misses {worst:.0f} samples in a row (limit {MAX_GAP_PERIODS}): check cable and rate"
    return Check("gap", worst <= MAX_GAP_PERIODS, worst, MAX_GAP_PERIODS, "samples", sentence)


def _jitter(evidence: Evidence) -> Check | None:
    """How unevenly the samples were taken; the device's clock alone counts, not when they arrived."""
    periods = evidence.run.t * evidence.run.rate_hz
    if not len(periods):
        return None
    off = periods - periods[0]
    jitter = float(np.sqrt(np.mean((off - np.round(off)) ** 2)))
    sentence = f"the samples are off their grid by {jitter:.3f} periods rms (limit {MAX_JITTER_PERIODS}): uneven clock"
    return Check("jitter", jitter <= MAX_JITTER_PERIODS, jitter, MAX_JITTER_PERIODS, "periods", sentence)


def _jumps(evidence: Evidence) -> Check | None:
    run = evidence.run
    if len(run.t) < 2:
        return None
    turned = np.abs(np.diff(run.theta[:, 1:], axis=0)) - SIGMAS * np.sqrt(2) * _reading_std(evidence.rig)
    speed = np.maximum(turned, 0.0) / np.diff(run.t)[:, np.newaxis]
    share = (speed / (SPEED_MARGIN * fastest_possible(evidence.rig))).max(axis=0)
    rod, worst = RODS[int(share.argmax())], float(share.max())
    sentence = f"the {rod} jumps at {worst:.1f} times the fastest speed possible: check encoder and its wiring"
    return Check("jumps", worst <= 1.0, worst, 1.0, "1", sentence)


def _moved(evidence: Evidence) -> Check | None:
    """Whether both joints turned; in counts, since with a relative encoder 2 theta2 moves along with theta1."""
    swing = evidence.run.swing
    if len(swing.t) < MIN_RELEASE_SAMPLES:
        return None
    counts = evidence.rig.positions(swing.theta) if swing.counts is None else swing.counts
    travel = np.ptp(counts, axis=0)[1:]
    joint, least = 1 + int(travel.argmin()), float(travel.min())
    sentence = f"encoder {joint} moved by {least:.0f} counts (at least {MIN_TRAVEL_COUNTS}): check it and the latch"
    return Check("moved", least >= MIN_TRAVEL_COUNTS, least, MIN_TRAVEL_COUNTS, "counts", sentence)


def _hanging_after(evidence: Evidence) -> Check | None:
    """Where the rods hang once they are at rest again: counts lost on the way, or a wrong zero, show there."""
    run = evidence.run
    last = run.t >= run.duration - REST_WINDOW_S
    if run.duration <= REST_WINDOW_S or rest_motion(run.t[last], run.theta[last])[1] > rest_spread_limit(evidence.rig):
        return None
    error = np.abs((run.theta[last, 1:].mean(axis=0)) % (2 * np.pi) - np.pi)
    rod, worst = RODS[int(error.argmax())], float(error.max())
    sentence = (
        f"the {rod} came to rest {worst:.3f} rad off hanging (limit {MAX_HANG_ERROR}): lost counts, or a wrong zero"
    )
    return Check("hanging_after", worst <= MAX_HANG_ERROR, worst, MAX_HANG_ERROR, "rad", sentence)


def _duration(evidence: Evidence) -> Check | None:
    if evidence.duration <= 0:
        return None
    reached = evidence.run.duration
    limit = evidence.duration - MAX_GAP_PERIODS / evidence.run.rate_hz
    sentence = f"recorded {reached:.2f} s of {evidence.duration:g} s: record again"
    return Check("duration", reached >= limit, reached, limit, "s", sentence)


def _complete(evidence: Evidence) -> Check | None:
    complete = evidence.run.complete
    sentence = "the file was finished" if complete else "the file was cut off: its end is missing"
    return Check("complete", complete, float(complete), 1.0, "1", sentence)


CHECKS: tuple[Callable[[Evidence], Check | None], ...] = (
    _hanging_before,
    _rest_speed,
    _rest_spread,
    _pose,
    _release_speed,
    _lost,
    _gap,
    _jitter,
    _jumps,
    _moved,
    _hanging_after,
    _duration,
    _complete,
)
"""Every check, in the order a recording happens."""
