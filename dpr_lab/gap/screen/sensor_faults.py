"""Detection of sensor faults without a model; affected readings are excluded, separated or weighted.

A swing is smooth over a few milliseconds, so an encoder fault is visible in neighbouring readings:

    repeated_sample             a reading that did not change although the rod moved
    outlier                     one reading that deviates from its neighbours
    missed_counts               a lasting step
    jitter                      noise that increases with speed: sigma^2 = sigma_0^2 + (s omega)^2, s the timing error
    gap                         missing samples: an interruption of the readings
    non_white_noise             correlated errors of neighbouring readings
    noise_level                 noise that differs from the rig file
    undithered_quantisation     constant counts at rest: rounding does not average out
    stamp_jitter                time stamps with jitter, but readings at even times: time stamps are replaced
    rounded_frames              even time stamps, but unevenly spaced frames of a film: time stamps are replaced
    periodic_delay              every n-th reading is taken later than its stamp, or before it: excluded
    queued_rows                 rows that wait in the queue of a saturated link, with a varying delay: excluded
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.effects.missed_counts import MISSED_COUNTS
from dpr_lab.estimation.noise import arm_noise, noise_floor, rest_correlation, same_rounding
from dpr_lab.gap.result.finding import SensorFinding
from dpr_lab.gap.screen.differences import noise_by_speed, stride_ratio
from dpr_lab.gap.screen.implausible import repeated, too_fast
from dpr_lab.gap.screen.local_faults import local_faults
from dpr_lab.gap.screen.quantisation import changing, count_size, has_dither, is_on_grid
from dpr_lab.gap.screen.stamps.instants import even_instants, periodic_delay
from dpr_lab.gap.screen.stamps.queued_rows import queued_rows
from dpr_lab.gap.screen.stamps.rounded_frames import rounded_frames
from dpr_lab.identification.misread.balance import periods
from dpr_lab.rig import Rig
from dpr_lab.run import Run

AXES = ("joint1", "joint2")
"""Names of the encoders of the rods in findings and results."""

ALL_AXES = (*AXES, "joint0")
"""Names of the encoders of the rods and of a moving arm, in the order of the columns of a problem."""


@dataclass(frozen=True, slots=True)
class ScreenSettings:
    """Limits beyond which a property of a run is reported as a fault."""

    gap_periods: float = 1.5
    """Maximum interval between two samples without a missing sample, in sampling periods."""
    gap_near: int = 10
    """Number of samples that are compared before and after a long sampling interval.

    If a sample is missing, the later samples lag by at least half a period.
    """
    noise_ratio: float = 1.5
    """Minimum ratio of two noise levels that is reported as a fault.

    The levels are the measured and the stated noise, in either order, or the noise of distant and of neighbouring
    samples.
    """
    colour_hz: float = 500.0
    """Minimum sampling rate, Hz, for the comparison of distant and neighbouring samples."""
    significance: float = 6.0
    """Minimum significance of an increase of the noise with speed, in standard errors."""
    repeating: float = 0.5
    """Fraction of repeated readings at one position of a cycle above which all readings at this position count as
    repeated."""
    repeating_in_part: float = 0.05
    """Minimum difference between the fractions of repeated readings at one position of a cycle and at the others."""
    rows_in_short_period: float = 80.0
    """Minimum number of samples per period of the faster small oscillation to detect steps in readings of two free
    rods.

    Large swings without a fault contained apparent steps with 58 and 68 samples, but none with 75 or more (72 swings).
    """
    rows_in_period: float = 20.0
    """Minimum number of samples per period of a small oscillation to detect steps in readings of a single rod.

    Of 40 simulated swings without a fault, 29 contained an apparent step with 6 samples, 2 with 15, none with 20.
    """
    shown: int = 20
    """Maximum number of findings of one kind on one axis that are listed individually."""


SCREEN = ScreenSettings()


@dataclass(frozen=True, slots=True)
class Screened:
    """A screened run: its readings, their noise, and the sensor faults."""

    run: Run
    """Run with the corrected sampling instants."""
    t: Array
    """(n,) instants since the release, s."""
    joints: Array
    """(n, 2) readings of the encoders of joints 1 and 2, rad."""
    keep: Flags
    """(n, 2) mask of the trusted readings."""
    breaks: tuple[tuple[float, int], ...]
    """Instant of each step (s) and its axis (0 or 1); no segment may contain a step."""
    noise: Array
    """(2,) standard deviation of a reading at rest, rad."""
    jitter_s: float
    """Standard deviation of the sampling instants, s."""
    count: Array
    """(2,) smallest change of a reading, rad; zero for a table of angles."""
    dithered: Flags
    """(2,) whether rounding errors of neighbouring readings are independent."""
    shared: Array
    """(n, 2) number of successive readings with the same rounding error: 1 unless the reading is constant."""
    on_grid: Flags
    """(2,) whether readings are on the grid of the encoder's counts. Counts can be missed only in this case."""
    findings: tuple[SensorFinding, ...]


