"""Rigs without effects, simulated by SciPy, have no gap: fast rods, faulty loggers."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.drift.estimates import estimate_each
from dpr_lab.gap.diagnose import diagnose
from tests.thinned import candidates

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from clean_rigs import KINDS, drawn


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        pytest.param("odd rig", 3, id="rods of 7 and 4 cm at 200 Hz", marks=pytest.mark.long),
        pytest.param("odd rig", 35, id="65536 counts at 4 kHz", marks=pytest.mark.long),
        pytest.param("odd rig", 47002, id="rods of 1.4 m, 2000 counts at 100 Hz", marks=pytest.mark.slow),
        pytest.param("bad logger", 1, id="repeats and outliers at 200 Hz", marks=pytest.mark.long),
        pytest.param("bad logger", 5, id="late stamps, repeats, outliers and gaps", marks=pytest.mark.slow),
        pytest.param("bad logger", 11, id="a segment that begins wrong", marks=pytest.mark.long),
        pytest.param("bad logger", 35, id="a gap in fast swings", marks=pytest.mark.long),
    ],
)
def test_a_clean_rig_has_no_gap(kind: str, seed: int) -> None:
    rig, runs, _ = drawn(kind, seed)
    diagnosis = diagnose(runs, rig)
    assert (diagnosis.verdict, diagnosis.effects) == ("no_gap", [])


@pytest.mark.long
@pytest.mark.parametrize("seed", [pytest.param(2, id="100 Hz"), pytest.param(13, id="240 Hz", marks=pytest.mark.long)])
def test_a_camera_whose_scale_is_unsure_has_no_gap(seed: int) -> None:
    rig, runs, logger = drawn("camera", seed)
    assert logger.shared > 0.7
    diagnosis = diagnose(runs, rig)
    assert (diagnosis.verdict, diagnosis.effects) == ("no_gap", [])
    assert diagnosis.model_effects  # L1 as it was fitted, for whoever simulates
    assert any(finding.name == "non_white_noise" for finding in diagnosis.sensor_findings)
    true = KINDS["camera"](np.random.default_rng(seed))[0]
    fitted, reach = re.search(r"fitted: ([\d.]+) m \+- ([\d.e-]+) m", diagnosis.assumptions[0]).groups()
    assert abs(float(fitted) - true) < 2 * float(reach) < 0.01 * abs(rig.L1 - true) + 1e-3
    again = estimate_each(runs[:1], rig, diagnosis.model_effects)  # the length is free there already
    assert len(again.names) == len(set(again.names))


@pytest.mark.slow
def test_a_length_error_beyond_its_stated_uncertainty_is_reported() -> None:
    rig, runs, _ = drawn("camera", 2)
    sure = rig.model_copy(update={"rig": rig.rig.model_copy(update={"L1_std": 0.001})})
    diagnosis = diagnose(runs, sure, library=candidates("wrong_length", "clock", "coulomb"))
    assert diagnosis.assumptions[0].endswith("This contradicts the rig file.")
