"""Modules that a command may import. Each unnecessary library delays every start."""

import subprocess
import sys
from pathlib import Path

import pytest

from dpr_lab.cli.app import COMMANDS
from dpr_lab.configs import BUILTIN

FIGURES = {"matplotlib", "PIL", "jinja2"}
SCREEN = {"textual", "textual_plot"}
SIMULATED = {"sim_device"}
KERNELS = {"numba", "llvmlite", "dpr_lab.kernels"}
SCIPY = {f"scipy.{name}" for name in ("special", "linalg", "optimize", "interpolate", "stats")}
TABLES = BUILTIN / "tables"

LISTED = """
import atexit, sys
listed = sys.argv.pop(1)
atexit.register(lambda: print(*sys.modules, file=open(listed, "w")))
"""
COMMAND = "from dpr_lab.cli import main\nmain()\n"
DIAGNOSIS = """
import dpr_lab.gap.diagnose
from dpr_lab.cli.diagnose import show
from tests.a_diagnosis import made
show(made())
"""


def imported(folder: Path, program: str, *words: object) -> set[str]:
    """Names of all modules that a program imports."""
    listed = folder / "modules"
    command = [sys.executable, "-c", LISTED + program, listed, *map(str, words)]
    subprocess.run(command, check=True, capture_output=True, text=True)
    return set(listed.read_text().split())


@pytest.mark.slow
def test_a_table_is_imported_without_compiled_kernels_and_other_commands(tmp_path: Path) -> None:
    table = ("import", "table", TABLES / "side.csv", "--rig", TABLES / "bench.toml", "--out", tmp_path / "side.mcap")
    modules = imported(tmp_path, COMMAND, *table, "--zero", "hanging", "--angles", "relative")
    commands = modules & {f"dpr_lab.cli.{place.partition(':')[0]}" for place in COMMANDS.values()}
    assert commands == {"dpr_lab.cli.import_table"}
    assert not modules & (KERNELS | FIGURES | SCREEN | SCIPY | {"rich", "dpr_lab.effects"})


@pytest.mark.slow
def test_a_diagnosis_on_the_terminal_needs_neither_figures_nor_scipy_nor_the_simulated_device(tmp_path: Path) -> None:
    assert not imported(tmp_path, DIAGNOSIS) & (FIGURES | SCREEN | SIMULATED | SCIPY)
