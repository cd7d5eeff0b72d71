"""Remaining time of a job with stages, from typical and measured durations, without compilation."""

import pytest

from dpr_lab.tui.jobs.stage_pace import StagePace

TYPICAL = {"read": 1.0, "fit": 2.0, "choose": 10.0, "report": 4.0}


@pytest.fixture
def pace() -> StagePace:
    return StagePace(TYPICAL, ("fit",), 0.0)


def test_typical_times_are_used_until_a_steady_stage_is_done(pace: StagePace) -> None:
    assert pace.left(0.5) == 16.5
    pace.begin("fit", 1.0)
    assert pace.left(1.0) == 16.0
    pace.begin("choose", 5.0)  # twice as slow as is typical
    assert pace.left(5.0) == 28.0
    assert pace.left(15.0) == 18.0


def test_compiling_counts_neither_as_pace_nor_as_elapsed_time(pace: StagePace) -> None:
    pace.begin("fit", 1.0)
    pace.compiling(50.0)
    assert pace.left(51.0) == 15.0
    pace.begin("choose", 52.0)
    assert pace.left(52.0) == 14.0


def test_a_stage_that_is_skipped_in_a_moment_brings_the_end_nearer(pace: StagePace) -> None:
    pace.begin("report", 3.0)
    assert pace.left(3.0) == 4.0


def test_no_remaining_time_is_shown_if_a_stage_takes_longer_than_typical(pace: StagePace) -> None:
    pace.begin("choose", 3.0)
    assert pace.left(14.0) is None
