"""Quality gate: checks of a finished recording before any fit.

The checks before a release are in `holding`. A run that fails a check is kept and marked as `degraded`, with the
reasons.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dpr_lab.acquisition.rest import RodPair, pose_error, rest_motion
from dpr_lab.acquisition.settings import QUALITY_LIMITS, QualityLimits
from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import base_parameters
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import Pose
from dpr_lab.run import MOUNTED, Run, clock_error, clock_rates, elbow_turn


@dataclass(frozen=True, slots=True)
class Check:
    """One quality check of a recording and its result."""

    name: str
    ok: bool
    measured: float
    limit: float
    unit: str
    sentence: str
    """Sentence with the measured value, the limit and a remedy; it is shown only if the check failed."""


@dataclass(frozen=True, slots=True)
class QualityReport:
    """Results of the quality checks of a recording."""

    checks: tuple[Check, ...]
    notes: tuple[str, ...] = ()
    """Notes on the recording that are not failures."""

    @property
    def ok(self) -> bool:
        """Whether every check passed."""
        return all(check.ok for check in self.checks)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Messages of the failed checks."""
        return tuple(check.sentence for check in self.checks if not check.ok)

    @property
    def sentence(self) -> str:
        """Text `ok`, or `degraded` with the reasons, followed by the notes."""
        return "; ".join(["ok" if self.ok else f"degraded: {'; '.join(self.reasons)}", *self.notes])

    def to_json(self) -> dict[str, Any]:
        """Return the report as JSON values."""
        return {"ok": self.ok, "checks": [asdict(check) for check in self.checks], "notes": list(self.notes)}


@dataclass(frozen=True, slots=True)
class DeviceState:
    """Information from the device about a recording, in addition to the samples."""

    real_time: bool
    """Whether the device's clock must agree with the host's clock; False for simulated time."""
    no_clock_fit: str
    """Reason why PING and PONG gave no clock fit; empty if they gave one."""
    statuses: int
    """Number of STATUS messages after the release."""
    latched: int
    """Number of these messages that reported a closed latch."""


@dataclass(frozen=True, slots=True)
class JudgedRun:
    """Recording to be checked, with the data that the quality checks require."""

    run: Run
    """Recording, whose time starts at the release."""
    rig: Rig
    duration: float = 0.0
    """Requested duration of the recording, s; 0 for an open end."""
    hanging: RodPair | None = None
    """Deviation of the hanging rods from the vertical before they were raised, rad; None if not measured."""
    limits: QualityLimits = QUALITY_LIMITS
    device: DeviceState | None = None
    """Information from the device; None for a table, or a run recorded without a device."""

    @property
    def pose(self) -> Pose | None:
        """Requested pose; None if no pose was requested."""
        return self.rig.poses.get(self.run.pose or "")


def judge(judged: JudgedRun) -> QualityReport:
    """Apply all quality checks to a recording.

    Checks without data, such as the rest of an imported table, are omitted from the report.
    """
    return QualityReport(tuple(check for apply in CHECKS if (check := apply(judged)) is not None))


def fastest_possible(rig: Rig) -> Array:
    """Return upper bounds (2,) on the speeds of the rods in a swing, rad/s.

    The kinetic energy of a free swing is at most E = 2 (e1 + e2), the difference of potential energy between upright
    and hanging. With this energy, the squared speed of rod i is at most 2 E (M^-1)_ii, where M is the mass matrix. This
    bound is largest if the rods are in line. M^-1 then has the diagonal [b, a] / (a b - d^2).
    """
    a, b, d, e1, _, _ = base_parameters(rig.nominal, rig.L1, rig.g)
    energy = 2 * (e1 + d * rig.g / rig.L1)
    return np.sqrt(2 * energy * np.array([b, a]) / (a * b - d * d))


def _rest(judged: JudgedRun) -> tuple[Array, Array] | None:
    run = judged.run
    window = (run.t < 0) & (run.t >= -judged.limits.rest.window_s)
    return (run.t[window], run.theta[window]) if np.count_nonzero(window) >= judged.limits.fewest_samples else None


