from pathlib import Path
from types import SimpleNamespace

import pytest

from dpr_lab.transports import discover as module


def test_discover_opens_nothing_and_knows_the_backends() -> None:
    links = module.discover()
    assert {"slcan", "socketcan", "virtual"} <= set(links.can_backends)


def test_can_interfaces_are_those_of_the_can_type(tmp_path: Path) -> None:
    for name, kind in {"can1": "280", "eth0": "1", "can0": "280"}.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "type").write_text(f"{kind}\n")
    assert module.can_interfaces(tmp_path) == ("can0", "can1")
    assert module.can_interfaces(tmp_path / "none") == ()


def test_ports_that_are_not_files_match_a_name_or_a_pattern(monkeypatch: pytest.MonkeyPatch) -> None:
    ports = tuple(module.SerialPortFound(f"COM{n}", "", "", "") for n in (3, 4))
    monkeypatch.setattr(module, "serial_ports", lambda: ports)
    assert module.matching_ports("COM3") == ["COM3"]
    assert module.matching_ports("COM*") == ["COM3", "COM4"]


def test_forbidden_port_is_reported_with_the_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    port = tmp_path / "ttyUSB0"
    port.touch()
    result = SimpleNamespace(device=str(port), description="FTDI", serial_number="A1")
    monkeypatch.setattr(module.list_ports, "comports", lambda: [result])
    monkeypatch.setattr(module.os, "access", lambda path, mode: False)
    (listed,) = module.serial_ports()
    assert (listed.device, listed.description, listed.serial_number) == (str(port), "FTDI", "A1")
    assert "usermod -aG dialout" in listed.problem
    monkeypatch.setattr(module.os, "access", lambda path, mode: True)
    assert module.serial_ports()[0].problem == ""
