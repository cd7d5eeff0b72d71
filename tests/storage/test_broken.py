"""Truncated, corrupted and foreign files: only RunError is raised, and no wrong sample is read."""

# pyright: reportOptionalMemberAccess=false, reportOptionalSubscript=false

import os
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType, Writer

from dpr_lab.errors import RunError
from dpr_lab.rig import load_rig
from dpr_lab.storage.inspect import info, recover, verify
from dpr_lab.storage.layout import LIMITS, RELEASED, SAMPLES, Stored
from dpr_lab.storage.metadata import RunMetadata, RunSummary
from dpr_lab.storage.reader import load_run
from dpr_lab.storage.writer import RunWriter, WriterSettings
from tests.warm_process import started

RIG = load_rig("paper")
N = 1200
COUNTS = np.cumsum(np.random.default_rng(1).integers(-9, 10, (N, 3)), axis=0)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "whole.mcap"
    with RunWriter(path, RunMetadata(RIG, "X1", 1000)) as writer:
        for at in range(0, N, 100):
            writer.raw(at, bytes(100))
            writer.samples(np.arange(at, at + 100), COUNTS[at : at + 100])
            if at == 100:
                writer.event(at, RELEASED, 110)
            writer.flush()
        writer.finish(RunSummary(110))
    return path


@pytest.mark.parametrize(
    ("topics", "note"),
    [
        (["/camera"], "'/camera'"),
        ([f"/{i}\n" for i in range(7)], r"'/0\n', '/1\n', '/2\n', '/3\n', '/4\n' and 2 more"),
    ],
)
def test_a_copy_omits_the_channels_of_other_programs_and_names_them(tmp_path, topics, note):
    with RunWriter(tmp_path / "a.mcap", RunMetadata(RIG, "X1", 1000)) as writer:
        writer.samples(range(20), np.zeros((20, 3), dtype=np.int64))
        for topic in topics:
            writer._mcap.add_message(writer._mcap.register_channel(topic, "json", 0), 5, b"{}", 5)
        writer.event(1, RELEASED, 10)
        writer.finish(RunSummary(10))
    assert recover(tmp_path / "a.mcap", tmp_path / "b.mcap") == 20
    assert verify(tmp_path / "b.mcap").ok
    assert info(tmp_path / "b.mcap").notes[-1] == f"channels of other programs, not copied: {note}"


def assert_only_true_samples(path):
    """Read all readable samples, and check that each equals the sample written for its tick."""
    try:
        run = load_run(path, verify=False)
    except RunError:
        return None
    ticks = np.round(run.t * 1000).astype(int) + 110
    np.testing.assert_array_equal(run.counts, COUNTS[ticks])
    return run


@pytest.mark.slow
def test_a_file_cut_anywhere_gives_true_samples_or_a_run_error(tmp_path, whole):
    content = whole.read_bytes()
    cuts = [0, 1, 7, 8, 9, len(content) - 1, *np.random.default_rng(2).integers(10, len(content) - 1, 25)]
    read = 0
    for cut in cuts:
        path = tmp_path / "cut.mcap"
        path.write_bytes(content[:cut])
        run = assert_only_true_samples(path)
        if run is not None:
            read += 1
            assert not run.complete
            assert "damaged" in run.notes[-1]
        assert not verify(path).ok
    assert read > 12


def test_every_chunk_before_the_cut_is_kept(tmp_path, whole):
    content = whole.read_bytes()
    path = tmp_path / "cut.mcap"
    kept = []
    for share in (0.5, 0.7, 0.9):
        path.write_bytes(content[: int(share * len(content))])
        kept.append(info(path).samples)
    assert kept == sorted(kept)
    assert kept[0] >= 300
    assert all(n % 100 == 0 for n in kept)


