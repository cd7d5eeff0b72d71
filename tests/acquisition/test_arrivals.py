import numpy as np
import pytest

from dpr_lab.acquisition.arrivals import ArrivalFit, Arrivals

RATE_HZ = 1000


def _fit(
    rng: np.random.Generator, rate: float = 1.0, duration: float = 3.0, late_s: float = 0.004, stall: float = 0.0
) -> ArrivalFit | None:
    """Fit reads every 2 to 20 ms of a device with the relative rate `rate`; the link stalls for `stall` s in each
    second."""
    arrivals, t = Arrivals(RATE_HZ), 100.0
    while t < 100.0 + duration:
        t += rng.uniform(0.002, 0.02)
        if stall and t % 1.0 < stall:
            t += stall - t % 1.0
        tick = int((t - rng.exponential(late_s) - 90.0) * rate * RATE_HZ)
        arrivals.add(tick, t)
    return arrivals.fit()


@pytest.mark.parametrize("rate", [0.5, 0.95, 1.0, 1.0005, 1.05, 2.0])
@pytest.mark.parametrize("duration", [1.5, 10.0])
def test_the_true_rate_lies_within_the_margin(rate: float, duration: float, rng: np.random.Generator) -> None:
    for _ in range(20):
        fit = _fit(rng, rate, duration)
        assert fit is not None
        assert abs(fit.arrival_ppm - (rate - 1) * 1e6) < fit.arrival_margin_ppm
        assert fit.arrival_margin_ppm < 30_000 * rate / duration


@pytest.mark.parametrize("stall", [0.2, 0.35])
def test_stalls_do_not_widen_the_margin_if_other_reads_determine_it(stall: float, rng: np.random.Generator) -> None:
    fit = _fit(rng, 1.05, 5.0, stall=stall)
    assert fit is not None
    assert abs(fit.arrival_ppm - 50_000) < fit.arrival_margin_ppm < 10_000


def test_slow_reads_make_the_margin_wide(rng: np.random.Generator) -> None:
    quick, slow = _fit(rng, late_s=0.001), _fit(rng, late_s=0.2)
    assert quick is not None
    assert slow is not None
    assert slow.arrival_margin_ppm > 2 * quick.arrival_margin_ppm


def test_a_delay_that_grows_by_10_ms_during_the_recording_is_within_the_margin() -> None:
    arrivals = Arrivals(RATE_HZ)
    for tick in range(0, 3000, 5):
        arrivals.add(tick, tick / RATE_HZ + 0.01 * tick / 3000)
    fit = arrivals.fit()
    assert fit is not None
    assert abs(fit.arrival_ppm) < fit.arrival_margin_ppm


@pytest.mark.parametrize("duration", [0.0, 0.1, 0.4])
def test_too_few_reads_determine_no_rate(duration: float, rng: np.random.Generator) -> None:
    assert _fit(rng, duration=duration) is None


def test_constant_ticks_determine_no_rate() -> None:
    arrivals = Arrivals(RATE_HZ)
    for t in range(100):
        arrivals.add(7, t / 10)
    assert arrivals.fit() is None
