"""Jobs from files to results, with events for the command line and the screen."""

import json
import pickle
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

from dpr_lab.acquisition.capture import CaptureOptions
from dpr_lab.errors import ConfigError, RunError
from dpr_lab.identification.model import load_model
from dpr_lab.rig import load_rig
from dpr_lab.workflows import events
from dpr_lab.workflows.capture import CaptureResult, capture
from dpr_lab.workflows.compare import CompareRequest, compare
from dpr_lab.workflows.diagnose import DiagnoseRequest, chosen_library, diagnose
from dpr_lab.workflows.identify import IdentifyRequest, identify
from dpr_lab.workflows.plan import PlanRequest, plan
from tests.a_diagnosis import made

SEARCH = Path(__file__).parents[2] / "configs" / "search" / "segments.toml"


class Heard(list[events.Event]):
    """List of all events, in order."""

    def __call__(self, event: events.Event) -> None:
        self.append(event)

    def of(self, *kinds: type) -> list[Any]:
        return [event for event in self if isinstance(event, kinds)]


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[CaptureResult, Heard]:
    heard = Heard()
    options = CaptureOptions(duration=1.5)
    folder, url = tmp_path_factory.mktemp("runs"), "sim://?clock=fast&seed=3"
    return capture("paper", folder, options, lambda: True, poses=("X1", "X3"), url=url, on_event=heard), heard


