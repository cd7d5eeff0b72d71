"""`dpr-lab diagnose --simulator` with recordings of MuJoCo, a model that lacks a term, and the recommended changes."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.errors import ConfigError
from dpr_lab.exports import FORMATS
from dpr_lab.exports.into.least_change import LeastChange
from dpr_lab.gap.result.diagnosis import load_diagnosis
from dpr_lab.rig import Rig, load_rig
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.workflows.diagnose import DiagnoseRequest, DiagnoseResult
from dpr_lab.workflows.diagnose_simulator import diagnose_simulator
from dpr_lab.workflows.rig_from import rig_from_model
from tests.a_diagnosis import made
from tests.exports.models import model_of

pytest.importorskip("mujoco")
from tests.exports.planted_errors import PLANTED, ROBOT, held_out_error, recordings


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Rig]:
    """Folder with the model, its rig file and three run files of the true model."""
    folder = tmp_path_factory.mktemp("simulator")
    (folder / "robot.xml").write_text(ROBOT, encoding="utf-8")
    rig_from_model(folder / "robot.xml", folder / "rig.toml")
    rig = load_rig(folder / "rig.toml")
    for run in recordings(PLANTED["damping wrong"].truth, rig, seconds=3.0):
        rows = np.column_stack([run.swing.t, run.swing.theta[:, 1:]])
        np.savetxt(folder / f"{run.name}.csv", rows, delimiter=",", header="t_s,theta1_rad,theta2_rad", comments="")
        import_csv(folder / f"{run.name}.csv", rig, out=folder / "runs" / f"{run.name}.mcap")
    return folder, rig


RUNS = ("runs/r0.mcap", "runs/r1.mcap", "runs/r2.mcap")
FEW = ("--library", "coulomb_joint1,coulomb_joint2,spring_joint1")


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_damping_of_the_file_is_changed_and_nothing_else(cli, bench: tuple[Path, Rig]) -> None:
    folder, rig = bench
    done = cli("diagnose", *RUNS, *FEW, "--simulator", "robot.xml", "--out", "out", "--json", cwd=folder)
    assert done.code == 0, done.err
    result = done.json["simulator"]
    assert (result["format"], result["joints"], result["refused"]) == ("MJCF", ["shoulder", "elbow"], "")
    (cause,) = result["causes"]
    assert (cause["joint"], cause["quantity"]) == ("shoulder", "damping")
    assert cause["after"] == pytest.approx(0.005, rel=2e-3)
    (change,) = result["changes"]
    assert (change["element"], change["attribute"], change["before"]) == ("joint shoulder", "damping", "0.002")
    text = (folder / "out" / "robot.xml").read_text(encoding="utf-8")
    truth = PLANTED["damping wrong"].truth
    assert held_out_error(text, truth, rig) < 0.1 * held_out_error(ROBOT, truth, rig)
    assert (folder / "out" / "robot.xml.diff").read_text(encoding="utf-8") == result["diff"]
    assert (folder / "robot.xml").read_text(encoding="utf-8") == ROBOT


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_recordings_of_the_inner_rod_alone_do_not_change_a_file_with_both_rods(cli, bench: tuple[Path, Rig]) -> None:
    folder, _ = bench
    arm, mass, inertia, damping = 0.12, 0.3, 0.0021 + 0.3 * 0.12**2, 0.003
    t = np.arange(0, 6, 0.005)
    swing = solve_ivp(
        lambda _, x: (x[1], (-mass * 9.81 * arm * np.sin(x[0]) - damping * x[1]) / inertia), (0, 6), (1.2, 0), t_eval=t
    )
    noisy = swing.y[0] + np.random.default_rng(3).normal(0, 3e-4, len(t))
    np.savetxt(folder / "inner.csv", np.column_stack([t, noisy]), delimiter=",", header="t_s,theta1_rad", comments="")
    described = ("--rig", "rig.toml", "--rods", "inner", "--zero", "hanging")
    assert cli("import", "table", "inner.csv", *described, "--out", "inner", cwd=folder).code == 0
    few = ("--library", "coulomb_joint1", "--rig", "rig.toml", "--simulator", "robot.xml")
    done = cli("diagnose", "inner/inner.mcap", *few, "--json", cwd=folder)
    assert done.code == 0, done.err
    assert "identified from the inner rod alone" in done.json["simulator"]["refused"]


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_output_uses_the_names_of_the_file(cli, bench: tuple[Path, Rig]) -> None:
    folder, _ = bench
    few = ("--library", "coulomb_joint1", "--rig", "rig.toml")
    done = cli("diagnose", *RUNS[:2], *few, "--simulator", "robot.xml", cwd=folder)
    assert done.code == 0, done.err
    assert "Joints of robot.xml, those of the rods first: 'shoulder', 'elbow'." in done.out
    assert "Changes of robot.xml" in done.out
    assert "Replayed with the numbers of robot.xml" in done.out
    assert "With --out FOLDER the changed robot.xml is written to this folder." in done.out


@pytest.mark.slow
def test_what_does_not_fit_is_refused_first(cli, bench: tuple[Path, Rig], paper: Rig) -> None:
    folder, _ = bench
    assert cli("diagnose", *RUNS, cwd=folder).code == 2
    assert cli("diagnose", *RUNS, "--rig", "rig.toml", "--joints", "a,b", cwd=folder).code == 2
    other = cli("diagnose", *RUNS, "--rig", "paper", "--simulator", "robot.xml", cwd=folder)
    assert (other.code, "its L1 is 0.3, but the model has 0.4" in other.err) == (3, True)
    own = cli("diagnose", *RUNS, "--simulator", "robot.xml", "--out", ".", cwd=folder)
    assert (own.code, "is not overwritten" in own.err) == (3, True)


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_urdf_is_compared_and_changed(cli, bench: tuple[Path, Rig]) -> None:
    pytest.importorskip("urdf_parser_py")
    folder, rig = bench
    text = FORMATS["urdf"].written(model_of(rig, {}, rig.name), rig)[FORMATS["urdf"].main]
    assert isinstance(text, str)
    (folder / "robot.urdf").write_text(text, encoding="utf-8")
    words = ("diagnose", *RUNS, *FEW, "--simulator", "robot.urdf", "--rig", "rig.toml", "--json")
    done = cli(*words, cwd=folder)
    assert done.code == 0, done.err
    result = done.json["simulator"]
    assert (result["format"], result["refused"], result["lost"]) == ("URDF", "", {})
    assert [cause["quantity"] for cause in result["causes"]] == ["damping"]
    assert [change["attribute"] for change in result["changes"]] == ["damping"]
    assert all(replay["after_rad"] < 0.1 * replay["before_rad"] for replay in result["replays"])


def test_the_diagnosis_of_a_file_that_cannot_be_changed_is_complete(
    monkeypatch: pytest.MonkeyPatch, paper: Rig, tmp_path: Path
) -> None:
    model = model_of(paper, {})

    def refuse(*arguments: object) -> None:
        raise ConfigError("no joint can be changed")

    workflow = "dpr_lab.workflows.diagnose_simulator"
    monkeypatch.setattr(f"{workflow}.diagnose", lambda request, on_event: DiagnoseResult(made(), {}))
    monkeypatch.setattr(f"{workflow}._least_change", lambda *arguments: LeastChange(model, (), ()))
    monkeypatch.setattr("dpr_lab.exports.corrected.corrected_model", lambda *arguments: model)
    monkeypatch.setattr("dpr_lab.exports.refit.fitted_in_words", lambda *arguments: model)
    monkeypatch.setattr("dpr_lab.exports.into.into_file", refuse)
    (tmp_path / "own.xml").write_text(OWN, encoding="utf-8")
    done = diagnose_simulator(DiagnoseRequest((), "paper", out=tmp_path / "out"), tmp_path / "own.xml")
    record = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert record["simulator"]["refused"] == done.simulator.refused == "no joint can be changed"


OWN = """<mujoco model="own"><worldbody><body name="upper">
  <joint name="shoulder" axis="0 1 0" damping="0.001"/>
  <inertial pos="0 0 -0.2" mass="0.1" diaginertia="0.00133 0.00133 1e-5"/>
  <body pos="0 0 -0.4"><inertial pos="0 0 0" mass="0.208" diaginertia="1e-7 1e-7 1e-7"/></body>
  <body name="lower" pos="0 0 -0.4"><joint name="elbow" axis="0 1 0" damping="0.001"/>
    <inertial pos="0 0 -0.2" mass="0.1" diaginertia="0.00133 0.00133 1e-5"/></body>
