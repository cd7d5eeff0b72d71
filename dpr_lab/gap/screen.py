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

from dpr_lab.estimation.noise import noise_floor
from dpr_lab.gap.differences import noise_by_speed, stride_ratio
from dpr_lab.rig import Rig
from dpr_lab.run import Run

AXES = ("joint1", "joint2")
MOVED = 6.0  # standard deviations a rod must have moved before a reading that did not is called repeated
STANDS_OUT = 6.0  # standard deviations; three runs hold 6e4 readings
ABOVE_ITS_SURROUNDINGS = 4.0  # a violent stretch lifts every residual, a fault only its own
HALF_WINDOW_S = 0.014
DEGREE = 5  # over 28 ms a 5 Hz tumble is a polynomial of this degree to 1e-5 rad
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
    std = noise_floor(run, rig).std_joint
    findings = [*_gaps(run), *_levels(run, rig, std)]
    colour, coloured = _colour(run, joints)
    std = std * colour  # noise that was filtered shows only over wider spacings
    keep, breaks = np.ones(joints.shape, dtype=bool), []
    jitter, jitter_findings = _jitter(run, t, joints, std, period)
    stale = _repeated(t, joints, std, jitter, period)
    for axis in range(2):
        repeated = np.flatnonzero(stale[:, axis])
        keep[repeated, axis] = False
        outliers, steps = _local_faults(t, joints[:, axis], keep[:, axis], std[axis], period)
        keep[outliers, axis] = False
        breaks += [(float(t[i]), axis) for i, _ in steps]
        findings += _events("repeated_sample", run, axis, t[repeated], "the reading stands still while the rod moves")
        findings += _events("outlier", run, axis, t[outliers], "one reading off the polynomial through its neighbours")
        count = abs(float(rig.radians_per_count[1 + axis]))
        findings += [
            Finding(
                "missed_counts", run.name, AXES[axis], float(t[i]), f"the reading steps by {size / count:+.1f} counts"
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
        dithered=_dithered(run, rig),
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


def _dithered(run: Run, rig: Rig) -> NDArray[np.bool_]:
    """Whether noise before rounding reaches a fifth of a count, seen at rest; assumed where there was no rest."""
    rest = joint_angles(run.rest, rig)
    if run.counts is None or len(rest) < 20:
        return np.ones(2, dtype=bool)
    moved = np.std(np.diff(rest, axis=0), axis=0) / np.sqrt(2)
    return moved > STILL_COUNTS * np.abs(rig.radians_per_count[1:])


def _levels(run: Run, rig: Rig, std: NDArray[np.float64]) -> list[Finding]:
    if run.counts is None:
        return []
    told = np.sqrt(rig.encoders.noise_counts**2 + 1 / 12)
    counts = std / np.abs(rig.radians_per_count[1:])
    dithered = _dithered(run, rig)
    found = []
    for axis, name in enumerate(AXES):
        if not dithered[axis]:
            evidence = "the counts stand still at rest: less noise than a fifth of a count before rounding"
            found.append(Finding("undithered_quantisation", run.name, name, None, evidence))
        elif not 1 / NOISE_RATIO < counts[axis] / told < NOISE_RATIO:
            evidence = f"{counts[axis]:.2f} counts rms, the rig file says {told:.2f} with rounding"
            found.append(Finding("noise_level", run.name, name, None, evidence))
    return found


def _repeated(
    t: NDArray[np.float64], joints: NDArray[np.float64], std: NDArray[np.float64], jitter: float, period: float
) -> NDArray[np.bool_]:
    """(n, 2) readings equal to the one before although the rod moves by many standard deviations a sample.

    Jittered instants can bring one axis to a stand by chance, but hardly both.
    """
    reach = 4
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
    t: NDArray[np.float64], angle: NDArray[np.float64], keep: NDArray[np.bool_], std: np.float64, period: float
) -> tuple[NDArray[np.int64], list[tuple[int, float]]]:
    """Indices of outliers; index and size (rad) of steps."""
    half = int(np.clip(round(HALF_WINDOW_S / period), 5, 16))
    if keep.sum() < 4 * half:
        return np.zeros(0, dtype=np.int64), []
    grid = np.arange(t[0], t[-1] + 0.5 * period, period)
    even = CubicSpline(t[keep], angle[keep])(grid)
    step_filter, spike_filter = _filters(half, DEGREE)
    step = np.convolve(even, step_filter[::-1], mode="same") / std
    spike = np.convolve(even, spike_filter[::-1], mode="same") / std
    for z in (step, spike):
        z[:half], z[-half:] = 0.0, 0.0
    at = (np.arange(-half, half + 1) >= 0).astype(float)
    outliers, steps = [], []
    for peak in _peaks(np.maximum(np.abs(step), np.abs(spike)), half):
        nearest = int(np.argmin(np.abs(t - grid[peak])))
        if abs(spike[peak]) >= np.abs(step[peak - 1 : peak + 2]).max():
            outliers.append(nearest)
        else:
            steps.append((nearest, float(step[peak] * std / (step_filter @ at))))
    return np.array(outliers, dtype=np.int64), steps


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
