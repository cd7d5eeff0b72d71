"""`dpr-lab export`: models are replayed in their programs, and a model worse than the bare one is refused."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dpr_lab.cli import export as command
from dpr_lab.dynamics.base import BASE, RATIOS
from dpr_lab.effects import effect_params
from dpr_lab.errors import ConfigError
from dpr_lab.exports import refit
from dpr_lab.exports.cost import ExportReference, Replayed
from dpr_lab.exports.programs import Replay
from dpr_lab.exports.refit import fitted_for, moving
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.hypothesis.hypothesis import free_parameters
from dpr_lab.identification.model import (
    Covariance,
    EstimatedValue,
    FitSummary,
    Model,
    ParameterValue,
    RigFacts,
    SearchRecord,
    load_model,
)
from dpr_lab.report.saving import _confirmed, _reference_or_none, save_exports
from dpr_lab.rig import PARAMETERS, Rig
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.workflows.export import ExportResult, export
from tests.exports.models import model_of

FRICTION: dict[str, dict[str, float]] = {
    f"friction_curve_joint{j}": dict(
        zip(
            ("forward_Nm", "backward_Nm", "rise1_Nm", "rise2_Nm", "rise3_Nm", "rise4_Nm"),
            (5e-3 / j, 2e-3 / j, 2e-3, 0.0, 2e-3, 4e-3),
            strict=True,
        )
    )
    for j in (1, 2)
}
OFFSET: dict[str, dict[str, float]] = {"encoder_offset_joint2": {"offset_rad": 0.01}}


def whole_model(rig: Rig, estimate) -> Model:
    """Model file with the content of an estimate."""
    base = dict(zip(BASE, estimate.base.tolist(), strict=True))
    nine = dict(zip(PARAMETERS, rig.nominal.tolist(), strict=True))
    ratios = dict(zip(RATIOS, estimate.ratios.tolist(), strict=False))
    rods = {"theta1": 1e-4, "theta2": 1e-4}
    return Model(
        rig=RigFacts(name=rig.name, sha256=rig.sha256, L1=rig.rig.L1, g=rig.rig.g),
        ratios={k: EstimatedValue(value=v, std=0.0, interval90=(v, v)) for k, v in ratios.items()},
        covariance=Covariance(order=list(RATIOS), matrix=np.zeros((5, 5)).tolist()),
        cramer_rao_std=dict.fromkeys(RATIOS, 0.0),
        parameters={k: ParameterValue(value=v, std=None, fixed_by="data") for k, v in nine.items()},
        base={k: ParameterValue(value=v, std=None, fixed_by="data") for k, v in base.items()},
        fit=FitSummary(rms_rad=rods, noise_rad=rods, segments=1, chi2_per_dof=1, iterations=1, longest_segment_s=0.5),
        search=SearchRecord(
            algorithm="",
            objective="",
            seed=0,
            evaluations=0,
            seconds=0,
            generations=0,
            best={},
            best_cost=0,
            history={},
        ),
        runs=[],
        effects=refit.named_params(estimate.params),
    )


@pytest.fixture(scope="module")
def runs(recorded) -> list[Run]:
    return recorded(FRICTION | OFFSET, duration=2.0)[:2]


@pytest.fixture(scope="module")
def corrected(runs: list[Run], screened, paper: Rig) -> Model:
    _, problem, bare = fit_bare_model(screened(runs), nominal_ratios(paper))
    at = bare.fit.estimate.changed(params=effect_params(FRICTION | OFFSET))
    return whole_model(paper, fit(problem, at, free_parameters(at, list(FRICTION | OFFSET), problem)).estimate)


@pytest.fixture(scope="module")
def saved(runs: list[Run], corrected: Model, paper: Rig, tmp_path_factory) -> tuple[Path, list[Path]]:
    folder = tmp_path_factory.mktemp("exports")
    corrected.save(folder / "model.json")
    files = []
    for run in runs:
        table = folder / f"{run.name}.csv"
        columns = np.column_stack([run.t, run.theta[:, 1:]])[run.t >= 0]
        np.savetxt(table, columns, delimiter=",", header="t_s,theta1_rad,theta2_rad", comments="", fmt="%.12g")
        files.append(folder / f"{run.name}.mcap")
        import_csv(table, paper, out=files[-1])
    return folder, files


@pytest.mark.slow
def test_an_effect_that_the_format_lacks_is_replaced_by_a_simpler_one_and_refitted(corrected: Model, runs, paper: Rig):
    models = fitted_for(["python", "urdf"], corrected, runs, paper)
    assert models["python"] is corrected
    assert moving(models["urdf"]) == ["coulomb_joint1", "coulomb_joint2"]
    assert "encoder_offset_joint2" in models["urdf"].effects
    friction = [models["urdf"].effects[f"coulomb_joint{j}"]["torque_Nm"] for j in (1, 2)]
    assert 2e-3 < friction[0] < 1.5e-2
    assert 1e-3 < friction[1] < 1e-2


@pytest.mark.slow
@pytest.mark.parametrize(
    "formats",
    [("python", "urdf"), pytest.param(("python", "mjcf", "sdf", "fmu", "fmu2"), marks=pytest.mark.long)],
    ids="+".join,
)
def test_an_export_is_replayed_where_it_runs(saved, formats, tmp_path: Path):
    folder, files = saved
    done = export(folder, "paper", formats, tmp_path / "out", files)
    assert set(done.files) == set(formats)
    assert done.refused == {}
    assert done.lab is not None
    assert done.bare_rad is not None
    assert done.lab.closed > 0.9
    for name in {"python", "mjcf", "fmu", "fmu2"} & set(formats):
        softer = 3e-3 if name == "mjcf" else 5e-5  # MuJoCo's friction at rest
        assert done.tried[name].off_rad == pytest.approx(done.lab.off_rad, abs=softer)
        assert name not in done.lost
    for name in {"urdf", "sdf"} & set(formats):
        assert done.lab.off_rad < done.tried[name].off_rad <= 1.02 * done.bare_rad
        assert set(done.lost[name]) == set(FRICTION | OFFSET)
        lost = json.loads(Path(f"{done.files[name]}.lost.json").read_text(encoding="utf-8"))
        assert lost["check"] == {
            "off_rad": done.tried[name].off_rad,
            "closed": done.tried[name].closed,
            "bare_rad": done.bare_rad,
        }
    json.dumps(done.to_json())


@pytest.mark.slow
def test_files_of_a_diagnosis_state_their_loss_of_accuracy(corrected: Model, runs, paper: Rig, tmp_path: Path):
    result: list[str] = []
    files = save_exports(corrected, runs, paper, tmp_path, result.append)
    assert [sentence.split(":")[0] for sentence in result] == ["urdf", "sdf"]
    assert "free-form friction curve, joint 1" in result[0]
    assert "rms error of free runs up to the predictability horizon" in result[0]
    lost = json.loads(Path(f"{files['urdf']}.lost.json").read_text(encoding="utf-8"))
    assert 0 < lost["check"]["off_rad"] <= lost["check"]["bare_rad"]
    assert _reference_or_none(corrected, [], paper, result.append) is None
    assert "error is unknown: no run can be replayed" in result[-1]


@pytest.mark.parametrize(
    ("verdict", "own_rad", "bare"),
    [("unexplained", 12.9e-3, True), ("unexplained", 10.7e-3, False), ("named", 12.9e-3, False)],
)
def test_an_unexplained_model_that_predicts_worse_is_not_written(verdict, own_rad, bare, monkeypatch):
    corrected: Any = Model.model_construct(effects={"spring_joint1": {}}, warnings=[])
    reference: Any = SimpleNamespace(
        bare_rad=10.6e-3,
        own=(),
        replayed=lambda swings: SimpleNamespace(off_rad=own_rad),
        bare=corrected.model_copy(update={"effects": {}}),
    )
    monkeypatch.setattr("dpr_lab.report.saving.export_reference", lambda *arguments: reference)
    diagnosis: Any = SimpleNamespace(verdict=verdict)
    runs: Any = [SimpleNamespace(arm=None)]
    messages: list[str] = []
    written = _confirmed(diagnosis, corrected, runs, reference, messages.append)
    assert written.effects == ({} if bare else corrected.effects)
    if bare:
        assert "predicts worse than the bare model (12.9 against 10.6 mrad in free runs)" in messages[0]
    assert written.warnings == messages
    assert bool(messages) == bare


def test_the_error_of_a_refitted_file_names_its_simulation(monkeypatch, tmp_path: Path, paper: Rig) -> None:
    corrected, refitted = (Model.model_construct(effects={}) for _ in range(2))
    form = SimpleNamespace(optional=False, lost=lambda *arguments: ["air_drag_both"])
    reference = SimpleNamespace(
        own=(), bare_rad=0.0944, chosen_model=lambda model: (model, ()), replayed=lambda swings: Replayed(0.05, 0.5, {})
    )
    for name, value in {"_reference_or_none": reference, "fitted_for": {"urdf": refitted}, "write_export": ""}.items():
        monkeypatch.setattr(f"dpr_lab.report.saving.{name}", lambda *arguments, value=value: value)
    monkeypatch.setattr("dpr_lab.report.saving.FORMATS", {"urdf": form})
    messages: list[str] = []
    save_exports(corrected, [], paper, tmp_path, messages.append)
    errors = "50 mrad (corrected model 50 mrad, bare model 94.4 mrad)"
    assert messages[0].endswith(f"; rms error of free runs up to the predictability horizon {errors}")


@pytest.mark.parametrize(("has_effects", "closed"), [(True, "0 %"), (False, "–")])
def test_a_model_without_effects_closes_no_gap(has_effects, closed, monkeypatch):
    rows: list[list[str]] = []
    monkeypatch.setattr(command, "table", lambda title, columns, of_table: rows.extend(of_table))
    errors = Replayed(0.56, -1e-4, {"run": 0.56})
    command._show(ExportResult({}, {}, {}, {}, 0.56, errors, {"python": errors}, (), None, "", has_effects))
    assert [row[2] for row in rows] == [closed] * 3


@pytest.mark.slow
def test_an_export_worse_than_the_bare_model_is_refused(saved, tmp_path: Path):
    folder, files = saved
    model = load_model(folder / "model.json")
    wrong = model.model_copy(update={"effects": {"coulomb_joint1": {"torque_Nm": 0.1}}})
    wrong.save(tmp_path / "wrong.json")
    done = export(tmp_path / "wrong.json", "paper", ("python",), tmp_path / "out", files[:1])
    assert done.files == {}
    assert "was not written: its error on these runs is" in done.refused["python"]
    assert not (tmp_path / "out" / "corrected_model.py").exists()


def test_without_runs_a_loss_is_a_warning(saved, tmp_path: Path):
    result = []
    done = export(saved[0], "paper", ("urdf",), tmp_path / "out", on_event=result.append)
    assert "cannot be expressed in this format; --check RUN refits the model without them" in result[0].sentence
    assert set(done.lost["urdf"]) == set(FRICTION | OFFSET)
    with pytest.raises(ConfigError, match="no format named step; available: python, mjcf"):
        export(saved[0], "paper", ("step",), tmp_path / "out")


def test_the_error_of_a_run_is_that_of_all_its_swings(paper: Rig) -> None:
    measured = np.zeros((5, 3))
    of_runs = {0.3: "first", 0.4: "first", 0.1: "second"}
    swings = [
        Replay(run, np.arange(5.0), measured, measured + error, 0.0, np.zeros(6), np.full(3, 1e-3), np.zeros((5, 1)))
        for error, run in of_runs.items()
    ]
    model = model_of(paper, {})
    reference = ExportReference(paper, (), model, model, tuple(swings), tuple(swings))
    by_run = reference.replayed(swings).by_run
    assert by_run == pytest.approx({"first": (0.5 * (0.3**2 + 0.4**2)) ** 0.5, "second": 0.1})
