"""Complete `dpr-lab diagnose` of a rig with additional friction, recorded through the protocol, with its report."""

import json
import os
import re
import subprocess
import sys
from html import escape
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import EFFECTS
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.report.gap.tables import sentence

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

KEYS = {
    "verdict", "sentence", "gap", "where", "effects", "rivals", "probabilities", "detectable", "sensor_findings",
    "advice", "ratios", "seconds",
}  # fmt: skip
GAP_KEYS = {"floor_rad", "before_rad", "after_rad", "explained_share", "closed_held_out"}
VERDICTS = {"no_gap", "named", "partly_explained", "unexplained"}


@pytest.fixture(scope="module")
def worn(tmp_path_factory: pytest.TempPathFactory, cli) -> list[Path]:
    """Three releases of a rig whose bearings have Coulomb friction in addition to viscous friction."""
    out = tmp_path_factory.mktemp("worn")
    words = (
        "--rig",
        "paper",
        "--link",
        "sim://?plant=dry&clock=fast&seed=4",
        "--out",
        out,
        "--json",
        "--duration",
        "2",
    )
    done = cli("capture", *words)
    assert done.code == 0, done.err
    return [Path(run["file"]) for run in done.json["runs"]]


@pytest.fixture(scope="module")
def printed(worn: list[Path], tmp_path_factory: pytest.TempPathFactory, cli) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("page")
    library = "coulomb_joint1,coulomb_joint2,stribeck_joint1,spring_joint1,encoder_offset_joint1,latency_joint2"
    done = cli("diagnose", *worn, "--rig", "paper", "--library", library, "--out", out, "--json")
    assert done.code == 0, done.err
    return done.json


def is_interval(value: object) -> bool:
    return isinstance(value, list) and len(value) == 2 and value[0] <= value[1]


def test_the_keys_that_other_tools_rely_on(printed: dict[str, Any], worn: list[Path]) -> None:
    assert set(printed) >= KEYS
    assert printed["verdict"] in VERDICTS
    assert set(printed["gap"]) >= GAP_KEYS
    for name in ("floor_rad", "before_rad", "after_rad"):
        assert set(printed["gap"][name]) == {"joint1", "joint2"}
    closed = printed["gap"]["closed_held_out"]
    assert set(closed) >= {"estimate", "interval90", "per_run"}
    assert closed["interval90"][0] <= closed["estimate"] <= closed["interval90"][1]
    assert set(closed["per_run"]) == {run.stem for run in worn}
    for place in printed["where"]:
        assert set(place) >= {"site", "coordinate", "share", "sentence"}
    for effect in printed["effects"]:
        assert set(effect) >= {"name", "class", "probability", "parameters", "share"}
        assert effect["name"] in effect["class"]
        assert set(effect["class"]) <= set(EFFECTS)
        assert all(is_interval(entry["interval90"]) and "value" in entry for entry in effect["parameters"].values())
    for rival in printed["rivals"]:
        assert set(rival) >= {"name", "class", "probability", "cosine"}
    assert {"no_gap", "unexplained"} <= set(printed["probabilities"])
    assert all(0 <= p <= 1 for p in printed["probabilities"].values())
    assert set(printed["detectable"]) <= set(EFFECTS)
    assert list(printed["ratios"]) == list(RATIOS)
    assert all(is_interval(ratio["interval90"]) for ratio in printed["ratios"].values())
    assert printed["seconds"] > 0


def test_dry_friction_is_named_with_its_size(printed: dict[str, Any]) -> None:
    """Torques assume the b of the rig file, which differs slightly from that of the plant."""
    assert printed["verdict"] == "named"
    result = {effect["name"]: effect for effect in printed["effects"]}
    assert set(result) == {"coulomb_joint1", "coulomb_joint2"}
    assert result["coulomb_joint1"]["parameters"]["torque_Nm"]["value"] == pytest.approx(0.0023, rel=0.2)
    assert result["coulomb_joint2"]["parameters"]["torque_Nm"]["value"] == pytest.approx(0.0008, rel=0.2)
    assert printed["gap"]["closed_held_out"]["estimate"] > 0.9


def test_the_page_and_the_exports_are_written(printed: dict[str, Any]) -> None:
    assert set(printed["files"]) >= {"report", "model", "python", "mjcf"}
    assert all(Path(file).is_file() for file in printed["files"].values())
    page = Path(printed["files"]["report"]).read_text(encoding="utf-8")
    HTMLParser().feed(page)
    assert escape(sentence(Diagnosis.model_validate(without_files(printed)))) in page.replace(
        "\N{NO-BREAK SPACE}%", " %"
    )
    assert not re.search(r"\d %", page.partition("</style>")[2])
    assert 'id="acceptance"' not in page  # limits were not given
    assert "http://" not in page
    assert "https://" not in page
    assert json.loads(Path(printed["files"]["model"]).read_text())


@pytest.mark.long
def test_same_seed_same_answer(worn: list[Path], cli) -> None:
    words = ("diagnose", *worn, "--rig", "paper", "--library", "coulomb_joint1,coulomb_joint2", "--seed", 3, "--json")
    once, again = cli(*words).json, cli(*words).json
    assert without_times(once) == without_times(again)


def without_files(printed: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in printed.items() if name != "files"}


def without_times(diagnosis: dict[str, Any]) -> dict[str, Any]:
    evidence = {name: value for name, value in diagnosis["evidence"].items() if name != "made_utc"}
    result = {name: value for name, value in diagnosis.items() if name not in ("seconds", "files")}
    return result | {"evidence": evidence}


