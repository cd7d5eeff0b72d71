"""Rows without a new reading: a logger that is faster than its camera, or that writes in bursts."""

import numpy as np
import pytest

from dpr_lab.estimation.repeated_readings import new_readings

T = np.arange(0.0, 10.0, 1 / 30)


def swing(t: np.ndarray) -> np.ndarray:
    return 0.3 * np.exp(-0.1 * t) * np.cos(7.3 * t)


def test_readings_that_a_logger_holds_count_once() -> None:
    rng = np.random.default_rng(1)
    fresh = np.append(True, rng.random(len(T) - 1) < 0.4)
    last = np.maximum.accumulate(np.where(fresh, np.arange(len(T)), 0))
    kept, note = new_readings(T, [np.zeros(len(T)), swing(T)[last]])
    np.testing.assert_array_equal(kept, np.flatnonzero(fresh))
    assert "repeat the previous reading" in note


@pytest.mark.parametrize("rate_hz", [100.0, 1000.0])
def test_an_encoder_that_turns_by_less_than_a_count_per_row_is_kept(rate_hz: float) -> None:
    t = np.arange(0.0, 10.0, 1 / rate_hz)
    count = 2 * np.pi / 1200
    noise = np.random.default_rng(2).normal(0.0, 0.3 * count, len(t))
    for reading in (swing(t), swing(t) + noise):
        kept, note = new_readings(t, [count * np.rint(reading / count)])
        assert len(kept) == len(t)
        assert not note


def test_a_burst_of_rows_is_one_reading() -> None:
    starts = 0.124 * np.arange(20)
    t = (starts[:, None] + 0.001 * np.arange(3)).ravel()
    kept, note = new_readings(t, [swing(t)])
    np.testing.assert_allclose(t[kept], starts + 0.001)
    assert "20 bursts of about 3" in note


def test_gaps_of_a_recording_are_no_bursts() -> None:
    t = np.delete(T, [*range(30, 60), *range(100, 105), *range(150, 190)])
    kept, note = new_readings(t, [swing(t)])
    assert (len(kept), note) == (len(t), "")


@pytest.mark.parametrize("rate_hz", [50.0, 200.0, 1000.0])
def test_a_logger_that_pauses_once_a_second_records_no_bursts(rate_hz: float) -> None:
    t = np.arange(0.0, 12.0, 1 / rate_hz)
    t = t[t % 1.0 > 12 / rate_hz]
    kept, note = new_readings(t, [swing(t)])
    assert (len(kept), note) == (len(t), "")
