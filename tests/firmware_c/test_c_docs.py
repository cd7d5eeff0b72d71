"""The porting guide agrees with the sources."""

import re
from pathlib import Path

import firmware_protocol
from dpr_lab.transports.can_bus import CAN
from dpr_lab.transports.serial_port import SERIAL
from dpr_lab.transports.transport import Capacity

SOURCES = Path(firmware_protocol.__file__).parent / "c"
GUIDE = (Path(__file__).parents[2] / "docs" / "connect-your-device.md").read_text(encoding="utf-8")


def test_every_function_of_the_hal_is_explained():
    declared = re.findall(r"\b(hal_\w+)\(void \*port", (SOURCES / "hal.h").read_text(encoding="utf-8"))
    assert re.findall(r"^\| `(hal_\w+)` \|", GUIDE, flags=re.MULTILINE) == declared


def test_every_make_target_and_file_it_names_exists():
    makefile = (SOURCES / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"make -C firmware_protocol/c (\w+)", GUIDE):
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), target
    for name in re.findall(r"`(firmware_protocol/[\w./]+)`", GUIDE):
        assert (SOURCES.parents[1] / name).exists(), name


def test_the_rates_are_those_that_the_links_allow():
    rows = re.findall(r"^\| (\d+) \| (\d+) \| (\d+) \| (\d+) \|$", GUIDE, flags=re.MULTILINE)
    assert len(rows) == 4
    for baud, serial_hz, bitrate, can_hz in rows:
        assert Capacity("", int(baud), SERIAL.sample_bits, "").max_rate_hz == int(serial_hz)
        assert Capacity("", int(bitrate), CAN.sample_bits, "").max_rate_hz == int(can_hz)
