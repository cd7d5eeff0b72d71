"""Clock fit from PING and PONG: answers that belong to the ticks of a stream."""

import pytest

from dpr_lab.acquisition.device import Device
from dpr_lab.acquisition.ping_clock import PingClock
from dpr_lab.acquisition.settings import DEVICE_TIMING
from firmware_protocol.messages import Pong
from tests.acquisition.test_device import Loop


def ask(clock: PingClock, now: float, tick: int) -> None:
    """Exchange PING and PONG, with an answer after one millisecond."""
    ping = clock.due(now)
    assert ping is not None
    clock.note(Pong(token=ping.token, tick=tick, fraction=0), now + 1e-3)


def test_an_answer_after_the_stop_does_not_belong_to_the_stream() -> None:
    """A device restarts its ticks when it stops, but pings continue."""
    clock = PingClock(DEVICE_TIMING, 0.0)
    clock.restart(0.0)
    for second in range(1, 11):
        ask(clock, float(second), 1000 * second)
    clock.stop()
    ask(clock, 11.0, 3)
    fit, _ = clock.fit(1000.0)
    assert fit is not None
    assert fit.rate_ppm == pytest.approx(0.0, abs=1.0)


def test_a_new_stream_discards_the_exchanges_of_the_previous_one() -> None:
    """The ticks of both begin at zero, so one line cannot describe them."""
    clock = PingClock(DEVICE_TIMING, 0.0)
    for begin in (0.0, 20.0):
        clock.restart(begin)
        for second in range(1, 11):
            ask(clock, begin + second, 1000 * second)
    fit, _ = clock.fit(1000.0)
    assert fit is not None
    assert fit.rate_ppm == pytest.approx(0.0, abs=1.0)
    assert fit.offset == pytest.approx(20.0, abs=1e-3)


def test_the_clock_is_fitted_while_the_reader_adds_no_exchange(monkeypatch: pytest.MonkeyPatch) -> None:
    with Device(Loop()) as device:
        device.connect()
        monkeypatch.setattr(PingClock, "fit", lambda *_: device._lock._is_owned())
        assert device.clock() is True
