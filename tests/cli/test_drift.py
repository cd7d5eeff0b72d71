"""`dpr-lab drift` with recordings of two days."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.rig import load_rig
from dpr_lab.storage.layout import RELEASED
from dpr_lab.storage.metadata import RunMetadata, RunSummary
from dpr_lab.storage.writer import RunWriter
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record

MONDAY = datetime(2026, 11, 16, 9, tzinfo=UTC)


def released(factor: float, seed: int):
    plant = load_plant("paper", seed)
    parameters = plant.parameters | {"c2": plant.parameters["c2"] * factor}
    return record(plant.model_copy(update={"parameters": parameters}), load_rig("paper"), 2.0, 250)


@pytest.fixture(scope="module")
def days(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Six releases on Monday, and six on Tuesday with two per cent more friction in joint 2."""
    folder, files = tmp_path_factory.mktemp("days"), []
    for k in range(4):
        for run in released(1.0 if k < 2 else 1.02, k + 1):
            path = folder / f"{k}_{run.name}.mcap"
            when = MONDAY + timedelta(days=k // 2, minutes=10 * k)
            metadata = RunMetadata(load_rig("paper"), run.pose, run.rate_hz, created_utc=when.isoformat())
            with RunWriter(path, metadata) as writer:
                writer.samples(np.rint((run.t - run.t[0]) * run.rate_hz).astype(np.int64), run.counts)
                writer.event(0, RELEASED, len(run.rest))
                writer.finish(RunSummary(len(run.rest), lost=run.lost, gate="ok"))
            files.append(path)
    return files


@pytest.mark.slow
def test_the_command_reports_what_changed_between_two_days(days: list[Path], tmp_path: Path, cli) -> None:
    done = cli("drift", *days, "--rig", "paper", "--out", tmp_path / "out", "--fail-on-drift", "--json")
    assert done.code == 1, done.err
    assert done.json["drifted"]
    (moved,) = [entry for entry in done.json["parameters"] if entry["moved"]]
    assert moved["name"] == "c2/b"
    low, high = (end / moved["first"] for end in moved["step_interval"])
    assert low < 0.02 < high
    page = (tmp_path / "out" / "drift.html").read_text()
    assert "c2/b by +" in page
    assert page.count("data:image/png") == 1
    same = cli("drift", *days[:3], *days[3:6], "--rig", "paper", "--by", "session", "--fail-on-drift")
    assert (same.code, "all 6 runs are of one session" in same.err) == (3, True)


@pytest.mark.slow
def test_a_rig_that_stays_as_it_is_ends_with_0(days: list[Path], cli) -> None:
    renamed = [file.rename(file.with_name(f"calm_{file.name}")) for file in days[:6]]
    for k, file in enumerate(renamed):
        file.with_name(f"{file.name}.note").write_text("before" if k < 3 else "after")
    done = cli("drift", *renamed, "--rig", "paper", "--by", "label", "--fail-on-drift")
    assert done.code == 0, done.err
    assert "No significant change between before and after" in done.out


def test_an_invalid_diagnosis_is_refused_with_a_sentence(days: list[Path], tmp_path: Path, cli) -> None:
    (tmp_path / "d.json").write_text(json.dumps({"verdict": "fine"}))
    done = cli("drift", *days[6:], "--rig", "paper", "--diagnosis", tmp_path / "d.json")
    assert done.code == 3
    assert "is not a diagnosis that this dpr-lab wrote" in done.err
