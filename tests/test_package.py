"""A wheel or a source archive installs all files, and works without the sources."""

import json
import os
import re
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from dpr_lab.version import __version__
from tests.installed_sizes import added_mb, extras, requirements, sizes_mb

ROOT = Path(__file__).parents[1]
PLATFORMS = (ROOT / "docs" / "reference" / "platforms.md").read_text(encoding="utf-8")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dist")
    subprocess.run([sys.executable, "-m", "hatchling", "build", "-d", str(folder)], cwd=ROOT, check=True)
    return folder


PACKAGES = ("dpr_lab", "firmware_protocol", "sim_device")
USED = """
import dpr_lab, firmware_protocol, sim_device
for package in (dpr_lab, firmware_protocol, sim_device):
    print(package.__file__)
from sim_device.firmware.c_firmware import load
from sim_device.plant.config import load_plant
from dpr_lab.cli.app import app
load()
load_plant("paper")
app(["rig", "show", "paper"], standalone_mode=False)
print("SCHEMA")
app(["schema", "model"], standalone_mode=False)
"""
"""Program that loads the C sources and a plant, and prints the folders, a rig and a schema."""
IMPORTED = """
import pkgutil, sys
from importlib import import_module
for package in map(import_module, sys.argv[1:]):
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        if not module.name.endswith("__main__"):
            import_module(module.name)
"""
"""Program that imports every module of the packages."""


@pytest.fixture
def installed(built: Path, tmp_path: Path) -> tuple[Path, Callable[..., str]]:
    """Folder with the content of the wheel, and a function that runs Python in an empty environment."""
    (wheel,) = built.glob("*.whl")
    place = tmp_path / "place"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(place)
    environment = {**os.environ, "PYTHONPATH": str(place), "PYTHONSAFEPATH": "1"}

    def run(*words: str) -> str:
        command = [sys.executable, *words]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return place, run


def test_the_wheel_works_in_an_empty_environment(installed: tuple[Path, Callable[..., str]]) -> None:
    place, run = installed
    for package in PACKAGES:
        modules = {path.relative_to(ROOT) for path in (ROOT / package).rglob("*.py")}
        assert {path.relative_to(place) for path in (place / package).rglob("*.py")} == modules
    shown, printed = run("-c", USED).split("SCHEMA\n")
    assert shown.count(str(place)) == 3
    assert "[rig]" in shown
    builtin = place / "dpr_lab" / "builtin"
    assert {"effects.md", "rig-file.md"} <= {file.name for file in builtin.iterdir()}
    assert json.loads(printed) == json.loads((builtin / "schemas" / "model.json").read_text())


@pytest.mark.long
def test_every_module_of_the_wheel_is_imported(installed: tuple[Path, Callable[..., str]]) -> None:
    _, run = installed
    run("-c", IMPORTED, *PACKAGES)


@pytest.mark.long
def test_the_wheel_captures_in_an_empty_environment(installed: tuple[Path, Callable[..., str]], tmp_path: Path) -> None:
    """Numba compiles the kernels again in each folder."""
    _, run = installed
    (tmp_path / "mine.toml").write_text(run("-m", "dpr_lab", "rig", "show", "paper"), encoding="utf-8")
    words = ("--rig", "mine.toml", "--link", "sim://?clock=fast&firmware=c", "--pose", "X1", "--duration", "1")
    run("-m", "dpr_lab", "capture", *words, "--out", "runs")
    assert len(list((tmp_path / "runs").glob("*.mcap"))) == 1


def test_the_source_archive_holds_what_builds_and_tests_it(built: Path) -> None:
    (archive,) = built.glob("*.tar.gz")
    with tarfile.open(archive) as opened:
        names = {name.partition("/")[2] for name in opened.getnames()}
    wanted = (
        "Makefile",
        "docs/conf.py",
        "configs/rigs/paper.toml",
        "firmware_protocol/c/device.c",
        "tests/conftest.py",
    )
    assert names.issuperset(wanted)


def test_one_version_everywhere() -> None:
    cited = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (.+)$", cited, flags=re.MULTILINE)[1] == __version__  # type: ignore[index]


def test_the_description_of_the_package_has_no_broken_links(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        shown = archive.read(name).decode()
    assert "dpr-lab tui" in shown
    assert re.findall(r"\]\((?!https?:)", shown) == []


def commands_of(target: str, venv: Path) -> str:
    """Commands that make would run for a target, with the environment in a folder."""
    command = ["make", "--dry-run", target, f"VENV={venv}"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout


def test_the_demo_installs_the_package_alone_and_the_tests_what_they_need(tmp_path: Path) -> None:
    demo, tests = (commands_of(target, tmp_path / "venv") for target in ("demo", "test"))
    assert "--editable ." in demo
    assert "[dev]" not in demo
    assert ".dev" not in demo
    assert "--editable '.[dev]'" in tests
    for target in ("check", "docs", "bench", "fuzz", "format"):
        assert "--editable '.[dev]'" in commands_of(target, tmp_path / "venv"), target


def test_the_tests_upgrade_the_environment_of_the_demo_and_nothing_is_installed_twice(tmp_path: Path) -> None:
    (tmp_path / ".core").touch()
    assert "pip" not in commands_of("demo", tmp_path)
    tests = commands_of("test", tmp_path)
    assert "-m venv" not in tests
    assert "--editable '.[dev]'" in tests
    (tmp_path / ".dev").touch()
    assert "pip" not in commands_of("test", tmp_path)


@pytest.mark.long
def test_the_page_platforms_states_the_installed_sizes() -> None:
    """Within a tenth, or 5 MB: libraries grow from version to version."""
    result = {
        name: float(size) for name, size in re.findall(r"^\| `(\w+)` \|.*\| (\d+) \|$", PLATFORMS, flags=re.MULTILINE)
    }
    (core,) = re.findall(r"The package and the libraries that it needs take (\d+) MB", PLATFORMS)
    measured = {name: sum(added_mb(name).values()) for name in extras() if name in result}
    assert set(extras()) - set(result) <= {"fuzz"}
    assert float(core) == pytest.approx(sum(sizes_mb(requirements()).values()), rel=0.1)
    for name, size in result.items():
        assert size == pytest.approx(measured[name], rel=0.1, abs=5), name
