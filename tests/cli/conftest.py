"""Runs of the command line as a user runs it: another process, its output and its exit code."""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest


@dataclass(frozen=True)
class Done:
    code: int
    out: str
    err: str

    @property
    def json(self) -> dict[str, Any]:
        return json.loads(self.out)


Cli = Callable[..., Done]


def run_cli(*arguments: object, cwd: Path | None = None, stdin: str = "") -> Done:
    done = subprocess.run(
        [sys.executable, "-m", "dpr_lab", *map(str, arguments)],
        capture_output=True,
        text=True,
        input=stdin,
        timeout=150,
        cwd=cwd,
        check=False,
    )
    return Done(done.returncode, done.stdout, done.stderr)


@pytest.fixture(scope="session")
def cli() -> Cli:
    return run_cli


@pytest.fixture(scope="session")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Three releases of one seeded plant over the serial protocol."""
    out = tmp_path_factory.mktemp("runs")
    poses = [word for pose in ("X1", "X2", "X3") for word in ("--pose", pose)]
    done = run_cli("capture", "--rig", "paper", "--link", "sim://?clock=fast&seed=3", *poses, "--out", out, "--json")
    assert done.code == 0, done.err
    return [Path(run["file"]) for run in done.json["runs"]]


@pytest.fixture(scope="session")
def model(runs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("model") / "model.json"
    done = run_cli("identify", *runs, "--rig", "paper", "--out", out, "--json")
    assert done.code == 0, done.err
    return out
