"""Fixtures that run the command line in another process and return its output and exit code."""

import json
import os
import pty
import re
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import pytest

from tests.pages import ROOT, blocks
from tests.schemas import validator
from tests.warm_process import started


@dataclass(frozen=True)
class Done:
    code: int
    out: str
    err: str

    @property
    def json(self) -> dict[str, Any]:
        return json.loads(self.out)


Cli = Callable[..., Done]
MadeOnce = Callable[[str, Callable[[Path], None]], Path]


def command(*arguments: object, cwd: Path | None = None, stdin: str = "") -> Done:
    """Run a command in a separate process until it ends."""
    words, pipe = list(map(str, arguments)), subprocess.PIPE
    with started("dpr_lab", words, cwd=cwd, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as process:
        out, err = process.communicate(stdin)
    validate_printed(words, out)
    return Done(process.returncode, out, err)


SCHEMA_OF = {
    "diagnose": "diagnosis",
    "identify": "model",
    "check": "check",
    "certify": "certificate",
    "drift": "drift",
    "accept": "accept",
    "plan": "plan",
}


_strict = set[str]()
"""Schemas for which additional and missing keys were found to be refused."""


def validate_printed(words: list[str], out: str) -> None:
    """Validate the JSON output of all commands against the published schemas, except for errors."""
    name = SCHEMA_OF.get(words[1] if words[:1] == ["trials"] and len(words) > 1 else words[0]) if words else None
    if name is None or "--json" not in words or not out.startswith("{"):
        return
    try:
        printed = json.loads(out)
    except ValueError:  # broken off: the test says whether that is right
        return
    if set(printed) != {"error", "exit_code"}:
        validator(name).validate(printed)
        if name in _strict:
            return
        required = validator(name).schema.get("required", [])  # of a model there are two kinds
        changed = [printed | {"misspelt": 1}, *({k: v for k, v in printed.items() if k != key} for key in required)]
        assert not any(map(validator(name).is_valid, changed)), f"the schema {name} accepts other keys"
        _strict.add(name)


@pytest.fixture(scope="session")
def cli() -> Cli:
    return command


@pytest.fixture(scope="session")
def on_terminal() -> Callable[..., tuple[int, str]]:
    """Fixture (command, variables, actions) that returns the exit code and all output on a terminal, no colours.

    A `dpr-lab` without actions is forked from the process with the libraries loaded.
    """

    def shown(
        command: list[str], variables: dict[str, str], meanwhile: Callable[[int], None] | None = None
    ) -> tuple[int, str]:
        master, slave = pty.openpty()
        environment = {**os.environ, "TERM": "xterm", **variables}
        start, words = subprocess.Popen, command
        if command[:3] == [sys.executable, "-m", "dpr_lab"] and meanwhile is None:
            start, words = partial(started, "dpr_lab"), command[3:]
        process = start(words, stdin=subprocess.DEVNULL, stdout=slave, stderr=slave, env=environment)
        os.close(slave)
        came: list[bytes] = []
        reader = threading.Thread(target=_read_all, args=(master, came))
        reader.start()
        if meanwhile is not None:
            meanwhile(process.pid)
        code = process.wait()
        reader.join()
        os.close(master)
        return code, re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", b"".join(came).decode())

    return shown


def _read_all(master: int, came: list[bytes]) -> None:
    while True:
        try:
            piece = os.read(master, 65536)
        except OSError:  # nobody has the terminal open any more
            return
        if not piece:
            return
        came.append(piece)


@pytest.fixture(scope="session")
def after_work() -> Callable[[int, float], bool]:
    """Fixture (process, s) that waits until `dpr-lab` has used this CPU time, and returns whether it still runs."""

    def wait(pid: int, work_s: float) -> bool:
        began: float | None = None
        while True:
            stat = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            if stat[0] == "Z":
                return False
            worked = (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")
            if began is None and _catches(pid, signal.SIGTERM):
                began = worked
            if began is not None and worked - began >= work_s:
                return True
            time.sleep(0.002)

    return wait


def _catches(pid: int, number: int) -> bool:
    status = Path(f"/proc/{pid}/status").read_text()
    return bool(int(status.partition("SigCgt:")[2].split()[0], 16) >> (number - 1) & 1)


@pytest.fixture(scope="session")
def quickstart(cli: Cli, made_once: MadeOnce) -> Path:
    """Folder in which the first commands of the README were run, with a seeded plant and releases of 5 s."""
    steps = next(block.text for block in blocks(ROOT / "README.md") if block.text.startswith("dpr-lab doctor"))
    steps = steps.replace("clock=fast'", "clock=fast&seed=3'").replace(
        "--pose X3 --out", "--pose X3 --duration 5 --out"
    )

    def run(folder: Path) -> None:
        for line in steps.splitlines():
            _, *words = shlex.split(line.replace(" runs/", f" {folder}/runs/"))
            files = [sorted(map(str, Path("/").glob(word[1:]))) if "*" in word else [word] for word in words]
            done = cli(*chain.from_iterable(files), cwd=folder)
            assert done.code == 0, done.err

    return made_once("quickstart", run)


@pytest.fixture(scope="session")
def runs(quickstart: Path) -> list[Path]:
    """Three releases of one seeded plant over the serial protocol, 5 s each."""
    return [next((quickstart / "runs").glob(f"*_{pose}_*.mcap")) for pose in ("X1", "X2", "X3")]


@pytest.fixture(scope="session")
def model(quickstart: Path) -> Path:
    """Model identified from these releases."""
    return quickstart / "model.json"
