from collections.abc import Callable

import numpy as np
import pytest

from firmware_protocol.clock import OUTSTANDING, ClockFit, Exchange, Pinger, fit_clock
from firmware_protocol.messages import Ping, Pong

RATE_HZ = 1000.0
Delay = Callable[[np.random.Generator], float]


def usb(rng: np.random.Generator) -> float:
    """Delay of one direction through a USB serial adapter: short, sometimes queued."""
    return 100e-6 + rng.exponential(40e-6) + (rng.random() < 0.1) * rng.uniform(0, 5e-3)


def record(rng: np.random.Generator, ppm: float, offset: float, n: int, delay: Delay = usb) -> list[Exchange]:
    """Exchange pings every half second with a device whose ticks are `ppm` fast and whose tick 0 was at `offset`, s."""
    rate = RATE_HZ * (1 + ppm * 1e-6)
    exchanges = []
    for sent in offset + 0.5 * np.arange(1, n + 1) + rng.uniform(0, 0.1, n):
        arrived = sent + delay(rng)
        exchanges.append(Exchange(float(sent), float((arrived - offset) * rate), float(arrived + delay(rng))))
    return exchanges


def misses(fit: ClockFit, ppm: float, offset: float) -> tuple[float, float]:
    """Errors of rate and offset, in standard uncertainties."""
    return abs(fit.rate_ppm - ppm) / fit.rate_ppm_std, abs(fit.offset - offset) / fit.offset_std


@pytest.mark.parametrize("ppm", [-80.0, 0.0, 3.0, 150.0])
def test_injected_rate_and_offset_are_recovered(ppm: float, rng: np.random.Generator):
    fit = fit_clock(record(rng, ppm, 1e5, 120), RATE_HZ)
    assert max(misses(fit, ppm, 1e5)) < 3
    assert fit.rate_ppm_std < 0.5
    assert fit.offset_std < 200e-6


@pytest.mark.slow
@pytest.mark.parametrize("n", [10, 30, 120])
def test_stated_intervals_hold_as_often_as_they_say(n: int, rng: np.random.Generator):
    trials = np.array([misses(fit_clock(record(rng, 42.0, 7.0, n), RATE_HZ), 42.0, 7.0) for _ in range(200)])
    rate_within, offset_within = (trials < 2).mean(axis=0)
    assert rate_within > 0.88
    assert offset_within > 0.95


def test_long_round_trips_do_not_bias_the_fit(rng: np.random.Generator):
    clean = record(rng, 20.0, 0.0, 60)
    queued = [Exchange(e.t_sent, e.ticks, e.t_received + 0.05) for e in record(rng, 20.0, 0.0, 40)]
    fit = fit_clock(clean + queued, RATE_HZ)
    assert max(misses(fit, 20.0, 0.0)) < 3
    assert fit.rtt_min < 1e-3
    assert fit.n == 50


def test_an_exact_line_is_found_exactly():
    exchanges = [Exchange(t, (t + 0.001 - 3.0) * RATE_HZ, t + 0.002) for t in np.linspace(4, 14, 21)]
    fit = fit_clock(exchanges, RATE_HZ)
    assert fit.offset == pytest.approx(3.0, abs=1e-9)
    assert fit.rate_ppm == pytest.approx(0.0, abs=1e-6)
    assert fit.offset_std >= fit.rtt_min / np.sqrt(12)
    assert fit.offset + 5000.0 * fit.period == pytest.approx(8.0, abs=1e-9)


def test_a_line_that_takes_longer_one_way_stays_within_the_offset_s_uncertainty(rng: np.random.Generator):
    slow_back = [Exchange(e.t_sent, e.ticks, e.t_received + 1e-3) for e in record(rng, 5.0, 0.0, 60)]
    fit = fit_clock(slow_back, RATE_HZ)
    assert abs(fit.offset) / fit.offset_std < 2
    assert abs(fit.rate_ppm - 5.0) / fit.rate_ppm_std < 3


def test_the_line_is_numpy_s_weighted_one(rng: np.random.Generator):
    exchanges = record(rng, 10.0, 2.0, 8, lambda _: 100e-6)
    fit = fit_clock(exchanges, RATE_HZ)
    ticks = np.array([e.ticks for e in exchanges])
    middle = np.array([(e.t_sent + e.t_received) / 2 for e in exchanges])
    period, offset = np.polyfit(ticks, middle, 1)
    assert (fit.period, fit.offset) == pytest.approx((period, offset), rel=1e-9)


