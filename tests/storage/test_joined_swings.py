"""Several recordings in one table: each is named."""

import re
from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.tables.understand import understand
from tests.storage.swing_files import small_swing


@pytest.mark.parametrize("appended", [True, False])
def test_a_swing_that_is_appended_after_a_gap_is_named(tmp_path, one, appended):
    """A log that was continued; rows that are lost in one swing are no other recording."""
    t = np.delete(np.arange(0, 4, 0.04), [40, 71, 72])
    angle = 1.2 * np.exp(-0.1 * t) * np.cos(6 * t + 1.5 * appended * (t > 71.5 * 0.04))
    angle += np.random.default_rng(1).normal(0, 2e-3, len(t))
    np.savetxt(tmp_path / "a.csv", np.column_stack([t, angle]), "%.5f", ",", header="t,theta", comments="")
    sentences = [q.sentence for q in understand(tmp_path / "a.csv", one, ImportOptions(zero="hanging")).questions]
    named = [sentence for sentence in sentences if "do not belong to one motion" in sentence]
    assert len(named) == appended
    assert all("(--duration-s 2.84; --start-s 2.92)" in sentence for sentence in named)


@pytest.mark.parametrize("starts", [(1.2, 1.0, 1.2), (1.2, 1.2, 1.2), (0.8, 1.0, 1.2)])
def test_each_of_three_swings_without_a_gap_is_named(tmp_path, one, starts):
    """Each part lies within one swing and contains most of it."""
    t = np.arange(0, 4.5, 0.01)
    rows = np.column_stack([np.arange(3 * len(t)) / 100, np.concatenate([small_swing(t, start) for start in starts])])
    np.savetxt(tmp_path / "a.csv", rows, "%.5f", ",", header="t,theta", comments="")
    (question,) = understand(tmp_path / "a.csv", one, ImportOptions(zero="hanging")).questions
    number = r"([\d.]+)"
    parts = re.search(
        rf"\(--duration-s {number}; --start-s {number} --duration-s {number}; --start-s {number}\)", question.sentence
    )
    assert parts
    first_ends, begins, lasts, last_begins = map(float, parts.groups())
    assert 3.5 < first_ends < 4.5 < begins < 5
    assert 8 < begins + lasts < 9 < last_begins < 9.5


@pytest.mark.parametrize(("rows", "named"), [(250, True), (30, False)])
def test_a_repeated_header_in_a_table_without_times_begins_a_recording(tmp_path, one, rows, named):
    """Some loggers repeat the header on each page, in one recording."""
    angles = [f"{angle:.5f},0" for angle in small_swing(np.arange(0, 5, 0.01), 1.2)]
    angles[rows:] = ["theta,other", *(angles if named else angles[rows:])]
    (tmp_path / "a.csv").write_text("\n".join(["theta,other", *angles]) + "\n")
    options = ImportOptions(zero="hanging", rate_hz=100)
    sentences = [question.sentence for question in understand(tmp_path / "a.csv", one, options).questions]
    asked = "another recording begins at the repeated header: import each separately"
    assert sentences == [f"{asked} (--duration-s 2.495; --start-s 2.495)"] * named
    if named:
        first = import_csv(tmp_path / "a.csv", one, replace(options, duration_s=2.495))
        later = import_csv(tmp_path / "a.csv", one, replace(options, start_s=2.495))
        assert (len(first.t), len(later.t)) == (250, 500)


@pytest.mark.parametrize("start", [0.0, 1.0])
@pytest.mark.parametrize("second", [1.0, 1.5])
def test_both_parts_of_a_table_with_a_long_gap_are_named(tmp_path, one, start, second):
    """No other warning judges both parts as one swing."""
    t = np.arange(0, 5, 0.01)
    parts = [np.column_stack([t + 305 * n, small_swing(t, angle)]) for n, angle in enumerate((1.2, second))]
    np.savetxt(tmp_path / "a.csv", np.concatenate(parts), "%.5f", ",", header="t,theta", comments="")
    options = ImportOptions(zero="hanging", start_s=start)
    (question,) = understand(tmp_path / "a.csv", one, options).questions
    assert "has an interruption of 300 s at" in question.sentence
    assert f"(--duration-s {5 - start:g}; --start-s 305)" in question.sentence
    first = import_csv(tmp_path / "a.csv", one, replace(options, duration_s=5 - start))
    later = import_csv(tmp_path / "a.csv", one, replace(options, start_s=305))
    assert (len(first.t), len(later.t)) == (500 - 100 * start, 500)
