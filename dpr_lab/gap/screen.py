"""Sensor faults found before any physics is fitted: each a named finding, each masked, split at, or weighted.

A swing is smooth over a few milliseconds, so what an encoder does wrong stands out from a local polynomial:

    repeated_sample           a reading that did not move although the rod did
    outlier                   one reading off its neighbours
    missed_counts             a step that stays
    jitter                    noise that grows with speed: sigma^2 = sigma_0^2 + (s omega)^2, s the timing error
    gap                       samples that never came
    non_white_noise           neighbouring readings share their error
    noise_level               noise other than the rig file says
    undithered_quantisation   counts that stand still at rest: rounding does not average out
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from dpr_lab.estimation.noise import noise_floor
from dpr_lab.gap.differences import noise_by_speed, stride_ratio
from dpr_lab.rig import Rig
from dpr_lab.run import Run

AXES = ("joint1", "joint2")
MOVED = 8.0  # standard deviations a rod must have moved before a reading that did not is called repeated
STANDS_OUT = 6.0  # standard deviations; three runs hold 6e4 readings
ABOVE_ITS_SURROUNDINGS = 4.0  # a violent stretch lifts every residual, a fault only its own
FASTEST = 200.0  # rad/s; no rod of a laboratory turns thirty times a second
HALF_WINDOW_S = 0.014
DEGREE = 5  # over 28 ms a 5 Hz tumble is a polynomial of this degree to 1e-5 rad
REACH = 3  # samples about a peak among which the fault is looked for
LEAST_SEEN = 1e-3  # share of a step or spike that a polynomial must leave
SMOOTH = 4  # samples on either side over which a speed is taken, so that one jittered instant does not make it
GAP_PERIODS = 1.5
NOISE_RATIO = 1.5
STILL_COUNTS = 0.2
SHOWN = 20  # findings of one kind on one axis that are listed singly


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing a sensor did wrong."""

    name: str
    run: str
    axis: str | None
    at_s: float | None
    """When, since the release, s; none for a property of the whole run."""
    evidence: str
    step: float | None = None
    """How far the reading stepped, rad, where it did."""


@dataclass(frozen=True, slots=True)
class Screened:
    """A swing with its sensor faults known."""

    t: NDArray[np.float64]
    """(n,) instants since the release, s."""
    joints: NDArray[np.float64]
    """(n, 2) what the encoders of joint 1 and 2 read, rad."""
    keep: NDArray[np.bool_]
    """(n, 2) readings to be trusted."""
    breaks: tuple[tuple[float, int], ...]
    """Instants of a step (s) and the axis (0 or 1) that made it: no segment may span it."""
    noise: NDArray[np.float64]
    """(2,) standard deviation of a reading at rest, rad."""
    jitter_s: float
    """Standard deviation of the sampling instants, s."""
    count: NDArray[np.float64]
    """(2,) least change of a reading, rad; zero for a table of angles."""
    dithered: NDArray[np.bool_]
    """(2,) whether rounding errors of neighbouring readings are independent."""
    findings: tuple[Finding, ...]


def joint_angles(theta: NDArray[np.float64], rig: Rig) -> NDArray[np.float64]:
    """(..., 2) what the two rod encoders read, from (..., 3) absolute angles, rad."""
    rods = theta[..., 1:].copy()
    if rig.encoders.joint2 == "relative":
        rods[..., 1] -= rods[..., 0]
    return rods


def screen(run: Run, rig: Rig) -> Screened:
    """Look for sensor faults in one run.

    Raises:
        RunError: too few samples to tell the noise.
    """
    swing = run.swing
    t, joints = swing.t, joint_angles(swing.theta, rig)
    period = 1.0 / run.rate_hz
    count = _count_size(run, rig)
    std = np.maximum(noise_floor(run, rig).std_joint, count / np.sqrt(12))
    findings = [*_gaps(run), *_levels(run, rig, std, count)]
    colour, coloured = _colour(run, joints)
    std = std * colour  # noise that was filtered shows only over wider spacings
    keep, breaks = np.ones(joints.shape, dtype=bool), []
    jitter, jitter_findings = _jitter(run, t, joints, std, period)
    stale = _repeated(t, joints, std, jitter, period)
    wild = _wild(t, joints)
    for axis in range(2):
        repeated = np.flatnonzero(stale[:, axis])
        keep[repeated, axis] = False
        keep[wild[:, axis], axis] = False
        findings += _events(
            "outlier", run, axis, t[wild[:, axis]], "the reading jumps there and back faster than any rod"
        )
        outliers, steps = _local_faults(t, joints[:, axis], keep[:, axis], (float(std[axis]), jitter), period)
        keep[outliers, axis] = False
        breaks += [(float(t[i]), axis) for i, _ in steps]
        findings += _events("repeated_sample", run, axis, t[repeated], "the reading stands still while the rod moves")
        findings += _events("outlier", run, axis, t[outliers], "one reading off the polynomial through its neighbours")
        told = abs(float(rig.radians_per_count[1 + axis]))
        findings += [
            Finding(
                "missed_counts",
                run.name,
                AXES[axis],
                float(t[i]),
                f"the reading steps by {size / told:+.1f} counts",
                step=float(size),
            )
            for i, size in steps
        ]
    return Screened(
        t=t,
        joints=joints,
        keep=keep,
        breaks=tuple(sorted(breaks)),
        noise=std,
        jitter_s=jitter,
        count=count,
        dithered=_dithered(run, rig, count),
        findings=(*findings, *jitter_findings, *coloured),
    )


