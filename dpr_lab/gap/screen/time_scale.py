"""Test of the time base of single-rod recordings against the period that gravity determines.

A rod swings like a mass point at the distance I / S from its joint, with inertia I and first moment S. If all mass is
between the joint and the end of the rod at L, this equivalent length is at most L (Huygens). If all time intervals are
recorded k times too long, the equivalent length appears k^2 times longer. The readings do not show the error in any
other way, because the motion of one rod determines I / S only in combination with the unit of time. With two rods the
unit of time is identifiable, because the coupling d relates gravity to L1.

Source: Huygens (1673), Horologium oscillatorium, part 4.
"""

import math
from dataclasses import dataclass, replace

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import base_of_run, whole_parameters
from dpr_lab.fitting.estimate import whole_of
from dpr_lab.gap.screen.pieces import are_pieces
from dpr_lab.gap.screen.record import Record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.identification.misread.local_motion import shows_a_period
from dpr_lab.rig import Rig
from dpr_lab.setup import Setup


@dataclass(frozen=True, slots=True)
class TimeScaleRules:
    """Limits beyond which the equivalent length of a rod contradicts the rig file."""

    longer: float = 1.5
    """Maximum ratio of the equivalent length to the length of the rod.

    The limit exceeds 1 because a rod may extend past the specified length and may have a small counterweight.
    """
    apart: float = 3.0
    """Maximum factor between the equivalent length and its value from the rig file, in either direction.

    The limit is large because some values in the file are guesses.
    """
    swings: int = 10
    """Number of swings whose duration the message asks the reader to measure with a stopwatch."""


TIME_SCALE = TimeScaleRules()


def with_time_scale(recordings: Recordings, ratios: Array) -> Recordings:
    """Add a finding to the first recording whose time stamps are inconsistent with gravity.

    Args:
        recordings: the runs
        ratios: (7,) ratios that were fitted to the runs
    """
    for number, record in enumerate(recordings.records):
        if evidence := _contradiction(record, recordings.rig, ratios):
            records = list(recordings.records)
            records[number] = record.with_finding("time_scale", evidence)
            return replace(recordings, records=tuple(records))
    return recordings


def equivalent_length(whole: Array, setup: Setup, rig: Rig) -> float:
    """Return the equivalent length of a single rod, m, from (7,) base parameters."""
    inner, outer, _, gravity, *_ = base_of_run(whole, setup, rig.L1, rig.g).tolist()
    return rig.g * (inner + outer) / gravity if gravity > 0 else math.inf


def _contradiction(record: Record, rig: Rig, ratios: Array) -> str:
    """Describe how the time stamps of a single-rod recording contradict gravity.

    The text is empty if they are consistent, or if the recording is not a free swing of a single rod.
    """
    setup = record.run.setup
    swings = are_pieces([record.run.name]) or shows_a_period(record.run.swing.theta[:, 1:])
    if not (setup.alone and setup.free and swings) or record.encoder0_moves:
        return ""
    length = equivalent_length(whole_of(ratios), setup, rig)
    nominal = equivalent_length(whole_parameters(rig.nominal, rig.L1, rig.g), setup, rig)
    end = (rig.L1 if setup.mounting == "inner" else rig.L2) or nominal
    factor = math.sqrt(length / nominal)
    too_long = length > max(TIME_SCALE.longer * end, TIME_SCALE.apart * nominal)
    if not math.isfinite(factor) or not (too_long or TIME_SCALE.apart * length < nominal):
        return ""
    stamps = f"{factor:.2g} times too long" if too_long else f"{1 / factor:.2g} times too short"
    film = "in slow motion, of unknown frame rate" if too_long else "with fewer frames per second than stated"
    masses = "has a counterweight" if too_long else "is much shorter, or has its mass near the joint"
    expected = TIME_SCALE.swings * 2 * math.pi * math.sqrt(nominal / rig.g)
    return (
        f"the rod swings like a simple pendulum of {length:.3g} m; the rig file gives {nominal:.3g} m. Either"
        f" the time stamps are {stamps} (a video {film}), or the rod {masses}. These recordings cannot"
        f" distinguish the two cases. Time {TIME_SCALE.swings} small swings with a stopwatch: the rig"
        f" file predicts {expected:.3g} s, the time stamps {factor * expected:.3g} s"
    )
