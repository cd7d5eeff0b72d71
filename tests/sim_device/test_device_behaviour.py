"""Behaviour of the simulated board with artificial wall time and without a link."""

import numpy as np
import pytest

from dpr_lab.errors import ConfigError
from firmware_protocol.errors import CommandRefused
from firmware_protocol.messages import (
    Event,
    EventKind,
    Hold,
    NakCode,
    Ping,
    Pong,
    Position,
    Release,
    Sample,
    State,
    Status,
    Stop,
    Stream,
    encode,
)
from sim_device.faults import FAULTS, Faults, parse_faults
from sim_device.plant.config import load_plant
from sim_device.plant.operator import placement, release_speed
from sim_device.plant.plant import Plant
from tests.plant_motion import motion

NOISE_COUNTS = 0.5
FAR = 6 * NOISE_COUNTS + 0.5
"""Difference in counts that noise and rounding do not reach."""


def off(counts: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Differences of low words from positions, counts."""
    return np.mod(counts - positions + 32768, 65536) - 32768


def away(counts: np.ndarray, positions: np.ndarray) -> float:
    """Largest difference of low words from positions, counts."""
    return np.abs(off(counts, positions)).max()


def true_positions(rig, t: np.ndarray, pose: int, release: int = 1, seed: int = 1) -> np.ndarray:
    """Counts (n, 3) of ideal encoders `t` seconds after a release."""
    config = load_plant("paper", seed)
    start = placement(config.hand, list(rig.poses.values())[pose - 1], seed, release)
    omega = release_speed(config.hand, seed, release)
    return rig.positions(motion(Plant(config, rig), start, omega, t)[:, :3])


@pytest.mark.parametrize("pose", [1, 2, 3])
@pytest.mark.parametrize("rate_hz", [200, 1000, 1700])
def test_the_swing_begins_at_the_release_tick(bench, paper, pose, rate_hz):
    host = bench.direct()
    tick = host.release(pose, rate_hz, rest=200, swing=rate_hz)
    counts = host.counts()
    assert np.array_equal(counts[:, 0], np.arange(len(counts)))
    swing = counts[tick : tick + rate_hz]
    assert away(swing[:, 1:], true_positions(paper, np.arange(rate_hz) / rate_hz, pose)) < FAR
    # One tick off would show: the rods move many counts a tick by then.
    assert away(swing[1:, 1:], true_positions(paper, np.arange(rate_hz - 1) / rate_hz, pose)) > 2 * FAR


def test_the_rest_before_the_release_is_rest(bench, paper):
    host = bench.direct()
    tick = host.release(pose=2, rest=2000)
    rest = host.counts()[:tick, 1:]
    held = true_positions(paper, np.zeros(1), pose=2)
    assert away(rest, held) < FAR
    rest = off(rest, held)
    assert rest.std(axis=0) == pytest.approx(np.sqrt(NOISE_COUNTS**2 + 1 / 12), rel=0.1)
    assert np.abs(rest[:1000].mean(axis=0) - rest[1000:].mean(axis=0)).max() < 0.1


@pytest.mark.slow
def test_counts_do_not_depend_on_how_often_the_board_is_served(bench):
    finely, coarsely = bench.direct(step_s=0.0013), bench.direct(step_s=0.09)
    swings = []
    for host in (finely, coarsely):
        tick = host.release(pose=2, swing=3000)
        swings.append(host.counts()[tick : tick + 3000, 1:])
    assert np.array_equal(*swings)


def test_the_rods_are_placed_again_for_the_next_release(bench, paper):
    host = bench.direct()
    for release in (1, 2):
        tick = host.release(pose=2, swing=1500)
        swing = host.counts()[tick : tick + 1500, 1:]
        assert away(swing, true_positions(paper, np.arange(1500) / 1000, pose=2, release=release)) < FAR


@pytest.mark.parametrize("drift_ppm", [-200.0, 200.0])
def test_a_crystal_that_is_off_stretches_the_swing(bench, paper, drift_ppm):
    host = bench.direct(drift_ppm=drift_ppm)
    tick = host.release(pose=2, swing=1500)
    swing, t = host.counts()[tick : tick + 1500, 1:], np.arange(1500) / 1000
    assert away(swing, true_positions(paper, t / (1 + drift_ppm * 1e-6), pose=2)) < FAR
    assert away(swing, true_positions(paper, t, pose=2)) > FAR


def test_whole_counters_come_first_and_agree_with_the_samples(bench):
    host = bench.direct()
    host.release(pose=3, swing=3000)
    streamed = host.messages[next(i for i, m in enumerate(host.messages) if isinstance(m, Sample)) - 4 :]
    assert [type(m) for m in streamed[:5]] == [Position, Position, Position, Status, Sample]
    samples = {m.tick: (m.position0, m.position1, m.position2) for m in streamed if isinstance(m, Sample)}
    last = max(samples)
    positions = [m for m in streamed if isinstance(m, Position) and m.tick in samples][: 3 * (last // 100)]
    assert len(positions) == 3 * (last // 100)
    assert all(m.position % 65536 == samples[m.tick][m.joint] for m in positions)
    assert any(abs(m.position) > 32768 for m in positions)


def test_reports_come_ten_times_a_second_in_every_state_once_greeted(bench):
    host = bench.direct()
    for command in (None, Hold(pose=1), Stream(rate_hz=500), Release(), Stop()):
        if command is not None:
            host.do(command)
        host.messages.clear()
        host.run_for(2.0)
        assert 19 <= len(host.of(Status)) <= 21
        assert len(host.of(Position)) == 3 * len(host.of(Status))
        assert len({m.state for m in host.of(Status)}) == 1


def test_nothing_is_sent_before_hello(bench):
    host = bench.direct()
    host.end.device.reset()
    host.messages.clear()
    host.end.write(encode(Ping(7)))
    host.run_for(1.0)
    assert {type(m) for m in host.messages} == {Pong}
    with pytest.raises(CommandRefused) as caught:
        host.do(Hold())
    assert caught.value.code is NakCode.NOT_GREETED


def test_pose_0_keeps_the_rods_where_they_hang(bench):
    host = bench.direct()
    host.do(Hold(pose=0))
    host.do(Stream(rate_hz=1000))
    host.run_for(1.0)
    assert away(host.counts()[:, 1:], np.zeros(3)) < FAR


def test_the_simulated_operator_needs_time_and_can_be_set_to_miss_the_pose(bench, paper):
    host = bench.direct(hand_error=0.2)
    host.do(Hold(pose=3))
    host.do(Stream(rate_hz=1000))
    host.run_for(1.0)
    inner = off(host.counts()[:, 2], np.zeros(1))
    target = paper.positions(paper.poses["X3"].theta + np.array([0.0, 0.2, 0.2]))[1]
    assert abs(inner[0]) < 200
    assert 0.2 < inner[250] / target < 0.8
    assert abs(inner[-1] - target) < 0.04 * 16384 / (2 * np.pi)


def test_a_silent_host_stops_the_stream_and_never_opens_the_latch(bench):
    host = bench.direct()
    host.do(Hold(pose=2))
    host.run_for(0.6)
    host.do(Stream(rate_hz=1000))
    host.session.info = None  # the session sends no more keepalives
    host.run_for(1.5)
    assert [m.kind for m in host.of(Event)] == [EventKind.LEASE_LOST]
    last = host.of(Status)[-1]
    assert (last.state, last.latched) == (State.HOLDING, True)
    assert 450 <= len(host.of(Sample)) <= 650
    still = [m.position for m in host.of(Position) if m.joint == 1][-5:]
    assert np.ptp(still) <= 2 * FAR


def test_pong_contains_the_present_tick(bench):
    host = bench.direct(step_s=0.00037)
    host.do(Hold())
    host.do(Stream(rate_hz=1000))
    pongs = []
    for token in range(50):
        host.messages.clear()
        asked = host.now()
        host.end.write(encode(Ping(token)))
        host.until(lambda: host.of(Pong))
        pong = host.of(Pong)[0]
        assert pong.token == token
        pongs.append((asked, pong.tick + pong.fraction / 65536))
        host.run_for(0.0123)
    asked, ticks = np.array(pongs).T
    assert ticks - ticks[0] == pytest.approx(1000 * (asked - asked[0]), abs=1e-3)


def test_the_rods_swing_on_after_stop(bench):
    host = bench.direct()
    host.release(pose=2, swing=500)
    host.messages.clear()
    host.run_for(3.0)
    assert np.ptp([m.position for m in host.of(Position) if m.joint == 1]) > 1000


def test_a_stuck_encoder_stays_at_its_release_value(bench):
    host = bench.direct(fault=("stuck_encoder=1",))
    tick = host.release(pose=2, swing=2000)
    swing = host.counts()[tick:, 1:]
    assert np.ptp(swing[:, 1]) == 0
    assert np.ptp(swing[:, 2]) > 1000


def test_a_reset_forgets_everything_and_drops_what_was_held(bench):
    host = bench.direct()
    host.do(Hold(pose=2))
    host.do(Stream(rate_hz=1000))
    host.run_for(1.0)
    host.end.device.reset()
    host.messages.clear()
    host.run_for(0.5)
    assert host.messages == []
    host.hello()
    host.run_for(2.0)
    assert host.of(Status)[-1].state is State.IDLE
    assert np.ptp([m.position for m in host.of(Position) if m.joint == 1]) > 1000


def test_a_free_arm_is_seen_by_its_encoder_and_a_clamped_one_is_not(bench):
    spread = {}
    for plant in ("paper", "arm"):
        host = bench.direct(plant=plant)
        tick = host.release(pose=2)
        arm = off(host.counts()[tick:, 1], np.zeros(1))
        spread[plant] = np.ptp(arm)
    assert spread["paper"] <= 2 * FAR
    assert spread["arm"] > 10


@pytest.mark.parametrize("text", ["drop=0.05", "duplicate=0.2", "flip=0.002", "garbage=0.3"])
def test_a_recording_over_a_bad_cable_ends_with_the_right_samples(bench, text):
    clean = bench.direct()
    clean_tick = clean.release(swing=1000)
    host = bench.connect(bench.serve(link="pty", clock="fast", fault=(text,)))
    host.hello()
    tick = host.release(swing=1000)
    expected = {k - clean_tick: tuple(row) for k, *row in clean.counts().tolist() if k >= clean_tick}
    received = [(k - tick, tuple(row)) for k, *row in host.counts().tolist() if tick <= k < tick + 1000]
    assert len(received) > 700
    assert all(expected[k] == row for k, row in received)
    seen = len({k for k, _ in received})
    decoder = host.end.decoder
    struck = {
        "drop": seen < 1000,
        "duplicate": len(received) > seen,
        "flip": decoder.crc_errors + decoder.framing_errors > 0 and seen < 1000,
        "garbage": decoder.crc_errors + decoder.framing_errors > 0,
    }
    assert struck[text.partition("=")[0]]


def test_faults_strike_as_often_as_asked():
    frames = [encode(Position(0, 0, tick)) for tick in range(20_000)]
    assert len(Faults({"drop": 0.1}, 1).frames(frames)) == pytest.approx(18_000, abs=200)
    assert len(Faults({"duplicate": 0.1}, 1).frames(frames)) == pytest.approx(22_000, abs=200)
    sent = bytes(20_000)
    struck = np.frombuffer(Faults({"flip": 0.1}, 1).flipped(sent), dtype=np.uint8)
    assert np.count_nonzero(struck) == pytest.approx(2000, abs=200)
    assert set(struck.tolist()) == {0, 1, 2, 4, 8, 16, 32, 64, 128}
    assert Faults().frames(frames) is frames
    assert Faults().to_host(sent) is sent


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_without_a_good_value_is_refused_with_its_meaning(name):
    for value in (
        "",
        "much",
        "-1",
        "nan",
        *([] if FAULTS[name].highest == np.inf else [f"{FAULTS[name].highest * 2 + 1:.0f}"]),
    ):
        with pytest.raises(ConfigError, match=f"write {name}=VALUE"):
            parse_faults([f"{name}={value}"])
    assert parse_faults([f"{name}=1"]).value(name) == 1.0


def test_an_unknown_fault_is_named_with_those_there_are():
    with pytest.raises(ConfigError, match=r"unknown fault 'fire'.*drop, duplicate"):
        parse_faults(["fire=1"])
