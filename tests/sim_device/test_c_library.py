"""Compiling the firmware in C on first use."""

import os
import subprocess
import sys

import pytest

from dpr_lab.errors import ConfigError
from sim_device.firmware import c_library


@pytest.fixture
def fresh(tmp_path, monkeypatch):
    """Module without a previously built library."""
    monkeypatch.setattr(c_library, "BUILT", tmp_path / "none")
    monkeypatch.setattr(c_library, "user_cache_path", tmp_path.joinpath)
    monkeypatch.delenv(c_library.CHOSEN, raising=False)
    try:
        c_library.library_path()
    except ConfigError as error:
        pytest.skip(str(error))
    return c_library


@pytest.mark.slow
def test_without_a_compiler_it_says_what_to_install(tmp_path):
    code = f"""
import pathlib
import sim_device.firmware.c_library as library
library.BUILT = pathlib.Path({str(tmp_path / "none")!r})
library.user_cache_path = pathlib.Path({str(tmp_path)!r}).joinpath
from sim_device.__main__ import main
raise SystemExit(main(["--firmware", "c", "--link", "tcp:0"]))
"""
    environment = {**os.environ, "PATH": str(tmp_path), "CC": ""}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=400)
    assert done.returncode == ConfigError.exit_code
    assert "needs a C compiler and none was found" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_it_is_compiled_once_and_again_when_the_sources_change(fresh, monkeypatch):
    first = fresh.library_path()
    written = first.stat().st_mtime_ns
    assert fresh.library_path() == first
    assert first.stat().st_mtime_ns == written
    monkeypatch.setattr(fresh, "FLAGS", (*fresh.FLAGS, "-DANOTHER"))
    assert fresh.library_path() != first


@pytest.mark.slow
def test_what_make_built_is_taken_until_a_source_is_newer(fresh, monkeypatch, tmp_path):
    built = tmp_path / "build" / "libdpr.so"
    fresh.compile_to(built)
    monkeypatch.setattr(fresh, "BUILT", built)
    assert fresh.library_path() == built
    os.utime(built, (0, 0))
    assert fresh.library_path() != built


@pytest.mark.slow
def test_sources_that_do_not_compile_are_named(fresh, tmp_path):
    with pytest.raises(ConfigError, match="did not compile"):
        fresh.compile_to(tmp_path / "broken" / "lib.so", "-include", "no-such-header.h")
    assert list((tmp_path / "broken").iterdir()) == []
