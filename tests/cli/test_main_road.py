"""Complete workflow on the command line: capture, identify and compare."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.rig import PARAMETERS
from dpr_lab.run import LOSS_CAUSES
from dpr_lab.storage.reader import load_run
from sim_device.assemble import hidden_plant
from sim_device.options import Options
from sim_device.trials.seal import truth
from tests.pages import ROOT, blocks

RATIO_KEYS = {"value", "std", "interval90"}


def plant_ratios(seed: int) -> dict[str, float]:
    return truth(hidden_plant(Options(plant="paper", seed=seed)))["ratios"]


def test_capture_reports_its_recordings(runs: list[Path], cli) -> None:
    for file, pose in zip(runs, ("X1", "X2", "X3"), strict=True):
        info = cli("run", "info", file, "--json").json
        assert info["pose"] == pose
        assert info["complete"] is True
        assert info["duration_s"] == pytest.approx(5.0, abs=0.02)
        assert info["samples"] >= 5_000
        assert set(info["lost"]) == set(LOSS_CAUSES)
        assert sum(info["lost"].values()) == 0
        assert cli("run", "verify", file).code == 0


def test_identify_finds_the_plant_within_its_own_uncertainty(model: Path) -> None:
    document = json.loads(model.read_text())
    assert list(document["ratios"]) == list(RATIOS)
    for name, true in plant_ratios(3).items():
        ratio = document["ratios"][name]
        assert set(ratio) >= RATIO_KEYS
        assert abs(ratio["value"] - true) < 4 * ratio["std"]
        assert ratio["interval90"][0] < ratio["value"] < ratio["interval90"][1]
        assert ratio["std"] < 1e-3 * ratio["value"]


def test_identify_json_carries_what_other_tools_rely_on(model: Path, runs: list[Path]) -> None:
    document = json.loads(model.read_text())
    assert list(document["parameters"]) == list(PARAMETERS)
    assert all(p["fixed_by"] in ("data", "measured", "bound") for p in document["parameters"].values())
    assert set(document["fit"]["rms_rad"]) == set(document["fit"]["noise_rad"]) == {"theta1", "theta2"}
    assert document["fit"]["segments"] >= 3
    assert {"evaluations", "seconds", "seed"} <= set(document["search"])
    assert [Path(run["file"]) for run in document["runs"]] == runs
    assert all(re.fullmatch("[0-9a-f]{64}", run["sha256"]) for run in document["runs"])


@pytest.mark.slow
def test_the_quickstart_and_the_python_example_run(
    quickstart: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (quickstart / "report" / "report.html").is_file()
    (example,) = (block.text for block in blocks(ROOT / "README.md") if block.language == "python")
    monkeypatch.chdir(quickstart)
    exec(example, {"__name__": "__main__"})
    assert "a/b" in capsys.readouterr().out
    assert (quickstart / "response.png").is_file()


@pytest.mark.slow
def test_same_seed_same_answer_for_any_number_of_threads(
    runs: list[Path], model: Path, tmp_path: Path, cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    done = cli("identify", *runs, "--rig", "paper", "--out", tmp_path / "one.json", "--json")
    one, many = done.json, json.loads(model.read_text())
    assert one["ratios"] == many["ratios"]
    assert one["search"]["best"] == many["search"]["best"]


@pytest.fixture(scope="module")
def of_two(runs: list[Path], tmp_path_factory: pytest.TempPathFactory, cli) -> Path:
    """Model identified from two of the three releases."""
    file = tmp_path_factory.mktemp("of_two") / "model.json"
    done = cli("identify", *runs[:2], "--rig", "paper", "--out", file, "--json")
    assert done.code == 0, done.err
    assert done.json["ratios"] == json.loads(file.read_text())["ratios"]
    return file


@pytest.mark.slow
def test_two_of_the_three_poses_are_enough(of_two: Path) -> None:
    ratios = json.loads(of_two.read_text())["ratios"]
    for name, true in plant_ratios(3).items():
        assert abs(ratios[name]["value"] - true) < 4 * ratios[name]["std"]


def test_compare_draws_the_papers_figures_and_a_page_without_a_network(
    runs: list[Path], model: Path, tmp_path: Path, cli
) -> None:
    done = cli("compare", *runs, "--model", model, "--out", tmp_path, "--json")
    assert done.code == 0, done.err
    assert set(done.json["figures"]) == {"response", "error", "evolution"}
    for figure in done.json["figures"].values():
        assert Path(figure).read_bytes().startswith(b"\x89PNG")
    page = Path(done.json["report"]).read_text()
    HTMLParser().feed(page)
    assert not re.search(r"""(src|href)=["']?https?:""", page)
    for run in done.json["runs"]:
        assert run["held_out"] is False
        for axis in ("theta1", "theta2"):
            assert run["segment_rms_rad"][axis] == pytest.approx(run["noise_rad"][axis], rel=0.1)


