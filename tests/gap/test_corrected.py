from pathlib import Path

import pytest

from dpr_lab.exports.corrected import corrected_model
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.identification.compare import compare_run
from dpr_lab.identification.model import Model, load_model
from dpr_lab.rig import Rig


@pytest.fixture(scope="module")
def corrected(two_found: Diagnosis, two_runs, paper: Rig) -> Model:
    return corrected_model(two_found, two_runs, paper)


@pytest.mark.slow
def test_compare_draws_the_effects(corrected: Model, two_runs, paper: Rig, tmp_path: Path):
    corrected.save(tmp_path / "model.json")
    kept = load_model(tmp_path / "model.json")
    assert set(kept.effects) == {"coulomb_joint1", "latency_joint2"}
    bare = compare_run(two_runs[0], paper, kept.model_copy(update={"effects": {}}))
    full = compare_run(two_runs[0], paper, kept)
    assert (full.segment_rms_rad < 1.1 * full.noise_rad).all()
    assert (bare.segment_rms_rad > 1.2 * bare.noise_rad).any()
    assert (full.free_run_rms_rad < 0.2 * bare.free_run_rms_rad).all()
