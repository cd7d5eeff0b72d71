"""One test for each sentence about safety and trust."""

import ast
import json
import pickle
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dpr_lab.acquisition.capture import CaptureOptions, capture
from dpr_lab.acquisition.device import Device
from dpr_lab.configs import read_config
from dpr_lab.errors import DprError, LinkError, SafetyStop
from dpr_lab.rig import Rig, load_rig
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.reader import load_run
from dpr_lab.transports import open_transport
from firmware_protocol.messages import NUMBERS, Hello, Ping, Release, State, Status
from sim_device.links.tcp_port import TcpServerPort
from tests.house import PACKAGES, tree_of

ROOT = Path(__file__).parents[1]
SOURCES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def containing(words: str) -> list[Path]:
    """Sources that contain some of these words. Only they need to be parsed."""
    return [path for path in SOURCES if re.search(words, path.read_text(encoding="utf-8"))]


def status_of(device: Device) -> Status:
    """Next STATUS of the device."""
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        result = [message for batch in device.poll(0.2) for message in batch.messages if isinstance(message, Status)]
        if result:
            return result[-1]
    raise AssertionError("the device says nothing")


def never() -> bool:
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("device", "options", "confirm"),
    [
        ({"hand_error": 0.3}, {"pose_timeout": 0.6}, lambda: True),
        ({"plant": "shaky"}, {"rest_timeout": 0.6}, lambda: True),
        ({}, {}, lambda: False),
        ({}, {}, never),
        ({"fault": ("reset_after_s=0.1",)}, {}, lambda: True),
    ],
    ids=["off the pose", "not at rest", "no go-ahead", "interrupted", "device restarted"],
)
def test_only_an_explicit_release_after_passed_checks_sends_release(
    device: dict[str, Any],
    options: dict[str, Any],
    confirm: Callable[[], bool],
    paper: Rig,
    tmp_path: Path,
    simulated,
    spy_on,
) -> None:
    if device.get("plant") == "shaky":
        device = {"plant": str(_shaky(tmp_path))}
    spy = spy_on(open_transport(simulated(**device).url))
    with Device(spy) as connected:
        connected.connect()
        with pytest.raises((DprError, KeyboardInterrupt)):
            capture(connected, paper, "X1", CaptureOptions(**options), tmp_path / "runs", confirm=confirm)
    assert NUMBERS[Release] not in spy.sent
    assert not list((tmp_path / "runs").glob("*"))


def _shaky(folder: Path) -> Path:
    """Plant `paper` with an encoder noise far above that of a rod at rest."""
    from sim_device.plant.config import BUILTIN

    text = (BUILTIN / "plants" / "paper.toml").read_text(encoding="utf-8")
    path = folder / "shaky.toml"
    path.write_text(_with_noise(text), encoding="utf-8")
    return path


def _with_noise(text: str) -> str:
    lines = [line for line in text.splitlines() if not line.startswith("noise_counts")]
    at = next((n for n, line in enumerate(lines) if line.strip() == "[encoders]"), None)
    if at is None:
        return "\n".join([*lines, "[encoders]", "noise_counts = 50", ""])
    return "\n".join([*lines[: at + 1], "noise_counts = 50", *lines[at + 1 :], ""])


def test_release_is_sent_from_one_place() -> None:
    callers = [
        (path.relative_to(ROOT).as_posix(), node.lineno)
        for path in containing("Release|release")
        if path.is_relative_to(ROOT / "dpr_lab")
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.Call)
        and (
            (isinstance(node.func, ast.Name) and node.func.id == "Release")
            or (
                isinstance(node.func, ast.Attribute)
                and node.func.attr == "release"
                and isinstance(node.func.value, ast.Name)
                and node.func.value.id == "device"
            )
        )
    ]
    places = ["dpr_lab/acquisition/device.py", "dpr_lab/acquisition/swing.py"]
    conformance = "dpr_lab/acquisition/conformance.py"  # for a device without rods, as its operator has to say
    assert sorted(path for path, _ in callers) == sorted([*places, conformance])


