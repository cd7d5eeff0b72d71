"""Order of steps of a trial: sealed before it is recorded, revealed after it is diagnosed."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dpr_lab.errors import DprError, RunError
from dpr_lab.rig import load_rig
from dpr_lab.trials.case import run_case, run_of
from dpr_lab.trials.protocol import Trial, keep_diagnosis, open_trial, read_trial, recordings, refuse_opened
from dpr_lab.trials.sealing import Kind, PlantRequest, sealed_in_memory
from dpr_lab.workflows.trial import draw

pytestmark = pytest.mark.slow


def test_a_clean_plant_is_found_clean_and_the_seal_holds(diagnosed: Trial) -> None:
    opened = open_trial(diagnosed)
    assert opened.truth.clean
    assert opened.truth.drawn == {"kind": "clean", "level": "clear", "seed": 3}
    assert opened.outcome.grade == "right"
    assert opened.outcome.seal == diagnosed.seal
    kept = json.loads(diagnosed.opened.read_text())
    assert kept["score"] == json.loads(json.dumps(opened.outcome.to_json()))
    assert open_trial(diagnosed).outcome == opened.outcome


def test_the_files_given_to_dpr_lab_do_not_contain_the_truth(diagnosed: Trial) -> None:
    folder, device = diagnosed.folder, diagnosed.folder / "device"
    salt = json.loads((device / "truth.json").read_text())["salt"]
    parameter = str(json.loads((device / "truth.json").read_text())["truth"]["parameters"]["l1"])
    for file in folder.rglob("*"):
        if file.is_file() and device not in file.parents:
            assert salt.encode() not in file.read_bytes()
            assert parameter.encode() not in file.read_bytes()


def test_drawing_and_diagnosing_work_while_the_device_folder_is_out_of_reach(diagnosed: Trial) -> None:
    """The lab needs nothing of the truth until it asks for it."""
    os.replace(diagnosed.folder / "device", diagnosed.folder.parent / "elsewhere")
    assert len(recordings(diagnosed)) == 3
    with pytest.raises(DprError, match="contains no sealed plant"):
        open_trial(diagnosed)


def test_nothing_is_opened_before_a_diagnosis(diagnosed: Trial) -> None:
    diagnosed.diagnosis.unlink()
    with pytest.raises(RunError, match="not diagnosed yet"):
        open_trial(diagnosed)
    assert not diagnosed.opened.exists()


def test_nothing_is_diagnosed_after_opening(diagnosed: Trial) -> None:
    before = diagnosed.diagnosis.read_bytes()
    diagnosis = open_trial(diagnosed).diagnosis
    with pytest.raises(RunError, match="already opened"):
        refuse_opened(diagnosed)
    with pytest.raises(RunError, match="already opened"):
        keep_diagnosis(diagnosed, diagnosis)
    assert diagnosed.diagnosis.read_bytes() == before


@pytest.mark.parametrize("part", ["truth", "salt", "seal"])
def test_a_truth_that_is_not_the_sealed_one_does_not_count(diagnosed: Trial, part: str) -> None:
    file = diagnosed.folder / ("trial.json" if part == "seal" else "device/truth.json")
    kept = json.loads(file.read_text())
    if part == "truth":
        kept["truth"]["parameters"]["l1"] += 1e-9
    else:
        kept[part] = "0" * len(kept[part])
    file.write_text(json.dumps(kept))
    with pytest.raises(DprError, match="does not match the seal"):
        open_trial(read_trial(diagnosed.folder))
    assert not diagnosed.opened.exists()


def test_a_folder_that_is_taken_is_refused(diagnosed: Trial) -> None:
    before = sorted(diagnosed.folder.rglob("*"))
    with pytest.raises(RunError, match="is not empty"):
        draw(PlantRequest(Kind.CLEAN), diagnosed.folder)
    assert sorted(diagnosed.folder.rglob("*")) == before


@pytest.mark.parametrize("content", [None, "", "[]", "{}", '{"seal": "x", "asked": "y", "runs": 3}'])
def test_a_folder_without_a_trial_is_refused(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "trial.json").write_text(content)
    with pytest.raises(RunError, match=r"contains no trial|trial\.json"):
        read_trial(tmp_path)


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"verdict": "no_gap"}'])
def test_an_invalid_diagnosis_is_refused(diagnosed: Trial, content: str) -> None:
    diagnosed.diagnosis.write_text(content)
    with pytest.raises(RunError, match=r"diagnosis\.json"):
        open_trial(diagnosed)


def _recorded_directly(request: PlantRequest) -> dict[str, Any]:
    """Let the device itself record a plant, without a link; return its public data."""
    rig_file = load_rig(request.rig).path
    assert rig_file is not None
    with sealed_in_memory(request, rig_file.read_text()) as plant:
        return plant.public


def test_direct_recordings_are_those_of_the_protocol(diagnosed: Trial) -> None:
    sealed = _recorded_directly(PlantRequest(Kind.CLEAN, seed=3))
    assert sealed["rig"] == (diagnosed.folder / "rig.toml").read_text()
    for run, direct in zip(recordings(diagnosed), sealed["runs"], strict=True):
        swing = np.array(direct["counts"])[np.array(direct["t"]) >= 0]
        assert run.pose == direct["pose"]
        counts = run.swing.counts
        assert counts is not None
        both = min(len(counts), len(swing))
        assert both >= 10_000
        assert np.array_equal(counts[:both], swing[:both])


@pytest.mark.long
def test_a_driven_plant_is_recorded_with_its_torques_through_the_protocol_and_directly(tmp_path: Path) -> None:
    asked = PlantRequest(Kind.DRIVEN, seed=101)
    trial = draw(asked, tmp_path / "trial")
    sealed = _recorded_directly(asked)
    for run, result in zip(recordings(trial), sealed["runs"], strict=True):
        sent, direct = run.swing, run_of(result, trial.rig).swing
        both = min(len(sent.t), len(direct.t))
        assert both >= 9_000
        assert direct.torque_kind == sent.torque_kind == "measured"
        for one, other in (
            (sent.theta, direct.theta),
            (sent.torques, direct.torques),
            (sent.commanded, direct.commanded),
        ):
            assert np.allclose(one[:both], other[:both], atol=1e-9)  # pyright: ignore[reportOptionalSubscript]
    opened = json.loads((trial.folder / "device" / "truth.json").read_text())["truth"]
    assert list(opened["effects"]) == ["torque_ripple_joint1"]
    assert opened["drawn"]["kind"] == "driven"


def test_a_worker_of_another_version_refuses() -> None:
    with pytest.raises(DprError, match="install the same"):
        run_case({"version": "0.0.0"})