def screen(run: Run, rig: Rig) -> Screened:
    """Detect the sensor faults of one run.

    Raises:
        RunError: too few samples to estimate the noise.
    """
    run, late, findings = _timed(run, rig)
    t, joints, period = run.swing.t, rig.encoders.joint_angles.of_rods(run.swing.theta[:, 1:]), 1.0 / run.rate_hz
    count = count_size(run, rig)[1:]
    still, shared = same_rounding(run, joints, rig.radians_per_count[1:])
    dithered, on_grid = has_dither(run, rig, count, still), is_on_grid(run, rig, joints)
    in_time = run.only(~np.pad(late, (len(run.t) - len(t), 0)))
    at_rest = np.maximum(noise_floor(in_time, rig, still=False).std_joint, count / np.sqrt(12))
    colour, coloured = _colour(run, rig, joints, np.where(dithered & ~still.any(axis=0), 0.0, at_rest))
    noise = at_rest * colour  # filtered noise is visible only over wider spacings
    jitter, jittered = jitter_of(run, t[~late], joints[~late], noise)
    wild, stale = too_fast(t, joints), np.zeros(joints.shape, dtype=np.bool_)
    stale[~late] = repeated(t[~late], joints[~late], noise, jitter, period)
    keep = ~(wild | stale | late[:, None])
    findings += [*_gaps(run.name, t, period), *_levels(run, rig, at_rest, dithered)]
    breaks: list[tuple[float, int]] = []
    slow, fast = periods(rig)
    slowest = slow / SCREEN.rows_in_period if run.setup.held else fast / SCREEN.rows_in_short_period
    for axis, name in enumerate(AXES):
        outliers, steps = local_faults(t, joints[:, axis], keep[:, axis], (float(noise[axis]), jitter), period)
        keep[outliers, axis] = False
        for kind, instant, evidence in (
            ("outlier", t[wild[:, axis]], "the reading jumps away and back faster than a rod can move"),
            ("repeated_sample", t[stale[:, axis]], "the reading is constant while the rod moves"),
            ("outlier", t[outliers], "one reading deviates from the polynomial through its neighbours"),
        ):
            findings += _events(SensorFinding(kind, run.name, name, None, evidence), instant.tolist())
        steps = steps if on_grid[axis] and period <= slowest else []
        breaks += [(float(t[i]), axis) for i, _ in steps]
        findings += _steps(run.name, name, t, steps, abs(rig.radians_per_count[1 + axis]))
    if jitter:  # repeated readings look like wrong instants: estimate again without them
        trusted, significance = noise_by_speed(t, joints, noise, period, keep)
        # the significance is zero for too few readings
        refuted = significance != 0.0 and significance < SCREEN.significance
        jitter, jittered = (0.0, []) if refuted else (max(jitter, trusted), jittered)
    findings += [*jittered, *coloured]
    screened = Screened(
        run, t, joints, keep, tuple(sorted(breaks)), noise, jitter, count, dithered, shared, on_grid, tuple(findings)
    )
    return _without_joint2(screened) if run.setup.alone else screened


