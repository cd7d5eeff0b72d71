"""Acceptance test, report and certificate in Python: the calls that the command line uses."""

import json
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

import dpr_lab as dpr
from dpr_lab.acceptance.judge import Acceptance
from dpr_lab.errors import ConfigError, RunError
from dpr_lab.gap.result.causes import EffectSize
from dpr_lab.gap.result.evidence import Evidence
from dpr_lab.gap.result.subject import refuse_other_subject
from dpr_lab.workflows import accept as job
from dpr_lab.workflows import certify as certificates
from tests.a_diagnosis import made

LIMITS = '[effects.{}]\n{} = {{ max = 1e3, unit = "{}" }}\n'


def diagnosis_and_limits(folder: Path) -> tuple[dpr.Diagnosis, Path]:
    """Return a diagnosis with one named effect, and a limit that it meets."""
    named = (
        made()
        .effects[0]
        .model_copy(
            update={
                "name": "coulomb_joint2",
                "members": ["coulomb_joint2"],
                "parameters": {"torque_Nm": EffectSize(value=1e-3, interval90=(0.9e-3, 1.1e-3))},
            }
        )
    )
    diagnosis = made(verdict="named").model_copy(update={"effects": [named], "hints": [], "scale": None, "rivals": []})
    file = folder / "limits.toml"
    file.write_text(LIMITS.format("coulomb_joint2", "torque_Nm", "N m"))
    return diagnosis, file


def of_rig(diagnosis: dpr.Diagnosis, rig: dpr.Rig) -> dpr.Diagnosis:
    """Return a diagnosis with evidence that states only the rig."""
    stated = {"rig": rig.name, "rig_sha256": rig.sha256, "rig_values_sha256": rig.values_sha256}
    evidence = Evidence.model_construct(**stated, recordings=[], exclusions=[])
    return diagnosis.model_copy(update={"evidence": evidence})


def unread(name: str) -> dpr.Run:
    """Return a run without readings."""
    return dpr.Run(**{field.name: None for field in fields(dpr.Run)} | {"name": name, "sha256": ""})


def test_limits_are_tested_in_python(tmp_path: Path) -> None:
    plain, file = diagnosis_and_limits(tmp_path)
    diagnosis = of_rig(plain, dpr.load_rig("paper"))
    acceptance = dpr.accept([], dpr.load_rig("paper"), str(file), diagnosis)
    assert isinstance(acceptance, dpr.Acceptance)
    assert (acceptance.answer, acceptance.limits[0].answer) == ("pass", "pass")
    with pytest.raises(dpr.DprError, match=r"none\.toml: cannot be read"):
        dpr.accept([], dpr.load_rig("paper"), tmp_path / "none.toml", diagnosis)


def test_a_diagnosis_of_another_rig_or_of_other_runs_is_refused_in_python(tmp_path: Path) -> None:
    plain, file = diagnosis_and_limits(tmp_path)
    rig = dpr.load_rig("paper")
    diagnosis = of_rig(plain, rig)
    with pytest.raises(ConfigError, match=r"another file of rig paper .* diagnose the runs again"):
        dpr.accept([], dpr.load_rig("multiarm"), file, diagnosis)
    closed = diagnosis.gap.closed_held_out.model_copy(update={"per_run": {"X1": 1.0, "X1 (2)": 1.0}})
    other = diagnosis.model_copy(update={"gap": diagnosis.gap.model_copy(update={"closed_held_out": closed})})
    with pytest.raises(RunError, match=r"is a diagnosis of X1 and X1 \(2\), not of X3"):
        dpr.accept([unread("X3")], rig, file, other)
    refuse_other_subject(other, [unread("X1"), unread("X1")], rig)


def test_plan_and_report_refuse_a_diagnosis_of_another_rig_or_of_other_runs_in_python(tmp_path: Path) -> None:
    paper, multiarm = dpr.load_rig("paper"), dpr.load_rig("multiarm")
    diagnosis = of_rig(diagnosis_and_limits(tmp_path)[0], paper)
    closed = diagnosis.gap.closed_held_out.model_copy(update={"per_run": {"X1": 1.0}})
    of_x1 = diagnosis.model_copy(update={"gap": diagnosis.gap.model_copy(update={"closed_held_out": closed})})
    calls: tuple[Callable[[dpr.Diagnosis, dpr.Rig], object], ...] = (
        lambda made, rig: dpr.plan(rig, [], made),
        lambda made, rig: dpr.save_report(made, [], rig, tmp_path / "out"),
    )
    for call in calls:
        with pytest.raises(ConfigError, match=r"^diagnosis: the diagnosis was made with another file of rig paper"):
            call(diagnosis, multiarm)
        with pytest.raises(RunError, match="is a diagnosis of X1, but no runs are given: give its runs"):
            call(of_x1, paper)


def test_a_rig_created_in_memory_is_compared_by_its_values(tmp_path: Path) -> None:
    diagnosis, file = diagnosis_and_limits(tmp_path)
    rig = dpr.Rig.model_validate(dpr.load_rig("paper").model_dump(exclude_none=True))
    assert dpr.accept([], rig, file, of_rig(diagnosis, rig)).answer == "pass"


def test_the_command_uses_the_functions_of_the_interface(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    diagnosis, file = diagnosis_and_limits(tmp_path)
    acceptance, saved = Acceptance("pass", "", ()), Mock(return_value={"report": "r"})
    tested = Mock(return_value=acceptance)
    for name, call in (("accept_runs", tested), ("save_report", saved), ("read_runs", Mock(return_value=[]))):
        monkeypatch.setattr(job, name, call)
    monkeypatch.setattr(job, "diagnose", Mock(return_value=SimpleNamespace(diagnosis=diagnosis)))
    result = job.accept(dpr.DiagnoseRequest((), "paper", out=tmp_path / "out"), file)
    assert (result.acceptance, result.files) == (acceptance, {"report": "r"})
    assert tested.call_args.args[3] is saved.call_args.args[0] is diagnosis
    assert (dpr.certify, dpr.verify) == (certificates.certify, certificates.verify)


def test_a_report_is_written_with_the_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    diagnosis, _ = diagnosis_and_limits(tmp_path)
    write = Mock(side_effect=lambda diagnosis, runs, rig, folder, *_: {"report": str(folder / "diagnosis.html")})
    monkeypatch.setattr("dpr_lab.report.saving.save_diagnosis", write)
    out, rig = tmp_path / "out", dpr.load_rig("paper")
    monkeypatch.setattr("dpr_lab.gap.result.subject.refuse_other_subject", Mock())
    assert dpr.save_report(diagnosis, [], rig, str(out)) == {"report": str(out / "diagnosis.html")}
    files = dpr.save_report(diagnosis, [], rig, out, Acceptance("pass", "", ()))
    assert files == {"accept": str(out / "accept.json"), "report": str(out / "diagnosis.html")}
    assert json.loads((out / "accept.json").read_text())["answer"] == "pass"