def _worst_rod(judged: JudgedRun, errors: Array) -> tuple[str, float]:
    """Return the name of the rod with the largest error, and this error."""
    return judged.rig.rods.names[int(errors.argmax())], float(errors.max())


def _hanging_before(judged: JudgedRun) -> Check | None:
    """Check the hanging position before the rods were raised.

    A deviation indicates a wrong zero in the rig file, or earlier lost counts.
    """
    if judged.hanging is None:
        return None
    limit = judged.limits.hang_error
    error = np.abs(judged.hanging)
    rod, worst = _worst_rod(judged, error)
    sentence = (
        f"before the rods were raised, the {rod} deviated by {worst:.3f} rad from the vertical (limit {limit}):"
        " lost counts, or a wrong zero in the rig file"
    )
    return Check("hanging_before", worst <= limit, worst, limit, "rad", sentence)


def _rest_speed(judged: JudgedRun) -> Check | None:
    rest = _rest(judged)
    if rest is None:
        return None
    limit = judged.limits.rest.speed
    speed, _ = rest_motion(*rest)
    sentence = f"before the release the rods drifted at {speed:.3f} rad/s (limit {limit}): hold them still"
    return Check("rest_speed", speed <= limit, speed, limit, "rad/s", sentence)


def _rest_spread(judged: JudgedRun) -> Check | None:
    rest = _rest(judged)
    if rest is None:
        return None
    _, spread = rest_motion(*rest)
    limit = judged.limits.rest.spread(judged.rig)
    sentence = f"before the release the rods vibrated by {spread:.5f} rad rms (limit {limit:.5f}): let them settle"
    return Check("rest_spread", spread <= limit, spread, limit, "rad", sentence)


def _pose(judged: JudgedRun) -> Check | None:
    rest = _rest(judged)
    if rest is None or judged.pose is None:
        return None
    error = np.abs(pose_error(rest[1], judged.pose)).mean(axis=0)[: judged.rig.rods.placed]
    (rod, worst), limit = _worst_rod(judged, error), judged.pose.tolerance
    sentence = f"the {rod} was {worst:.3f} rad away from the pose (limit {limit}): place the rods more accurately"
    return Check("pose", worst <= limit, worst, limit, "rad", sentence)


def _release_speed(judged: JudgedRun) -> Check | None:
    """Check the initial speed w of the swing.

    In the first 20 ms, theta(t) = theta_rest + w t + alpha t^2 / 2, where theta_rest comes from the samples before the
    release. If the sample rate is too low for this window, beta t^4 / 24 is added, because the acceleration of a rod
    that starts at rest changes with t^2.
    """
    limits = judged.limits
    rest, swing = _rest(judged), judged.run.swing
    if rest is None or len(swing.t) < limits.fewest_samples:
        return None
    n = max(limits.fewest_samples, int(np.searchsorted(swing.t, limits.release_window_s)))
    t, rods = swing.t[:n], swing.theta[:n, 1:] - rest[1][-n:, 1:].mean(axis=0)
    slow = [t**4 / 24] if t[-1] > 2 * limits.release_window_s else []
    A = np.stack([t, t * t / 2, *slow], axis=1)
    coefficients, *_ = np.linalg.lstsq(A, rods, rcond=None)
    speed = float(np.abs(coefficients[0]).max())
    uncertain = float(judged.rig.reading_std[1:].max() * np.sqrt(np.linalg.pinv(A.T @ A)[0, 0]))
    limit = max(limits.release_speed, limits.sigmas * uncertain)
    sentence = f"the rods started at {speed:.2f} rad/s (limit {limit:.2g}): release without a push"
    return Check("release_speed", speed <= limit, speed, limit, "rad/s", sentence)


def _lost(judged: JudgedRun) -> Check | None:
    limit = judged.limits.lost_share
    run = judged.run
    lost = {cause: n for cause, n in run.lost.items() if n and cause != "contradicted_position"}
    share = sum(lost.values()) / max(1, len(run.t) + sum(lost.values()))
    if lost.get("contradicted"):
        limit = 0.0
    causes = ", ".join(f"{cause} {n}" for cause, n in lost.items()) or "none"
    sentence = f"lost samples: {causes}, {100 * share:.2f} % of the samples (limit {100 * limit:g} %)"
    return Check("lost", share <= limit, share, limit, "1", sentence + ": check cable and rate")


