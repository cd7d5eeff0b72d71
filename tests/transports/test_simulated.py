import os
import signal
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest

from dpr_lab import kernel_cache
from dpr_lab.errors import DeviceLost, LinkError
from dpr_lab.transports import open_transport
from dpr_lab.transports.simulated import _arguments, compiles_first
from dpr_lab.transports.transport import Transport
from firmware_protocol.host_role import HostSession
from firmware_protocol.identity import DeviceInfo
from tests.thinned import thinned


def greet(link: Transport) -> DeviceInfo:
    session = HostSession()
    link.send(session.hello(time.monotonic()))
    deadline = time.monotonic() + 60
    while session.info is None:
        assert time.monotonic() < deadline
        for frame in link.receive(0.05).frames:
            session.receive(frame)
        for frame in session.due(time.monotonic()):
            link.send(frame)
    return session.info


def is_running(pid: int) -> bool:
    stat = Path(f"/proc/{pid}/stat")
    return stat.exists() and stat.read_text().rpartition(")")[2].split()[0] != "Z"


def wait_for_end(pid: int) -> bool:
    deadline = time.monotonic() + 60
    while is_running(pid) and time.monotonic() < deadline:
        time.sleep(0.02)
    return not is_running(pid)


@pytest.mark.slow
@pytest.mark.parametrize("bus", thinned(["can", "pty", "tcp"], 3))
def test_simulated_device_starts_answers_and_ends_with_its_transport(bus: str) -> None:
    link = open_transport(f"sim://?plant=paper&seed=1&clock=fast&bus={bus}&uid=c0ffee")
    child = link._child.pid
    with closing(link):
        assert greet(link).uid == "0000000000c0ffee"
        assert link.url.startswith("sim://")
        assert bool(link.capacities) == (bus != "tcp")
        assert set(link.errors) == {"crc", "framing"}
    assert not is_running(child)
    link.close()


@pytest.mark.slow
def test_child_that_dies_is_device_lost() -> None:
    with closing(open_transport("sim://?clock=fast")) as link:
        os.kill(link._child.pid, signal.SIGKILL)
        with pytest.raises(DeviceLost, match="the simulated device has ended"):
            _receive_for_ever(link)


def _receive_for_ever(link: Transport) -> None:
    while True:
        link.receive(0.1)


@pytest.mark.slow
def test_child_does_not_outlive_a_killed_parent() -> None:
    code = "import time; from dpr_lab.transports import open_transport as o; l = o('sim://?clock=fast');"
    code += "print(l._child.pid, flush=True); time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        assert is_running(child)
        parent.kill()
    assert wait_for_end(child)


@pytest.mark.long
def test_ctrl_c_at_the_terminal_does_not_reach_the_child() -> None:
    with closing(open_transport("sim://?clock=fast")) as link:
        assert os.getpgid(link._child.pid) != os.getpgid(os.getpid())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("query", "sentence"),
    [
        ("plant=nowhere", "did not start: .*nowhere"),
        pytest.param("fault=gremlins=1", "did not start: .*gremlins", marks=pytest.mark.long),
        pytest.param("rig=/no/such/rig.toml", r"did not start: .*rig\.toml", marks=pytest.mark.long),
    ],
)
def test_child_that_cannot_start_is_reported_with_the_reason(query: str, sentence: str) -> None:
    with pytest.raises(LinkError, match=sentence):
        open_transport(f"sim://?{query}")


@pytest.mark.parametrize(
    ("query", "sentence"),
    [
        ("bus=usb", "is not one of pty, can, tcp"),
        ("clock=slow", "is not one of realtime, fast"),
        ("seed=-1", "is not a positive whole number"),
        ("draw=maybe", "is not one of true, false"),
        ("plant=", "plant = '': is empty"),
    ],
)
def test_wrong_option_never_starts_a_child(query: str, sentence: str) -> None:
    with pytest.raises(LinkError, match=sentence):
        open_transport(f"sim://?{query}")


def test_simulated_device_has_no_address() -> None:
    with pytest.raises(LinkError, match="has no address"):
        open_transport("sim://localhost/paper")


def test_options_become_the_childs_command_line() -> None:
    options = {
        "bus": "can",
        "plant": "dry",
        "seed": 3,
        "draw": "true",
        "fault": "drop=0.01,flip=0.1",
        "hand_error": "0.2",
    }
    arguments = " ".join(_arguments(options, Path("my.toml")))
    assert arguments == (
        "--link slcan --rig my.toml --fault drop=0.01 --fault flip=0.1 --draw --plant dry --seed 3 --hand-error 0.2"
    )
    assert _arguments({"rig": "other"}, Path("my.toml")) == ["--link", "pty", "--rig", "other"]


def test_only_a_first_simulated_device_compiles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_cache, "CACHE", tmp_path)
    assert compiles_first("sim://?plant=paper")
    assert not compiles_first("serial:///dev/ttyACM0")
    kernel_cache.mark_simulator_compiled()
    assert not compiles_first("sim://?plant=paper")
