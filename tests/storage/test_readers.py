"""Recordings in many file formats give the same run; other files are refused with a message."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import RunError
from dpr_lab.rig_tables import Rods
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.tables.understand import understand
from tests.storage.swing_files import (
    BAGS,
    GUESSED,
    RIG,
    ROWS,
    SWING,
    THETA1,
    THETA2,
    WRITERS,
    T,
    is_the_swing,
    read,
    text,
    write_mat,
)


@pytest.mark.slow
def test_text_tables_of_any_form_are_read(tmp_path: Path) -> None:
    assert is_the_swing(read(text(tmp_path / "a.tsv", ROWS, "\t", "time [s]\tq1 (rad)\tq2 (rad)\n")))
    assert is_the_swing(read(text(tmp_path / "b.txt", ROWS, " ")))
    named = {"t": "Zeit", "theta1": "innen", "theta2": "außen"}
    german = text(tmp_path / "c.csv", ROWS, ";", "Zeit;innen;außen\n", comma=True)
    assert is_the_swing(read(german, columns=named))
    assert is_the_swing(read(text(tmp_path / "d.txt", ROWS, "\t", comma=True)))
    in_degrees = np.column_stack([T * 1e3, np.degrees(ROWS[:, 1:])])
    assert is_the_swing(read(text(tmp_path / "e.csv", in_degrees, head="time_ms,theta1_deg,theta2 [°]\n")))
    run = read(text(tmp_path / "f.txt", ROWS))
    assert run.notes[0] == "columns without names are interpreted as t, theta1, theta2"


@pytest.mark.slow
def test_records_of_a_logger_are_a_table_however_they_are_nested(tmp_path: Path) -> None:
    samples = [{"t": t, "rod": {"theta1": a, "theta2": b}, "on": True, "mode": "free"} for t, a, b in ROWS.tolist()]
    document = {"motor": "none", "gains": [1.0, 2.0], "log": {"entries": samples}}
    file = tmp_path / "a.json"
    file.write_text(json.dumps(document))
    assert is_the_swing(read(file))
    lines = tmp_path / "b.jsonl"
    lines.write_text("\n".join(map(json.dumps, samples)))
    assert is_the_swing(read(lines))
    rows = tmp_path / "c.json"
    rows.write_text(json.dumps(ROWS.tolist()))
    named = {"t": "array[1]", "theta1": "array[2]", "theta2": "array[3]"}
    assert is_the_swing(read(rows, columns=named))
    file.write_text(json.dumps([{"mode": "free"}] * 9))
    with pytest.raises(RunError, match="contain no numbers"):
        read(file)


def damaged(path: Path) -> list[Path]:
    """Truncated file, and file with changed bytes."""
    content = path.read_bytes()
    result = []
    rng = np.random.default_rng(5)
    for number in range(12):
        changed = bytearray(content if number else content[: len(content) // 2])
        for at in rng.integers(0, len(changed), 30 if number else 0):
            changed[at] = int(rng.integers(256))
        result.append(path.with_name(f"{number}{path.suffix}"))
        result[-1].write_bytes(changed)
    return result


@pytest.mark.parametrize("suffix", [*WRITERS, ".mcap", ".db3"])
def test_a_damaged_file_is_a_sentence(tmp_path: Path, suffix: str) -> None:
    whole = tmp_path / f"whole{suffix}"
    if suffix in WRITERS:
        WRITERS[suffix](whole, **SWING)
    else:
        BAGS[suffix](whole, [("/joint_states", ("theta1", "theta2"), ROWS)])
    for file in damaged(whole):
        try:
            read(file)
        except RunError as error:
            assert str(file) in str(error)  # noqa: PT017


def test_files_that_are_not_tables_are_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.xlsx", "w") as archive:
        archive.writestr("xl/workbook.xml", "<workbook/>")
    with pytest.raises(RunError, match="save the table of a spreadsheet as CSV"):
        read(tmp_path / "a.xlsx")
    with pytest.raises(RunError, match="contains no columns of numbers; it contains: name"):
        read(write_mat(tmp_path / "b.mat", name="swing"))
    with pytest.raises(RunError, match=r"without metadata.yaml and therefore not a ROS 2 bag"):
        read(tmp_path)
    long = text(tmp_path / "c.csv", ROWS, head="t,theta1,theta2\n")
    long.write_text(long.read_text() + f"9,{'9' * 5000},1\n")
    assert any("outliers removed: 1" in note or "without a value" in note for note in read(long).notes)


@pytest.mark.slow
def test_scale_offset_and_wrap(tmp_path: Path) -> None:
    turned = np.column_stack([T, 90 - np.degrees(THETA1), (np.degrees(THETA2) * 2) % 360])
    file = text(tmp_path / "a.csv", turned, head="t,theta1,theta2\n")
    options = {"scale": {"theta1": -1.0, "theta2": 0.5}, "offset": {"theta1": 90.0}, "wrap": 360.0}
    run = read(file, unit="deg", **options)
    assert np.allclose(run.theta[:, 1], THETA1)
    assert np.allclose(np.diff(run.theta[:, 2]), np.diff(THETA2))
    whole = np.round(RIG.positions(np.column_stack([0 * T, THETA1, THETA2])))
    counts = np.column_stack([T, whole[:, 1:] % 4096])
    run = read(text(tmp_path / "b.csv", counts, head="t,counts1,counts2\n"), wrap=4096.0)
    assert run.counts is not None
    np.testing.assert_array_equal(np.diff(run.counts, axis=0), np.diff(whole.astype(int), axis=0))


def test_a_preview_shows_the_interpretation_and_writes_nothing(tmp_path: Path) -> None:
    file = write_mat(tmp_path / "a.mat", **SWING | {"t": np.where(T > 0.5, T + 0.2, T)})
    result = understand(file, RIG, ImportOptions(**GUESSED))
    facts = result.facts()
    assert facts["columns"] == "t = t, theta1 = theta1, theta2 = theta2"
    assert facts["angles"] == "rad, absolute, upright is 0"
    assert facts["rate"].startswith("200 Hz, steps 0.005 to 0.205 s; 1 interruption")
    assert result.first_rows()[0] == pytest.approx((0.0, THETA1[0], THETA2[0]))
    assert [path.name for path in tmp_path.iterdir()] == ["a.mat"]
    fast = text(tmp_path / "b.csv", np.column_stack([T, np.degrees(ROWS[:, 1:])]), head="t,theta1,theta2\n")
    asked = [question.sentence for question in understand(fast, RIG, ImportOptions(**GUESSED)).questions]
    assert any("--unit" in sentence for sentence in asked), asked


def test_the_rate_of_a_preview_does_not_depend_on_the_rounding_of_times(tmp_path: Path) -> None:
    times = np.round(np.arange(len(T)) / 120, 4)  # the median step is 8.3 ms, that is 120.48 Hz
    file = text(tmp_path / "a.csv", np.column_stack([times, ROWS[:, 1:]]), head="t,theta1,theta2\n")
    rate = understand(file, RIG, ImportOptions(**GUESSED)).facts()["rate"]
    assert rate.startswith("120 Hz, steps 0.0083 to 0.0084 s")


@pytest.mark.parametrize(
    ("name", "scale"), [("theta_deg", 180 / np.pi), ("angle [rad]", 1.0), ("counts", 16384 / 2 / np.pi)]
)
def test_one_rod_alone_needs_no_number(tmp_path: Path, name: str, scale: float) -> None:
    rig = RIG.model_copy(update={"rods": Rods(mounted="inner")})
    hanging = np.round((THETA1 - np.pi) * scale) if name == "counts" else THETA1 * scale
    file = text(tmp_path / "a.csv", np.column_stack([T, hanging]), head=f"t_s,{name}\n")
    run = import_csv(file, rig, ImportOptions(**GUESSED))
    assert np.allclose(run.theta[:, 1], THETA1, atol=2 * np.pi / 16384)