def with_arm(screened: Screened, rig: Rig) -> Screened:
    """Add the readings of a moving arm's encoder to a screened run, as the third column."""
    swing = screened.run.swing
    theta0, noise = swing.theta[:, 0], arm_noise(screened.run, rig, still=False)
    still, shared = same_rounding(screened.run, swing.theta[:, :1], rig.radians_per_count[:1])
    count = float(count_size(screened.run, rig)[0])
    noise = max(noise, count / 12**0.5)
    dithered = screened.run.counts is not None or bool(changing(theta0[:, None], still)[0])
    keep = np.ones(len(theta0), dtype=np.bool_)
    outliers, _ = local_faults(screened.t, theta0, keep, (noise, screened.jitter_s), 1.0 / screened.run.rate_hz)
    keep[outliers] = False
    evidence = "one reading deviates from the polynomial through its neighbours"
    findings = [
        SensorFinding("outlier", screened.run.name, ALL_AXES[2], float(screened.t[i]), evidence) for i in outliers
    ]
    return replace(
        screened,
        joints=np.column_stack([screened.joints, theta0]),
        keep=np.column_stack([screened.keep, keep]),
        noise=np.append(screened.noise, noise),
        count=np.append(screened.count, count),
        dithered=np.append(screened.dithered, dithered),
        shared=np.column_stack([screened.shared, shared]),
        on_grid=np.append(screened.on_grid, False),
        findings=(*screened.findings, *findings),
    )


def _timed(run: Run, rig: Rig) -> tuple[Run, Flags, list[SensorFinding]]:
    """Correct the time stamps of a run, and detect readings whose instants are unknown.

    Returns:
        the run with corrected instants, the (n,) mask of these readings in its swing, and the findings
    """
    queued, waiting = _queued(run, rig)
    run, stamped = _on_true_instants(run, rig)
    late, swing = queued[run.t >= 0.0], run.swing
    on_time = ~late
    late[on_time], delayed = _late(run, swing.t[on_time], rig.encoders.joint_angles.of_rods(swing.theta[on_time, 1:]))
    return run, late, [*waiting, *stamped, *delayed]


def _on_true_instants(run: Run, rig: Rig) -> tuple[Run, list[SensorFinding]]:
    """Replace jittering time stamps by even times, or even time stamps by the times of unevenly spaced frames.

    Returns:
        the run with the replaced time stamps, and the finding; no finding if the time stamps are kept
    """
    if (film := rounded_frames(run.t, _read_joints(run, rig))) is not None:
        instants = film.instants - min(film.instants[run.t >= 0.0].min(), 0.0)
        fewest, most = film.frames
        evidence = (
            f"the time stamps are even, but the readings fit rows that are {fewest} or {most} frames apart in a film"
            f" of {film.film_hz:g} frames per second better; these instants are used"
        )
        return replace(run, t=instants), [SensorFinding("rounded_frames", run.name, None, None, evidence)]
    if (even := even_instants(run.t, _read_joints(run, rig))) is None:
        return run, []
    even -= min(even[run.t >= 0.0].min(), 0.0)  # no reading of the swing may come before the release
    rms = float(np.std(run.t - even))
    evidence = (
        f"the time stamps deviate by {1e3 * rms:.2g} ms rms from a uniform clock; the readings fit uniform instants"
        " better"
    )
    return replace(run, t=even), [SensorFinding("stamp_jitter", run.name, None, None, evidence)]