@pytest.mark.slow
def test_a_flipped_byte_is_found_and_never_read_as_right(tmp_path, whole):
    content = whole.read_bytes()
    path = tmp_path / "flipped.mcap"
    rng = np.random.default_rng(3)
    for at in rng.integers(0, len(content), 30):
        flipped = bytearray(content)
        flipped[at] ^= 1 << rng.integers(8)
        path.write_bytes(flipped)
        shutil.copy(f"{whole}.sha256", f"{path}.sha256")
        assert not verify(path).ok
        with pytest.raises(RunError):
            load_run(path)
        assert_only_true_samples(path)


def test_a_flipped_byte_in_the_data_is_found_without_the_sidecar(tmp_path, whole):
    content = bytearray(whole.read_bytes())
    content[len(content) // 2] ^= 0x10
    path = tmp_path / "flipped.mcap"
    path.write_bytes(content)
    run = assert_only_true_samples(path)
    assert run is None or not run.complete
    assert any("damaged" in fault for fault in verify(path).faults)


def test_a_changed_run_is_reported_with_the_remedy(tmp_path, whole):
    path = tmp_path / "whole.mcap"
    shutil.copy(whole, path)
    (tmp_path / "whole.mcap.sha256").write_text("0" * 64 + "  whole.mcap\n")
    with pytest.raises(RunError, match=r"has changed since it was finished.*run recover"):
        load_run(path)
    assert load_run(path, verify=False).complete


def test_recover_writes_an_undamaged_run_that_states_where_the_recording_ended(tmp_path, whole):
    content = whole.read_bytes()
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(content[: int(0.8 * len(content))])
    before = broken.read_bytes()
    kept = recover(broken, tmp_path / "new.mcap")
    assert broken.read_bytes() == before
    checked, about = verify(tmp_path / "new.mcap"), info(tmp_path / "new.mcap")
    assert checked.ok
    run = load_run(tmp_path / "new.mcap", RIG)
    assert not run.complete
    assert not about.complete
    where = f"interrupted {run.duration:.3f} s after the release: the file is incomplete"
    assert about.stopped == checked.interrupted
    assert about.stopped.startswith(where)
    assert any(where in note for note in run.notes)
    assert len(run.t) == kept == len(load_run(broken).t)
    np.testing.assert_array_equal(run.counts, COUNTS[:kept])
    assert f"recovered from broken.mcap, {kept} samples kept" in run.notes
    with pytest.raises(RunError, match="exists already"):
        recover(broken, tmp_path / "new.mcap")
    recover(tmp_path / "new.mcap", tmp_path / "again.mcap")
    assert info(tmp_path / "again.mcap").stopped == about.stopped


def test_a_recording_with_all_its_samples_is_complete_after_its_recovery(tmp_path, whole):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:-8])
    assert not load_run(cut).complete
    recover(cut, tmp_path / "new.mcap")
    assert load_run(tmp_path / "new.mcap").complete


