"""Options of `dpr-lab export` that belong to one of its modes, and files next to the model."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from dpr_lab.cli.app import app
from dpr_lab.errors import RunError
from dpr_lab.exports import FORMATS
from dpr_lab.identification.model import FitSummary
from dpr_lab.rig import Rig
from dpr_lab.workflows.export_ensemble import _diagnosis_of
from dpr_lab.workflows.rig_from import rig_from_model
from tests.a_diagnosis import made
from tests.exports.models import model_of


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--ensemble 3 --joints a,b", "--joints requires --into"),
        ("--joints a,b", "--joints requires --into"),
        ("--into mine.xml --to mjcf", "remove the option --to"),
        ("--into mine.xml --seed 1", "--seed requires --ensemble"),
        ("--seed 0", "--seed requires --ensemble"),
        ("--torque measured", "--torque requires --check"),
        ("--ensemble 3 --torque measured", "--torque requires --check"),
    ],
)
def test_an_option_of_another_mode_is_refused(options: str, message: str) -> None:
    done = CliRunner().invoke(app, ["export", "model.json", "--rig", "paper", *options.split()])
    assert (done.exit_code, message in " ".join(done.output.split())) == (2, True)


@pytest.mark.parametrize("command", ["identifiability --rig paper", "plan --rig paper", "check found.json 1 --value 1"])
def test_torques_are_not_chosen_without_runs(command: str) -> None:
    done = CliRunner().invoke(app, [*command.split(), "--torque", "measured"])
    assert (done.exit_code, "--torque requires runs" in done.output) == (2, True)


@pytest.mark.parametrize("mode", ["export", "export_ensemble", "export_into"])
def test_every_mode_reads_the_requested_torques(
    mode: str, monkeypatch: pytest.MonkeyPatch, paper: Rig, tmp_path: Path
) -> None:
    torques: list[str | None] = []

    def read(*arguments: object, torque: str | None = None, **options: object) -> None:
        torques.append(torque)
        raise RunError("read")

    monkeypatch.setattr(f"dpr_lab.workflows.{mode}.read_runs", read)
    model = model_of(paper, {})
    monkeypatch.setattr("dpr_lab.workflows.export.model_to_export", lambda file, rig: model)
    (tmp_path / "mine.xml").write_text(str(FORMATS["mjcf"].written(model, paper)["corrected_model.xml"]))
    rig_from_model(tmp_path / "mine.xml", tmp_path / "rig.toml")
    own = {"export": [], "export_ensemble": ["--ensemble", "2"], "export_into": ["--into", str(tmp_path / "mine.xml")]}
    words = ["export", "model.json", "--rig", str(tmp_path / "rig.toml"), "--check", "x1.mcap", "--torque", "commanded"]
    CliRunner().invoke(app, [*words, *own[mode], "--out", str(tmp_path / "out")])
    assert torques == ["commanded"]


def test_a_diagnosis_of_another_fit_is_not_the_posterior_of_a_model(paper: Rig, tmp_path: Path) -> None:
    diagnosis = made()
    record = tmp_path / "diagnosis.json"
    record.write_text(diagnosis.model_dump_json(by_alias=True), encoding="utf-8")
    own = FitSummary.model_construct(segments=diagnosis.segments, chi2_per_dof=diagnosis.chi2_per_dof)
    other = own.model_copy(update={"chi2_per_dof": 1.2})
    assert _diagnosis_of(model_of(paper, {}).model_copy(update={"fit": own}), record) == diagnosis
    assert _diagnosis_of(model_of(paper, {}).model_copy(update={"fit": other}), record) is None
