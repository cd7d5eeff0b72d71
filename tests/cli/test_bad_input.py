"""Bad input gives a message with place and remedy, and the documented exit code."""

import os
import pty
from pathlib import Path

import numpy as np
import pytest

RIG = Path(__file__).parents[2] / "configs" / "rigs" / "paper.toml"
GOOD = "t_s,theta1_rad,theta2_rad\n" + "".join(
    f"{k * 0.005},{3.1 + 0.1 * np.cos(k / 30)},{3.2 + 0.15 * np.cos(k / 30)}\n" for k in range(400)
)


def changed_rig(tmp_path: Path, old: str, new: str) -> Path:
    path = tmp_path / "rig.toml"
    text = RIG.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return path


def capture(cli, link: str, tmp_path: Path, rig: object = "paper"):
    return cli("capture", "--rig", rig, "--link", link, "--pose", "X1", "--yes", "--out", tmp_path / "runs")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("lower = 0.16", "lower = 0.3", "bounds are reversed"),
        ('name = "paper"', 'name = "paper"\ncolour = "red"', "unknown key"),
        ("nominal = 0.2\n", "", "is missing"),
        ("counts_per_rev = [16384, 16384, 16384]", 'counts_per_rev = ["many", 16384, 16384]', "counts_per_rev"),
        ("g = 9.81", "g = -9.81", "g = -9.81"),
        ("[rig]", "[rig", "not valid TOML"),
        ("lower = 0.16\nupper = 0.24", "measured = 0.2", "std"),
    ],
)
def test_a_wrong_rig_file_names_file_key_and_value(tmp_path: Path, cli, old: str, new: str, message: str) -> None:
    rig = changed_rig(tmp_path, old, new)
    done = capture(cli, "sim://", tmp_path, rig)
    assert done.code == 3
    assert message in done.err
    assert str(rig) in done.err
    assert "Traceback" not in done.err


def test_an_unknown_kind_of_link_is_refused_before_a_confirmation_is_required(tmp_path: Path, cli) -> None:
    done = cli("capture", "--rig", "paper", "--link", "nosuch://", "--out", tmp_path)
    assert done.code == 2
    assert "unknown kind of link 'nosuch'; use for example: serial://" in done.err
    assert "--yes" not in done.err


def test_verify_names_the_file_that_it_needs(tmp_path: Path, cli) -> None:
    done = cli("verify", tmp_path)
    assert (done.code, "give the file that `dpr-lab certify` has written" in done.err) == (3, True)


@pytest.mark.parametrize("place", ["option", "rig file"])
def test_without_a_terminal_a_real_device_is_released_only_with_yes(tmp_path: Path, cli, place: str) -> None:
    link = "serial:///dev/nonesuch0"
    rig = changed_rig(tmp_path, 'url = "sim://', f'url = "{link}" #')
    done = cli(
        "capture", "--rig", rig, "--pose", "X1", "--out", tmp_path, *(("--link", link) if place == "option" else ())
    )
    assert done.code == 2
    assert f"{link}: without a terminal nobody can confirm the release" in " ".join(done.err.split())
    assert "give --yes" in done.err


@pytest.mark.parametrize("text", ["0,3", "30cm"])
def test_a_number_that_cannot_be_read_has_an_example(cli, text: str) -> None:
    done = cli("rig", "new", "--name", "b", "--l1", text, "--m1", "0.2")
    assert done.code == 2
    assert "must be a number with a decimal point and without a unit, such as 0.25" in done.err


