"""Wrapping counters in tables, and angles in counts recognised by the names of their columns."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import RunError
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.tables.clock_wrap import summed_durations, unwrapped_times, wrap_behind
from dpr_lab.storage.tables.columns import find_columns
from dpr_lab.storage.tables.options import ImportOptions
from dpr_lab.storage.tables.table import bare, read_table

T = np.arange(0, 4, 0.005)
THETA = np.pi + 0.4 * np.cos(2 * np.pi * 0.8 * T[:, None] + [0, 0.3])
WRAP = 1 << 32


def table(path: Path, times: np.ndarray, name: str, form: str) -> Path:
    rows = zip(times.tolist(), *THETA.T.tolist(), strict=True)
    path.write_text(f"{name},theta1,theta2\n" + "".join(f"{t:{form}},{a:.6f},{b:.6f}\n" for t, a, b in rows))
    return path


def test_a_32_bit_counter_that_wraps_is_suggested_and_undone(tmp_path: Path, paper) -> None:
    micros = ((WRAP - 1_500_000 + np.round(T * 1e6)) % WRAP).astype(np.int64)
    file = table(tmp_path / "a.csv", micros, "t_us", "d")
    options = {"unit": "rad", "time_unit": None, "keep_rest": True}
    with pytest.raises(
        RunError,
        match=r"line \d+: time decreases by 4294.96 s, like a wrapping counter: import with"
        r" --time-wrap 4294967296$",
    ):
        import_csv(file, paper, ImportOptions(**options))
    run = import_csv(file, paper, ImportOptions(**options, time_wrap=WRAP))
    np.testing.assert_allclose(run.t, T, atol=1e-9)


def test_a_counter_of_microseconds_that_was_logged_in_seconds_is_known_too(tmp_path: Path, paper) -> None:
    seconds = ((WRAP - 1_500_000 + np.round(T * 1e6)) % WRAP) / 1e6
    file = table(tmp_path / "a.csv", seconds, "t", ".6f")
    with pytest.raises(RunError, match=r"--time-wrap 4294\.967296$"):
        import_csv(file, paper, ImportOptions(keep_rest=True))
    run = import_csv(file, paper, ImportOptions(time_wrap=WRAP / 1e6, keep_rest=True))
    np.testing.assert_allclose(run.t, T, atol=1e-6)


def test_a_counter_of_another_width_needs_its_period(tmp_path: Path, paper) -> None:
    file = table(tmp_path / "a.csv", (np.round(T * 1e3).astype(np.int64) + 500) % 1000, "t_ms", "d")
    with pytest.raises(
        RunError, match=r"If the same swing continues, give the period of its counter \(--time-wrap 1000\)$"
    ):
        import_csv(file, paper, ImportOptions(keep_rest=True))
    run = import_csv(file, paper, ImportOptions(keep_rest=True, time_wrap=1000))
    np.testing.assert_allclose(run.t, T, atol=1e-9)


@pytest.mark.parametrize(
    ("header", "rows"), [("t", [10.0, 10.0, 9.0, 11.0]), ("dt", [10.0, 10.0, 10.0, 11.0]), ("dt_ms", [10.0] * 4)]
)
def test_durations_of_rows_are_summed(header: str, rows: list[float], tmp_path: Path, paper) -> None:
    durations = np.tile(rows, len(T) // 4 + 1)[: len(T)]
    options = ImportOptions(time_unit=None if header == "dt_ms" else "ms", keep_rest=True)
    run = import_csv(table(tmp_path / "a.csv", durations, header, "g"), paper, options)
    np.testing.assert_allclose(run.t, (np.cumsum(durations) - durations[0]) / 1e3, atol=1e-9)
    assert f"column {header} contains the durations of the rows" in " ".join(run.notes)


@pytest.mark.parametrize("name", ["t", "duration_s"])
def test_random_durations_are_summed(name: str) -> None:
    for seed in range(40):
        durations = 0.005 + np.random.default_rng(seed).uniform(-0.001, 0.001, 300)
        summed, note = summed_durations(durations, name)
        assert note
        np.testing.assert_allclose(summed, np.cumsum(durations) - durations[0])


@pytest.mark.parametrize(("header", "first"), [("dt", 0.0), ("duration", 0.0), ("duration", 0.005)])
def test_durations_may_begin_with_zero(header: str, first: float, tmp_path: Path, paper) -> None:
    durations = np.r_[first, np.full(len(T) - 1, 0.005)]
    run = import_csv(table(tmp_path / "a.csv", durations, header, "g"), paper, ImportOptions(keep_rest=True))
    np.testing.assert_allclose(run.t, T, atol=1e-9)


@pytest.mark.parametrize("name", ["t", "dt"])
@pytest.mark.parametrize("times", [T + 100 - 5 * (np.arange(len(T)) % 90 == 7), 100 + T % 0.5, T % 1, T])
def test_true_times_are_not_summed(times: np.ndarray, name: str) -> None:
    """Times with wrong rows, and counters that wrap."""
    assert summed_durations(times, name)[1] == ""


def test_one_decrease_of_late_times_is_no_duration() -> None:
    late = 1.7e9 + np.repeat([0.0, 1.0, 0.0, 2.0], 9)
    assert summed_durations(late, "t")[1] == ""


def test_a_second_recording_in_a_table_is_no_wrap(tmp_path: Path, paper) -> None:
    start = np.r_[0 : len(T) // 2, 0 : len(T) // 2]
    rows = zip(T[start].tolist(), *THETA[start].T.tolist(), strict=True)
    (tmp_path / "a.csv").write_text("t,theta1,theta2\n" + "".join(f"{t:.3f},{a},{b}\n" for t, a, b in rows))
    with pytest.raises(RunError, match="split the table there"):
        import_csv(tmp_path / "a.csv", paper, ImportOptions(keep_rest=True))


def test_times_that_fall_by_no_counter_still_run_backwards(tmp_path: Path, paper) -> None:
    file = table(tmp_path / "a.csv", np.where(T < 2, T, T - 1.5), "t", ".6f")
    with pytest.raises(RunError, match="time decreases"):
        import_csv(file, paper, ImportOptions())
    with pytest.raises(
        RunError, match=r"spans 2.495, which is more than the given period of its counter, 1: correct --time-wrap"
    ):
        import_csv(file, paper, ImportOptions(time_wrap=1.0))


@pytest.mark.parametrize("wrong", [{0: 6.5}, {1: 6.5, 2: 6.6}, {-1: 0.1}, {-1: T[-2], -2: T[-1]}])
def test_a_few_wrong_times_are_no_counter(tmp_path: Path, paper, wrong: dict[int, float]) -> None:
    times = T.copy()
    for row, time in wrong.items():
        times[row] = time
    with pytest.raises(RunError, match=r"line \d+: time decreases .* or correct or delete rows with a wrong time"):
        import_csv(table(tmp_path / "a.csv", times, "t", "g"), paper, ImportOptions())


def test_a_wrap_keeps_missing_times_and_counts_each_fall() -> None:
    times = np.array([8.0, 9.5, np.nan, 1.0, 5.0, 9.0, 0.5])
    np.testing.assert_array_equal(unwrapped_times(times, 10.0, "t"), [8, 9.5, np.nan, 11, 15, 19, 20.5])


@pytest.mark.parametrize(
    ("before", "after", "width"),
    [(2.0**32 - 100, 400, 2.0**32), (65_530, 5, 65_536), (4294.9, 0.1, 2.0**32 / 1e6), (10.0, 1.0, None)],
)
def test_a_fall_is_known_by_the_width_of_a_counter(before: float, after: float, width: float | None) -> None:
    assert wrap_behind(before, after) == width


@pytest.mark.parametrize(
    "names", [("theta1_counts", "theta2_counts"), ("q1 [counts]", "q2 [counts]"), ("joint1_ticks", "joint2_ticks")]
)
def test_columns_that_say_counts_are_counts(names: tuple[str, str], tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(f"t,{','.join(names)}\n" + "".join(f"{k / 10},{k},{k}\n" for k in range(5)))
    columns = find_columns(read_table(tmp_path / "a.csv"), {}, ImportOptions())
    assert (columns.unit, columns.names["theta1"], columns.names["theta2"]) == ("counts", *names)


def test_a_type_in_a_header_is_no_part_of_the_name() -> None:
    assert bare("Time (uint32)[1]") == "time"
    assert bare("theta (float64)") == "theta"
    assert bare("x (int)") == "xint"
