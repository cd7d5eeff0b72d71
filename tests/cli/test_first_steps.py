"""Typical errors of new users: a rig without poses, an impossible rate, a wrong name, a narrow terminal."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import typer

from dpr_lab.cli.checks import EFFECT_NAMES, EXPORT_NAMES, OBJECTIVE_NAMES, SEARCHES, complete_rig
from dpr_lab.configs import BUILTIN, built_in
from dpr_lab.effects import EFFECTS
from dpr_lab.exports import FORMATS
from dpr_lab.identification.objectives import OBJECTIVES, objective_words
from dpr_lab.rig import load_rig
from dpr_lab.rig_tables import AddedMass, Encoders, LinkSettings, Parameter, Pose, RigGeometry
from dpr_lab.search import ALGORITHMS, search_words

ROOT = Path(__file__).parents[2]


def test_a_rig_without_poses_is_reported(cli, tmp_path: Path) -> None:
    text = (BUILTIN / "rigs" / "paper.toml").read_text()
    (tmp_path / "rig.toml").write_text(re.sub(r"\[poses\.[^[]*", "", text))
    done = cli("capture", "--rig", tmp_path / "rig.toml", "--link", "sim://?clock=fast", "--out", tmp_path / "runs")
    assert done.code == 3
    assert "has no poses" in done.err


@pytest.mark.parametrize("command", [("import", "table", "swing.csv"), ("identify", "a.mcap"), ("diagnose", "a.mcap")])
def test_a_command_without_a_rig_says_how_to_write_a_rig_file(cli, command: tuple[str, ...]) -> None:
    done = cli(*command)
    assert done.code == 2
    assert "`dpr-lab rig new` writes a rig file; for a single rod, add --rods inner" in " ".join(done.err.split())


def test_a_rate_that_cannot_be_is_refused_before_anyone_moves(cli, tmp_path: Path) -> None:
    words = ("capture", "--rig", "paper", "--link", "sim://?clock=fast", "--rate-hz", "9999999", "--out", tmp_path)
    done = cli(*words)
    assert done.code == 4
    assert "X1" not in done.err


@pytest.mark.parametrize(
    ("words", "known"),
    [
        (("identify", "x", "--rig", "paper", "--search", "luck"), "covariance matrix adaptation [cma_es]"),
        (("identify", "x", "--rig", "paper", "--objective", "luck"), "short segments, insensitive to chaos [segments]"),
        (("diagnose", "x", "--rig", "paper", "--library", "luck,coulom"), "nearest of"),
        (("diagnose", "x", "--rig", "paper", "--without", "luck of coulomb"), "friction, joint 1 [coulomb_joint1]"),
        (("export", "x", "--to", "luck"), "MuJoCo [mjcf]"),
        (("diagnose", "x", "--rig", "paper", "--fail-on", "luck"), "unexplained"),
    ],
)
def test_a_wrong_choice_ends_with_2_and_lists_the_right_ones(cli, words, known: str) -> None:
    done = cli(*words)
    assert done.code == 2
    assert "luck" in done.err
    assert known in done.err


def test_effects_are_named_by_identifier_or_words_and_the_nearest_are_listed() -> None:
    one = "coulomb_joint1"
    for given in (one, EFFECTS[one].words, f"{EFFECTS[one].words} [{one}]", EFFECTS[one].words.upper()):
        assert EFFECT_NAMES.check_each([given]) == [one]
    assert EFFECT_NAMES.check(f"{EFFECTS[one].words}, base_tilt") == f"{one},base_tilt"
    with pytest.raises(typer.BadParameter) as refused:
        EFFECT_NAMES.check("coulomb_jiont2")
    message = str(refused.value)
    assert "coulomb_joint2" in message
    assert len(message) < 500


def test_choices_are_completed() -> None:
    assert SEARCHES.complete("c") == [("cma_es", "covariance matrix adaptation")]
    assert [name for name, _ in OBJECTIVE_NAMES.complete("")] == ["segments", "paper"]
    assert EFFECT_NAMES.complete("backlash_joint2,coul") == [
        (f"backlash_joint2,{name}", EFFECTS[name].words) for name in EFFECTS if name.startswith("coul")
    ]
    others = [f"mjcf,{name}" for name in FORMATS if name != "mjcf"]
    assert [name for name, _ in EXPORT_NAMES.complete("mjcf,")] == others
    assert complete_rig("pap") == ["paper"]


@pytest.mark.parametrize("command", ["capture", "import table swing.csv"])
def test_poses_of_the_rig_are_completed(command: str, tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(
        (BUILTIN / "rigs" / "paper.toml").read_text() + "[poses.Xhigh]\ntheta1 = 0.1\ntheta2 = 0.1\n"
    )
    words = f"dpr-lab {command} --rig rig.toml --pose X"
    environment = {**os.environ, "_DPR_LAB_COMPLETE": "complete_bash", "COMP_WORDS": words}
    environment["COMP_CWORD"] = str(len(words.split()) - 1)
    program = Path(sys.executable).with_name("dpr-lab")
    done = subprocess.run([program], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=400)
    assert done.stdout.split() == ["X1", "X2", "X3", "Xhigh"]


def test_rig_files_and_folders_are_completed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rigs").mkdir()
    assert complete_rig("ri") == []  # a single completion would end with a blank, so the shell completes the path
    (tmp_path / "rigs" / "bench.toml").touch()
    assert complete_rig("ri") == ["rigs/", "rigs/bench.toml"]
    assert complete_rig("rigs/be") == ["rigs/bench.toml"]
    (tmp_path / "rig_a.toml").touch()
    assert complete_rig("ri") == ["rig_a.toml", "rigs/"]
    assert complete_rig("") == [*built_in("rigs"), "rig_a.toml", "rigs/"]
    assert complete_rig(f"{tmp_path}/rigs/b") == [f"{tmp_path}/rigs/bench.toml"]


def test_help_names_every_search(cli) -> None:
    output = " ".join(cli("identify", "--help").out.split())
    for name in ALGORITHMS:
        assert search_words(name) in output
    for name in OBJECTIVES:
        assert objective_words(name) in output


@pytest.mark.slow
def test_built_in_rigs_are_listed_and_shown(cli, on_terminal, tmp_path: Path) -> None:
    listed = cli("rig", "list", "--json")
    assert [rig["name"] for rig in listed.json] == built_in("rigs") == ["driven_double", "furuta", "multiarm", "paper"]
    (tmp_path / "mine.toml").write_text(cli("rig", "show", "paper").out)
    code, shown = on_terminal([sys.executable, "-m", "dpr_lab", "rig", "show", "paper"], {"COLUMNS": "80"})
    assert (code, shown.replace("\r", "")) == (0, (tmp_path / "mine.toml").read_text())
    assert load_rig(tmp_path / "mine.toml").model_dump() == load_rig("paper").model_dump()


def test_the_page_of_the_rig_file_has_every_key() -> None:
    page = (ROOT / "docs" / "rig-file.md").read_text()
    for model in (RigGeometry, Parameter, Encoders, Pose, AddedMass, LinkSettings):
        for key in model.model_fields:
            assert f"`{key}`" in page, (model, key)
    blocks = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    assert all(tomllib.loads(block) for block in blocks)


@pytest.mark.parametrize("columns", [80, 50])
def test_a_table_keeps_its_words_whole_on_a_narrow_terminal(columns: int, on_terminal) -> None:
    program = f"""
