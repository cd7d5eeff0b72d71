"""Two runs of a rig with Coulomb friction, certified once for all tests."""

import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.certificate import files
from dpr_lab.certificate.document import load_certificate
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.reader import load_run
from dpr_lab.workflows import certify as workflow
from dpr_lab.workflows.certify import certify
from dpr_lab.workflows.diagnose import DiagnoseRequest, diagnose

LIBRARY = ("coulomb_joint1", "coulomb_joint2")


def request_of(folder: Path) -> DiagnoseRequest:
    return DiagnoseRequest((folder / "X1.mcap", folder / "X2.mcap"), "paper", library=LIBRARY, seed=3)


@pytest.fixture(scope="session")
def folder(
    recorded: Callable,
    paper: Rig,
    made_once: Callable[[str, Callable[[Path], None]], Path],
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """Folder with tables, runs, and `certificate.json`."""

    def certified(where: Path) -> None:
        for run in recorded({"coulomb_joint1": {"torque_Nm": 4e-3}}, duration=2.5)[:2]:
            table = where / f"{run.name}.csv"
            columns = np.column_stack([run.t, run.theta[:, 1:]])[run.t >= 0]
            np.savetxt(table, columns, delimiter=",", header="t_s,theta1_rad,theta2_rad", comments="", fmt="%.12g")
            import_csv(table, paper, out=where / f"{run.name}.mcap")
        certify(request_of(where), where / "certificate.json")

    return Path(shutil.copytree(made_once("certified", certified), tmp_path_factory.mktemp("certified") / "copy"))


@cache
def _diagnosed(request: DiagnoseRequest) -> object:
    return diagnose(request)


@cache
def _read(content: bytes, name: str, folder: Path) -> Run:
    (folder / name).write_bytes(content)
    return load_run(folder / name)


@pytest.fixture
def remembered(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Cache diagnoses and decoded recordings, because most verifications use the same ones."""
    monkeypatch.setattr(workflow, "diagnose", lambda request, on_event: _diagnosed(request))
    monkeypatch.setattr(files, "load_run", lambda path: _read(path.read_bytes(), path.name, tmp_path))


def reseal(path: Path) -> None:
    """Give an edited certificate the seal of its new content."""
    path.write_text(load_certificate(path).sealed().to_text(), encoding="utf-8")