def test_a_file_instead_of_a_command_is_refused_with_the_commands(cli, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(GOOD)
    done = cli("import", tmp_path / "a.csv")
    assert done.code == 2
    assert "is a file: write a command before it (table, csv)" in done.err
    assert "dpr-lab --help lists them" in cli(tmp_path / "a.csv").err


def test_an_effect_instead_of_a_command_is_answered_with_the_command(cli) -> None:
    done = cli("effects", "coulomb_joint1")
    assert (done.code, "effects show coulomb_joint1" in done.err) == (2, True)


def test_no_such_rig_lists_those_there_are(tmp_path: Path, cli) -> None:
    done = capture(cli, "sim://", tmp_path, "nonesuch")
    assert done.code == 3
    assert "paper" in done.err


def test_no_such_port(tmp_path: Path, cli) -> None:
    done = capture(cli, "serial:///dev/nonesuch0", tmp_path)
    assert done.code == 4
    assert "nonesuch0" in done.err
    assert not list(tmp_path.rglob("*.mcap"))


@pytest.mark.parametrize(
    "link",
    [
        "",
        "smoke://signal",
        "sim://?colour=red",
        "sim://?drift_ppm=much",
        "sim://?fault=gremlins=1",
        "can://nonesuch/can0",
        "can://socketcan/can0?bitrate=fast",
        "serial://",
        "serial:///dev/ttyS0?baud=-1",
        "socket://127.0.0.1",
    ],
)
def test_a_wrong_link_is_wrong_usage(tmp_path: Path, cli, link: str) -> None:
    done = capture(cli, link, tmp_path)
    assert done.code == 2
    last = done.err.splitlines()[-1]  # a busy computer announces its first start before
    assert last.startswith(f"dpr-lab: {link or 'empty text'}: ")
    assert "Traceback" not in done.err


def test_nothing_answers_on_the_port(tmp_path: Path, cli) -> None:
    master, slave = pty.openpty()
    try:
        done = capture(cli, f"serial://{os.ttyname(slave)}", tmp_path)
    finally:
        os.close(master)
        os.close(slave)
    assert done.code == 4
    assert "no DPR device answered" in done.err


def test_a_rate_the_link_cannot_carry_is_refused_with_the_arithmetic(tmp_path: Path, cli) -> None:
    done = capture(cli, "sim://?clock=fast&baud=115200", tmp_path)
    assert done.code == 4
    assert "115200" in done.err
    assert "1000 Hz" in done.err


@pytest.mark.slow
def test_a_pulled_cable_keeps_the_partial_file(tmp_path: Path, cli) -> None:
    done = capture(cli, "sim://?clock=realtime&fault=cut_after_s=4", tmp_path)
    assert done.code == 7, done.err
    (file,) = tmp_path.rglob("*.mcap")
    assert str(file) in done.err
    info = cli("run", "info", file, "--json").json
    assert info["complete"] is False
    assert info["samples"] > 500
    recovered = tmp_path / "whole.mcap"
    assert cli("run", "recover", file, "--out", recovered).code == 0
    assert cli("run", "info", recovered, "--json").json["samples"] == info["samples"]
    assert cli("run", "verify", recovered).code == 0


def test_no_such_pose(tmp_path: Path, cli) -> None:
    done = cli("capture", "--rig", "paper", "--link", "sim://?clock=fast", "--pose", "X9", "--out", tmp_path)
    assert done.code == 3
    assert "X1" in done.err
    assert "move the rods" not in done.err


@pytest.mark.parametrize(
    "words",
    [("--duration", "-1"), ("--duration", "0"), ("--duration", "nan"), ("--rate-hz", "0"), ("--rate-hz", "-5")],
)
def test_an_invalid_length_or_rate_is_refused(tmp_path: Path, cli, words: tuple[str, str]) -> None:
    done = cli("capture", "--rig", "paper", "--link", "sim://?clock=fast", *words, "--out", tmp_path)
    assert done.code == 2
    assert words[0] in done.err
    assert not list(tmp_path.iterdir())


def imported(cli, tmp_path: Path, text: str | bytes, *options: str):
    table = tmp_path / "table.csv"
    table.write_bytes(text.encode() if isinstance(text, str) else text)
    return cli("import", "csv", table, "--rig", "paper", *options, "--out", tmp_path / "runs")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR", "table.csv"),
        ("", "table.csv"),
        ("t_s,theta1_rad,theta2_rad\n", "table.csv"),
        ("t_s,theta1_rad\n0,1\n1,2\n", "theta2"),
        (GOOD.replace("1.0,", "0.2,"), "line"),
        ("t_s,theta1_rad,theta2_rad\n" + "0.1,nan,nan\n" * 50, "table.csv"),
    ],
    ids=["not a CSV", "empty", "zero length", "one axis missing", "time going backwards", "NaN rows"],
)
def test_a_wrong_table_is_refused_with_a_sentence(tmp_path: Path, cli, text: str | bytes, message: str) -> None:
    done = imported(cli, tmp_path, text)
    assert done.code == 3
    assert message in done.err
    assert "Traceback" not in done.err
    assert not list(tmp_path.rglob("*.mcap"))


@pytest.mark.slow
def test_a_doubled_row_is_left_out_and_reported(tmp_path: Path, cli) -> None:
    lines = GOOD.splitlines(keepends=True)
    done = imported(cli, tmp_path, "".join([*lines[:50], lines[49], *lines[50:]]))
    assert done.code == 0
    assert "399" in done.out or "400" in done.out
    assert "1" in done.err


@pytest.mark.slow
def test_a_table_that_begins_before_its_zero_is_remarked_on(tmp_path: Path, cli) -> None:
    header, *rows = GOOD.splitlines()
    early = [f"{-0.005 * k},{3.1 + 0.1 * np.cos(k / 30)},{3.2 + 0.15 * np.cos(k / 30)}" for k in range(40, 0, -1)]
    done = imported(cli, tmp_path, "\n".join([header, *early, *rows]))
    assert done.code == 0, done.err
    assert "--start-s 0.2" in done.err