def _events(name: str, run: Run, axis: int, at: NDArray[np.float64], evidence: str) -> list[Finding]:
    """One finding each, or the first with a count where they are many."""
    if len(at) > SHOWN:
        return [Finding(name, run.name, AXES[axis], float(at[0]), f"{evidence}; {len(at)} times, first here")]
    return [Finding(name, run.name, AXES[axis], float(s), evidence) for s in at]


def _gaps(run: Run) -> list[Finding]:
    t, period = run.swing.t, 1.0 / run.rate_hz
    missing = np.rint(np.diff(t) / period) - 1
    wide = np.flatnonzero(np.diff(t) > GAP_PERIODS * period)
    if not len(wide):
        return []
    longest = wide[np.argmax(missing[wide])]
    return [
        Finding(
            "gap",
            run.name,
            None,
            float(t[longest]),
            f"{missing[wide].sum():.0f} of {len(t)} samples missing in {len(wide)} gaps;"
            f" the longest, here, is {1e3 * (t[longest + 1] - t[longest]):.3g} ms",
        )
    ]


def _count_size(run: Run, rig: Rig) -> NDArray[np.float64]:
    """(2,) angle by which readings move at least, rad: a coarse encoder behind a finer counter takes several counts."""
    if run.counts is None:
        return np.zeros(2)
    steps = np.gcd.reduce(np.diff(run.counts[:, 1:], axis=0), axis=0)
    return np.asarray(np.maximum(steps, 1) * np.abs(rig.radians_per_count[1:]), dtype=np.float64)


