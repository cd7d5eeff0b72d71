"""A truncated recording in the results of identify, compare and diagnose, and in a certificate."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dpr_lab as dpr
from dpr_lab.certificate.document import Certificate, CertifiedRecording
from dpr_lab.certificate.files import certify_recording, compare_truncated, truncated_recordings
from dpr_lab.report.tables import comparison_table
from dpr_lab.run import Run
from dpr_lab.storage.metadata import RunMetadata, RunSummary
from dpr_lab.storage.writer import RunWriter
from tests.bench_rigs import Rod, one_rod, rod_swing, table
from tests.thinned import candidates

SENTENCE = "truncated recordings, used up to their interruption (`dpr-lab run verify` states its cause): cut"
NOTE = f"T{SENTENCE[1:]}."


@pytest.fixture
def rig() -> dpr.Rig:
    return one_rod(1.5 * 9.81 / 21.4, 0.115, 4000, np.random.default_rng(1))


@pytest.fixture
def cut(tmp_path: Path, rig: dpr.Rig) -> Run:
    t, rng = np.arange(0.0, 2.4, 0.04), np.random.default_rng(3)
    angle = rod_swing(Rod(21.4, 0.04, 0.0, 0.0), np.radians(60.0), t) + rng.normal(0.0, 2e-3, len(t))
    return replace(table(tmp_path, "cut", rig, {"t_s": t, "theta1_rad": angle}), complete=False)


def test_a_truncated_recording_is_named_by_every_result(rig: dpr.Rig, cut: Run) -> None:
    model = dpr.identify(cut, rig)
    assert SENTENCE in model.warnings
    assert [run.truncated for run in model.runs] == [True]
    comparison = dpr.compare(cut, rig, model)
    assert comparison.truncated
    assert comparison_table([comparison]).rows[0][1] == "fitted, truncated"
    diagnosis = dpr.diagnose(cut, rig, library=candidates("coulomb_joint1"))
    assert diagnosis.notes[0] == NOTE
    assert diagnosis.evidence is not None
    assert [recording.truncated for recording in diagnosis.evidence.recordings] == [True]


def test_a_certificate_states_which_recordings_are_truncated(tmp_path: Path) -> None:
    paper = dpr.load_rig("paper")
    with RunWriter(tmp_path / "cut.mcap", RunMetadata(paper, "X2", 1000)) as writer:
        writer.samples(np.arange(5), np.zeros((5, 3), dtype=np.int64))
        writer.abort("stopped by the operator", RunSummary(1))
    recording: CertifiedRecording = certify_recording(tmp_path / "cut.mcap", tmp_path, held_out=False)
    assert truncated_recordings([recording], tmp_path) == ("cut.mcap",)
    certificate = Certificate.model_construct(recordings=[recording], truncated_recordings=("cut.mcap",), limits=None)
    assert compare_truncated(certificate, tmp_path) == []
    [fault] = compare_truncated(certificate.model_copy(update={"truncated_recordings": ()}), tmp_path)
    assert not fault.holds
    (older,) = compare_truncated(certificate.model_copy(update={"truncated_recordings": None}), tmp_path)
    assert (older.holds, older.now, older.reason) == (True, "cut.mcap", "the certificate does not state them")
