"""`dpr-lab trials` and the demo from the sealed plant to the score."""

import json
import re
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from dpr_lab.acquisition.capture import CaptureOptions
from dpr_lab.cli import main, trials
from dpr_lab.report.words import named
from dpr_lab.trials.score import read_outcome
from tests.blank_figures import save_blank
from tests.thinned import FULL


def test_a_diagnosed_trial_states_the_file_for_the_results_of_its_checks(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[Path] = []
    trial = SimpleNamespace(diagnosis=None, files={"report": "trial/diagnosis/diagnosis.html"})
    monkeypatch.setattr("dpr_lab.workflows.trial.diagnose_trial", lambda *_, **__: trial)
    monkeypatch.setattr("dpr_lab.cli.diagnose.show", lambda _, out: shown.append(out))
    trials.run(Path("trial"))
    assert shown == [Path("trial/diagnosis")]


def opens_and_stays_open(folder: Path, hidden: str, cli) -> None:
    """Reveal a diagnosed trial, and return the name of its hidden effect."""
    shown = cli("trials", "open", folder)
    assert shown.code == 0, shown.err
    assert "the seal is valid" in shown.out
    assert f"hidden: {named(hidden)}; diagnosis:" in shown.out
    late = cli("trials", "run", folder)
    assert late.code == 3
    assert "already opened" in late.err


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_trial_is_drawn_diagnosed_opened_and_scored_in_this_order(tmp_path: Path, cli) -> None:
    folder = tmp_path / "my trial"
    drawn = cli("trials", "draw", "--kind", "single", "--seed", 5, "--out", folder, "--json")
    assert drawn.code == 0, drawn.err
    assert re.fullmatch("[0-9a-f]{64}", drawn.json["seal"])
    assert drawn.err.index(f"seal of the plant: {drawn.json['seal']}") < drawn.err.index("X1: ")
    assert len(drawn.json["runs"]) == len(list((folder / "runs").glob("*.mcap"))) == 3

    early = cli("trials", "open", folder, "--json")
    assert early.code == early.json["exit_code"] == 3
    assert f"dpr-lab trials run {folder}" in early.err
    assert not (folder / "opened.json").exists()

    output = cli("trials", "run", folder, "--json")
    assert output.code == 0, output.err
    assert json.loads((folder / "diagnosis.json").read_text())["verdict"] == output.json["verdict"]
    assert Path(output.json["files"]["report"]).is_file()

    opened = cli("trials", "open", folder, "--json")
    assert opened.code == 0, opened.err
    assert opened.json["seal"] == drawn.json["seal"]
    assert opened.json["drawn"] == {"kind": "single", "level": "clear", "seed": 5}
    (hidden,) = opened.json["truth"]["effects"]
    assert any(hidden in effect["class"] for effect in output.json["effects"])
    assert read_outcome(opened.json["score"]).first
    opens_and_stays_open(folder, hidden, cli)


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_campaign_ends_with_scores_and_a_page(tmp_path: Path, cli) -> None:
    words = ("trials", "campaign", "--n", 2, "--kind", "clean", "--kind", "single", "--jobs", 1, "--out", tmp_path)
    done = cli(*words, "--json")
    assert done.code == 0, done.err
    assert done.json["trials"] == 2
    assert [row["kind"] for row in done.json["by_kind"]] == ["clean", "single"]
    assert json.loads((tmp_path / "summary.json").read_text())["trials"] == 2
    again = cli(*words)
    assert again.code == 0, again.err
    assert "2 of 2 trials are complete already" in again.err
    assert "first cause correct" in again.out
    assert str(tmp_path / "trials.html") in again.out
    other = cli(*words, "--seed", 77)
    assert other.code == 3
    assert "another campaign" in other.err


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_failed_trial_is_reported_and_the_others_count(tmp_path: Path, cli) -> None:
    done = cli("trials", "campaign", "--n", 1, "--kind", "clean", "--plant", "none", "--jobs", 1, "--out", tmp_path)
    assert done.code == 1
    assert "trial 0: the simulated device reports: none: is neither a file nor the name of a built-in plant" in done.err
    assert "run the command again" in done.err
    assert "neither a file nor the name" in (tmp_path / "trials.html").read_text()


@pytest.fixture
def demo(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> tuple[dict[str, Any], str]:
    """JSON output and messages of the demo. Fast tests record 2 s of each swing instead of 10 s."""
    seconds = 10.0 if FULL else 2.0
    monkeypatch.setattr("dpr_lab.acquisition.capture.CaptureOptions", partial(CaptureOptions, duration=seconds))
    monkeypatch.setattr("dpr_lab.report.figures.save_png", save_blank)
    monkeypatch.setattr("sys.argv", ["dpr-lab", "demo", "--seed", "5", "--out", str(tmp_path), "--json"])
    with pytest.raises(SystemExit) as ended:
        main()
    shown = capsys.readouterr()
    assert not ended.value.code, shown.err
    return json.loads(shown.out), shown.err


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_demo_ends_near_the_plant_and_with_a_hidden_effect_opened_and_scored(
    demo: tuple[dict[str, Any], str], cli
) -> None:
    printed, messages = demo
    assert max(abs(z) for z in printed["deviations_std"].values()) < 3
    (seal,) = re.findall("seal of the plant: ([0-9a-f]{64})", messages)
    trial = printed["trial"]
    assert trial["seal"] == seal
    (hidden,) = trial["truth"]["effects"]
    assert trial["score"]["first"]
    reports = [Path(printed["report"]), Path(trial["report"])]
    assert [report.name for report in reports] == ["report.html", "diagnosis.html"]
    assert all(report.is_file() for report in reports)
    folder = reports[1].parents[1]
    opens_and_stays_open(folder, hidden, cli)
    (folder / "diagnosis.json").unlink()
    early = cli("trials", "open", folder, "--json")
    assert early.code == early.json["exit_code"] == 3
    assert f"dpr-lab trials run {folder}" in early.err


def test_wrong_arguments_are_refused(tmp_path: Path, cli) -> None:
    for words in (
        ("draw", "--kind", "mystery", "--out", tmp_path / "t"),
        ("draw", "--level", "huge", "--out", tmp_path / "t"),
        ("draw", "--kind", "single"),
        ("campaign", "--kind", "mystery", "--out", tmp_path / "t"),
        ("campaign", "--n", 0, "--out", tmp_path / "t"),
    ):
        assert cli("trials", *words).code == 2
    assert not (tmp_path / "t").exists()


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (("draw", "--rig", "nonesuch", "--out", "t"), 3, "nor the name of a built-in rig"),
        (("draw", "--plant", "nonesuch", "--out", "t"), 3, "nor the name of a built-in plant"),
        (("run", "nowhere"), 3, "contains no trial; draw one"),
        (("open", "nowhere"), 3, "contains no trial; draw one"),
        (("campaign", "--rig", "nonesuch", "--out", "t"), 3, "nor the name of a built-in rig"),
        (
            ("campaign", "--arm", "free", "--kind", "form", "--n", "1", "--out", "t"),
            3,
            "kind form: not available for plants whose arm moves",
        ),
        (("campaign", "--n", "1", "--scheduler", "localhost", "--out", "t"), 4, "tcp://127.0.0.1:8786"),
        (("campaign", "--n", "1", "--scheduler", "tcp://0.0.0.0:1", "--out", "t"), 4, "can run any code"),
    ],
)
def test_bad_input_is_answered_with_a_sentence(tmp_path: Path, cli, words, code: int, message: str) -> None:
    done = cli("trials", *words, cwd=tmp_path)
    assert done.code == code
    assert message in done.err
    assert "Traceback" not in done.err


@pytest.mark.parametrize("command", [(), ("draw",), ("run",), ("open",), ("campaign",)], ids=" ".join)
def test_every_help_has_an_example(cli, command: tuple[str, ...]) -> None:
    done = cli("trials", *command, "--help")
    assert done.code == 0
    assert "Example:" in done.out
