"""A written run equals the run read by this package and by the plain mcap reader; errors are reported."""

# pyright: reportOptionalMemberAccess=false, reportArgumentType=false

import hashlib
import itertools
import json
import subprocess
import tracemalloc
from dataclasses import asdict

import numpy as np
import pytest
from mcap.reader import make_reader

from dpr_lab.errors import RunError
from dpr_lab.rig import Rig, load_rig
from dpr_lab.storage.inspect import info, verify
from dpr_lab.storage.layout import RELEASED
from dpr_lab.storage.metadata import RunMetadata, RunSummary
from dpr_lab.storage.reader import load_run
from dpr_lab.storage.writer import RunWriter
from tests.full_disk import full_disk

RIG = load_rig("paper")
RELEASE = 50


def wobble(ticks):
    """Counts near pose X1: inner rod hanging, outer rod nearly upright."""
    start = np.round(RIG.positions(RIG.poses["X1"].theta)).astype(np.int64)
    return start + np.column_stack([0 * ticks, (40 * np.sin(ticks / 30)).astype(int), -ticks])


def record(path, n=400, **metadata):
    ticks = np.arange(n)
    with RunWriter(path, RunMetadata(RIG, "X1", 1000, **metadata)) as writer:
        for at in range(0, n, 50):
            writer.raw(10**18 + at * 10**6, bytes(range(at % 200, at % 200 + 14)))
            writer.samples(ticks[at : at + 50], wobble(ticks)[at : at + 50])
        writer.event(10**18 + 55 * 10**6, RELEASED, RELEASE)
        writer.status(10**18 + 60 * 10**6, {"state": "RELEASED", "sent": np.int64(60)})
        writer.clock(10**18 + 70 * 10**6, {"offset_s": 0.25, "std_s": np.nan})
        writer.finish(RunSummary(RELEASE, lost={"crc": 2, "tick_gap": np.int64(0)}, pose_measured=(0.0, 3.1, 0.1)))
    return path


def test_a_run_comes_back_as_it_was_written(tmp_path):
    path = record(tmp_path / "runs" / "swing.mcap", firmware="1.2.3", note="größer")
    run = load_run(path, RIG)
    np.testing.assert_array_equal(run.counts, wobble(np.arange(400)))
    np.testing.assert_allclose(run.t, (np.arange(400) - RELEASE) / 1000, atol=1e-15)
    np.testing.assert_array_equal(run.theta, RIG.theta(wobble(np.arange(400))))
    assert (run.name, run.pose, run.rig_name, run.rate_hz) == ("swing", "X1", "paper", 1000)
    assert run.complete
    assert run.lost == {"crc": 2, "tick_gap": 0}
    assert len(run.rest) == RELEASE
    assert run.rig_sha256 == RIG.sha256
    assert run.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    about = json.loads(json.dumps(asdict(info(path))))
    assert (about["firmware"], about["note"], about["release_tick"]) == ("1.2.3", "größer", RELEASE)
    assert about["duration_s"] == pytest.approx(0.349)
    assert about["pose_measured_rad"] == [0.0, 3.1, 0.1]
    assert verify(path).ok


def test_sha256sum_accepts_the_sidecar(tmp_path):
    record(tmp_path / "swing.mcap")
    checked = subprocess.run(["sha256sum", "-c", "swing.mcap.sha256"], cwd=tmp_path, capture_output=True, text=True)
    assert checked.stdout == "swing.mcap: OK\n"


def test_the_plain_mcap_reader_opens_every_channel(tmp_path):
    with record(tmp_path / "swing.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        messages = {topic: [] for topic in ("/samples", "/raw", "/events", "/status", "/clock")}
        for schema, channel, message in reader.iter_messages():
            messages[channel.topic].append((schema, message))
        schema, first = messages["/samples"][0]
        assert schema.encoding == "jsonschema"
        assert (
            set(json.loads(first.data))
            == {"tick", "t", "counts", "theta"}
            <= set(json.loads(schema.data)["properties"])
        )
        assert [m.log_time for _, m in messages["/samples"]] == [i * 1_000_000 for i in range(400)]
        assert messages["/raw"][1][1].data == bytes(range(50, 64))
        assert messages["/raw"][1][1].publish_time == 10**18 + 50 * 10**6
        assert messages["/raw"][1][1].log_time == 50 * 10**6
        assert json.loads(messages["/events"][0][1].data)["tick"] == RELEASE
        assert json.loads(messages["/clock"][0][1].data) == {"offset_s": 0.25, "std_s": None}
        assert {m.name for m in reader.iter_metadata()} == {"provenance", "units", "end"}
        (attached,) = reader.iter_attachments()
        assert attached.data == RIG.path.read_bytes()


def test_a_rig_made_in_memory_is_stored_whole(tmp_path):
    rig = Rig.model_validate({**RIG.model_dump(), "encoders": {"zero_counts": (5, -6, 7), "joint2": "absolute"}})
    with RunWriter(tmp_path / "a.mcap", RunMetadata(rig, "X1", 500)) as writer:
        writer.samples([3, 5], wobble(np.array([3, 5])))
        writer.finish(RunSummary(3))
    run = load_run(tmp_path / "a.mcap", rig)
    np.testing.assert_allclose(run.theta, rig.theta(run.counts))
    np.testing.assert_allclose(run.t, [0, 0.004])


def test_an_existing_file_is_never_overwritten(tmp_path):
    path = record(tmp_path / "swing.mcap")
    before = path.read_bytes()
    with pytest.raises(RunError, match="exists already"):
        RunWriter(path, RunMetadata(RIG, "X1", 1000))
    assert path.read_bytes() == before


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RunError, match=r"file: this folder cannot be created"):
        RunWriter(tmp_path / "file" / "a.mcap", RunMetadata(RIG, None, 1000))


