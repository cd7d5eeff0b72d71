"""Clock rate and offset of the device, from PING and PONG exchanges during a stream."""

from collections import deque

from dpr_lab.acquisition.settings import DeviceTiming
from firmware_protocol.clock import FEWEST, ClockFit, Exchange, Pinger, fit_clock
from firmware_protocol.messages import Ping, Pong


class PingClock:
    """Schedule of the PING commands, and the clock fit to the PONG answers.

    Args:
        timing: intervals of the PING commands, and number of exchanges that are kept
        now: host time of the first PING, s
    """

    def __init__(self, timing: DeviceTiming, now: float) -> None:
        self._timing = timing
        self._pinger = Pinger()
        self._exchanges: deque[Exchange] = deque(maxlen=timing.exchanges)
        self._quick, self._sent, self._due_at = 0, 0, now
        self._streaming = False

    def restart(self, now: float) -> None:
        """Discard the exchanges of the previous stream, and send fast PING commands from the host time `now`, s."""
        self._exchanges.clear()
        self._streaming = True
        self._quick, self._sent, self._due_at = self._timing.quick_pings, 0, now

    def stop(self) -> None:
        """End the stream; later answers are ignored, because the device may restart its ticks."""
        self._streaming = False

    def due(self, now: float) -> Ping | None:
        """Return the PING that is due at the host time `now`, s, or None."""
        if now < self._due_at:
            return None
        self._due_at = now + (self._timing.quick_ping_s if self._quick else self._timing.ping_s)
        self._quick = max(0, self._quick - 1)
        self._sent += 1
        return self._pinger.ping(now)

    def note(self, pong: Pong, host_time: float) -> None:
        """Add a PONG that arrived at the host time `host_time`, s.

        The call has no effect if no stream is in progress.
        """
        exchange = self._pinger.exchange(pong, host_time)
        if exchange is not None and self._streaming:
            self._exchanges.append(exchange)

    def fit(self, rate_hz: float) -> tuple[ClockFit | None, str]:
        """Fit the host time as a linear function of the ticks.

        Return the fit and an empty text, or None and the reason.
        """
        exchanges = list(self._exchanges)
        if len(exchanges) < FEWEST:
            return None, f"{len(exchanges) or 'none'} of {self._sent} PING commands were answered"
        ticks = {exchange.ticks for exchange in exchanges}
        try:
            return fit_clock(exchanges, rate_hz), ""
        except (ValueError, ZeroDivisionError):
            frozen = f"all {len(exchanges)} PONG answers gave tick {min(ticks):.0f}"
            too_few = f"{len(exchanges)} PONG answers gave only {len(ticks)} different ticks"
            return None, frozen if len(ticks) == 1 else too_few