@pytest.mark.parametrize("scale", [0.01, 100.0], ids=["smaller", "larger"])
def test_a_scatter_beyond_the_delays_widens_the_uncertainties(scale: float):
    """The excesses of the round trips are 0, 1, 2, 3 and 4 ms, with a median of 2 ms."""
    excess, ticks = np.arange(5) * 1e-3, np.array([1000.0, 5000.0, 2000.0, 4000.0, 3000.0])
    middle = 7.0 + ticks / RATE_HZ + scale * np.array([1e-4, -2e-4, 3e-4, -1e-4, 2e-4])
    half = (6e-3 + excess) / 2
    exchanges = [Exchange(float(m - h), float(t), float(m + h)) for t, m, h in zip(ticks, middle, half, strict=True)]
    fit = fit_clock(exchanges, RATE_HZ)
    std = np.sqrt((excess**2 + 2e-3**2) / 12)
    (period, offset), covariance = np.polyfit(ticks, middle, 1, w=1 / std, cov="unscaled")
    chi2_per_dof = float(np.sum(((middle - offset - period * ticks) / std) ** 2)) / 3
    assert (chi2_per_dof > 1.0) is (scale > 1.0)
    covariance = covariance * max(chi2_per_dof, 1.0)
    assert (fit.offset, fit.period) == pytest.approx((offset, period), rel=1e-9)
    assert fit.rate_ppm == pytest.approx(1e6 * (1 / RATE_HZ / period - 1))
    assert fit.rate_ppm_std == pytest.approx(1e6 * RATE_HZ * np.sqrt(covariance[0, 0]))
    assert fit.offset_std == pytest.approx(np.sqrt(covariance[1, 1] + 6e-3**2 / 12))


@pytest.mark.parametrize(("count", "used"), [(5, 5), (9, 5), (10, 5), (11, 6), (12, 6)])
def test_the_half_with_the_shortest_round_trips_is_used(count: int, used: int):
    exchanges = [Exchange(float(i), RATE_HZ * i, i + 1e-3 * (count - i)) for i in range(count)]
    fit = fit_clock(exchanges, RATE_HZ)
    assert (fit.n, fit.rtt_min) == (used, pytest.approx(1e-3))
    assert fit_clock(exchanges[-used:], RATE_HZ).offset == pytest.approx(fit.offset, abs=1e-9)


@pytest.mark.parametrize(
    "exchanges",
    [[], [Exchange(0, 0, 1)], [Exchange(0, 0, 1), Exchange(1, 5, 2)], [Exchange(0, 4, 1)] * 9],
    ids=["none", "one", "two", "one tick"],
)
def test_too_few_exchanges_make_no_fit(exchanges: list[Exchange]):
    with pytest.raises(ValueError, match="are not enough for a clock fit"):
        fit_clock(exchanges, RATE_HZ)


def test_pings_are_matched_by_token():
    pinger = Pinger()
    first, second = pinger.ping(1.0), pinger.ping(2.0)
    assert pinger.exchange(Pong(second.token, 200, 32768), 2.5) == Exchange(2.0, 200.5, 2.5)
    assert pinger.exchange(Pong(first.token, 100, 0), 2.6) == Exchange(1.0, 100.0, 2.6)
    assert pinger.exchange(Pong(first.token, 100, 0), 2.7) is None
    assert pinger.exchange(Pong(999, 100, 0), 2.8) is None


def test_a_device_that_never_answers_takes_no_memory():
    pinger = Pinger()
    tokens = [pinger.ping(float(n)).token for n in range(70_000)]
    assert pinger.exchange(Pong(tokens[-OUTSTANDING - 1], 0, 0), 1e5) is None
    assert pinger.exchange(Pong(tokens[-OUTSTANDING], 0, 0), 1e5)
    assert pinger.ping(0.0) == Ping((tokens[-1] + 1) % 65536)


def test_device_time_continues_after_32_bits():
    pinger = Pinger()
    late = [
        pinger.exchange(Pong(pinger.ping(0.0).token, tick % (1 << 32), 0), 0.1) for tick in range(0, 1 << 34, 1 << 30)
    ]
    assert [e.ticks for e in late if e] == list(range(0, 1 << 34, 1 << 30))
