"""Samples written in blocks: any JSON reader reads them, and all numbers are exact."""

import json
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from dpr_lab.storage.inspect import verify
from dpr_lab.storage.layout import SAMPLES
from dpr_lab.storage.metadata import RunMetadata, RunSummary
from dpr_lab.storage.reader import load_run
from dpr_lab.storage.row_text import Samples, message_records, message_texts, sample_texts, samples_of
from dpr_lab.storage.writer import RunWriter

N = 3000
RNG = np.random.default_rng(5)
TICK = np.arange(N)
T = np.round(TICK / 3000, 9)
THETA = np.round(RNG.normal(size=(N, 3)) * [0, 3, 300], 11)
NO_TORQUES = np.zeros((0, N, 2))
TORQUES = np.round(RNG.normal(size=(2, N, 2)) * 1e-3, 7)
COUNTS = RNG.integers(-(10**6), 10**6, (N, 3))


@pytest.mark.parametrize("counts", [None, COUNTS], ids=["no counts", "counts"])
@pytest.mark.parametrize("torques", [NO_TORQUES, TORQUES[:1], TORQUES], ids=["free", "one kind", "both"])
def test_any_reader_of_json_reads_the_rows(counts, torques) -> None:
    samples = Samples(TICK, T, THETA, counts, torques)
    texts = sample_texts(samples)
    assert texts is not None
    rows = [json.loads(row.tobytes()) for row in texts]
    assert [row["tick"] for row in rows] == TICK.tolist()
    assert [row["t"] for row in rows] == T.tolist()
    assert [row["theta"] for row in rows] == THETA.tolist()
    assert counts is None or [row["counts"] for row in rows] == counts.tolist()
    for key, torque in zip(("tau", "tau_commanded"), torques, strict=False):
        assert [row[key] for row in rows] == torque.tolist()
    again = samples_of(texts)
    assert again is not None
    assert again.vectors.keys() == samples.vectors.keys()
    for field in fields(samples):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(samples, field.name))


def test_records_of_mcap_are_distinguished_from_others() -> None:
    texts = sample_texts(Samples(TICK, T, THETA, None, NO_TORQUES))
    assert texts is not None
    records = message_records(4, TICK * 1000, texts).tobytes()
    read = message_texts(records)
    assert read is not None
    assert read[0] == 4
    np.testing.assert_array_equal(read[1], texts)
    for other in (b"", records[:20], records[:-1], b"\x04" + records[1:], records + b"\x05" + bytes(8)):
        assert message_texts(other) is None


@given(st.lists(st.floats(-9000, 9000, allow_nan=False), min_size=1, max_size=20))
def test_what_has_a_text_comes_back_to_the_last_bit(values: list[float]) -> None:
    n = len(values)
    theta = np.column_stack([values, np.round(values, 11), np.round(values, 3)])
    theta += 0.0  # no negative zero
    texts = sample_texts(Samples(np.arange(n), np.arange(n) / 4, theta, None, np.zeros((0, n, 2))))
    if texts is None:
        assert (np.round(values, 9) != values).any()
        return
    samples = samples_of(texts)
    assert samples is not None
    np.testing.assert_array_equal(samples.theta, theta)


@pytest.mark.parametrize(
    ("old", "new"), [(b"1", b"x"), (b".", b","), (b"  1", b"1 1"), (b" -", b"--"), (b"[", b"("), (b"-", b"+")]
)
def test_texts_that_are_not_as_they_were_written_are_left_to_json(old: bytes, new: bytes) -> None:
    texts = sample_texts(Samples(TICK[:50], T[:50], -np.abs(THETA[:50]), None, NO_TORQUES[:, :50]))
    assert texts is not None
    row = texts[1].tobytes()
    assert old in row
    changed = texts.copy()
    changed[1] = np.frombuffer(row.replace(old, new, 1), dtype=np.uint8)
    assert samples_of(changed) is None


@pytest.mark.parametrize(
    ("tick", "angle"),
    [
        ("3", f"{10**310 - 1}.000"),
        ("3", "2.10"),
        ("3", "2"),
        ("3", ".100"),
        ("3", "1.   "),
        ("3", "-.0"),
        ("3", "-0.000"),
        ("3", "01.000"),
        ("3", "nan"),
        ("012", "0.000"),
        ("1_0", "0.000"),
        ("3.000", "0.000"),
        (str(2**53 + 1), "0.000"),
        (str(-(2**63)), "0.000"),
    ],
)
def test_numbers_that_are_not_written_are_left_to_json_in_each_row(tick: str, angle: str) -> None:
    width, size = len(tick) + 1, max(len(angle) + 1, 6)
    rows = [
        list(f'{{"tick":{i:>{width}},"t": 0.000,"theta":[{x:>{size}}, 0.000, 0.000]}}'.encode())
        for i, x in (("2", "0.000"), (tick, angle))
    ]
    assert samples_of(np.array(rows, dtype=np.uint8)) is None


@pytest.mark.parametrize("odd", [1 / 3, 1e-12, 1e16])
def test_numbers_without_a_short_text_are_written_row_by_row(odd: float, tmp_path: Path, paper) -> None:
    theta = THETA.copy()
    theta[7, 1] = odd
    assert sample_texts(Samples(TICK, T, theta, None, NO_TORQUES)) is None
    file = written(tmp_path / "a.mcap", paper, theta)
    assert load_run(file).theta[7, 1] == odd


def written(file: Path, rig, theta: np.ndarray) -> Path:
    metadata = RunMetadata(rig=rig, pose=None, rate_hz=3000.0, source="import", time_source="table")
    with RunWriter(file, metadata) as writer:
        for part in (slice(0, 20), slice(20, 2000), slice(2000, N)):
            writer.table(T[part], theta[part])
        writer.finish(RunSummary(release_tick=0))
    return file


@pytest.mark.filterwarnings("ignore:start_time is deprecated:DeprecationWarning")
@pytest.mark.filterwarnings("ignore:end_time is deprecated:DeprecationWarning")
def test_a_run_of_many_rows_is_a_sound_mcap_file(tmp_path: Path, paper) -> None:
    file = written(tmp_path / "a.mcap", paper, THETA)
    assert verify(file).ok
    run = load_run(file)
    np.testing.assert_array_equal(run.theta, THETA)
    np.testing.assert_array_equal(run.t, T)
    with file.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == N
        window = list(reader.iter_messages(SAMPLES, start_time=500_000_000, end_time=510_000_000))
    assert [json.loads(message.data)["tick"] for _, _, message in window] == list(range(1500, 1530))