def _dithered(run: Run, rig: Rig, count: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether noise before rounding reaches a fifth of a count, seen at rest; assumed where there was no rest."""
    rest = joint_angles(run.rest, rig)
    if run.counts is None or len(rest) < 20:
        return np.ones(2, dtype=bool)
    moved = np.std(np.diff(rest, axis=0), axis=0) / np.sqrt(2)
    return moved > STILL_COUNTS * count


def _levels(run: Run, rig: Rig, std: NDArray[np.float64], count: NDArray[np.float64]) -> list[Finding]:
    if run.counts is None:
        return []
    told = np.sqrt(rig.encoders.noise_counts**2 + 1 / 12)
    counts = std / np.abs(rig.radians_per_count[1:])
    dithered = _dithered(run, rig, count)
    found = []
    for axis, name in enumerate(AXES):
        if not dithered[axis]:
            evidence = "the counts stand still at rest: less noise than a fifth of a count before rounding"
            found.append(Finding("undithered_quantisation", run.name, name, None, evidence))
        elif not 1 / NOISE_RATIO < counts[axis] / told < NOISE_RATIO:
            evidence = f"{counts[axis]:.2f} counts rms, the rig file says {told:.2f} with rounding"
            found.append(Finding("noise_level", run.name, name, None, evidence))
    return found


def _wild(t: NDArray[np.float64], joints: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(n, 2) readings that lie further from both neighbours than a rod can turn in between: one, or a burst of them."""
    too_fast = np.abs(np.diff(joints, axis=0)) > FASTEST * np.diff(t)[:, None]
    edge = np.zeros((1, joints.shape[1]), dtype=bool)
    return np.concatenate([edge, too_fast]) & np.concatenate([too_fast, edge])


def _repeated(
    t: NDArray[np.float64], joints: NDArray[np.float64], std: NDArray[np.float64], jitter: float, period: float
) -> NDArray[np.bool_]:
    """(n, 2) readings equal to the one before although the rod moves by many standard deviations a sample.

    Jittered instants can bring one axis to a stand by chance, but hardly both.
    """
    reach = SMOOTH
    if len(t) <= 2 * reach:
        return np.zeros(joints.shape, dtype=bool)
    across = np.abs(joints[2 * reach :] - joints[: -2 * reach]) / (t[2 * reach :] - t[: -2 * reach])[:, None]
    speed = np.pad(across, ((reach, reach), (0, 0)), mode="edge")
    moved = speed * np.diff(t, prepend=t[0] - period)[:, None]
    stands = np.diff(joints, axis=0, prepend=np.nan) == 0.0
    alone = stands & (moved > MOVED * np.hypot(std, jitter * speed))
    both = stands.all(axis=1) & (moved > MOVED * std).any(axis=1)
    return alone | both[:, None]


@cache
def _filters(half: int, degree: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Weights that read a step before the sample in the middle, and the middle sample alone, off a polynomial.

    Both are scaled to unit variance on unit white noise; the first times its own norm gives the step's size.
    """
    at = np.arange(-half, half + 1) / half
    smooth = np.linalg.qr(np.vander(at, degree + 1))[0]
    filters = []
    for shape in ((at >= 0).astype(float), (np.arange(2 * half + 1) == half).astype(float)):
        rest = shape - smooth @ (smooth.T @ shape)
        filters.append(rest / np.linalg.norm(rest))
    return filters[0], filters[1]


def _local_faults(
    t: NDArray[np.float64],
    angle: NDArray[np.float64],
    keep: NDArray[np.bool_],
    noise: tuple[float, float],
    period: float,
) -> tuple[NDArray[np.int64], list[tuple[int, float]]]:
    """Indices of outliers; index and size (rad) of steps; `noise` is that of a reading (rad) and of its instant (s)."""
    half = int(np.clip(round(HALF_WINDOW_S / period), 5, 16))
    if keep.sum() < 4 * half:
        return np.zeros(0, dtype=np.int64), []
    grid = np.arange(t[0], t[-1] + 0.5 * period, period)
    even = CubicSpline(t[keep], angle[keep])(grid)
    step_filter, spike_filter = _filters(half, DEGREE)
    smooth = np.gradient(uniform_filter1d(even, 2 * SMOOTH + 1, mode="nearest"), period)
    std = np.hypot(noise[0], noise[1] * maximum_filter1d(np.abs(smooth), 2 * half + 1))
    step = np.convolve(even, step_filter[::-1], mode="same") / std
    spike = np.convolve(even, spike_filter[::-1], mode="same") / std
    for z in (step, spike):
        z[:half], z[-half:] = 0.0, 0.0
    outliers, steps = [], []
    for peak in _peaks(np.maximum(np.abs(step), np.abs(spike)), half):
        near = np.flatnonzero(keep & (np.abs(t - grid[peak]) < (half + 0.5) * period))
        if len(near) < half:
            continue
        at, size = _step_or_spike(t[near], angle[near], grid[peak], period)
        if size is None:
            outliers.append(int(near[at]))
        else:
            steps.append((int(near[at]), size))
    return np.array(outliers, dtype=np.int64), steps


def _step_or_spike(
    t: NDArray[np.float64], angle: NDArray[np.float64], about: float, period: float
) -> tuple[int, float | None]:
    """What a polynomial lacks most in a few samples: one reading that is off (its index), or a step from one on.

    Args:
        t: (n,) instants, s
        angle: (n,) readings, rad
        about: where something is wrong, s
        period: time between samples, s

    Returns:
        index of the sample, and the size of the step, rad; no size for a single reading
    """
    smooth = np.linalg.qr(np.vander((t - about) / np.ptp(t), DEGREE + 1))[0]
    rest = angle - smooth @ (smooth.T @ angle)
    found: list[tuple[float, int, float | None]] = []
    for i in np.flatnonzero(np.abs(t - about) < (REACH + 0.5) * period):
        for shape, single in ((np.arange(len(t)) == i, True), (np.arange(len(t)) >= i, False)):
            column = shape - smooth @ (smooth.T @ shape)
            power = float(column @ column)
            if power > LEAST_SEEN:
                found.append(
                    (float(column @ rest) ** 2 / power, int(i), None if single else float(column @ rest) / power)
                )
    _, at, size = max(found, key=lambda one: one[0], default=(0.0, int(np.argmin(np.abs(t - about))), None))
    return at, size


def _peaks(z: NDArray[np.float64], half: int) -> list[int]:
    """Local maxima that stand out from zero and from their surroundings."""
    peaks: list[int] = []
    for i in np.flatnonzero(z > STANDS_OUT):
        near = slice(max(0, i - half), i + half + 1)
        around = np.concatenate([z[max(0, i - 10 * half) : max(0, i - 2 * half)], z[i + 2 * half + 1 : i + 10 * half]])
        usual = float(np.quantile(around, 0.9)) if len(around) else 0.0
        if z[i] >= z[near].max() and z[i] > ABOVE_ITS_SURROUNDINGS * usual:
            peaks.append(int(i))
    return peaks


def _jitter(
    run: Run, t: NDArray[np.float64], joints: NDArray[np.float64], std: NDArray[np.float64], period: float
) -> tuple[float, list[Finding]]:
    jitter, significance = noise_by_speed(t, joints, std, period)
    if significance < STANDS_OUT:
        return 0.0, []
    evidence = f"noise grows with speed as sampling instants off by {1e3 * jitter:.2g} ms rms would make it"
    return jitter, [Finding("jitter", run.name, None, None, evidence)]


def _colour(run: Run, joints: NDArray[np.float64]) -> tuple[NDArray[np.float64], list[Finding]]:
    """(2,) factor from the noise of neighbours to that of wider spacings, 1 for white noise; and what was found."""
    factor, found = np.ones(2), []
    if run.rate_hz < 500:  # slower, and the swing itself leaks into the wider differences
        return factor, found
    for axis, name in enumerate(AXES):
        ratio = stride_ratio(joints[:, axis])
        if ratio > NOISE_RATIO:
            factor[axis] = ratio
            evidence = f"every third sample has {ratio:.2g} times the noise of neighbours: filtered before recording"
            found.append(Finding("non_white_noise", run.name, name, None, evidence))
    return factor, found
