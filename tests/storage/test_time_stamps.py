"""Time stamps of a logger that pauses or writes few digits, and headers with other separators."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import RunError
from dpr_lab.rig import Rig, parse_rig
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.tables.time_stamps import carried_times, even_times, spread_times, stamps_at_gaps
from dpr_lab.workflows.rig_file import RigMeasures, draft_rig
from dpr_lab.workflows.rig_toml import Measure
from tests.one_rod import Rod, swing
from tests.thinned import thinned

COUNT = 2 * np.pi / 2400
LOST = 9


@pytest.fixture
def one() -> Rig:
    mass = Measure(0.1)
    return parse_rig(draft_rig(RigMeasures("one rod", 0.4, 0.4, mass, mass, counts_per_rev=2400))).with_rods("inner")


@cache
def paused(seed: int, rate_hz: float = 200.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Instants and counted angles of a rod whose logger loses rows once a second, and the rows before the gaps."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 5.0, 1 / rate_hz)
    angle = swing(Rod(length=float(rng.uniform(0.15, 0.5))), float(rng.uniform(0.5, 2.0)), t)
    lost = np.isin(np.arange(len(t)) % round(rate_hz), np.arange(20, 20 + LOST))
    t, counts = t[~lost], np.round((angle[~lost] + rng.normal(0.0, 2e-4, (~lost).sum())) / COUNT)
    return t, counts, np.flatnonzero(np.diff(t) > 2 / rate_hz)


@pytest.mark.parametrize("seed", thinned(range(10), 2))
@pytest.mark.parametrize("side", ["early", "late"])
def test_stamps_on_the_wrong_side_of_a_gap_are_moved(seed: int, side: str) -> None:
    t, counts, before = paused(seed)
    wrong, stamped = (before + 1, t[before] + 0.005) if side == "early" else (before, t[before + 1] - 0.005)
    written = t.copy()
    written[wrong] = stamped
    corrected, note = stamps_at_gaps(written, {"theta1": counts})
    moved = np.abs(corrected - t)[wrong] < 1e-9
    # a rod near a turning point reads nearly the same on both sides: such a stamp matters little and may remain
    assert moved.sum() >= 3
    assert np.abs(np.delete(corrected - t, wrong)).max() == 0.0
    assert note.startswith(f"time stamps on the wrong side of an interruption: {moved.sum()}.")


@pytest.mark.parametrize("seed", thinned(range(20), 2))
@pytest.mark.parametrize("rate_hz", [50.0, 200.0])
def test_right_stamps_next_to_gaps_are_kept(seed: int, rate_hz: float) -> None:
    t, counts, before = paused(seed, rate_hz)
    assert len(before) == 5
    assert stamps_at_gaps(t, {"theta1": counts}) == (pytest.approx(t, abs=0.0), "")


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("rows", "unit"), [(1, 1.0), (2, 1.0), (1, -1.0), (1, 60.0)])
def test_stamps_whose_second_and_fraction_are_read_apart_are_corrected(seed: int, rows: int, unit: float) -> None:
    rng = np.random.default_rng(seed)
    t = 53000 + np.cumsum(rng.uniform(0.003, 0.02, 400))
    written = t.copy()
    for second in np.arange(np.ceil(t[9]), t[-9]):
        changed = int(np.searchsorted(t, second))
        written[changed : changed + rows] -= unit
    assert (np.diff(written) < 0).any()
    corrected, note = carried_times(written)
    assert corrected == pytest.approx(t, abs=1e-9)
    assert note.startswith("time stamps are a whole second or minute early or late")
    two_recordings = np.concatenate([t, t[:50]])
    assert carried_times(two_recordings) == (pytest.approx(two_recordings, abs=0.0), "")


def test_counts_of_an_unsigned_number_are_unwrapped_before_their_stamps_are_tested(one: Rig, tmp_path: Path) -> None:
    t, counts, before = paused(3)
    written = t.copy()
    written[before + 1] = t[before] + 0.005
    file = tmp_path / "wrapped.csv"
    np.savetxt(file, np.column_stack([written, counts % 65536]), delimiter=",", header="t,counts", comments="")
    options = ImportOptions(zero="hanging", unit="counts", columns={"theta1": "counts"}, wrap=65536.0)
    run = import_csv(file, one, options)
    assert any("stamps on the wrong side of an interruption" in note for note in run.notes)
    assert np.abs(run.theta[:, 1] - np.pi).max() < 2.1


@pytest.mark.parametrize("digits", [3, 4])
def test_times_with_few_significant_digits_are_counted(digits: int) -> None:
    """Spreadsheets write 9.97E+00, then 1.00E+01 three times: the resolution depends on the size of the time."""
    true = 4e-4 + np.arange(10 ** (digits - 3) * 450) / (30 * 10 ** (digits - 3))
    written = np.array([float(f"{instant:.{digits - 1}e}") for instant in true])
    assert np.mean(np.diff(written) == 0) > 0.1
    times, note = even_times(written, {"theta1": np.sin(4 * true)})
    assert np.abs(times - true).max() < 0.02
    assert "several rows share one time" in note
    lost = np.delete(np.arange(len(true)), slice(100, 103))
    unchanged, silent = even_times(written[lost], {"theta1": np.sin(4 * true[lost])})
    assert (unchanged == written[lost]).all()
    assert not silent


def test_a_header_may_have_another_separator_than_the_numbers(one: Rig, tmp_path: Path) -> None:
    t = np.arange(0, 6, 0.02)
    file = tmp_path / "swing.txt"
    file.write_text(
        "time theta1\n" + "".join(f"{a:.3f}\t{b:.5f}\n" for a, b in zip(t, swing(Rod(), 1.2, t), strict=True))
    )
    run = import_csv(file, one, ImportOptions(zero="hanging"))
    assert len(run.t) == len(t)


@pytest.mark.parametrize("stale", [True, False])
def test_rows_with_one_stamp_are_spread_over_the_gap(stale: bool) -> None:
    """A clock that is read before several rows, or rows that wait and are stamped together."""
    true = np.arange(0, 1, 0.0025)
    written, waiting = true.copy(), np.add.outer(np.arange(20, 390, 37), np.arange(4))
    written[waiting] = true[waiting[:, :1] if stale else waiting[:, -1:]]
    times, note = spread_times(written, {"theta1": np.sin(6 * true)})
    np.testing.assert_allclose(times, true, atol=1e-9)
    assert note.startswith(f"{3 * len(waiting)} rows next to an interruption have the time of the previous row")


def test_neighbouring_groups_of_rows_share_no_gap() -> None:
    written = np.concatenate([np.arange(0, 0.1, 0.01), [0.1, 0.1, 0.13, 0.13], np.arange(0.15, 0.3, 0.01)])
    times, note = spread_times(written, {"theta1": np.sin(6 * np.arange(len(written)))})
    np.testing.assert_allclose(times[10:14], [0.1, 0.115, 0.13, 0.14])
    assert note.startswith("2 rows")


def test_rows_that_are_written_twice_are_not_spread() -> None:
    """Each reading of a second sensor writes a row with the stamp of the first sensor."""
    written = np.repeat(np.arange(0, 1, 0.01), 1 + (np.arange(100) % 9 == 4))
    written, note = spread_times(written, {"theta1": np.sin(6 * np.arange(len(written)))})
    assert (np.diff(written) == 0).sum() == 11
    assert not note


def test_points_without_a_header_are_explained(one: Rig, tmp_path: Path) -> None:
    t = np.arange(0, 6, 0.02)
    angle = swing(Rod(), 1.2, t)
    file = tmp_path / "film.csv"
    np.savetxt(file, np.column_stack([t, np.sin(angle), -np.cos(angle)]), delimiter=",")
    with pytest.raises(RunError, match=r"for points of a video add a first line with their names, for example t,x,y"):
        import_csv(file, one, ImportOptions())
    file.write_text("t,x,y\n" + file.read_text())
    assert len(import_csv(file, one, ImportOptions()).t) == len(t)
