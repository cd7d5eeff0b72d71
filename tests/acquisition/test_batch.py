"""Samples of one read as arrays, and counters of 16 bits."""

import numpy as np
import pytest

from dpr_lab.acquisition.batch import Counter, arrays, torques_of
from firmware_protocol.stream import Row
from firmware_protocol.torques import DrivenRow

ROWS = [DrivenRow(7 + i, (i, -i, 9), ((i, -10 * i), (100 + i, 3))) for i in range(3)]


def test_torques_are_sorted_by_kind_and_converted_to_newton_metres() -> None:
    """A unit of 250 uN m is 0.00025 N m."""
    measured, commanded = [[0, 0], [1, -10], [2, -20]], [[100, 3], [101, 3], [102, 3]]
    torques = torques_of([ROWS[0], Row(1, (0, 0, 0)), *ROWS[1:]], 250)
    assert torques is not None
    assert torques.tolist() == (np.array([measured, commanded]) / 4000).round(6).tolist()
    assert torques_of(ROWS, 0) is None
    assert torques_of([Row(1, (0, 0, 0))], 250) is None
    fine = torques_of(ROWS[1:2], 1)
    assert fine is not None
    assert fine[:, 0].tolist() == [[1e-6, -1e-5], [1.01e-4, 3e-6]]


def test_samples_have_one_column_for_each_joint() -> None:
    ticks, counts = arrays(ROWS[:2])
    assert (ticks.tolist(), counts.tolist()) == ([7, 8], [[0, 0, 9], [1, -1, 9]])
    ticks, counts = arrays([])
    assert (ticks.shape, counts.shape) == ((0,), (0, 3))


@pytest.mark.parametrize(
    ("readings", "total"), [([5], 5), ([5, 5], 5), ([65535, 0], 65536), ([40000, 10000, 9999], 75536 + 65535)]
)
def test_a_counter_of_16_bits_continues_after_its_overflow(readings: list[int], total: int) -> None:
    counter = Counter()
    for low in readings:
        counter.read(low)
    assert counter.total == total
    counter.restart()
    counter.read(4)
    assert counter.total == total + 4
