"""The C core under the address and undefined-behaviour sanitizers, through every test that needs no Cortex-M."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
FILES = [HERE / name for name in ("test_c_wire.py", "test_c_traces.py", "test_c_safety.py")]


def runtime(name: str) -> str:
    """The sanitizer's own library, which has to come before everything else."""
    compiler = os.environ.get("CC", "cc")
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    stdout = subprocess.run([compiler, f"-print-file-name={name}"], capture_output=True, text=True, check=True).stdout
    if not Path(stdout.strip()).is_file():
        pytest.skip(f"{compiler} has no {name}")
    return stdout.strip()


def sanitized(library: Path, *command: str) -> subprocess.CompletedProcess[str]:
    environment = {
        **os.environ,
        "LD_PRELOAD": runtime("libasan.so"),
        "ASAN_OPTIONS": "detect_leaks=0:abort_on_error=1",  # Python leaves what it once took to the system
        "UBSAN_OPTIONS": "print_stacktrace=1",
        "PYTHONMALLOC": "malloc",
        "DPR_FIRMWARE_LIBRARY": str(library),
    }
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=170, check=False)


@pytest.mark.long
def test_nothing_is_read_or_written_out_of_bounds(make):
    library = make("sanitized", "cc") / "libdpr_sanitized.so"
    options = ["-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", "not slow"]
    done = sanitized(library, sys.executable, "-m", "pytest", *options, *map(str, FILES))
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    assert " passed" in done.stdout
    assert "skipped" not in done.stdout


@pytest.mark.long
def test_the_sanitizers_are_there_and_would_see_it(make):
    library = make("sanitized", "cc") / "libdpr_sanitized.so"
    code = """
import ctypes, os
library = ctypes.CDLL(os.environ["DPR_FIRMWARE_LIBRARY"])
library.dpr_crc16(ctypes.create_string_buffer(600), ctypes.c_size_t(601))
"""
    done = sanitized(library, sys.executable, "-c", code)
    assert done.returncode != 0
    assert "heap-buffer-overflow" in done.stderr
