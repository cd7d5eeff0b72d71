import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol.device_role import DeviceSession
from firmware_protocol.identity import DeviceInfo
from firmware_protocol.messages import Ack, Frame, Position, Sample, decode
from firmware_protocol.stream import Row, SampleStream, blind_ticks, unwrap

SESSION = DeviceSession(DeviceInfo("0.1.0", "1", (16384, 16384, 16384), 4000, 100))


def fed(stream: SampleStream, frames: list[Frame]) -> list[Row]:
    return [row for frame in frames if (row := stream.feed(decode(frame)))]


def anchored(counts: tuple[int, int, int] = (0, 0, 0)) -> SampleStream:
    stream = SampleStream()
    for joint, position in enumerate(counts):
        stream.feed(Position(joint, 0, position))
    return stream


def walk(rng: np.random.Generator, n: int, speed: int) -> list[tuple[int, int, int]]:
    """Motion of three joints with up to `speed` counts per tick, mostly in one direction, so that the counters
    overflow."""
    steps = rng.integers(-speed // 4, speed + 1, size=(n, 3)) * np.array([1, -1, 1])
    return [tuple(int(count) for count in row) for row in np.cumsum(steps, axis=0)]


@given(st.integers(-(1 << 40), 1 << 40), st.integers(-32768, 32767), st.sampled_from([16, 32]))
def test_unwrap_finds_the_nearest(near: int, off: int, bits: int):
    assert unwrap((near + off) % (1 << bits), near, bits) == near + off


@pytest.mark.slow
def test_many_wraps_of_ticks_and_positions(rng: np.random.Generator):
    truth = walk(rng, 200_000, 3000)
    stream = SampleStream()
    frames = [*SESSION.positions(0, (0, 0, 0)), *(SESSION.sample(tick, row) for tick, row in enumerate(truth))]
    assert fed(stream, frames) == list(enumerate(truth))
    assert abs(truth[-1][1]) > 1000 * 65536
    assert (stream.lost_tick_gap, stream.contradicted, stream.contradicted_position) == (0, 0, 0)


@pytest.mark.parametrize("seed", range(5))
def test_gaps_are_counted_and_what_arrives_is_right(seed: int):
    rng = np.random.default_rng(seed)
    truth = walk(rng, 20_000, 700)
    stream, frames, sent = SampleStream(), list(SESSION.positions(0, truth[0])), []
    tick = 0
    while tick < len(truth):
        if tick % 100 == 0:
            frames += SESSION.positions(tick, truth[tick])
        frames.append(SESSION.sample(tick, truth[tick]))
        sent.append((tick, truth[tick]))
        tick += 1 if rng.random() < 0.95 else int(rng.integers(2, 45))
    assert fed(stream, frames) == sent
    assert stream.lost_tick_gap == sent[-1][0] + 1 - len(sent)
    assert (stream.contradicted, stream.contradicted_position) == (0, 0)


def test_samples_missing_from_the_very_start_are_counted():
    stream = anchored()
    assert stream.feed(Sample(5, 0, 0, 0)) == Row(5, (0, 0, 0))
    assert stream.lost_tick_gap == 5


@pytest.mark.parametrize("stale", [10, 9, 0, 65535])
def test_doubled_and_late_samples_are_left_out(stale: int):
    stream = anchored()
    for tick in range(11):
        stream.feed(Sample(tick, tick, 0, 0))
    assert stream.feed(Sample(stale, 77, 77, 77)) is None
    assert stream.feed(Sample(11, 11, 0, 0)) == Row(11, (11, 0, 0))
    assert stream.lost_tick_gap == 0


def test_samples_wait_for_every_joint_s_counter():
    stream = SampleStream()
    assert stream.feed(Sample(0, 1, 2, 3)) is None
    stream.feed(Position(0, 0, 65536))
    stream.feed(Position(2, 0, -65536))
    assert stream.feed(Sample(1, 1, 2, 3)) is None
    stream.feed(Position(1, 0, 1 << 20))
    assert stream.feed(Sample(2, 1, 2, 3)) == Row(2, (65537, (1 << 20) + 2, -65533))
    assert stream.lost_tick_gap == 0


def test_a_turn_missed_in_a_gap_is_corrected_and_reported():
    stream = anchored()
    stream.feed(Sample(0, 0, 0, 0))
    moved = 50_000
    assert stream.feed(Sample(1000, moved, 0, 0)) == Row(1000, (moved - 65536, 0, 0))
    stream.feed(Position(0, 1000, moved))
    assert stream.feed(Sample(1001, moved, 0, 0)) == Row(1001, (moved, 0, 0))
    assert (stream.contradicted, stream.contradicted_position) == (0, 1)


def test_blind_ticks_follow_from_the_counters():
    assert blind_ticks(1000, (16384, 16384, 16384)) == 99
    assert blind_ticks(4000, (4096, 65536, 4096)) == 99
    assert blind_ticks(10, (1 << 20, 4, 4)) == 1
    assert blind_ticks(4000, (4, 4, 4)) == 0x7FFF


def test_after_a_gap_in_which_a_joint_may_have_gone_round_samples_wait_for_the_whole_counters():
    stream = anchored()
    stream.restart(blind_ticks=99)
    assert stream.feed(Sample(0, 0, 0, 0)) == Row(0, (0, 0, 0))
    moved = 50_000
    assert stream.feed(Sample(1000, moved, 0, 0)) is None  # a leap, not believed before the next
    assert stream.feed(Sample(1001, moved, 0, 0)) is None  # 50000 or -15536: nobody knows
    stream.feed(Position(0, 1002, moved))
    stream.feed(Position(1, 1002, 0))
    assert stream.feed(Sample(1002, moved, 0, 0)) is None
    stream.feed(Position(2, 1002, 0))
    assert stream.feed(Sample(1003, moved, 0, 0)) == Row(1003, (moved, 0, 0))
    assert (stream.lost_tick_gap, stream.contradicted, stream.contradicted_position) == (1000, 0, 0)


def test_complete_counters_received_at_the_end_of_a_gap_are_kept():
    stream = anchored()
    stream.restart(blind_ticks=99)
    stream.feed(Sample(0, 0, 0, 0))
    for joint, position in enumerate((50_000, -50_000, 7)):
        stream.feed(Position(joint, 1000, position))
    stream.feed(Sample(1000, 50_000, -50_000 & 0xFFFF, 7))
    assert stream.feed(Sample(1001, 50_000, -50_000 & 0xFFFF, 7)) == Row(1001, (50_000, -50_000, 7))


def test_a_damaged_tick_hides_no_samples():
    stream = anchored()
    stream.restart(blind_ticks=99)
    rows = [stream.feed(Sample(tick, 0, 0, 0)) for tick in (0, 1, 20_000, 2, 3)]
    assert [row.tick for row in rows if row] == [0, 1, 2, 3]
    assert stream.lost_tick_gap == 0


def test_a_position_that_comes_far_too_late_is_not_believed():
    stream = anchored()
    stream.restart(blind_ticks=99)
    for tick in range(0, 400, 50):
        stream.feed(Sample(tick, tick * 400 & 0xFFFF, 0, 0))
    stream.feed(Position(0, 0, 0))
    assert stream.feed(Sample(351, 140_400 & 0xFFFF, 0, 0)) == Row(351, (140_400, 0, 0))
    assert (stream.contradicted, stream.contradicted_position) == (0, 0)


def test_the_32_bit_counter_wraps_too():
    edge = (1 << 31) - 1
    stream = anchored((edge, 0, 0))
    stream.feed(Sample(0, (edge + 5) & 0xFFFF, 0, 0))
    stream.feed(Position(0, 0, edge + 10 - (1 << 32)))
    assert stream.feed(Sample(1, (edge + 12) & 0xFFFF, 0, 0)) == Row(1, (edge + 12, 0, 0))
    assert (stream.contradicted, stream.contradicted_position) == (0, 0)


def test_restart_begins_at_tick_0_and_keeps_positions():
    stream = anchored((100_000, 0, 0))
    stream.feed(Sample(40_000, 100_000 & 0xFFFF, 0, 0))
    stream.feed(Sample(7, 100_000 & 0xFFFF, 0, 0))
    lost = stream.lost_tick_gap
    stream.restart()
    assert stream.feed(Sample(0, 100_001 & 0xFFFF, 0, 0)) == Row(0, (100_001, 0, 0))
    assert stream.lost_tick_gap == lost


def test_a_turn_of_an_idle_device_contradicts_nothing():
    """The ticks of an idle device restart at 0 and reach those of the stream again."""
    stream = anchored()
    stream.restart(blind_ticks=99)
    for tick in range(200):
        stream.feed(Sample(tick, 0, 0, 0))
    stream.stop()
    for tick in range(0, 400, 20):
        stream.feed(Position(0, tick, 0 if tick < 100 else 40_000))
    assert (stream.contradicted, stream.contradicted_position) == (0, 0)
    stream.restart(blind_ticks=99)
    assert stream.feed(Sample(0, 40_000, 0, 0)) == Row(0, (40_000, 0, 0))


def test_other_messages_give_nothing():
    assert SampleStream().feed(Ack(33, 1)) is None
