"""Commands on a system without the POSIX modules of Python, such as Windows."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.thinned import FULL

pytestmark = pytest.mark.slow

WITHOUT = """
import json, os, signal, subprocess, sys
import platformdirs.unix  # a library that asks for the user here, and not on Windows
for name in ("fcntl", "termios", "pty", "tty", "resource", "pwd", "grp", "readline"):
    sys.modules[name] = None
for name in ("fork", "forkpty", "getuid", "geteuid", "getgid", "killpg", "setsid", "openpty", "getpgid", "mkfifo"):
    delattr(os, name)
for name in ("SIGHUP", "SIGKILL", "SIGUSR1", "SIGUSR2", "SIGALRM", "SIGWINCH", "SIGCONT", "SIGTSTP"):
    delattr(signal, name)
for name in ("pthread_kill", "setitimer", "alarm", "pthread_sigmask"):
    delattr(signal, name)
from dpr_lab.cli import main
for words in json.loads(sys.argv[1]):
    sys.argv = ["dpr-lab", *words]
    try:
        main()
    except SystemExit as end:
        assert not end.code or words == ["tui"]
"""
POSES = ("side", "elbow", "low") if FULL else ("side",)
IMPORT = ("--rig", "tables/bench.toml", "--angles", "relative", "--zero", "hanging", "--out", "runs")


def run(folder: Path, *commands: tuple[str, ...]) -> subprocess.CompletedProcess[str]:
    """Run commands one after another in one process."""
    command = [sys.executable, "-c", WITHOUT, json.dumps(commands)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, encoding="utf-8")
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture(scope="module")
def used(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """Folder with spaces and non-ASCII characters in its name, runs imported there, and the output of the commands."""
    folder = tmp_path_factory.mktemp("Prüfstand 双摆")
    imports = [("import", "table", f"tables/{pose}.csv", *IMPORT, "--pose", pose) for pose in POSES]
    shown = (("--help",), ("rig", "list"), ("schema", "drift"), ("tui",))
    return folder, run(folder, ("demo", "--table", "--out", "tables"), *imports, *shown)


def test_help_rigs_schemas_and_tables(used: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    folder, done = used
    for word in ("diagnose", "paper", "2020-12"):
        assert word in done.stdout
    assert "\ndpr-lab: the screen requires Linux, macOS" in f"\n{done.stderr}"
    assert len(list((folder / "runs").glob("*.mcap"))) == len(POSES)


@pytest.mark.long
def test_identify_and_diagnose(used: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    folder, _ = used
    runs = sorted(str(file) for file in (folder / "runs").glob("*.mcap"))
    rig = ("--rig", "tables/bench.toml")
    done = run(folder, ("identify", *runs, *rig, "--out", "model.json"), ("diagnose", *runs, *rig, "--json"))
    assert "coulomb_joint2" in done.stdout
