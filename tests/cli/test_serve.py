"""`dpr-lab serve --stdio` from another program: requests on lines, and responses in any order."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from dpr_lab.workflows.service import METHODS
from tests.warm_process import started

pytestmark = pytest.mark.slow


class Client:
    """Client of the service on the other end of the streams; `fresh`: nothing of it is forked."""

    def __init__(self, folder: Path, fresh: bool = False) -> None:
        pipe, words = subprocess.PIPE, ["serve", "--stdio"]
        if fresh:
            command = [sys.executable, "-m", "dpr_lab", *words]
            self.process = subprocess.Popen(command, cwd=folder, stdin=pipe, stdout=pipe)
        else:
            self.process = started("dpr_lab", words, cwd=folder, stdin=pipe, stdout=pipe)
        self.received: list[dict[str, Any]] = []

    def write(self, line: bytes) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(line + b"\n")
        self.process.stdin.flush()

    def request(self, identifier: Any, method: str, **params: Any) -> None:
        self.write(json.dumps({"jsonrpc": "2.0", "id": identifier, "method": method, "params": params}).encode())

    def next(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        message = json.loads(self.process.stdout.readline())
        assert message.pop("jsonrpc") == "2.0"
        self.received.append(message)
        return message

    def response(self, identifier: Any) -> dict[str, Any]:
        """Wait for the response to a request; earlier messages are stored."""
        while "id" not in (message := self.next()) or message["id"] != identifier:
            pass
        return message

    def until(self, event: str) -> None:
        """Wait for a progress event."""
        while self.next().get("params", {}).get("event") != event:
            pass

    def job_process(self) -> int:
        """Number of the process that runs the jobs."""
        listed = subprocess.run(
            ["ps", "-ww", "-e", "-o", "pid=,ppid=,args="], capture_output=True, text=True, check=True
        )
        rows = [line.split(None, 2) for line in listed.stdout.splitlines()]
        own = [row for row in rows if int(row[1]) == self.process.pid]
        (job,) = [int(row[0]) for row in own if "resource_tracker" not in row[2]]
        return job

    def close(self) -> None:
        """Close the stream of requests."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.stdin = None  # `communicate` would flush it

    def end(self) -> int:
        self.close()
        return self.process.wait(300)


@pytest.fixture
def client(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Client]:
    started = Client(tmp_path, fresh=getattr(request, "param", False))
    yield started
    started.process.kill()
    started.process.communicate()


MALFORMED = [
    (b"{", -32700, "is not JSON"),
    (b"\xff\xfe", -32700, "is not JSON"),
    (b'{"jsonrpc": "2.0", "id": 1, "method": "status", "params": {"x": NaN}}', -32700, "NaN"),
    (b"[" * 100_000, -32700, "is not JSON"),
    (b" " * (2 << 20), -32700, "longer than 1 MB"),
    (b"[]", -32600, "batches"),
    (b"1", -32600, "an object"),
    (b'{"id": 1, "method": "status"}', -32600, '"jsonrpc": "2.0"'),
    (b'{"jsonrpc": "2.0", "id": 1, "method": 3}', -32600, '"method"'),
    (b'{"jsonrpc": "2.0", "id": [1], "method": "status"}', -32600, '"id"'),
    (b'{"jsonrpc": "2.0", "id": 1, "method": "release"}', -32601, "no method 'release'"),
    (b'{"jsonrpc": "2.0", "id": 1, "method": "identify", "params": [1]}', -32602, "named parameters"),
    (b'{"jsonrpc": "2.0", "id": 1, "method": "identify", "params": {"runz": 1}}', -32602, "unknown parameter 'runz'"),
    (b'{"jsonrpc": "2.0", "id": 1, "method": "identify", "params": {"runs": 3}}', -32602, "runs"),
    (b'{"jsonrpc": "2.0", "id": 1, "method": "identify", "params": {"runs": []}}', -32602, "missing parameter 'rig'"),
    (b'{"jsonrpc": "2.0", "id": 1, "method": "plan", "params": {"runs": "x", "rig": "paper"}}', -32602, "valid array"),
    (b'{"jsonrpc": "2.0", "id": 1, "method": "cancel", "params": {}}', -32602, "needs the id"),
]


def test_malformed_requests_get_errors_and_the_service_continues(client: Client) -> None:
    for line, code, words in MALFORMED:
        client.write(line)
        error = client.next()["error"]
        assert (error["code"], words in error["message"]) == (code, True), (line[:60], error)
        assert "Traceback" not in error["message"]
    client.write(b'{"jsonrpc": "2.0", "method": "release"}')  # a notification is never answered
    client.request("last", "status")
    status = client.next()
    assert status["id"] == "last"
    assert status["result"]["running"] is None
    assert {"identify", "diagnose", "status", "cancel"} <= set(status["result"]["methods"])
    assert client.end() == 0


