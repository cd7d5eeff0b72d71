"""Compiling the firmware in C on first use."""

import os

import pytest

from dpr_lab.errors import ConfigError
from sim_device.firmware import c_firmware, c_library


@pytest.fixture
def empty(tmp_path, monkeypatch):
    """Module without a previously built library."""
    monkeypatch.setattr(c_library, "BUILT", tmp_path / "none")
    monkeypatch.setattr(c_library, "user_cache_path", tmp_path.joinpath)
    monkeypatch.delenv(c_library.CHOSEN, raising=False)
    return c_library


@pytest.fixture
def fresh(empty, monkeypatch):
    """The same on a computer with a compiler, which does not optimise: this takes less than half of the time."""
    try:
        empty._compiler()
    except ConfigError as error:
        pytest.skip(str(error))
    monkeypatch.setattr(empty, "FLAGS", tuple(flag for flag in empty.FLAGS if flag != "-O2"))
    return empty


def test_without_a_compiler_the_message_names_what_to_install(empty, program, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("CC", "")
    monkeypatch.setattr(c_firmware, "load", c_firmware.load.__wrapped__)  # not the library that other tests use
    done = program("--firmware", "c", "--link", "tcp:0")
    assert done.code == ConfigError.exit_code
    assert "needs a C compiler and none was found" in done.err


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
