import os
import pty
from pathlib import Path

import pytest

from dpr_lab.transports.software_link import leads_to_software


@pytest.mark.parametrize(
    "url",
    [
        "sim://?plant=paper",
        "serial:///dev/pts/5?baud=921600",
        "can://slcan/dev/pts/5",
        "socket://127.0.0.1:5555",
        "socket://localhost:5555",
        "socket://[::1]:5555",
        "can://virtual/dpr",
        "can://virtual",
        "can://socketcan/vcan0",
    ],
)
def test_links_inside_this_computer_can_lead_to_software(url: str) -> None:
    assert leads_to_software(url)


@pytest.mark.parametrize(
    "url",
    [
        "serial:///dev/ttyACM0",
        "serial://COM3",
        "serial:///dev/ttyACM*?uid=51d000000001",
        "serial://?uid=51d000000001",
        "can://slcan/dev/ttyACM0",
        "can://slcan?uid=51d000000001",
        "can://socketcan/can0",
        "can://pcan/PCAN_USBBUS1",
        "socket://192.168.1.20:5555",
        "socket://rig.example.org:5555",
        "loop",
        "other://place",
    ],
)
def test_ports_adapters_and_other_computers_cannot(url: str) -> None:
    assert not leads_to_software(url)


def test_a_pseudo_terminal_is_known_behind_any_name(tmp_path: Path) -> None:
    device, host = pty.openpty()
    try:
        (tmp_path / "ttyA").symlink_to(os.ttyname(host))
        assert leads_to_software(f"serial://{tmp_path}/ttyA")
        assert leads_to_software(f"can://slcan{tmp_path}/tty*?uid=beef")
        (tmp_path / "ttyB").symlink_to("/dev/ttyACM0")
        assert not leads_to_software(f"serial://{tmp_path}/tty*?uid=beef")
    finally:
        os.close(device)
        os.close(host)
