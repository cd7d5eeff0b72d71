"""Samples written in blocks: any JSON reader reads them, and all numbers are exact."""

import json
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
from dpr_lab.storage.row_text import Samples, sample_texts
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


@given(st.lists(st.floats(-9000, 9000, allow_nan=False), min_size=1, max_size=20))
def test_what_has_a_text_comes_back_to_the_last_bit(values: list[float]) -> None:
    n = len(values)
    theta = np.column_stack([values, np.round(values, 11), np.round(values, 3)])
    theta += 0.0  # no negative zero
    texts = sample_texts(Samples(np.arange(n), np.arange(n) / 4, theta, None, np.zeros((0, n, 2))))
    if texts is None:
        assert (np.round(values, 9) != values).any()
        return
    rows = [json.loads(row.tobytes())["theta"] for row in texts]
    np.testing.assert_array_equal(rows, theta)


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