def _queued(run: Run, rig: Rig) -> tuple[Flags, list[SensorFinding]]:
    """Detect readings that waited in a queue; return their (n,) mask and the finding."""
    swing, waited = run.t >= 0.0, np.zeros(len(run.t), dtype=np.bool_)
    queue = queued_rows(run.t[swing], _read_joints(run, rig)[swing])
    if queue is None:
        return waited, []
    waited[swing] = queue.rows
    return waited, [SensorFinding("queued_rows", run.name, None, float(run.t[waited][0]), queue.evidence)]


def _late(run: Run, t: Array, joints: Array) -> tuple[Flags, list[SensorFinding]]:
    """Detect periodically late or repeated readings; return their (n,) mask and the findings."""
    read = joints[:, :1] if run.setup.alone else joints
    delay, repeated = periodic_delay(t, read), np.append(False, (read[1:] == read[:-1]).all(axis=1))
    if delay is None:
        return np.zeros(len(t), dtype=np.bool_), []
    # a reading that is late by a whole period equals the next one; if it is late by less, the next reading is a
    # repeated one
    places = [delay.late] if 2 * delay.delay_s * run.rate_hz > 1 else [delay.late, np.roll(delay.late, 1)]
    cycle_position = max(places, key=lambda positions: float(np.mean(repeated[positions])))
    name, share, elsewhere = "repeated_sample", np.mean(repeated[cycle_position]), np.mean(repeated[~cycle_position])
    if share > SCREEN.repeating:
        late, evidence = cycle_position, f"one reading in {delay.cycle} repeats the previous one"
    elif share > elsewhere + SCREEN.repeating_in_part:
        late = cycle_position & repeated
        first, last = np.quantile(t[late], [0.1, 0.9])  # a few other readings are equal by chance
        evidence = f"mostly between {first:.2f} and {last:.2f} s, one reading in {delay.cycle} repeats the previous one"
    else:
        late, name = delay.late, "periodic_delay"
        size, side = abs(delay.delay_s), "after" if delay.delay_s > 0 else "before"
        precision = f"{1e3 * size:.3g} +- {1e3 * delay.std_s:.1g} ms"
        evidence = f"one reading in {delay.cycle} is taken {precision} {side} its time stamp"
    finding = SensorFinding(name, run.name, None, float(t[late][0]), f"{evidence}; these readings are excluded")
    if share > SCREEN.repeating or name == "periodic_delay":
        return late, [finding]
    others, findings = _late(run, t[~late], joints[~late])  # repeated readings can hide a delay
    late[~late] = others
    return late, [finding, *findings]


def _read_joints(run: Run, rig: Rig) -> Array:
    """Return the (n, 1 or 2) angles, rad, of the joints that have a rod."""
    joints = rig.encoders.joint_angles.of_rods(run.theta[:, 1:])
    return joints[:, :1] if run.setup.alone else joints


def _without_joint2(screened: Screened) -> Screened:
    """Remove the readings and faults of joint 2 from the screened run of a single rod."""
    return replace(
        screened,
        keep=np.repeat(screened.keep[:, :1], 2, axis=1),
        breaks=tuple((instant, axis) for instant, axis in screened.breaks if axis == 0),
        noise=np.array([screened.noise[0], np.inf]),
        findings=tuple(finding for finding in screened.findings if finding.axis != AXES[1]),
    )


def _steps(run: str, axis: str, t: Array, steps: Sequence[tuple[int, float]], count: float) -> list[SensorFinding]:
    """Create a finding for each step; `count` is the size of a count, rad."""
    sizes = [(float(t[i]), size, f"the reading steps by {size / count:+.1f} counts") for i, size in steps]
    return [SensorFinding(MISSED_COUNTS.name, run, axis, at_s, evidence, step=size) for at_s, size, evidence in sizes]


def _events(finding: SensorFinding, instants: list[float]) -> list[SensorFinding]:
    """Create a finding for each instant, or a single finding for more than `SCREEN.shown` instants."""
    if len(instants) > SCREEN.shown:
        return [replace(finding, at_s=instants[0], count=len(instants))]
    return [replace(finding, at_s=s) for s in instants]