def test_the_readable_form_starts_with_the_verdict(worn: list[Path], cli) -> None:
    done = cli("diagnose", *worn, "--rig", "paper", "--library", "coulomb_joint1, coulomb_joint2", "--explain")
    assert done.code == 0, done.err
    assert done.out.startswith("The gap is explained by ")
    assert "90 % interval" in done.out
    _, search = done.out.split("Model search")
    assert "+ Coulomb friction, joint 1" in search
    assert {"add", "drop", "accepted", "rejected"} <= set(search.split())


def test_a_run_held_out_only_measures(worn: list[Path], cli) -> None:
    words = ("--held-out", worn[2], "--library", "coulomb_joint1,coulomb_joint2", "--json")
    closed = cli("diagnose", *worn[:2], "--rig", "paper", *words).json["gap"]["closed_held_out"]
    assert set(closed["per_run"]) == {run.stem for run in worn[:2]}
    assert set(closed["held_out"]) == {worn[2].stem}
    assert closed["held_out"][worn[2].stem] > 0.9


@pytest.mark.long
def test_the_library_bounds_what_can_be_named(worn: list[Path], cli) -> None:
    words = ("--library", "coulomb_joint1,coulomb_joint2,detent_joint1", "--without", "coulomb_joint2")
    result = cli("diagnose", *worn, "--rig", "paper", *words, "--max-effects", 1, "--json").json
    assert set(result["detectable"]) <= {"coulomb_joint1", "detent_joint1"}
    assert len(result["effects"]) <= 1
    assert {effect["name"] for effect in result["effects"]} <= {"coulomb_joint1", "detent_joint1"}


@pytest.mark.long
def test_an_identified_model_is_a_start(worn: list[Path], model: Path, cli) -> None:
    words = ("--model", model, "--library", "coulomb_joint1,coulomb_joint2", "--json")
    result = cli("diagnose", *worn, "--rig", "paper", *words).json
    assert {effect["name"] for effect in result["effects"]} == {"coulomb_joint1", "coulomb_joint2"}


def test_a_rig_without_a_gap_has_none(runs: list[Path], cli) -> None:
    library = "coulomb_joint1,coulomb_joint2,encoder_offset_joint1,latency_joint2,spring_joint1"
    diagnosis = cli("diagnose", *runs, "--rig", "paper", "--library", library, "--json").json
    assert diagnosis["verdict"] == "no_gap"
    assert diagnosis["effects"] == []
    assert diagnosis["probabilities"]["no_gap"] > 0.9


def test_bad_input_is_answered_with_a_sentence_and_a_code(worn: list[Path], model: Path, tmp_path: Path, cli) -> None:
    rig = tmp_path / "rig.toml"
    paper = Path(__file__).parents[2] / "configs" / "rigs" / "paper.toml"
    rig.write_text(paper.read_text().replace('name = "paper"', 'name = "other"', 1))
    no_run, no_model = tmp_path / "run.mcap", tmp_path / "model.json"
    no_run.write_text("hello")
    no_model.write_text("{}")
    cases: list[tuple[tuple[object, ...], int, str]] = [
        (
            (*worn, "--rig", "paper", "--library", "gremlins"),
            2,
            "no effect named gremlins; nearest of ",
        ),
        ((*worn, "--rig", "paper", "--without", "gremlins"), 2, "no effect named gremlins"),
        ((*worn, "--rig", "paper", "--library", ""), 2, "no effect named"),
        ((*worn, "--rig", "paper", "--held-out", worn[0]), 3, "the same recording"),
        ((*worn, worn[1], "--rig", "paper"), 3, "give each run once"),
        ((*worn, "--rig", rig), 3, "run of another rig"),
        ((*worn, "--rig", "nonesuch"), 3, "nor the name of a built-in rig"),
        ((*worn, "--rig", "paper", "--model", no_model), 3, str(no_model)),
        ((*worn, "--rig", "paper", "--model", tmp_path / "none.json"), 3, "none.json"),
        ((no_run, "--rig", "paper"), 3, str(no_run)),
        ((tmp_path / "none.mcap", "--rig", "paper"), 3, "no such file"),
        ((*worn, "--rig", "paper", "--max-effects", 0), 2, "--max-effects"),
        (("--rig", "paper"), 2, "runs"),
        ((*worn,), 2, "--rig"),
    ]
    for words, code, result in cases:
        done = cli("diagnose", *words)
        assert (done.code, result in done.err, "Traceback" in done.err) == (code, True, False), (words, done.err)


def test_a_model_of_another_rig_is_refused(worn: list[Path], model: Path, tmp_path: Path, cli) -> None:
    other = json.loads(model.read_text())
    other["rig"]["name"] = "other"
    (tmp_path / "other.json").write_text(json.dumps(other))
    done = cli("diagnose", *worn, "--rig", "paper", "--model", tmp_path / "other.json")
    assert done.code == 3
    assert "the model belongs to rig other" in done.err


def test_names_of_effects_complete_after_a_comma() -> None:
    words = "dpr-lab diagnose --library coulomb_joint1,detent_j"
    environment = {**os.environ, "_DPR_LAB_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": "3"}
    program = Path(sys.executable).with_name("dpr-lab")
    done = subprocess.run([program], env=environment, capture_output=True, text=True, timeout=400)
    assert done.stdout.split() == [f"coulomb_joint1,detent_joint{joint}" for joint in (1, 2, 0)]


def test_help_has_an_example(cli) -> None:
    assert "Example: dpr-lab diagnose" in cli("diagnose", "--help").out
