"""Identification of a real record: the free swing of the MultiArm project, if the data are available."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.identification.compare import compare_run
from dpr_lab.identification.identify import identify
from dpr_lab.rig import load_rig
from dpr_lab.storage.csv_import import ImportOptions, import_csv

RECORD = Path(__file__).parents[2] / "shared" / "data" / "real" / "multiarm" / "dp_freeswing_1khz.csv"
# The authors' fit, from A1, A2, B: a/b = A1/A2, d/b = B/A2, e1/b = 1/A2.
PUBLISHED = {"a/b": 0.0169602 / 0.0094442, "d/b": 0.0083333 / 0.0094442, "e1/b": 1 / 0.0094442}

needs_record = pytest.mark.skipif(not RECORD.is_file(), reason=f"no real record at {RECORD}")


def swing(start_s: float, duration_s: float):
    options = ImportOptions(zero="hanging", start_s=start_s, duration_s=duration_s)
    return import_csv(RECORD, load_rig("multiarm"), options)


@needs_record
@pytest.mark.slow
def test_a_fit_of_the_first_ten_seconds_agrees_with_the_published_one_and_predicts_the_next_ten() -> None:
    rig = load_rig("multiarm")
    model = identify([swing(0, 10)], rig)
    for name, published in PUBLISHED.items():
        assert model.ratios[name].value == pytest.approx(published, rel=5e-3)
    assert model.warnings, "the published structure is viscous only and the record shows more"
    held_out = compare_run(swing(10, 10), rig, model)
    assert held_out.held_out
    assert np.all(held_out.segment_rms_rad < 2e-3)


@needs_record
@pytest.mark.long
def test_the_interval_is_at_least_as_wide_as_the_difference_between_two_halves() -> None:
    rig = load_rig("multiarm")
    whole, *halves = [identify([swing(start, length)], rig) for start, length in ((0, 80), (0, 40), (40, 40))]
    for name, published in PUBLISHED.items():
        low, high = whole.ratios[name].interval90
        first, second = (half.ratios[name].value for half in halves)
        assert high - low >= abs(second - first)
        assert whole.ratios[name].value == pytest.approx(published, rel=5e-3)