def _contradicted_position(judged: JudgedRun) -> Check | None:
    n = judged.run.lost.get("contradicted_position")
    if n is None:
        return None
    sentence = (
        "some angles are wrong by multiples of 65536 counts, because complete counts contradict the samples"
        f" (number {n}, limit 0): check encoders, firmware and rate, then record again"
    )
    return Check("contradicted_position", not n, float(n), 0.0, "messages", sentence)


def _gap(judged: JudgedRun) -> Check | None:
    limit = judged.limits.gap_periods
    steps = np.diff(judged.run.t) * judged.run.rate_hz
    if not len(steps):
        return None
    worst = float(np.round(steps.max())) - 1
    sentence = f"the longest interruption has {worst:.0f} missing samples (limit {limit}): check cable and rate"
    return Check("gap", worst <= limit, worst, limit, "samples", sentence)


def _jitter(judged: JudgedRun) -> Check | None:
    """Check the regularity of the sampling by the device's clock alone.

    Arrival times have no influence.
    """
    limit = judged.limits.jitter_periods
    periods = judged.run.t * judged.run.rate_hz
    if not len(periods):
        return None
    differences = periods - periods[0]
    jitter = float(np.sqrt(np.mean((differences - np.round(differences)) ** 2)))
    sentence = (
        f"the samples deviate from their grid by {jitter:.3f} periods rms (limit {limit}): check the device's timer"
    )
    return Check("jitter", jitter <= limit, jitter, limit, "periods", sentence)


def _clock(judged: JudgedRun) -> Check | None:
    """Check the clock rate error of the device, from PING and from arrival times."""
    if not clock_rates(judged.run.clock):
        return None
    limit = judged.limits.clock_ppm
    error, words = clock_error(judged.run.clock)
    sentence = (
        f"the device's clock runs {words} relative to this computer (limit {limit:g} ppm; the error of a"
        " crystal is about 100 ppm): check its sample timer, because all times have this error"
    )
    return Check("clock", error <= limit, error, limit, "ppm", sentence)


def _clock_fit(judged: JudgedRun) -> Check | None:
    """Check that both estimates of the clock rate are consistent.

    The estimates come from PING and from arrival times.
    """
    device, limits = judged.device, judged.limits
    if device is None or not device.real_time:
        return None
    rates = clock_rates(judged.run.clock)
    std = judged.run.clock.get("rate_ppm_std", np.inf)
    if "pong" not in rates:
        reason = (
            device.no_clock_fit
            or "its samples arrive at the rate of real time, although it declares its time as simulated"
        )
        sentence = f"the device's clock could not be checked by PING and PONG ({reason}): check PONG in its firmware"
        return Check("clock_fit", False, std, limits.clock_std_ppm, "ppm", sentence)
    (pong, _), (arrival, margin) = rates["pong"], rates.get("arrival", (0.0, np.inf))
    difference, allowed = abs(pong - arrival), margin + 5 * std + limits.clock_ppm
    if difference > allowed:
        sentence = (
            f"the rate error of the device's clock is {pong / 1e4:+.2f} % by PONG, but {arrival / 1e4:+.2f} % by its"
            " samples: check which timer PONG reads in the firmware"
        )
        return Check("clock_fit", False, difference, allowed, "ppm", sentence)
    sentence = (
        f"PONG answers contradict each other, so the clock rate has an uncertainty of {std / 1e4:.2g} %: check PONG in"
        " the firmware"
    )
    return Check("clock_fit", std <= limits.clock_std_ppm, std, limits.clock_std_ppm, "ppm", sentence)


def _latch(judged: JudgedRun) -> Check | None:
    """Check that the device detected the opening of its latch."""
    device, limits = judged.device, judged.limits
    if device is None or device.statuses < limits.fewest_statuses:
        return None
    share = device.latched / device.statuses
    sentence = (
        f"after the release {device.latched} of {device.statuses} STATUS messages reported that the latch holds:"
        " check the latch's sensor and the firmware"
    )
    return Check("latch", share <= limits.latched_share, share, limits.latched_share, "1", sentence)


