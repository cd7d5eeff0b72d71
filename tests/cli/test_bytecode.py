"""Bytecode of libraries installed without it, in an environment that forbids writing it next to the source."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import sys
from dpr_lab.cli import bytecode
bytecode.PACKAGES = ("library",)
bytecode.keep_bytecode()
import library
print(sys.pycache_prefix, library.__cached__)
"""


def kept(folder: Path, **environment: str) -> tuple[str, str]:
    """Folder of bytecode of a process that imports a library, and the bytecode file of this library."""
    (folder / "library").mkdir(exist_ok=True)
    (folder / "library" / "__init__.py").touch()
    own = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    own |= {"PYTHONPATH": os.pathsep.join([str(folder), str(Path(__file__).parents[2])]), **environment}
    own["XDG_CACHE_HOME"] = str(folder / "cache")
    run = subprocess.run([sys.executable, "-c", PROGRAM], env=own, capture_output=True, text=True, check=True)
    prefix, cached = run.stdout.split()
    return prefix, cached


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="names the cache folder by XDG_CACHE_HOME")
@pytest.mark.slow
def test_bytecode_goes_to_the_cache_where_none_may_be_written_next_to_the_source(tmp_path: Path) -> None:
    prefix, cached = kept(tmp_path, PYTHONDONTWRITEBYTECODE="1")
    assert Path(prefix).parent == tmp_path / "cache" / "dpr-lab" / "bytecode"
    assert Path(cached).is_file()
    assert Path(cached).is_relative_to(prefix)
    assert Path(prefix).stat().st_mode & 0o077 == 0


@pytest.mark.slow
def test_bytecode_stays_where_python_keeps_it_otherwise(tmp_path: Path) -> None:
    assert kept(tmp_path)[0] == "None"
    assert Path(kept(tmp_path)[1]).is_relative_to(tmp_path / "library")
    assert kept(tmp_path, PYTHONDONTWRITEBYTECODE="1")[0] == "None"  # it is there by now


@pytest.mark.slow
def test_a_folder_that_the_user_names_is_kept(tmp_path: Path) -> None:
    assert kept(tmp_path, PYTHONDONTWRITEBYTECODE="1", PYTHONPYCACHEPREFIX=str(tmp_path / "own"))[0] == str(
        tmp_path / "own"
    )