@pytest.mark.slow
def test_a_run_the_model_never_saw_is_held_out_and_predicted(
    runs: list[Path], of_two: Path, tmp_path: Path, cli
) -> None:
    done = cli("compare", runs[2], "--model", of_two, "--out", tmp_path, "--json")
    (compared,) = done.json["runs"]
    assert compared["held_out"] is True
    assert compared["segment_rms_rad"]["theta2"] == pytest.approx(compared["noise_rad"]["theta2"], rel=0.1)


def swing_counts(file: Path) -> NDArray[np.int64]:
    counts = load_run(file).swing.counts
    assert counts is not None
    return counts


@pytest.mark.slow
def test_serial_and_can_carry_the_same_counts(runs: list[Path], tmp_path: Path, cli) -> None:
    link = "sim://?clock=fast&seed=3&bus=can"
    done = cli(
        "capture", "--rig", "paper", "--link", link, "--pose", "X1", "--duration", "2", "--out", tmp_path, "--json"
    )
    assert done.code == 0, done.err
    over_can, over_serial = swing_counts(Path(done.json["runs"][0]["file"])), swing_counts(runs[0])
    both = min(len(over_can), len(over_serial))
    assert both >= 2_000
    assert np.array_equal(over_can[:both], over_serial[:both])


@pytest.mark.slow
def test_paper_objective_reaches_the_noise_floor_too(runs: list[Path], tmp_path: Path, cli) -> None:
    settings = tmp_path / "short.toml"
    settings.write_text('algorithm = "iga"\ngenerations = 10\npopulation = 40\n')
    done = cli(
        "identify", runs[0], "--rig", "paper", "--objective", "paper", "--settings", settings,
        "--out", tmp_path / "m.json", "--json",
    )  # fmt: skip
    assert done.code == 0, done.err
    assert done.json["search"]["objective"] == "paper"
    assert done.json["fit"]["chi2_per_dof"] < 1.3


@pytest.mark.slow
def test_one_more_release_with_a_known_added_mass_gives_absolute_values(runs: list[Path], tmp_path: Path, cli) -> None:
    paper = (ROOT / "configs" / "rigs" / "paper.toml").read_text()
    rig = tmp_path / "with_collar.toml"
    rig.write_text(paper + '\n[added_mass]\nrod = "outer"\nmass = 0.05\nposition = 0.35\n')
    link = "sim://?clock=fast&seed=3"
    words = ("--pose", "X1", "--duration", "5", "--out", tmp_path, "--json")
    done = cli("capture", "--rig", rig, "--link", link, *words)
    assert done.code == 0, done.err
    heavy = done.json["runs"][0]["file"]
    done = cli("identify", *runs, heavy, "--rig", "paper", "--out", tmp_path / "m.json", "--json")
    assert done.code == 0, done.err
    true = truth(hidden_plant(Options()))["parameters"]
    for name in ("c1", "c2"):
        result = done.json["parameters"][name]
        assert result["fixed_by"] == "data"
        assert abs(result["value"] - true[name]) < 4 * result["std"]
        assert result["std"] < 0.01 * true[name]
    assert {value["fixed_by"] for value in done.json["base"].values()} == {"data"}
    assert done.json["covariance"]["order"][-1] == "b"
