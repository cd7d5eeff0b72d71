"""The lock file names one version of everything that the project asks for."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def name(requirement: str) -> str:
    return re.split(r"[\[<>=!;~ ]", requirement)[0].lower().replace("_", "-")


def test_the_lock_file_covers_the_project() -> None:
    lines = (ROOT / "requirements-dev.lock").read_text(encoding="utf-8").splitlines()
    pinned = [line for line in lines if not line.startswith("#")]
    assert all(re.fullmatch(r"[\w.-]+==[\w.+!]+", line) for line in pinned)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    wanted = [
        *project["dependencies"],
        *extras["parquet"],
        *extras["hdf5"],
        *extras["netcdf"],
        *extras["ros2"],
        *extras["cluster"],
        *extras["signing"],
        *extras["dev"],
    ]
    missing = {name(requirement) for requirement in wanted} - {name(line) for line in pinned} - {"dpr-lab"}
    assert missing == set()