WRITER = """
import sys, time
import numpy as np
from dpr_lab.rig import load_rig
from dpr_lab.storage.layout import RELEASED
from dpr_lab.storage.metadata import RunMetadata
from dpr_lab.storage.writer import RunWriter

writer = RunWriter(sys.argv[1], RunMetadata(load_rig("paper"), "X1", 1000))
start, written = time.monotonic(), 0
while True:
    time.sleep(0.01)
    due = int((time.monotonic() - start) * 1000)
    ticks = np.arange(written, due)
    writer.samples(ticks, np.column_stack([ticks, 3 * ticks, -ticks]))
    if written <= 100 < due:
        writer.event(time.time_ns(), RELEASED, 100)
    written = due
    print(written, flush=True)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="kill -9")
def test_a_killed_writer_loses_at_most_its_last_chunk(tmp_path):
    path = tmp_path / "killed.mcap"
    with started("tests.program_text", [WRITER, path], stdout=subprocess.PIPE, text=True) as process:
        written = 0
        while written < 1500:
            written = int(process.stdout.readline())
        process.kill()
        written = max([written, *map(int, process.stdout.read().split())])
    faults = verify(path).faults
    assert any("not completed" in fault for fault in faults)
    kept = recover(path, tmp_path / "saved.mcap")
    assert kept >= written - 250 - 100  # the margin is for a loaded machine
    run = load_run(tmp_path / "saved.mcap")
    np.testing.assert_array_equal(run.counts[:, 1], 3 * np.arange(kept))
    assert run.t[100] == 0
    assert run.lost == {"tick_gap": 0}
    assert verify(tmp_path / "saved.mcap").ok


def test_a_gap_in_a_cut_file_is_counted(tmp_path):
    path = tmp_path / "a.mcap"
    with RunWriter(path, RunMetadata(RIG, "X1", 1000)) as writer:
        writer.samples([0, 1, 5, 6, 9], COUNTS[:5])
        writer.event(0, RELEASED, 1)
        writer.finish(RunSummary(1, lost={"crc": 5}))
    about = info(path)
    assert (about.gaps, about.longest_gap_s, about.lost) == (2, pytest.approx(0.004), {"crc": 5})
    content = path.read_bytes()
    path.write_bytes(content[: content.index(b"complete")])
    assert load_run(path, verify=False).lost == {"tick_gap": 5}


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ('"t":"0.5","theta":[0,1,2]', "'t' must be one finite number, not '0.5'"),
        ('"t":NaN,"theta":[0,1,2]', "'t' must be one finite number, not nan"),
        ('"t":0.5,"theta":[0,1]', r"'theta' must be 3 finite numbers, not \[0, 1\]"),
    ],
)
def test_a_wrong_value_in_a_sample_is_named_with_its_key_and_tick(tmp_path, values, sentence):
    rows = ['"tick":6,"t":0.1,"theta":[0,1,2]', f'"tick":7,{values}']
    with RunWriter(tmp_path / "a.mcap", RunMetadata(RIG, "X1", 1000)) as writer:
        writer.copy(Stored(SAMPLES, 0, 0, f"{{{row}}}".encode()) for row in rows)
        writer.finish(RunSummary(6))
    with pytest.raises(RunError, match=rf"a\.mcap: its samples .*: {sentence} \(sample with tick 7\)\. .*use the"):
        load_run(tmp_path / "a.mcap")


def foreign(path, chunk=b"{}"):
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start()
        channel = writer.register_channel("/imu", "json", writer.register_schema("imu", "jsonschema", b"{}"))
        writer.add_message(channel, 0, chunk, 0)
        writer.finish()


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "is empty: nothing was recorded; record or import it again"),
        (b"t,theta1\n0,1\n", "is not a run file"),
        (b"\x89MC", "is not a run file"),
        (b"\x89MCAP0\r\n", "incomplete or damaged near byte 8"),
        (None, "MCAP file of another tool"),
    ],
    ids=["empty", "text", "start", "magic alone", "foreign"],
)
def test_what_is_not_a_run_is_refused_in_a_sentence(tmp_path, content, sentence):
    path = tmp_path / "a.mcap"
    if content is None:
        foreign(path)
    else:
        path.write_bytes(content)
    for read in (load_run, info):
        with pytest.raises(RunError, match=sentence):
            read(path)
    assert sentence in verify(path).faults[0]
    with pytest.raises(RunError, match=sentence):
        recover(path, tmp_path / "new.mcap")


def test_missing_file_and_folder_are_named(tmp_path):
    with pytest.raises(RunError, match=r"no.mcap: no such file; check the path$"):
        load_run(tmp_path / "no.mcap")
    with pytest.raises(RunError, match="is a folder: give the run files in this folder"):
        load_run(tmp_path)
    with pytest.raises(RunError, match=r"no.mcap: no such file; check the path$"):
        verify(tmp_path / "no.mcap")


def header_of_second_chunk(content):
    second = content.index(b"zstd", content.index(b"zstd") + 4)
    return second - 4 - 4 - 8 - 8 - 8 - 9  # opcode and length, three u64, crc u32, length of "zstd" u32


def chunk_of(whole, data):
    """Chunk with the header of a run's second chunk and other compressed data."""
    content = whole.read_bytes()
    header = header_of_second_chunk(content)
    length = 8 + 8 + 8 + 4 + 4 + 4 + 8 + len(data)
    head = content[header + 9 : header + 9 + 8 + 8 + 8 + 4 + 4 + 4]
    return b"\x06" + length.to_bytes(8, "little") + head + len(data).to_bytes(8, "little") + data


