"""Exclusion of kicks, pushes and steps of a reading from recordings.

A kick changes the speeds of the rods. A step changes the reading of a joint. Both occur within one segment and stand
out from all other segments (`dpr_lab.gap.damage.jumps`), whereas an effect of the rig acts in many segments.

Around a kick, the readings of a tenth of a second are excluded. A push looks like two kicks, at its beginning and at
its end. The readings between two kicks that follow each other closely are therefore excluded as well. Each kick belongs
to one push at most. If a reading steps and returns after a while, the readings in between are excluded. If it stays
shifted, the encoder missed counts, whose number the diagnosis estimates. A table of angles contains no counts, so its
shorter part is excluded.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects.missed_counts import MISSED_COUNTS
from dpr_lab.fitting.cut import MIN_SAMPLES, cut
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.gap.damage.hand import HELD, fitted_initial_states, without_hand
from dpr_lab.gap.damage.jumps import JUMP, Jump, jumps_of_segments, outstanding
from dpr_lab.gap.damage.steps import shows_step
from dpr_lab.gap.result.finding import SensorFinding
from dpr_lab.gap.screen.record import Record
from dpr_lab.gap.screen.recordings import LENGTHS, Recordings
from dpr_lab.gap.screen.sensor_faults import AXES


@dataclass(frozen=True, slots=True)
class DisturbanceRules:
    """Limits of the intervals that are excluded."""

    kick_s: float = 0.1
    """Length of the interval around a kick that is excluded, s. A hand touches a rod for 20 to 100 ms."""
    joins_s: float = 0.15
    """Maximum time between a step of a reading and another disturbance that count as one disturbance, s."""
    push_s: float = 2.5
    """Maximum duration of the excluded interval of a push, from before its first kick to after its last kick, s."""
    release_s: float = 0.5
    """Time after the first reading within which a kick counts as the hand that releases the rods, s.

    All readings before such a kick are excluded, because the hand may act on the rods with a constant torque.
    """
    rounds: int = 6
    """Maximum number of searches; a large disturbance hides smaller ones."""
    returns: float = 0.25
    """Maximum |sum of a step and a later opposite step|, divided by the first step, for a reading that returns."""
    while_share: float = 0.3
    """Maximum time between the two steps of a reading that returns, divided by the duration of the recording."""


DISTURBANCE = DisturbanceRules()


@dataclass(frozen=True, slots=True)
class ExcludedInterval:
    """Excluded interval of a recording, s; an infinite limit stands for the beginning or end of the recording."""

    since: float
    until: float
    jumps: tuple[Jump, ...]

    @property
    def of_reading(self) -> bool:
        """Whether a reading steps in the interval; otherwise the rods are kicked or pushed."""
        return any(jump.joint is not None for jump in self.jumps)

    @property
    def of_counts(self) -> bool:
        """Whether the interval is a step of missed counts, which excludes no reading."""
        return self.since == self.until


def without_disturbances(recordings: Recordings, ratios: Array) -> Recordings:
    """Exclude readings under the influence of a hand, of kicks, and of steps of a reading.

    Args:
        recordings: the runs
        ratios: (7,) ratios of a robust fit in short segments

    Returns:
        the corrected recordings; the same object if there are no disturbances
    """
    records = [
        without_hand(recordings, record, ratios) if _undriven(record) else record for record in recordings.records
    ]
    if any(before is not record for before, record in zip(recordings.records, records, strict=True)):
        recordings = replace(recordings, records=tuple(records))
    estimate = Estimate.of(ratios, recordings.start_params, np.zeros((0, 4)))
    whole, parts = recordings, [list[ExcludedInterval]() for _ in recordings.records]
    for _ in range(DISTURBANCE.rounds):
        jumps = _jumps(recordings, estimate)
        for run in {jump.run for jump in jumps}:
            new = [jump for jump in jumps if jump.run == run]
            parts[run] += _intervals(recordings.records[run], new)
        cleaned = _cleaned(whole, parts) if jumps else None
        if cleaned is None:
            break
        recordings = cleaned
    return recordings


def _cleaned(whole: Recordings, parts: Sequence[Sequence[ExcludedInterval]]) -> Recordings | None:
    """Remove intervals from recordings; return None if no segment of a recording remains."""
    records = [_remaining(record, intervals) for record, intervals in zip(whole.records, parts, strict=True)]
    cleaned = tuple(record for record in records if record is not None)
    return replace(whole, records=cleaned) if len(cleaned) == len(records) else None


def _remaining(record: Record, parts: Sequence[ExcludedInterval]) -> Record | None:
    """Return the record without the given intervals, or None if no segment remains.

    Neighbouring intervals are merged, unless the merged intervals leave no segment.
    """
    ordered = sorted(parts, key=lambda part: part.since)
    for intervals in (_merged(ordered), ordered):
        remaining = _without(record, intervals)
        if cut(remaining.t, np.inf, remaining.breaks):
            return remaining
    return None


def _undriven(record: Record) -> bool:
    """Return whether neither a known torque nor a moving arm drives the rods.

    Driven runs are not searched, because an error of the drive could look like a disturbance.
    """
    return record.run.setup.free and not record.encoder0_moves


def _jumps(recordings: Recordings, estimate: Estimate) -> list[Jump]:
    """Detect kicks and steps of readings in free swings.

    Two divisions into segments are searched, so that no jump lies at the end of a segment in both. Recordings with
    missed counts are not searched, because a jump does not stand out there.
    """
    searched = [_undriven(record) and not record.screened.breaks for record in recordings.records]
    kicks, steps = list[Jump](), list[Jump]()
    if recordings.arm_moves or not any(searched):
        return []
    for begin in (0.0, 0.5 * LENGTHS.working):
        later = [_later(record, begin) for record in recordings.records]
        problem, fitted = fitted_initial_states(recordings.only(later), estimate, LENGTHS.working)
        for best, candidates in zip((kicks, steps), jumps_of_segments(problem, fitted), strict=True):
            best += [jump for jump in candidates if searched[jump.run]]
    # A step of a reading also changes the gains of kicks, so kicks are returned only if there are no steps.
    steps = [step for step in outstanding(steps, JUMP.outstanding_step) if shows(recordings.records[step.run], step)]
    return steps or outstanding(kicks, JUMP.outstanding_kick)


def _later(record: Record, begin: float) -> Record:
    """Return the record from the time `begin` on, in s after its first reading.

    The record is unchanged if too few readings would remain.
    """
    later = record.t >= record.t[0] + begin
    return record.only(later) if later.sum() >= 2 * MIN_SAMPLES else record


def shows(record: Record, jump: Jump) -> bool:
    """Return whether the readings themselves contain the step.

    The residual of a model may also show a step that the readings do not contain.
    """
    return jump.joint is not None and shows_step(record, jump.joint, jump.at, jump.size[0])


def _intervals(record: Record, jumps: Sequence[Jump]) -> list[ExcludedInterval]:
    """Return the intervals to exclude.

    The intervals lie around kicks, between a step and an opposite step, and before or after a lasting step.
    """
    reach, parts = 0.5 * DISTURBANCE.kick_s, list[ExcludedInterval]()
    steps = sorted((jump for jump in jumps if jump.joint is not None), key=lambda jump: jump.at)
    while steps:
        first, *steps = steps
        opposite = next((step for step in steps if _returns(record, first, step)), None)
        if opposite is not None:
            steps = [step for step in steps if step.at > opposite.at]
            parts.append(ExcludedInterval(first.at, opposite.at, (first, opposite)))
        elif record.screened.on_grid[first.joint]:
            parts.append(ExcludedInterval(first.at, first.at, (first,)))
        elif np.mean(record.t < first.at) < 0.5:
            parts.append(ExcludedInterval(-np.inf, first.at, (first,)))
        else:
            parts.append(ExcludedInterval(first.at, np.inf, (first,)))
    for kick in (jump for jump in jumps if jump.joint is None):
        since, until = kick.at - reach, kick.at + reach
        of_release = since < record.t[0] + DISTURBANCE.release_s
        parts.append(ExcludedInterval(-np.inf if of_release else since, until, (kick,)))
    return parts


def _returns(record: Record, first: Jump, later: Jump) -> bool:
    """Return whether a later step of the readings cancels an earlier one."""
    sizes = first.size[0], later.size[0]
    cancels = first.joint == later.joint and abs(sum(sizes)) < DISTURBANCE.returns * abs(sizes[0])
    return cancels and later.at - first.at < DISTURBANCE.while_share * float(np.ptp(record.t))


def _merged(parts: Iterable[ExcludedInterval]) -> list[ExcludedInterval]:
    """Merge neighbouring intervals, which are in chronological order."""
    merged = list[ExcludedInterval]()
    for part in parts:
        if merged and _one_disturbance(merged[-1], part):
            last = merged.pop()
            part = ExcludedInterval(last.since, max(last.until, part.until), (*last.jumps, *part.jumps))
        merged.append(part)
    return merged


def _one_disturbance(first: ExcludedInterval, later: ExcludedInterval) -> bool:
    """Return whether two intervals, in chronological order, belong to one disturbance.

    Two single kicks that follow each other closely may be the ends of a push.
    """
    if first.of_counts or later.of_counts:
        return False
    if first.of_reading or later.of_reading:
        return later.since - first.until < DISTURBANCE.joins_s
    both_of_release, single = np.isinf(later.since), len(first.jumps) == len(later.jumps) == 1
    return bool(both_of_release or (single and later.until - first.since < DISTURBANCE.push_s))


def _without(record: Record, parts: Sequence[ExcludedInterval]) -> Record:
    """Return the record without the given intervals, with a finding for each."""
    findings = [_finding(record, part) for part in parts]
    for part in parts:
        record = _with_missed_counts(record, part) if part.of_counts else record.left_out(part.since, part.until)
    return record.with_findings(findings)


def _with_missed_counts(record: Record, part: ExcludedInterval) -> Record:
    """Add a step of missed counts to the record; an effect of the model estimates their number."""
    (step,) = part.jumps
    steps = sorted([*record.screened.breaks, (step.at, int(step.joint or 0))])
    breaks = np.sort(np.append(record.breaks, step.at))
    return replace(record, breaks=breaks, screened=replace(record.screened, breaks=tuple(steps)))


def _finding(record: Record, part: ExcludedInterval) -> SensorFinding:
    first, run = part.jumps[0], record.run.name
    if not part.of_reading:
        at_s = part.since
        evidence = (
            "until {:.3g} s the rods do not swing freely: a hand pushes or holds them; these readings are excluded"
        )
        if np.isinf(part.since):
            at_s = float(record.t[0])
            evidence = HELD
        elif len(part.jumps) == 1:
            speeds = " and ".join(f"{change:+.2g}" for change in dict.fromkeys(first.size))
            excluded = f"the readings of {DISTURBANCE.kick_s:g} s around it are excluded"
            at_s, evidence = first.at, f"a kick changes the speed of the rods by {speeds} rad/s: {excluded}"
        return SensorFinding("disturbance", run, None, at_s, evidence.format(part.until))
    steps = [jump for jump in part.jumps if jump.joint is not None]
    step, name = steps[0], "reading_step"
    evidence = f"the reading steps by {1e3 * step.size[0]:+.3g} mrad"
    if part.of_counts:
        name = MISSED_COUNTS.name
    elif len(steps) > 1 and np.isfinite([part.since, part.until]).all():
        evidence += f" and returns at {steps[-1].at:.3g} s: the readings in between are excluded"
    else:
        rest = "later" if np.isinf(part.until) else "earlier"
        evidence += f" and stays: the tracker or the encoder slipped; the {rest} readings are excluded"
    return SensorFinding(name, run, AXES[step.joint or 0], step.at, evidence, step=step.size[0])
