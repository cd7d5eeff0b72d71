"""All jobs can use measured or commanded torques of runs that contain both."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.dynamics.base import whole_parameters
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import segments
from dpr_lab.effects import effect_params
from dpr_lab.fitting.estimate import Estimate, unknown_ratios
from dpr_lab.fitting.rods import RodsAlone
from dpr_lab.identification.identifiability import Identifiability
from dpr_lab.rig import Rig
from dpr_lab.setup import Setup, Torques
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.workflows.drift import watch_drift
from dpr_lab.workflows.export import export
from dpr_lab.workflows.identifiability import identifiability
from dpr_lab.workflows.identify import IdentifyRequest, identify

T = np.arange(0, 2, 5e-3)
NAMES = "t_s,theta1_rad,theta2_rad,tau1_Nm,tau2_Nm,tau1_commanded_Nm,tau2_commanded_Nm"


@pytest.fixture(scope="module")
def driven(paper: Rig, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two swings under measured torques; the commanded torques are twice as large."""
    files, random, at = [], np.random.default_rng(3), unknown_ratios(whole_parameters(paper.nominal, paper.L1, paper.g))
    for k in range(2):
        folder = tmp_path_factory.mktemp(f"day{k}")
        tau = random.normal(0, 0.1, (len(T), 2)) + 0.2 * np.sin(7 * T + k)[:, None]
        laid_out = segments([T], setups=[Setup(torques=Torques(T, tau))])
        start = Estimate.of(at, effect_params({}), np.array([[2.4 + 0.3 * k, 3.6, 0.0, 0.0]]))
        theta = np.cumsum(RodsAlone(rig_constants(paper)).predict(laid_out, start), axis=1)
        table = np.column_stack([T, theta + random.normal(0, 2e-4, theta.shape), tau, 2 * tau])
        np.savetxt(folder / f"x{k}.csv", table, delimiter=",", header=NAMES, comments="")
        import_csv(folder / f"x{k}.csv", paper, out=folder / f"x{k}.mcap")
        files.append(folder / f"x{k}.mcap")
    return files


@pytest.mark.slow
def test_the_scale_is_that_of_the_torques_which_are_taken(driven: list[Path], paper: Rig, cli) -> None:
    scale = [identifiability("paper", driven, kind) for kind in (None, "commanded")]
    assert [entry.torques for entry in scale] == [("measured",), ("commanded",)]
    answers = [result.identifiability for result in scale if isinstance(result.identifiability, Identifiability)]
    measured, commanded = (answer.unknowns["b"] for answer in answers)
    assert commanded == pytest.approx(2 * measured, rel=0.01)
    output = cli("identifiability", *driven, "--rig", "paper", "--torque", "commanded", "--json")
    assert output.json["torques"] == ["commanded"]


@pytest.mark.slow
def test_drift_says_which_torques_drove_the_runs(driven: list[Path], tmp_path: Path) -> None:
    drift = watch_drift(driven, "paper", "label", out=tmp_path / "drift", torque="commanded")
    assert drift.to_json()["torques"] == ["commanded"]
    assert "driven by their commanded torques" in (tmp_path / "drift" / "drift.html").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("formats", [("python",), pytest.param(("mjcf", "fmu"), marks=pytest.mark.long)])
def test_an_exported_model_is_replayed_under_the_torques(driven: list[Path], tmp_path: Path, formats) -> None:
    made = identify(IdentifyRequest(tuple(driven), "paper", tmp_path / "model.json"))
    assert [run.torque_kind for run in made.model.runs] == ["measured", "measured"]
    done = export(made.file, "paper", formats, tmp_path / "out", driven[:1], "measured")
    assert (done.refused, done.torques) == ({}, ("measured",))
    assert done.lab is not None
    assert done.lab.off_rad < 1e-3
    for tried in done.tried.values():
        assert tried.off_rad == pytest.approx(done.lab.off_rad, abs=5e-5)
