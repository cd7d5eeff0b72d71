"""Whole ticks and positions from the low bits that SAMPLE carries."""

from typing import NamedTuple

from firmware_protocol.messages import Event, Message, Position, Sample


class Row(NamedTuple):
    """One sample: ticks since STREAM, and the multi-turn counters of arm, inner and outer rod, counts."""

    tick: int
    counts: tuple[int, int, int]


def unwrap(low: int, near: int, bits: int) -> int:
    """The integer nearest to `near` whose low bits are `low`."""
    half = 1 << bits - 1
    return near + (low - near + half) % (1 << bits) - half


class SampleStream:
    """Follows one device's messages in the order they arrived.

    Ticks are right as long as fewer than 32768 in a row are missing, positions as long as no joint turns more than
    32767 counts between two messages that tell of it; POSITION, ten times a second, bounds that wait.
    """

    def __init__(self) -> None:
        self.lost_tick_gap = 0
        """Samples that never arrived: ticks missing between those that did."""
        self.out_of_order = 0
        """Samples left out because their tick had been there or was passed."""
        self.unanchored = 0
        """Samples left out because a joint's whole counter was not known yet."""
        self.position_slips = 0
        """Times a POSITION showed that a gap had been too long: rows since that gap are off by whole 65536 counts."""
        self._tick = -1
        self._counts: list[int | None] = [None, None, None]

    def restart(self) -> None:
        """Begin again at tick 0: call once, when STREAM is acknowledged. Positions stay known."""
        self._tick = -1

    def feed(self, message: Message) -> Row | None:
        """Take the next message; a SAMPLE in order gives a row, any other message None."""
        if isinstance(message, Sample):
            return self._row(message)
        if isinstance(message, Position):
            self._anchor(message)
        return None

    def tick_of(self, event: Event) -> int:
        """The whole tick of an EVENT, on the count of the rows."""
        return unwrap(event.tick, max(self._tick, 0), 32)

    def _row(self, sample: Sample) -> Row | None:
        step = (sample.tick - self._tick) & 0xFFFF
        if not 0 < step < 0x8000:
            self.out_of_order += 1
            return None
        self._tick += step
        self.lost_tick_gap += step - 1
        near0, near1, near2 = self._counts
        if near0 is None or near1 is None or near2 is None:
            self.unanchored += 1
            return None
        counts = (
            near0 + ((sample.position0 - near0 + 0x8000) & 0xFFFF) - 0x8000,
            near1 + ((sample.position1 - near1 + 0x8000) & 0xFFFF) - 0x8000,
            near2 + ((sample.position2 - near2 + 0x8000) & 0xFFFF) - 0x8000,
        )
        self._counts[:] = counts
        return Row(self._tick, counts)

    def _anchor(self, position: Position) -> None:
        near = self._counts[position.joint]
        if near is None:
            self._counts[position.joint] = position.position
            return
        whole = unwrap(position.position, near, 32)
        self.position_slips += abs(whole - near) >= 0x8000
        self._counts[position.joint] = whole