def _gaps(name: str, t: Array, period: float) -> list[SensorFinding]:
    spacing, behind, near = np.diff(t), t - period * np.arange(len(t)), SCREEN.gap_near
    missing = np.rint(spacing / period) - 1
    wide = np.flatnonzero(spacing > SCREEN.gap_periods * period)
    # after a lost sample all stamps are late; after a late reading they are not
    stays = [np.median(behind[i + 1 : i + 1 + near]) - np.median(behind[max(0, i + 1 - near) : i + 1]) for i in wide]
    wide = wide[np.array(stays) > 0.5 * period]
    if not len(wide):
        return []
    evidence = (
        f"{missing[wide].sum():.0f} of {len(t)} samples missing; the longest interruption is"
        f" {1e3 * spacing[wide].max():.3g} ms"
    )
    return [SensorFinding("gap", name, None, float(t[wide[0]]), evidence, count=len(wide))]


def _levels(run: Run, rig: Rig, std: Array, dithered: Flags) -> list[SensorFinding]:
    if run.counts is None:
        return []
    nominal = np.sqrt(rig.encoders.noise_counts**2 + 1 / 12)
    counts = std / np.abs(rig.radians_per_count[1:])
    findings = []
    for axis, name in enumerate(AXES):
        if not dithered[axis]:
            evidence = "the counts are constant at rest: the noise before rounding is below a fifth of a count"
            findings.append(SensorFinding("undithered_quantisation", run.name, name, None, evidence))
        elif not 1 / SCREEN.noise_ratio < counts[axis] / nominal < SCREEN.noise_ratio:
            evidence = f"{counts[axis]:.2f} counts rms, the rig file gives {nominal:.2f} with rounding"
            findings.append(SensorFinding("noise_level", run.name, name, None, evidence))
    return findings


def jitter_of(run: Run, t: Array, joints: Array, std: Array) -> tuple[float, list[SensorFinding]]:
    """Estimate the timing error, s, from noise that increases with speed; also return its finding, if any."""
    jitter, significance = noise_by_speed(t, joints, std, 1.0 / run.rate_hz)
    if significance < SCREEN.significance:
        return 0.0, []
    evidence = (
        f"noise increases with speed, as errors of the sampling instants of {1e3 * jitter:.2g} ms rms would cause"
    )
    return jitter, [SensorFinding("jitter", run.name, None, None, evidence)]


def _colour(run: Run, rig: Rig, joints: Array, floor: Array) -> tuple[Array, list[SensorFinding]]:
    """Compare the noise of distant and of neighbouring samples; return a (2,) factor and findings.

    The factor is the noise of distant samples divided by that of neighbouring samples, or 1 without a significant
    difference. Below the sampling rate `SCREEN.colour_hz`, it is always 1, and only a correlation of the errors is
    reported.
    """
    factor, findings = np.ones(2), []
    if run.rate_hz < SCREEN.colour_hz:
        evidence = (
            "neighbouring readings at rest have correlated errors (correlation {:.2f}), due to a filter or a tracker"
        )
        if run.film_noise is not None:
            evidence = "the lengths of the rods in neighbouring frames have correlated errors (correlation {:.2f})"
        correlations = rest_correlation(run, rig).tolist()
        return factor, [
            SensorFinding("non_white_noise", run.name, name, None, evidence.format(correlation))
            for name, correlation in zip(AXES, correlations, strict=True)
            if correlation
        ]
    for axis, name in enumerate(AXES):
        ratio = stride_ratio(joints[:, axis], float(floor[axis]))
        if ratio > SCREEN.noise_ratio:
            factor[axis] = ratio
            evidence = (
                f"every third sample has {ratio:.2g} times the noise of neighbouring samples: the readings were"
                " filtered before the recording"
            )
            findings.append(SensorFinding("non_white_noise", run.name, name, None, evidence))
    return factor, findings
