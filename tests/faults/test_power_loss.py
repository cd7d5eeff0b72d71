"""Power loss during the writing of a run: the file may end anywhere, and its readable content is correct."""

import os
from pathlib import Path

import numpy as np
import pytest
from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from dpr_lab.errors import RunError
from dpr_lab.storage.inspect import info, recover, verify
from dpr_lab.storage.reader import load_run
from dpr_lab.storage.sidecar import sidecar_of

RANDOM_CUTS, EVERY_CHUNK = (2000, 1) if os.environ.get("DPR_LAB_FULL") == "1" else (4, 6)
"""Cuts anywhere; of the chunks every so manieth is cut at its end and one byte before it, the last one always."""


def chunk_ends(path: Path) -> list[int]:
    """Position of the end of each chunk of a run file, bytes."""
    ends: list[int] = []
    with path.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Chunk):
                ends.append(file.tell())
    return ends


pytestmark = pytest.mark.slow


@pytest.fixture
def run_file(serve, operate) -> Path:
    done = operate(serve(clock="realtime"), "--duration", "2")
    assert done.code == 0, done.message
    return done.runs[0]


@pytest.mark.timeout(1800)
def test_power_loss(run_file: Path, tmp_path: Path, wrong_samples, matrix, command) -> None:
    content, whole = run_file.read_bytes(), load_run(run_file)
    ends = chunk_ends(run_file)
    assert len(ends) > 8
    anywhere = np.random.default_rng(1).integers(0, len(content), RANDOM_CUTS).tolist()
    kept: list[int] = []
    at = ends[::-EVERY_CHUNK]
    for cut in sorted([*at, *(end - 1 for end in at), *anywhere]):
        path = tmp_path / "cut.mcap"
        path.write_bytes(content[:cut])
        assert not verify(path).ok
        try:
            about = info(path)
        except RunError:
            assert cut < ends[0]  # before the first sample
            continue
        assert not about.complete
        kept.append(about.samples)
        if about.release_tick is None:
            continue
        assert wrong_samples(path) == 0
        saved = tmp_path / "saved.mcap"
        assert recover(path, saved) == about.samples
        assert verify(saved).ok
        saved.unlink()
        sidecar_of(saved).unlink()
    assert kept == sorted(kept)  # a longer file never says less
    assert max(kept) == len(whole.t)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(content[: ends[-1] - 1])
    code, result = command("run", "verify", cut)
    shown = f"`run verify`: {result.removeprefix(f'{cut}: ')}"
    matrix.show(
        "power lost: the file ends at any byte", "any", shown, code, "every whole chunk (250 ms) before the cut"
    )
