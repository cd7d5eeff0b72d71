"""Fixture of a diagnosed blind trial of a plant without effects; tests work on copies of its folder."""

import shutil
from pathlib import Path

import pytest

from dpr_lab.gap.diagnose import diagnose
from dpr_lab.trials.protocol import Trial, keep_diagnosis, read_trial, recordings
from dpr_lab.trials.sealing import Kind, PlantRequest
from dpr_lab.workflows.trial import draw
from tests.thinned import candidates


@pytest.fixture(scope="session")
def diagnosed_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trials") / "clean & sealed"
    trial = draw(PlantRequest(Kind.CLEAN, seed=3), folder)
    library = candidates("coulomb", "encoder", "spring")
    keep_diagnosis(trial, diagnose(recordings(trial), trial.rig, library=library).to_json())
    return folder


@pytest.fixture
def diagnosed(diagnosed_once: Path, tmp_path: Path) -> Trial:
    return read_trial(Path(shutil.copytree(diagnosed_once, tmp_path / "trial")))
