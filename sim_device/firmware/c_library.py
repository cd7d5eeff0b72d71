"""Reference firmware as a shared library, built by `make -C firmware_protocol/c` or compiled on first use."""

import hashlib
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from platformdirs import user_cache_path

import firmware_protocol
from dpr_lab.errors import ConfigError

FOLDER = Path(firmware_protocol.__file__).parent / "c"
BUILT = FOLDER / "build" / "libdpr.so"
"""Path of the library that the Makefile builds."""

CHOSEN = "DPR_FIRMWARE_LIBRARY"
"""Environment variable with the path of another build, such as one with sanitizers."""

FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared")
COMPILERS = ("cc", "gcc", "clang")


def library_path() -> Path:
    """Return the path of the library for the current sources.

    Raises:
        ConfigError: the library must be compiled, but there is no C compiler or the compiler failed.
    """
    if chosen := os.environ.get(CHOSEN):
        return Path(chosen)
    if BUILT.is_file() and BUILT.stat().st_mtime >= max(path.stat().st_mtime for path in _sources(".[ch]")):
        return BUILT
    cached = user_cache_path("dpr-lab") / "firmware" / f"libdpr-{_source_hash()}.so"
    if not cached.is_file():
        compile_to(cached)
    return cached


def compile_to(target: Path, *flags: str) -> None:
    """Compile core and host port to a library; the file is written atomically.

    Raises:
        ConfigError: there is no C compiler, or the compiler failed.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        fresh = Path(folder) / target.name
        done = subprocess.run(
            [_compiler(), *FLAGS, *flags, "-o", fresh, *_sources(".c")], capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise ConfigError(f"{FOLDER}: the firmware did not compile:\n{done.stderr.strip()}")
        os.replace(fresh, target)


def _compiler() -> str:
    for name in (os.environ.get("CC", ""), *COMPILERS):
        if compiler := shutil.which(name):
            return compiler
    raise ConfigError(
        "the firmware in C needs a C compiler and none was found (cc, gcc, clang): install one (Debian: apt install"
        " gcc), or use the firmware in Python"
    )


def _sources(ending: str) -> list[Path]:
    folders = (FOLDER, FOLDER / "generated", FOLDER / "ports" / "host")
    return [path for folder in folders for path in sorted(folder.glob(f"*{ending}"))]


def _source_hash() -> str:
    digest = hashlib.sha256(" ".join(FLAGS).encode())
    for path in _sources(".[ch]"):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]
