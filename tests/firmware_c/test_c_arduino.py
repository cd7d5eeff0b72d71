"""Arduino sketch in C++: it compiles without a warning, links with the C core, and conforms to the protocol."""

import os
import pty
import shutil
import subprocess
import tty
from pathlib import Path

import pytest

import firmware_protocol
from dpr_lab.acquisition.conformance import ConformanceSettings, conformity
from dpr_lab.transports import open_transport

CORE = Path(firmware_protocol.__file__).parent / "c"
HERE = Path(__file__).parent / "arduino"
STRICT = ("-Wall", "-Wextra", "-Werror", "-O1")


@pytest.fixture(scope="session")
def sketch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sketch as its page says to lay it out, built for this computer."""
    for tool in ("cc", "c++"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")
    folder = tmp_path_factory.mktemp("arduino")
    shutil.copy(CORE / "ports" / "arduino" / "arduino.ino", folder)
    shutil.copytree(CORE, folder / "src" / "dpr", ignore=shutil.ignore_patterns("ports", "build"))
    core = sorted(str(path) for path in (folder / "src" / "dpr").rglob("*.c"))
    build("cc", "-std=c99", *STRICT, "-c", *core, cwd=folder)
    objects = sorted(path.name for path in folder.glob("*.o"))
    cpp = ("c++", "-std=c++11", *STRICT, "-I", str(HERE))
    build(*cpp, "-x", "c++", "-c", "arduino.ino", "-o", "sketch.out", cwd=folder)
    build(*cpp, str(HERE / "computer.cpp"), "-x", "none", "sketch.out", *objects, "-o", "board", cwd=folder)
    return folder / "board"


def build(*words: str, cwd: Path) -> None:
    done = subprocess.run(words, cwd=cwd, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_sketch_keeps_to_the_protocol(sketch: Path) -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    board = subprocess.Popen([sketch], stdin=master, stdout=master)
    try:
        link = open_transport(f"serial://{os.ttyname(slave)}?baud=921600")
        try:
            patient = ConformanceSettings(patience_s=60.0, rate_off=0.5, reports_hz=(1.0, 30.0))
            result = list(conformity(link, patient))
        finally:
            link.close()
    finally:
        board.kill()
        board.wait()
        os.close(master)
        os.close(slave)
    # Whether every tick was in time is this computer's affair.
    assert [(one.what, one.message) for one in result if not one.ok and "tick" not in one.what] == []
    assert len(result) >= 15