def test_losing_the_host_keeps_the_latch(simulated) -> None:
    url = simulated(clock="realtime").url
    with Device(open_transport(url)) as host:
        host.connect()
        host.hold(1)
        host.stream(1000)
        assert status_of(host).latched
    with Device(open_transport(url), read_only=True) as later:
        later.connect()
        status = status_of(later)
        while status.state is State.STREAMING:  # until the lease has run out
            status = status_of(later)
    assert (status.state, status.latched) == (State.HOLDING, True)


@pytest.mark.parametrize("address", ["0.0.0.0:0", "192.0.2.1:0", "example.org:0", "[::]:0"])
def test_tcp_links_listen_on_this_machine_only(address: str) -> None:
    with pytest.raises(LinkError, match="listens on this machine only"):
        TcpServerPort(address)
    port = TcpServerPort("0")
    try:
        assert port._server.getsockname()[0] == "127.0.0.1"
    finally:
        port.close()


@pytest.mark.slow
def test_nothing_else_listens() -> None:
    listening = [
        path.relative_to(ROOT).as_posix()
        for path in containing("bind|create_server|start_server")
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.Attribute) and node.attr in ("bind", "create_server", "start_server")
    ]
    assert listening == ["sim_device/links/tcp_port.py"]


RUNS_CODE = {"eval", "exec", "compile", "__import__"}
LOADS_CODE = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "joblib", "yaml"}
MAKES_ITS_OWN_SOURCE = {"dpr_lab/effects/fold.py"}
"""Joins the kernels of the effects, by their names in our own table, into one function."""


def test_no_source_runs_what_a_file_says() -> None:
    result: set[str] = set()
    for path in containing("|".join((*RUNS_CODE, *LOADS_CODE, "shell", "allow_pickle"))):
        name = path.relative_to(ROOT).as_posix()
        for node in ast.walk(tree_of(path)):
            match node:
                case ast.Call(func=ast.Name(id=called)) if called in RUNS_CODE:
                    result.add(name)
                case ast.Import(names=names) if LOADS_CODE & {alias.name.split(".")[0] for alias in names}:
                    result.add(name)
                case ast.ImportFrom(module=str(module)) if module.split(".")[0] in LOADS_CODE:
                    result.add(name)
                case ast.keyword(arg="shell" | "allow_pickle", value=ast.Constant(value=True)):
                    result.add(name)
                case _:
                    pass
    assert result <= MAKES_ITS_OWN_SOURCE


class Bomb:
    """Object whose loading from a pickle runs code."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> tuple[Any, ...]:
        return (Path.touch, (self.trace,))


def test_a_file_that_carries_code_is_refused_and_not_run(paper: Rig, tmp_path: Path) -> None:
    trace, bomb = tmp_path / "ran", tmp_path / "bomb"
    bomb.write_bytes(pickle.dumps(Bomb(trace)))
    readers: list[Callable[[], Any]] = [
        lambda: load_run(bomb),
        lambda: import_csv(bomb, paper, ImportOptions(), tmp_path / "out.mcap"),
        lambda: load_rig(bomb),
        lambda: read_config(bomb, Rig),
    ]
    for read in readers:
        with pytest.raises(DprError):
            read()
    assert not trace.exists()
    pickle.loads(bomb.read_bytes())
    assert trace.exists()  # it would have been seen


def test_a_release_cannot_be_triggered_from_a_read_only_view(simulated, spy_on) -> None:
    url = simulated().url
    with Device(open_transport(url)) as host:
        host.connect()
        host.hold(1)
    spy = spy_on(open_transport(url))
    with Device(spy, read_only=True) as view:
        view.connect()
        for command in (view.release, view.hold, view.stop, lambda: view.stream(100)):
            with pytest.raises(SafetyStop, match="was not sent"):
                command()
        status = status_of(view)
    assert set(spy.sent) <= {NUMBERS[Hello], NUMBERS[Ping]}
    assert (status.state, status.latched) == (State.HOLDING, True)


def test_doctor_changes_nothing(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], simulated) -> None:
    from dpr_lab.cli import main

    url = simulated().url
    with Device(open_transport(url)) as host:
        host.connect()
        host.hold(1)
    monkeypatch.setattr("sys.argv", ["dpr-lab", "doctor", "--link", url, "--rig", "paper", "--json"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    with Device(open_transport(url), read_only=True) as view:
        view.connect()
        assert status_of(view).state is State.HOLDING
    assert json.loads(capsys.readouterr().out)["findings"][-1]["state"] == "ok"