@pytest.mark.parametrize("error", [KeyboardInterrupt(), RuntimeError("cable pulled")])
def test_an_exception_closes_the_file_as_incomplete(tmp_path, error):
    path = tmp_path / "swing.mcap"

    def interrupted():
        with RunWriter(path, RunMetadata(RIG, "X1", 1000)) as writer:
            writer.samples(np.arange(100), wobble(np.arange(100)))
            writer.event(0, RELEASED, 10)
            raise error

    with pytest.raises(type(error)):
        interrupted()
    run = load_run(path)
    assert not run.complete
    assert len(run.t) == 100
    assert run.t[10] == 0
    assert type(error).__name__ in run.notes[0]
    assert "not completed" in verify(path).faults[0]


def test_an_interrupt_in_the_middle_of_a_chunk_leaves_a_file_without_it(tmp_path, monkeypatch):
    path = tmp_path / "swing.mcap"
    writer = RunWriter(path, RunMetadata(RIG, "X1", 1000))
    writer.samples(np.arange(100), wobble(np.arange(100)))
    writer.event(0, RELEASED, 10)
    writer.flush()
    writer.samples(np.arange(100, 200), wobble(np.arange(100, 200)))

    def interrupt(_):
        raise KeyboardInterrupt

    monkeypatch.setattr("mcap.writer.zstandard.compress", interrupt)
    with pytest.raises(KeyboardInterrupt), writer:
        writer.flush()
    monkeypatch.undo()
    run = load_run(path)
    assert not run.complete
    np.testing.assert_array_equal(run.counts, wobble(np.arange(100)))


def test_leaving_without_finish_is_incomplete_and_abort_keeps_its_reason(tmp_path):
    with RunWriter(tmp_path / "a.mcap", RunMetadata(RIG, "X1", 1000)):
        pass
    assert "before the recording was finished" in info(tmp_path / "a.mcap").stopped
    with RunWriter(tmp_path / "b.mcap", RunMetadata(RIG, "X1", 1000)) as writer:
        writer.abort("device lost", RunSummary(lost={"crc": 1}))
    assert (info(tmp_path / "b.mcap").stopped, info(tmp_path / "b.mcap").lost) == ("device lost", {"crc": 1})


def test_a_finished_run_takes_nothing_more(tmp_path):
    with RunWriter(tmp_path / "a.mcap", RunMetadata(RIG, "X1", 1000)) as writer:
        writer.samples([0, 1], wobble(np.arange(2)))
        writer.finish(RunSummary(0))
        with pytest.raises(ValueError, match="is closed"):
            writer.samples([2], wobble(np.array([2])))


@pytest.mark.parametrize(
    ("ticks", "counts"), [([0, 0], np.zeros((2, 3))), ([4], np.zeros((1, 3))), ([9, 10], np.zeros((3, 3)))]
)
def test_callers_mistakes_are_value_errors(tmp_path, ticks, counts):
    with RunWriter(tmp_path / "a.mcap", RunMetadata(RIG, "X1", 1000)) as writer:
        writer.samples([4], np.zeros((1, 3)))
        with pytest.raises(ValueError, match="tick"):
            writer.samples(ticks, counts)
        with pytest.raises(ValueError, match="time_source"):
            writer.table([0.0], np.zeros((1, 3)))


def test_samples_reach_the_operating_system_within_a_quarter_second(tmp_path):
    clock = iter(np.arange(0, 10, 0.01)).__next__  # each look at the clock is 10 ms later
    with RunWriter(tmp_path / "a.mcap", RunMetadata(RIG, "X1", 1000), now=clock) as writer:
        oldest_unwritten, size = 0, (tmp_path / "a.mcap").stat().st_size
        for at in range(0, 2000, 10):
            writer.samples(np.arange(at, at + 10), wobble(np.arange(at, at + 10)))
            if (tmp_path / "a.mcap").stat().st_size > size:
                oldest_unwritten, size = at + 10, (tmp_path / "a.mcap").stat().st_size
            assert at + 10 - oldest_unwritten <= 250
        writer.finish(RunSummary(0))


@pytest.mark.slow
def test_memory_stays_flat_and_every_chunk_is_in_the_index(tmp_path):
    path, ticks, clock = tmp_path / "long.mcap", np.arange(1200), itertools.count()
    with RunWriter(path, RunMetadata(RIG, "X1", 1000), now=lambda: float(next(clock))) as writer:
        for tick in ticks:
            if tick == 200:
                tracemalloc.start()
            writer.samples([tick], wobble(ticks[tick : tick + 1]))
        grown, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        writer.finish(RunSummary())
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert len(summary.chunk_indexes) == summary.statistics.chunk_count >= 1200
    assert [len(index.message_index_offsets) for index in summary.chunk_indexes[-2:]] == [1, 1]
    assert grown < 100_000  # bytes; mcap's list of chunks takes 600 each, so 0.6 MB


def test_a_full_disk_is_reported_and_the_file_is_kept(tmp_path, monkeypatch, rng):
    def write(path):
        with RunWriter(path, RunMetadata(RIG, "X1", 1000)) as writer:
            for at in range(0, 100_000, 100):
                writer.samples(np.arange(at, at + 100), rng.integers(0, 10**6, (100, 3)))
                writer.flush()

    full_disk(monkeypatch, 40_000)
    path = tmp_path / "full.mcap"
    with pytest.raises(RunError, match=r"full\.mcap: cannot be written: No space left on device;.*recover"):
        write(path)
    about = info(path)
    assert not about.complete
    assert about.samples >= 500
