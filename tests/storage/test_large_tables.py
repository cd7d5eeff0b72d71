"""Tables are read in blocks: fast and exact path give the same result, and compressed text is read as text."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import RunError
from dpr_lab.progress import ImportProgress
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.tables import table as table_module
from dpr_lab.storage.tables.cells import clean_rows
from dpr_lab.storage.tables.content import TableLimits
from dpr_lab.storage.tables.table import Table, read_table

ROWS = 400

MANNERS = {
    "plain": "{t:.4f},{a:.6f},{b!r}\n",
    "blanks": "  {t:.4f}   {a:.6f} {b:e}\n",
    "tabs": "{t:.4f}\t{a:.6f}\t{b:.9f}\n",
    "line ends of Windows": "{t:.4f},{a:.6f},{b:.9f}\r\n",
    "line ends of old": "{t:.4f},{a:.6f},{b:.9f}\r",
    "missing": "{t:.4f},{missing},{b:.9f}\n",
    "quoted": '"{t:.4f}","{a:.6f}","{b:.9f}"\n',
    "underscores": "1_0{t:.4f},{a:.6f},{b:.9f}\n",
    "spaces": " {t:.4f} , {a:.6f} , {b:.9f} \n",
}


def text_of(manner: str) -> str:
    rng = np.random.default_rng(3)
    rows = zip(np.arange(ROWS) / 200, *rng.normal(size=(2, ROWS)).tolist(), strict=True)
    lines = []
    for k, (t, a, b) in enumerate(rows):
        missing = ("", "NaN", "n/a", "-", f"{a:.6f}")[k % 5]
        lines.append(MANNERS[manner].format(t=t, a=a, b=b, missing=missing))
    delimiter = {"tabs": "\t", "blanks": " "}.get(manner, ",")
    return delimiter.join(("t", "theta1", "theta2")) + "\n" + "".join(lines)


def same(one: Table, other: Table) -> bool:
    values = all(np.array_equal(a, b, equal_nan=True) for a, b in zip(one.values, other.values, strict=True))
    strange = all(a.strange == b.strange for a, b in zip(one.columns, other.columns, strict=True))
    return values and strange and np.array_equal(one.lines, other.lines) and one.notes == other.notes


def both_ways(path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Table, Table]:
    """Read the table in small blocks, and line by line."""
    monkeypatch.setattr(table_module, "LIMITS", TableLimits(block_bytes=700))
    by_block = read_table(path)
    monkeypatch.setattr(table_module, "clean_rows", lambda *_: None)
    return by_block, read_table(path)


@pytest.mark.parametrize("manner", MANNERS)
def test_a_block_gives_what_its_lines_give(manner: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.csv").write_bytes(text_of(manner).encode())
    by_block, by_line = both_ways(tmp_path / "a.csv", monkeypatch)
    assert len(by_block.lines) == ROWS
    assert same(by_block, by_line)


@pytest.mark.parametrize("odd", ["\n", "# a comment, of, words\n", "//,1,2\n", "1,two,3\n", "\f\n", "  \n", "1,2,é\n"])
def test_an_odd_line_far_down_gives_what_it_gave(odd: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = text_of("plain").splitlines(keepends=True)
    (tmp_path / "a.csv").write_text("".join([*lines[:300], odd, *lines[300:]]), encoding="utf-8")
    by_block, by_line = both_ways(tmp_path / "a.csv", monkeypatch)
    assert same(by_block, by_line)
    assert by_block.lines[-1] == ROWS + 2


def test_decimal_commas_are_read_in_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.csv").write_text(text_of("plain").replace(",", ";").replace(".", ","))
    by_block, by_line = both_ways(tmp_path / "a.csv", monkeypatch)
    assert same(by_block, by_line)
    assert by_block.values[0][1] == 0.005


def test_a_row_of_another_length_far_down_is_named_by_its_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table_module, "LIMITS", TableLimits(block_bytes=700))
    lines = text_of("plain").splitlines(keepends=True)
    (tmp_path / "a.csv").write_text("".join([*lines[:300], "1,2\n", *lines[300:]]))
    with pytest.raises(RunError, match="line 301 has 2 fields, but there are 3 columns"):
        read_table(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_text("".join([*lines, "1,2\n"]))
    assert read_table(tmp_path / "a.csv").notes == (f"the last line, {ROWS + 2}, is incomplete and was ignored",)


def test_a_line_without_end_far_down_is_no_table(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,a\n" + "1,2\n" * 100 + "1" * (1 << 21))
    with pytest.raises(RunError, match="line 102 is longer than"):
        read_table(tmp_path / "a.csv")


def test_blocks_that_are_no_numbers_are_left_to_the_exact_reader() -> None:
    limits = (",", False, 100)
    assert clean_rows("1,2\n3,4\n", 2, *limits) is not None
    for odd in ("1,2\n3,4,5\n6\n", "1,2\n\n3,4\n", '"1",2\n', "1,2\nx,4\n", "1," + "0" * 200 + "\n"):
        assert clean_rows(odd, 2, *limits) is None


@pytest.mark.slow
def test_a_packed_table_is_the_table(tmp_path: Path, paper) -> None:
    text = "t,theta1,theta2\n" + "".join(
        f"{k / 100:.2f},{3 + 0.1 * np.sin(k / 9):.5f},{3 + 0.1 * np.sin(k / 7):.5f}\n" for k in range(300)
    )
    (tmp_path / "swing.csv").write_text(text)
    (tmp_path / "swing.csv.gz").write_bytes(gzip.compress(text.encode()))
    plain, packed = (import_csv(tmp_path / name, paper, ImportOptions()) for name in ("swing.csv", "swing.csv.gz"))
    assert packed.name == plain.name == "swing"
    np.testing.assert_array_equal(packed.theta, plain.theta)


def test_a_packed_table_that_is_damaged_or_swells_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    packed = gzip.compress(text_of("plain").encode())
    (tmp_path / "cut.csv.gz").write_bytes(packed[: len(packed) // 2])
    with pytest.raises(RunError, match="is damaged or incomplete"):
        read_table(tmp_path / "cut.csv.gz")
    (tmp_path / "other.csv.gz").write_bytes(gzip.compress(bytes(range(256))))
    with pytest.raises(RunError, match="binary file and not a text table: unpack it with gunzip first"):
        read_table(tmp_path / "other.csv.gz")
    monkeypatch.setattr(table_module, "LIMITS", TableLimits(small_bytes=1 << 16))
    (tmp_path / "bomb.csv.gz").write_bytes(gzip.compress(b"\n" * (1 << 24)))
    with pytest.raises(RunError, match="expands to far more data than a table"):
        read_table(tmp_path / "bomb.csv.gz")


def test_reading_reports_its_progress(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table_module, "LIMITS", TableLimits(block_bytes=4000))
    (tmp_path / "a.csv").write_text(text_of("plain"))
    events: list[ImportProgress] = []
    read_table(tmp_path / "a.csv", events.append)
    done = [event.done for event in events]
    assert len(done) > 3
    assert done == sorted(done)
    assert {event.of for event in events} == {done[-1]} == {(tmp_path / "a.csv").stat().st_size}