def test_a_job_reports_progress_answers_as_the_command_does_and_is_finished_after_the_last_request(
    cli: Any, client: Client, runs: list[Path], model: Path, tmp_path: Path
) -> None:
    files = [str(run) for run in runs]
    client.request(1, "identify", runs=files, rig="paper", out=str(tmp_path / "model.json"))
    client.request(2, "identify", runs=["missing.mcap"], rig="paper", out="m.json")
    client.request(1, "identify", runs=files, rig="paper", out="twice.json")
    client.close()  # the end of the requests finishes the jobs
    assert "is not finished yet" in client.response(1)["error"]["message"]
    result = client.response(2)["error"]
    assert (result["code"], result["data"]) == (-32000, {"kind": "RunError", "exit_code": 3})
    progress = [message["params"] for message in client.received if message.get("method") == "progress"]
    assert {event["event"] for event in progress if event["id"] == 1} >= {"run", "generation", "fit"}
    (answer,) = [m["result"] for m in client.received if m.get("id") == 1 and "ratios" in m.get("result", {})]
    own = json.loads(model.read_text(encoding="utf-8"))["ratios"]["a/b"]["value"]
    assert answer["ratios"]["a/b"]["value"] == pytest.approx(own, rel=1e-9)
    assert (tmp_path / "model.json").is_file()
    assert client.process.wait(300) == 0


def test_jobs_are_cancelled_running_and_waiting_or_killed(client: Client, runs: list[Path]) -> None:
    files = [str(run) for run in runs]
    client.request("long", "diagnose", runs=files, rig="paper")
    client.request("next", "diagnose", runs=files, rig="paper")
    client.until("fit")
    for name in ("next", "long"):
        client.request(f"cancel {name}", "cancel", id=name)
    assert client.response("long")["error"]["code"] == -32800
    assert client.response("next")["error"]["code"] == -32800
    client.request("again", "cancel", id="long")
    assert client.response("again")["result"] == {"cancelled": False}
    client.request("after", "identify", runs=["missing.mcap"], rig="paper", out="m.json")
    assert client.response("after")["error"]["data"]["kind"] == "RunError"
    a_killed_job_is_answered_and_the_next_one_runs(client, files)


def a_killed_job_is_answered_and_the_next_one_runs(client: Client, files: list[str]) -> None:
    client.request("killed", "diagnose", runs=files, rig="paper")
    client.until("fit")
    os.kill(client.job_process(), signal.SIGKILL)
    error = client.response("killed")["error"]
    assert (error["code"], "ended unexpectedly" in error["message"]) == (-32000, True)
    client.request("next one", "identify", runs=["missing.mcap"], rig="paper", out="m.json")
    assert client.response("next one")["error"]["data"]["kind"] == "RunError"
    assert client.end() == 0


@pytest.mark.long
def test_a_job_cancelled_while_it_waits_does_not_run(client: Client, runs: list[Path], tmp_path: Path) -> None:
    files = [str(run) for run in runs]
    client.request("first", "identify", runs=files, rig="paper", out="first.json")
    client.request("second", "identify", runs=files, rig="paper", out="second.json")
    client.request("cancel", "cancel", id="second")
    assert client.response("second")["error"]["code"] == -32800
    assert (tmp_path / "first.json").is_file()
    assert not (tmp_path / "second.json").exists()
    assert client.end() == 0


@pytest.mark.parametrize("client", [True], ids=["a new process"], indirect=True)
def test_no_process_outlives_a_killed_service(client: Client, runs: list[Path]) -> None:
    client.request("long", "diagnose", runs=[str(run) for run in runs], rig="paper")
    client.until("fit")
    job = Path("/proc") / str(client.job_process())
    client.process.kill()
    ends = time.monotonic() + 60
    while job.exists() and "Z" not in (job / "stat").read_text().split()[2]:
        assert time.monotonic() < ends
        time.sleep(0.05)


def test_without_stdio_the_command_states_the_remedy(cli: Any) -> None:
    done = cli("serve")
    assert (done.code, "--stdio" in done.err) == (2, True)


def test_the_page_lists_every_parameter() -> None:
    page = (Path(__file__).parents[2] / "docs/how-to/serve.md").read_text(encoding="utf-8")
    rows = page.split("| parameter | method |")[1].split("\n\n")[0].splitlines()[2:]
    cells = [[cell.strip() for cell in row.split("|")[1:3]] for row in rows]
    for name, method in METHODS.items():
        listed = [names.strip("`").split("`, `") for names, of in cells if of in ("all", f"`{name}`")]
        known = [field.name for field in fields(method.request)]
        assert sorted(known) == sorted(one for names in listed for one in names)