def test_many_small_chunks_cannot_exceed_the_limit_of_memory(tmp_path, whole):
    bomb = chunk_of(whole, zstandard.compress(bytes(LIMITS.record_bytes - 1)))
    content = whole.read_bytes()
    path = tmp_path / "bombs.mcap"
    path.write_bytes(content[: header_of_second_chunk(content)] + 1000 * bomb)
    about = info(path)
    assert "would expand" in about.damage
    assert about.samples == 100


def test_a_chunk_that_would_expand_beyond_reason_is_not_expanded(tmp_path, whole, monkeypatch):
    content = whole.read_bytes()
    bomb = zstandard.compress(bytes(4 * LIMITS.record_bytes))
    path = tmp_path / "bomb.mcap"
    path.write_bytes(content[: header_of_second_chunk(content)] + chunk_of(whole, bomb))
    expanded = []
    real = zstandard.decompress
    monkeypatch.setattr(zstandard, "decompress", lambda data, size=0: expanded.append(len(data)) or real(data, size))
    start = time.process_time()
    about = info(path)
    assert "would expand" in about.damage
    assert about.samples == 100
    assert len(bomb) not in expanded
    assert time.process_time() - start < 1


@pytest.mark.skipif(not hasattr(os, "SEEK_HOLE"), reason="needs a system that tells where a file has holes")
def test_a_small_file_that_claims_any_size_is_read_to_its_hole(tmp_path, whole):
    path = shutil.copy(whole, tmp_path / "huge.mcap")
    os.truncate(path, 50 << 30)
    if os.stat(path).st_blocks * 512 > 1 << 30:
        pytest.skip("this file system keeps no holes")
    before = time.process_time()
    assert info(path).samples == N
    assert info(path).size_bytes < whole.stat().st_size + (1 << 20)
    assert not verify(path).ok
    assert len(load_run(path, verify=False).t) == N
    assert recover(path, tmp_path / "sound.mcap") == N
    assert verify(tmp_path / "sound.mcap").ok
    os.truncate(path, 0)
    os.truncate(path, 50 << 30)  # nothing but a hole
    with pytest.raises(RunError, match="is empty"):
        load_run(path)
    assert time.process_time() - before < 20


def flooded(path, kinds=("INDEX",), times=2000):
    # with time standing still: a slow machine would flush within a flood and restart the count
    with RunWriter(path, RunMetadata(RIG, "X1", 1000), now=lambda: 0.0) as writer:
        for at in range(0, N, 100):
            writer.samples(np.arange(at, at + 100), COUNTS[at : at + 100])
            for kind in kinds:
                for _ in range(times):
                    writer.event(at, kind, at, "1")
            writer.status(at, {"state": "RELEASED"})
            if at == 100:
                writer.event(at, RELEASED, 110)
            writer.flush()
        writer.finish(RunSummary(110))
    return path


@pytest.mark.slow
def test_a_flood_of_events_is_counted_and_costs_no_sample(tmp_path):
    path = flooded(tmp_path / "flood.mcap", ("INDEX", "LEASE_LOST"))
    run = assert_only_true_samples(path)
    assert (len(run.t), run.complete, verify(path).ok) == (N, True, True)
    assert "events INDEX: 18,000 more than the maximum number, discarded" in run.notes
    assert "events LEASE_LOST: 18,000 more than the maximum number, discarded" in run.notes


@pytest.mark.slow
def test_a_flood_that_an_earlier_version_kept_is_read_and_recovered(tmp_path, monkeypatch):
    monkeypatch.setattr("dpr_lab.storage.writer.SETTINGS", WriterSettings(messages_a_chunk=10**9))
    path = flooded(tmp_path / "flood.mcap")
    assert len(assert_only_true_samples(path).t) == N
    path.write_bytes(path.read_bytes()[:-300])
    assert recover(path, tmp_path / "saved.mcap") == N
