"""Ports of a cluster execute code of any peer: the recipe opens none to the network, and open ones cause a warning."""

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dpr_lab.trials.workers import exposure

ROOT = Path(__file__).parents[2]
LISTENING = "0A"


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:8786", "tcp://localhost:8786", "tcp://[::1]:1", "tls://10.0.0.1:8786"]
)
def test_own_interface_and_tls_need_no_warning(address: str) -> None:
    assert exposure(address) is None


@pytest.mark.parametrize("address", ["tcp://10.0.0.1:8786", "tcp://0.0.0.0:8786", "tcp://lab-pc:8786"])
def test_what_the_network_reaches_is_warned_of(address: str) -> None:
    assert "can run any code" in (exposure(address) or "")


def recipe() -> list[str]:
    """Commands of the page Reliability that start a scheduler and workers on this machine."""
    page = (ROOT / "docs" / "reliability.md").read_text()
    return re.findall(r"^(dask (?:scheduler|worker) .*127\.0\.0\.1.*)$", page, re.MULTILINE)


def listeners(group: int) -> set[str]:
    """Local addresses, hexadecimal, on which the processes of a group listen."""
    inodes: set[str] = set()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            if int(stat.read_text().rpartition(")")[2].split()[2]) == group:
                inodes |= {os.readlink(link) for link in (stat.parent / "fd").iterdir()}
        except OSError:
            continue
    result: set[str] = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for row in Path(table).read_text().splitlines()[1:]:
            fields = row.split()
            if fields[3] == LISTENING and f"socket:[{fields[9]}]" in inodes:
                result.add(fields[1].partition(":")[0])
    return result


def test_every_address_of_the_recipe_is_this_machine() -> None:
    commands = recipe()
    assert [command.split()[1] for command in commands] == ["scheduler", "worker"]
    for command in commands:
        words = shlex.split(command)
        assert words[words.index("--host") + 1] == "127.0.0.1"
        assert words[words.index("--dashboard-address") + 1].startswith("127.0.0.1:")
    assert exposure(words[2]) is None


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="needs /proc to see who listens")
def test_the_recipe_listens_on_this_machine_alone(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="dask.distributed is not installed")
    processes: list[subprocess.Popen[bytes]] = []
    try:
        for command, port in zip(recipe(), ("--port 18786", ""), strict=True):
            _, kind, *words = shlex.split(command.replace(":8786", ":18786").replace(":8787", ":0") + f" {port}")
            run = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *words]
            with (tmp_path / kind).open("wb") as log:
                processes.append(subprocess.Popen(run, stdout=log, stderr=log, start_new_session=True, cwd=tmp_path))
            deadline = time.monotonic() + 120
            marker = b"Scheduler at" if kind == "scheduler" else b"Registered to"
            while marker not in (tmp_path / kind).read_bytes():
                assert time.monotonic() < deadline
                assert processes[-1].poll() is None, (tmp_path / kind).read_text()
                time.sleep(0.2)
            result = listeners(processes[-1].pid)
            assert result == {"0100007F"}, kind
    finally:
        for process in reversed(processes):
            os.killpg(process.pid, signal.SIGTERM)
            process.wait(60)