def test_every_command_refuses_a_long_gap(tmp_path: Path, model: Path, runs: list[Path], cli) -> None:
    """The import warns; an analysis of such a run, also with other runs, is refused with the same message."""
    header, *rows = GOOD.splitlines()
    later = [f"{300 + float(time)},{angles}" for time, _, angles in (row.partition(",") for row in rows)]
    table = tmp_path / "gap.csv"
    table.write_text("\n".join([header, *rows, *later]))
    message = cli("import", "table", table, "--rig", "paper", "--out", tmp_path).err
    assert "has an interruption of 298 s at 1.995 s" in message
    out, gap = ("--rig", "paper", "--out", tmp_path / "out"), tmp_path / "gap.mcap"
    for command in (
        ("identify", gap, *out),
        ("identifiability", gap, "--rig", "paper"),
        ("diagnose", gap, runs[0], *out),
        ("plan", gap, *out),
        ("compare", gap, "--model", model, "--out", tmp_path / "out"),
        ("export", model, "--to", "python", "--check", gap, *out),
    ):
        done = cli(*command)
        assert (done.code, "too long for a prediction" in done.err) == (8, True), command


def test_a_recording_counts_once(tmp_path: Path, runs: list[Path], cli) -> None:
    for command in (("identify", "--out", tmp_path / "m.json"), ("identifiability",)):
        done = cli(*command, "--rig", "paper", runs[0], runs[0])
        assert done.code == 3
        assert "give each run once" in done.err


def test_results_do_not_go_into_a_file(tmp_path: Path, runs: list[Path], model: Path, cli) -> None:
    out = tmp_path / "taken"
    out.touch()
    for words in (
        ("capture", "--rig", "paper", "--link", "sim://?clock=fast"),
        ("compare", runs[0], "--model", model),
        ("diagnose", runs[0], "--rig", "paper"),
        ("paper",),
        ("trials", "draw"),
        ("trials", "campaign"),
    ):
        done = cli(*words, "--out", out)
        assert done.code == 3
        assert f"{out}: is a file" in done.err


def test_an_empty_part_of_a_table_is_wrong_usage(tmp_path: Path, cli) -> None:
    assert imported(cli, tmp_path, GOOD, "--duration-s", "0").code == 2


def test_a_negative_seed_is_wrong_usage(runs: list[Path], cli) -> None:
    for command in ("identify", "diagnose"):
        done = cli(command, runs[0], "--rig", "paper", "--seed", "-1")
        assert done.code == 2
        assert "--seed" in done.err


def test_a_run_of_another_rig_is_refused(tmp_path: Path, runs: list[Path], cli) -> None:
    rig = changed_rig(tmp_path, 'name = "paper"', 'name = "other"')
    done = cli("identify", *runs, "--rig", rig, "--out", tmp_path / "m.json")
    assert done.code == 3
    assert "other" in done.err
    assert "paper" in done.err


@pytest.mark.parametrize("content", ["", "{}", "[1, 2]", "\x00\x01", '{"rig": 3}'])
def test_a_file_that_is_no_model_is_refused(tmp_path: Path, runs: list[Path], cli, content: str) -> None:
    path = tmp_path / "model.json"
    path.write_text(content)
    done = cli("compare", runs[0], "--model", path, "--out", tmp_path)
    assert done.code == 3
    assert str(path) in done.err
    assert "Traceback" not in done.err


def test_a_file_that_is_no_run_is_refused(tmp_path: Path, cli) -> None:
    path = tmp_path / "run.mcap"
    path.write_text("hello")
    for words in (("identify", path, "--rig", "paper"), ("run", "info", path), ("run", "verify", path)):
        done = cli(*words)
        assert done.code == 3
        assert "Traceback" not in done.err
        assert done.err.count(str(path)) == 1


def test_an_error_with_json_is_an_object_too(tmp_path: Path, cli) -> None:
    done = cli("capture", "--rig", "nonesuch", "--json")
    assert done.json["exit_code"] == done.code == 3
    assert "nonesuch" in done.json["error"]


def test_unknown_names_list_the_known_ones(tmp_path: Path, runs: list[Path], cli) -> None:
    for option, known in (("--objective", "segments"), ("--search", "iga")):
        done = cli("identify", runs[0], "--rig", "paper", option, "nonesuch", "--out", tmp_path / "m.json")
        assert done.code == 2
        assert known in done.err


def test_an_unknown_choice_names_the_choices_without_words_of_a_library(tmp_path: Path, cli) -> None:
    done = cli("import", "table", tmp_path / "swing.csv", "--rig", "paper", "--zero", "absolute")
    assert done.code == 2
    assert "'--zero': 'absolute' is not one of 'upright', 'hanging'" in done.err


def test_wrong_usage_is_two(cli) -> None:
    assert cli("identify").code == 2
    assert cli("nonesuch").code == 2
