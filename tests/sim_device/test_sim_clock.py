"""Device time."""

import pytest

from firmware_protocol.messages import State
from sim_device.firmware.clock import CLOCKS, LONGEST_STEP, Clock
from sim_device.plant.operator import HABITS

FAST = CLOCKS["fast"]


def test_real_time_follows_the_wall_with_the_crystal_s_error():
    clock = Clock(CLOCKS["realtime"], drift_ppm=100.0)
    assert clock.advance(50.0, State.IDLE, 1000) == 0.0
    for wall in (50.4, 51.0, 150.0):
        clock.advance(wall, State.STREAMING, 1000, blocked=True)
    assert clock.now == pytest.approx(100.0 * (1 + 1e-4), abs=1e-9)
    assert not clock.simulated


@pytest.mark.parametrize("state", State)
def test_fast_time_has_a_pace_for_every_state(state):
    clock = Clock(FAST)
    clock.advance(0.0, state, 1000)
    assert clock.advance(0.01, state, 1000) == pytest.approx(0.01 * FAST.get(state, 1.0))
    assert clock.simulated


@pytest.mark.parametrize("state", [State.IDLE, State.HOLDING])
def test_fast_time_places_the_rods_within_six_loops_of_the_device(state):
    clock = Clock(FAST)
    for loop in range(6):
        clock.advance(loop * LONGEST_STEP, state, 1000)
    assert clock.now >= HABITS.placing_time


@pytest.mark.parametrize(("rate_hz", "pace"), [(50, 60.0), (1000, 4.0), (4000, 1.0), (5000, 1.0)])
def test_fast_time_keeps_to_the_ticks_a_host_can_take(rate_hz, pace):
    clock = Clock(FAST, most_ticks_hz=4000)
    clock.advance(0.0, State.RELEASED, rate_hz)
    assert clock.advance(0.01, State.RELEASED, rate_hz) == pytest.approx(0.01 * pace)


def test_fast_time_stands_still_while_the_link_is_blocked_and_does_not_catch_up():
    clock = Clock(FAST)
    clock.advance(0.0, State.RELEASED, 1000)
    before = clock.advance(0.01, State.RELEASED, 1000)
    assert clock.advance(5.0, State.RELEASED, 1000, blocked=True) == before
    assert clock.advance(5.01, State.RELEASED, 1000) == pytest.approx(2 * before)


def test_fast_time_skips_a_stall():
    clock = Clock(FAST)
    clock.advance(0.0, State.RELEASED, 1000)
    assert clock.advance(60.0, State.RELEASED, 1000) == pytest.approx(LONGEST_STEP * FAST[State.RELEASED])
