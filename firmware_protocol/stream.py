"""Reconstruction of complete ticks and positions from the low bits in SAMPLE."""

from collections.abc import Iterable
from typing import NamedTuple

from firmware_protocol.messages import Message, Position, Sample

FASTEST_TURNS_S = 20.0
"""Assumed maximum speed of a joint, turns per second. A free rod of a typical rig reaches a third of it."""
HALF_RANGE = 0x7FFF
"""Maximum difference between two messages, counts or ticks, at which the low 16 bits are unambiguous."""


REMEMBERED = 1024
"""Number of recent samples that are kept, for comparison with repeated ones."""
LATE_IN_A_ROW = 6
"""Number of consecutive samples with past ticks above which reordering by a link is no longer an explanation."""


class Row(NamedTuple):
    """One sample: ticks since STREAM, and the multi-turn counters of arm, inner and outer rod, counts."""

    tick: int
    counts: tuple[int, int, int]


def unwrap(low: int, near: int, bits: int) -> int:
    """Return the integer nearest to `near` whose low bits are `low`."""
    half = 1 << bits - 1
    return near + (low - near + half) % (1 << bits) - half


def blind_ticks(rate_hz: int, counts_per_rev: Iterable[int]) -> int:
    """Return the maximum gap, ticks, after which the low 16 bits of SAMPLE still determine every position."""
    return max(1, min(HALF_RANGE, int(HALF_RANGE * rate_hz / (FASTEST_TURNS_S * max(counts_per_rev)))))


class SampleStream:
    """Reconstruction of one device's samples, in the order of arrival.

    During a gap longer than `blind_ticks`, a counter may make an unobserved turn. Samples are then discarded until
    POSITION, which is sent ten times per second, has provided the complete counter of every joint. A tick after such a
    gap is accepted only when a second sample follows it, because a damaged tick would otherwise discard all later
    samples.

    If two samples of one tick have different counts, the correct one is unknown. A link that duplicates or reorders
    frames delivers late samples, but no contradictory samples and not several late samples in succession. These two
    cases show that the tick of the device has decreased.
    """

    def __init__(self) -> None:
        self.lost_tick_gap = 0
        """Number of missing ticks between received samples."""
        self.contradicted = 0
        """Number of ticks that were repeated with different counts."""
        self.contradicted_position = 0
        """Number of POSITION messages that differ from the rows by multiples of 65536 counts. Some rows since the
        previous POSITION are then wrong."""
        self.went_back = False
        """Whether the device's ticks have decreased. The time of later samples is then unknown."""
        self._recent: dict[int, Sample] = {}
        self._late = 0
        self._blind = HALF_RANGE
        self._tick = -1
        self._leap: int | None = None
        self._counts: list[int | None] = [None, None, None]
        self._position_ticks = [-1, -1, -1]
        self._stopped = False

    def restart(self, blind_ticks: int = HALF_RANGE) -> None:
        """Restart at tick 0; positions remain known.

        Call it once, before STREAM is sent.
        """
        self._blind, self._tick, self._leap, self._position_ticks = blind_ticks, -1, None, [-1, -1, -1]
        self._late, self.went_back, self._stopped = 0, False, False
        self._recent.clear()

    def stop(self) -> None:
        """End the comparison of POSITION with the samples until the next `restart`.

        Call it once, after STOP. The ticks of an idle device are not those of the stream.
        """
        self._stopped = True

    def feed(self, message: Message) -> Row | None:
        """Process the next message.

        Returns:
            A row for a SAMPLE in order, otherwise None.
        """
        if isinstance(message, Sample):
            return self._row(message)
        if isinstance(message, Position):
            self._anchor(message)
        return None

    def _row(self, sample: Sample) -> Row | None:
        step = (sample.tick - self._tick) & 0xFFFF
        if not 0 < step < 0x8000:
            self._count_late(sample)
            return None
        if step > self._blind and not self._after_gap(sample.tick, self._tick + step):
            return None
        self._late = 0
        self._recent[sample.tick % REMEMBERED] = sample
        self._tick += step
        self.lost_tick_gap += step - 1
        near0, near1, near2 = self._counts
        if near0 is None or near1 is None or near2 is None:
            return None
        counts = (
            near0 + ((sample.position0 - near0 + 0x8000) & 0xFFFF) - 0x8000,
            near1 + ((sample.position1 - near1 + 0x8000) & 0xFFFF) - 0x8000,
            near2 + ((sample.position2 - near2 + 0x8000) & 0xFFFF) - 0x8000,
        )
        self._counts[:] = counts
        return Row(self._tick, counts)

    def contradicts(self, row: Row, sample: Sample) -> bool:
        """Return whether a sample has the tick of a row but different counts."""
        low = tuple(count & 0xFFFF for count in row.counts)
        return sample.tick == row.tick & 0xFFFF and low != (sample.position0, sample.position1, sample.position2)

    def _count_late(self, late: Sample) -> None:
        if self._tick < 0:
            return  # a sample of the previous stream
        before = self._recent.get(late.tick % REMEMBERED)
        self.contradicted += before is not None and before.tick == late.tick and before != late
        self._late += 1
        self.went_back |= self._late >= LATE_IN_A_ROW

    def _after_gap(self, low: int, tick: int) -> bool:
        """Return whether a jump of the tick is accepted.

        After an accepted jump, counters that no POSITION has confirmed are discarded.
        """
        leap, self._leap = self._leap, low
        if leap is None or not 0 < (low - leap) & 0xFFFF <= self._blind:
            return False
        for joint, position_tick in enumerate(self._position_ticks):
            if tick - max(position_tick, self._tick) > self._blind:
                self._counts[joint] = None
        return True

    def _anchor(self, position: Position) -> None:
        if self._stopped:
            self._counts[position.joint] = position.position
            return
        near, tick = self._counts[position.joint], unwrap(position.tick, self._tick, 16)
        if self._tick >= 0:
            if tick < self._tick - self._blind:
                return  # the message is so late that the joint may have made another turn since
            self._position_ticks[position.joint] = tick
        if near is None or tick - self._tick > self._blind:
            self._counts[position.joint] = position.position
            return
        whole = unwrap(position.position, near, 32)
        self.contradicted_position += self._tick >= 0 and abs(whole - near) >= 0x8000
        self._counts[position.joint] = whole