def _jumps(judged: JudgedRun) -> Check | None:
    run, limits = judged.run, judged.limits
    if len(run.t) < 2:
        return None
    turned = np.abs(np.diff(run.theta[:, 1:], axis=0)) - limits.sigmas * np.sqrt(2) * judged.rig.reading_std[1:]
    speed = np.maximum(turned, 0.0) / np.diff(run.t)[:, np.newaxis]
    share = (speed / (limits.speed_margin * fastest_possible(judged.rig))).max(axis=0)
    rod, worst = _worst_rod(judged, share)
    sentence = f"the {rod} jumps at {worst:.1f} times the maximum possible speed: check the encoder and its wiring"
    return Check("jumps", worst <= 1.0, worst, 1.0, "1", sentence)


def _moved(judged: JudgedRun) -> Check | None:
    """Check that every joint moved, in counts.

    Counts are used because the angle theta2 of a relative encoder also changes with theta1.
    """
    limit = judged.limits.travel_counts
    swing = judged.run.swing
    if len(swing.t) < judged.limits.fewest_samples:
        return None
    readings = swing.theta if swing.counts is None else judged.rig.theta(swing.counts)
    if (turned := elbow_turn(readings, swing.mounting)) > MOUNTED.still:
        sentence = (
            f"joint 2 turned by {turned:.2f} rad, but it is declared as fixed (--rods or --elbow): correct this option"
        )
        return Check("moved", False, turned, MOUNTED.still, "rad", sentence)
    counts = judged.rig.positions(swing.theta) if swing.counts is None else swing.counts
    travel = np.ptp(counts, axis=0)[1 : 2 if judged.run.setup.held else 3]
    joint, least = 1 + int(travel.argmin()), float(travel.min())
    sentence = (
        f"encoder {joint} moved by {least:.0f} counts (required: at least {limit}): check the encoder,"
        " the latch, and whether the rods are in balance at this pose"
    )
    return Check("moved", least >= limit, least, limit, "counts", sentence)


def _hanging_after(judged: JudgedRun) -> Check | None:
    """Check the hanging position at rest after the swing.

    A deviation indicates counts lost during the swing, or a wrong zero.
    """
    limit, rest = judged.limits.hang_error, judged.limits.rest
    run = judged.run
    last = run.t >= run.duration - rest.window_s
    if run.setup.mounting == "clamped":  # a clamped elbow tilts the hanging rods
        return None
    if run.duration <= rest.window_s or rest_motion(run.t[last], run.theta[last])[1] > rest.spread(judged.rig):
        return None
    error = np.abs((run.theta[last, 1:].mean(axis=0)) % (2 * np.pi) - np.pi)
    rod, worst = _worst_rod(judged, error)
    sentence = f"the {rod} came to rest {worst:.3f} rad away from hanging (limit {limit}): lost counts, or a wrong zero"
    return Check("hanging_after", worst <= limit, worst, limit, "rad", sentence)


def _duration(judged: JudgedRun) -> Check | None:
    if judged.duration <= 0:
        return None
    reached = judged.run.duration
    limit = judged.duration - judged.limits.gap_periods / judged.run.rate_hz
    sentence = f"recorded {reached:.2f} s of {judged.duration:g} s: record again"
    return Check("duration", reached >= limit, reached, limit, "s", sentence)


def _complete(judged: JudgedRun) -> Check | None:
    complete = judged.run.complete
    sentence = "the file was finished" if complete else "the file is incomplete: its end is missing"
    return Check("complete", complete, float(complete), 1.0, "1", sentence)


CHECKS: tuple[Callable[[JudgedRun], Check | None], ...] = (
    _hanging_before,
    _rest_speed,
    _rest_spread,
    _pose,
    _release_speed,
    _lost,
    _contradicted_position,
    _gap,
    _jitter,
    _clock,
    _clock_fit,
    _latch,
    _jumps,
    _moved,
    _hanging_after,
    _duration,
    _complete,
)
"""All checks in the order of a recording."""