from dpr_lab.cli.console import table
row = ("coulomb_joint1", "rolling_friction_of_the_bearing", "indistinguishable", "0.98", "friction_curve_joint2")
table("Effects", ("effect", "what it is", "standing", "probability", "alternative"), [row])
table("One run", ("", "value"), [("sha256", {"f" * 64!r}), ("gate_figures", "release_speed " * 9)])
columns = ("parameter", "moved", "first group", "change", "simultaneous interval", "after", "chance")
table("Drift", columns, [("c1/b", "no", "0.207688", "-0.93 %", "-8.49 % to +6.63 %", "2026-11-16", "0.99")] * 2)
"""
    code, text = on_terminal([sys.executable, "-c", program], {"COLUMNS": str(columns)})
    assert code == 0
    assert max(map(len, text.splitlines())) <= max(columns, 64 + len("sha256: "))
    for word in ("coulomb_joint1", "rolling_friction_of_the_bearing", "indistinguishable", "friction_curve_joint2"):
        assert word in text
    for word in ("0.207688", "2026-11-16", "f" * 64):
        assert word in text
    assert text.count("0.99") == 2
    assert text.count("release_speed") == 9


@pytest.mark.slow
def test_sentences_end_their_lines_between_words(on_terminal) -> None:
    wrong = [sys.executable, "-m", "dpr_lab", "diagnose", "x.mcap", "--rig", "paper", "--library", "gremlins"]
    code, text = on_terminal(wrong, {"COLUMNS": "80"})
    assert code == 2
    assert max(map(len, text.splitlines())) <= 80
    nearest = [name for name in re.findall(r"\[(\w+)\]", text) if name != "OPTIONS"]
    assert len(nearest) == 5
    assert set(nearest) <= set(EFFECTS)
    program = "from dpr_lab.cli.console import line; line('residual ' * 20)"
    code, text = on_terminal([sys.executable, "-c", program], {"COLUMNS": "80"})
    assert max(map(len, text.splitlines())) <= 80
    assert set(text.split()) == {"residual"}


def test_excluded_effects_are_a_list_as_the_completion_proposes() -> None:
    assert EFFECT_NAMES.check_each(["coulomb_joint1,Coulomb friction, joint 2", "base_tilt"]) == [
        "coulomb_joint1",
        "coulomb_joint2",
        "base_tilt",
    ]
    assert ("coulomb_joint1,base_tilt", "base tilt") in EFFECT_NAMES.complete("coulomb_joint1,base_t")
