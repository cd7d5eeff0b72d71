"""Command line: help, imports, doctor, export, interruption."""

import os
import pty
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer

from dpr_lab.cli.app import COMMANDS, app
from tests.thinned import thinned
from tests.warm_process import started


def commands(group: Any, *words: str) -> Iterator[tuple[str, ...]]:
    yield words
    for name, command in getattr(group, "commands", {}).items():
        yield from commands(command, *words, name)


def test_every_help_has_an_example_and_keeps_words_whole(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    for command in commands(typer.main.get_command(app)):
        assert app([*command, "--help"], prog_name="dpr-lab", standalone_mode=False) == 0
        help_text = capsys.readouterr().out
        assert "Example:" in help_text, command
        lines = help_text.splitlines()
        assert max(map(len, lines)) <= 80, command
        assert not [line for line in lines if re.search(r"\w-$|[\w,:]\.\.\.$", line)], command


def test_each_name_of_the_table_is_that_of_its_command() -> None:
    assert len(set(COMMANDS.values())) == len(COMMANDS)
    for name, target in COMMANDS.items():
        assert target.partition(":")[2] in (name, "app")


def test_the_help_names_every_exit_code(cli) -> None:
    text = cli("--help").out
    for code in ("0 ok", "2 usage", "3 ", "4 ", "5 ", "6 ", "7 ", "8 ", "130 "):
        assert code in text


def test_help_imports_nothing_heavy() -> None:
    program = (
        "import sys\nfrom dpr_lab.cli.app import app\napp(['--help'], standalone_mode=False)\n"
        "heavy = {'numpy', 'scipy', 'numba', 'filterpy', 'matplotlib', 'cantools', 'can', 'serial', 'textual',"
        " 'pydantic', 'mcap'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_doctor_greets_a_device(cli) -> None:
    done = cli("doctor", "--link", "sim://?clock=fast", "--rig", "paper", "--json")
    result = {finding["what"]: finding for finding in done.json["findings"]}
    assert result["device"]["state"] == result["rig"]["state"] == "ok"
    assert result["numba"]["state"] == "ok"


def test_doctor_tests_the_device_without_a_valid_rig_file(tmp_path: Path, cli) -> None:
    (tmp_path / "rig.toml").write_text("[rig]")
    done = cli("doctor", "--link", "sim://?clock=fast&rig=paper", "--rig", tmp_path / "rig.toml", "--json")
    result = {finding["what"]: finding for finding in done.json["findings"]}
    assert (done.code, result["rig"]["state"], result["device"]["state"]) == (3, "wrong", "ok")


def test_doctor_shows_its_progress_on_a_terminal(on_terminal) -> None:
    words = ("doctor", "--link", "sim://?clock=fast", "--rig", "paper")
    code, text = on_terminal([sys.executable, "-m", "dpr_lab", *words], {"COLUMNS": "120"})
    assert code == 0, text
    assert text.index("4 of 4: device at sim://") < text.index("firmware 1.0.0")


def test_doctor_compares_the_device_with_the_rig_file(tmp_path: Path, cli) -> None:
    text = (Path(__file__).parents[2] / "configs/rigs/paper.toml").read_text()
    rig = tmp_path / "rig.toml"
    rig.write_text(text.replace("[16384, 16384, 16384]", "[4096, 4096, 4096]"))
    done = cli("doctor", "--link", "sim://?clock=fast&rig=paper", "--rig", rig, "--json")
    assert done.code == 3
    assert "4096, 4096, 4096" in {finding["what"]: finding for finding in done.json["findings"]}["device"]["said"]


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="needs a folder that takes no file")
def test_doctor_reports_a_folder_that_cannot_be_written(cli) -> None:
    done = cli("doctor", "--json", cwd=Path("/proc"))
    disk = next(finding for finding in done.json["findings"] if finding["what"] == "disk")
    assert (done.code, disk["state"]) == (1, "wrong")
    assert "/proc: cannot be written" in disk["said"]


def test_doctor_reports_the_fault_of_a_link(cli) -> None:
    done = cli("doctor", "--link", "serial:///dev/nonesuch0", "--json")
    assert done.code == 4
    assert done.json["ok"] is False


@pytest.mark.parametrize("suffix", thinned([".csv", ".parquet", ".h5", ".mat", ".mcap"], 3))
def test_export_by_suffix(runs: list[Path], tmp_path: Path, cli, suffix: str) -> None:
    out = tmp_path / f"run{suffix}"
    assert cli("run", "export", runs[0], "--out", out).code == 0
    assert out.stat().st_size > 50_000


def test_an_exported_table_comes_back_as_the_same_run(runs: list[Path], tmp_path: Path, cli) -> None:
    from dpr_lab.storage.reader import load_run

    table = tmp_path / "run.csv"
    assert cli("run", "export", runs[0], "--out", table).code == 0
    assert cli("import", "csv", table, "--rig", "paper", "--pose", "X1", "--out", tmp_path).code == 0
    back, original = load_run(tmp_path / "run.mcap"), load_run(runs[0])
    assert np.abs(back.theta - original.theta).max() < 1e-6
    assert np.abs(np.diff(back.t) - np.diff(original.t)).max() < 1e-6


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_capture_finalises_its_file(tmp_path: Path, cli, number: signal.Signals) -> None:
    words = ["capture", "--rig", "paper", "--link", "sim://?clock=realtime", "--pose", "X1", "--out", str(tmp_path)]
    process = subprocess.Popen(
        [sys.executable, "-m", "dpr_lab", *words], stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 60
    while not (files := list(tmp_path.glob("*.mcap"))) and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(1.0)
    process.send_signal(number)
    _, result = process.communicate(timeout=400)
    assert process.returncode == 130, result
    info = cli("run", "info", files[0], "--json").json
    assert info["complete"] is False
    assert info["damage"] == ""
    assert info["samples"] > 300


@pytest.mark.slow
def test_on_a_terminal_nothing_is_released_before_enter(tmp_path: Path) -> None:
    master, slave = pty.openpty()
    words = ["capture", "--rig", "paper", "--link", "sim://?clock=fast", "--pose", "X1", "--duration", "1"]
    pipe = subprocess.PIPE
    process = started("dpr_lab", [*words, "--out", str(tmp_path)], stdin=slave, stdout=pipe, stderr=pipe, text=True)
    assert process.stderr is not None
    for line in process.stderr:
        if "press Enter" in line:
            break
    time.sleep(1.0)
    assert not list(tmp_path.glob("*.mcap"))
    os.write(master, b"\n")
    out, err = process.communicate(timeout=400)
    os.close(master)
    os.close(slave)
    assert process.returncode == 0, err
    assert out.strip().endswith(".mcap")