</body></worldbody></mujoco>
"""
"""The rig `paper` at its nominal values."""


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_an_effect_that_the_file_cannot_contain_is_written_as_passive_forces(cli, tmp_path: Path) -> None:
    (tmp_path / "own.xml").write_text(OWN, encoding="utf-8")
    link = "sim://?clock=fast&seed=1&plant=tilted"
    poses = ("--pose", "X1", "--pose", "X2", "--pose", "X3")
    done = cli("capture", "--rig", "paper", "--link", link, *poses, "--duration", 2, "--out", "runs", cwd=tmp_path)
    assert done.code == 0, done.err
    *fitted, held_out = sorted((tmp_path / "runs").glob("*.mcap"))
    words = ("--held-out", held_out, "--rig", "paper", "--simulator", "own.xml", "--out", "out", "--json")
    done = cli("diagnose", *fitted, *words, "--library", "base_tilt,coulomb_joint1,coulomb_joint2", cwd=tmp_path)
    assert done.code == 0, done.err
    result = done.json["simulator"]
    assert result["passive"] == list(result["lost"]) == ["base_tilt"]
    assert load_diagnosis(tmp_path / "out" / "diagnosis.json").effects[0].name == "base_tilt"
    (replay,) = result["replays"]
    assert replay["passive_rad"] < 0.02 * replay["after_rad"]
    assert replay["passive_rad"] == pytest.approx(replay["lab_rad"], rel=0.2)
    folder = tmp_path / "out" / "with_passive_forces"
    assert sorted(path.name for path in folder.iterdir()) == ["own.xml", "passive.py"]
    assert (tmp_path / "out" / "own.xml").read_text(encoding="utf-8") != (folder / "own.xml").read_text(
        encoding="utf-8"
    )