def test_importing_a_job_imports_nothing_heavy() -> None:
    program = (
        "import sys, pkgutil, importlib, dpr_lab.workflows as jobs\n"
        "for found in pkgutil.iter_modules(jobs.__path__): importlib.import_module(f'dpr_lab.workflows.{found.name}')\n"
        "print(sorted({'numpy', 'scipy', 'numba', 'pydantic', 'matplotlib', 'mcap', 'textual', 'typer', 'rich'}"
        " & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.slow
def test_a_capture_reports_each_release_from_pose_to_result(recorded) -> None:
    result, heard = recorded
    assert isinstance(heard[0], events.DeviceGreeted)
    steps = heard.of(events.CaptureBegan, events.CaptureDone)
    assert [(type(step).__name__, step.name) for step in steps] == [
        (kind, pose) for pose in ("X1", "X3") for kind in ("CaptureBegan", "CaptureDone")
    ]
    assert heard.of(events.CaptureProgress)
    assert result.ok
    assert [run.run_file for run in result.captured] == list(result.files)


def test_unknown_poses_are_refused_before_anything_is_opened(tmp_path: Path) -> None:
    poses, url = ("X1", "X9"), "serial:///dev/nonesuch"
    with pytest.raises(ConfigError, match="no pose 'X9'"):
        capture("paper", tmp_path, CaptureOptions(), lambda: True, poses=poses, url=url)


@pytest.mark.slow
def test_identification_reports_its_progress_and_stops_on_request(recorded, tmp_path: Path) -> None:
    heard, asked = Heard(), []

    def proceed() -> bool:
        asked.append(len(heard.of(events.GenerationDone)))
        return len(asked) < 3

    files = recorded[0].files
    result = identify(IdentifyRequest(files, "paper", tmp_path / "model.json", settings=str(SEARCH)), heard, proceed)
    assert [event.file for event in heard.of(events.RunRead)] == list(files)
    generations = heard.of(events.GenerationDone)
    assert [event.number for event in generations] == [0, 1, 2]
    assert asked == [1, 2, 3]
    assert all(event.at_most >= 2 and event.evaluations > 0 for event in generations)
    assert isinstance(heard[-1], events.LocalFitBegan)
    assert pickle.loads(pickle.dumps(list(heard))) == heard
    assert load_model(result.file).ratios == result.model.ratios

    heard = Heard()
    compared = compare(CompareRequest(files, result.file, tmp_path, record=tmp_path / "comparison.json"), heard)
    assert [event.comparison.run for event in heard.of(events.RunCompared)] == [file.stem for file in files]
    assert (tmp_path / "comparison.json").is_file()
    missing = tmp_path / "none.mcap"
    with pytest.raises(RunError):
        compare(CompareRequest((missing, *files), result.file, tmp_path))
    compared = compare(CompareRequest((missing, *files), result.file, tmp_path, leave_out=True), heard)
    assert compared.left_out == (missing,)
    assert [event.file for event in heard.of(events.RunLeftOut)] == [missing]
    with pytest.raises(RunError, match="no run can be compared"):
        compare(CompareRequest((missing,), result.file, tmp_path, leave_out=True))

    saved = json.loads(result.file.read_text())
    (tmp_path / "other.json").write_text(json.dumps(saved | {"rig": saved["rig"] | {"name": "other"}}))
    with pytest.raises(RunError, match=r"run of rig paper, but the model belongs to other: give a model of this rig"):
        compare(CompareRequest(files, tmp_path / "other.json", tmp_path))
    (tmp_path / "longer.json").write_text(json.dumps(saved | {"rig": saved["rig"] | {"L1": 0.41}}))
    compare(CompareRequest(files[:1], tmp_path / "longer.json", tmp_path), heard)
    assert heard.of(events.RunRead)[-1].notes == (
        "uses the corrected description of the rig: rig.L1 = 0.41 (in the run: 0.4)",
    )
    (tmp_path / "diagnosis.json").write_text('{"verdict": "no_gap"}')
    with pytest.raises(RunError, match=r"is a diagnosis; its corrected model is model.json in the same folder"):
        compare(CompareRequest(files, tmp_path / "diagnosis.json", tmp_path))
    with pytest.raises(RunError, match=r"is not a model, because it is not a text file: give model.json, which"):
        compare(CompareRequest(files, files[0], tmp_path))
    (tmp_path / "empty.json").touch()
    with pytest.raises(RunError, match=r"is not a model, because it is not valid JSON .*: give model.json, which"):
        compare(CompareRequest(files, tmp_path / "empty.json", tmp_path))


@pytest.mark.slow
def test_a_diagnosis_reports_its_stages_and_fits(recorded, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the diagnosis does is not this test's: here it tells three things, and finds nothing."""
    tells = (events.StageBegan(4, 8, "which"), events.ScoreTestBegan(()), events.FitBegan(("base_tilt",)))

    def diagnosed(runs, rig, *, on_progress, **options):
        for event in tells:
            on_progress(event)
        return SimpleNamespace(to_json=lambda: {"nothing": "to see"}, sentence="Nothing.")

    def saved(diagnosis, runs, rig, out, *arguments):
        (out / "diagnosis.html").write_text("new")
        return {"report": str(out / "diagnosis.html")}

    def stopped(*arguments):
        saved(*arguments)
        raise KeyboardInterrupt

    monkeypatch.setattr("dpr_lab.gap.diagnose.diagnose", diagnosed)
    monkeypatch.setattr("dpr_lab.report.saving.save_diagnosis", saved)
    heard, files = Heard(), recorded[0].files
    result = diagnose(DiagnoseRequest(files, "paper"), heard)
    assert heard == [*heard.of(events.RunRead), *tells]
    assert result.to_json() == {"nothing": "to see"}

    heard, record = Heard(), tmp_path / "diagnosis.json"
    result = diagnose(DiagnoseRequest(files, "paper", out=tmp_path), heard)
    assert heard.of(events.StageBegan) == [events.StageBegan(4, 9, "which"), events.StageBegan(9, 9, "report")]
    assert json.loads(record.read_text()) == result.to_json() == {"nothing": "to see", "files": dict(result.files)}

    assert result.files == {"report": str(tmp_path / "diagnosis.html")}

    (tmp_path / "diagnosis.html").write_text("old")
    monkeypatch.setattr("dpr_lab.report.saving.save_diagnosis", stopped)
    kept = tmp_path / "new.diagnosis" / "diagnosis.json"
    with pytest.raises(KeyboardInterrupt, match=rf"The diagnosis is in {kept}; no other file"):
        diagnose(DiagnoseRequest(files, "paper", out=tmp_path))
    assert (tmp_path / "diagnosis.html").read_text() == "old"
    assert json.loads(record.read_text())["files"]
    assert [file.name for file in kept.parent.iterdir()] == ["diagnosis.json"]
    assert json.loads(kept.read_text()) == {"nothing": "to see"}


def test_blind_trials_of_a_moving_arm_are_refused_before_the_diagnosis(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = SimpleNamespace(file="X1.csv", arm_mode="driven")
    fitted = Mock()
    monkeypatch.setattr("dpr_lab.workflows.diagnose.read_runs", lambda *arguments, **options: [run])
    monkeypatch.setattr("dpr_lab.identification.misread.refuse.refuse_misread", lambda *arguments: None)
    monkeypatch.setattr("dpr_lab.gap.diagnose.diagnose", fitted)
    with pytest.raises(RunError, match=r"X1.csv: its arm was driven, and --trust supports only"):
        diagnose(DiagnoseRequest((tmp_path / "X1.csv",), "furuta", trust=4))
    fitted.assert_not_called()


def test_effects_are_chosen_by_name() -> None:
    assert list(chosen_library(("base_tilt", "air_drag_both"), ("base_tilt",))) == ["air_drag_both"]
    with pytest.raises(ConfigError, match="no effect named gremlin"):
        chosen_library(None, ("gremlin",))
    with pytest.raises(ConfigError, match="exclude all effects"):
        chosen_library(("base_tilt",), ("base_tilt",))


def test_the_same_recording_is_refused_twice(recorded, tmp_path: Path) -> None:
    file = recorded[0].files[0]
    with pytest.raises(RunError, match="give each run once"):
        diagnose(DiagnoseRequest((file,), "paper", held_out=(file,)))


def test_a_plan_refuses_a_diagnosis_of_another_rig_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = load_rig("paper").path
    assert path is not None
    text = path.read_text()
    tables = re.split(r"(?m)^(?=\[)", text)
    files = {
        "paper": text,
        "reordered": "\n".join([tables[0], *reversed(tables[1:])]),
        "posed": f"{text}\n[poses.P1]\ntheta1 = 1.0\ntheta2 = 1.0\n",
        "moon": re.sub(r"(?m)^g = .*", "g = 1.6", text),
    }
    for name, content in files.items():
        (tmp_path / f"{name}.toml").write_text(content)
    paper = load_rig(tmp_path / "paper.toml")
    stated = SimpleNamespace(rig="paper", rig_sha256=paper.sha256, rig_values_sha256=paper.values_sha256, recordings=[])
    plain = made()
    gap = plain.gap.model_copy(update={"closed_held_out": plain.gap.closed_held_out.model_copy(update={"per_run": {}})})
    diagnosis = plain.model_copy(update={"gap": gap, "evidence": stated})
    monkeypatch.setattr("dpr_lab.gap.result.diagnosis.load_diagnosis", lambda file: diagnosis)
    monkeypatch.setattr("dpr_lab.workflows.plan.read_runs", Mock(return_value=[]))
    monkeypatch.setattr("dpr_lab.planning.plan.plan", Mock(return_value="planned"))

    def planned(rig: str) -> object:
        return plan(PlanRequest(str(tmp_path / rig), (Path("X1.mcap"),), Path("d.json"))).plan

    assert [planned(f"{name}.toml") for name in ("paper", "reordered", "posed")] == ["planned"] * 3
    both = rf"another file of rig paper \(SHA-256 {paper.sha256[:8]}...\) than .*moon.toml \(SHA-256"
    with pytest.raises(ConfigError, match=rf"^d.json: the diagnosis was made with {both}.*: give the rig file of the"):
        planned("moon.toml")
    diagnosis = plain.model_copy(update={"gap": gap})
    with pytest.raises(ConfigError, match=r"state its rig file \(key evidence.rig_sha256\): diagnose the runs again"):
        planned("paper.toml")
