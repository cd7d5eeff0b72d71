"""Limits of the structure of the code (`python tests/house.py --list` prints each number and its parts)."""

import ast
import re
from pathlib import Path

import pytest

from dpr_lab.effects import EFFECTS
from tests import house

LONGEST_CHAIN = 10
CONSTANTS = 120
FILES_IN_A_FOLDER = 15
LINES_OF_A_FILE = 400
ROOT = Path(__file__).parents[1]
EXTENSIONS = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split("\n## ")[2]
TABLES = {"dpr_lab/workflows", *re.findall(r"`([\w/]+)/NAME\.py`", EXTENSIONS)}
"""Folders in which an extension is one file more: they may grow."""


@pytest.fixture(scope="module")
def trees() -> dict[str, ast.Module]:
    return {name: tree for package in house.PACKAGES for name, tree in house.modules(package).items()}


@pytest.mark.parametrize("deferred", [False, True], ids=["at the top", "inside functions too"])
def test_no_modules_import_one_another(trees: dict[str, ast.Module], deferred: bool) -> None:
    circles = house.circles(house.imports(trees, deferred=deferred))
    assert circles == [], "move what both modules need to a module that both import"


def test_the_diagnosis_is_a_short_chain(trees: dict[str, ast.Module]) -> None:
    chain = house.longest_chain(house.within(house.imports(trees), "dpr_lab.gap"))
    links = " imports ".join(chain)
    assert len(chain) <= LONGEST_CHAIN, f"{links}: move what one of them needs to an earlier module"


def test_a_class_name_means_one_thing(trees: dict[str, ast.Module]) -> None:
    repeated = {name: where for name, where in house.class_names(trees).items() if len(where) > 1}
    assert repeated == {}, "rename one of the classes"


def test_numbers_live_in_settings_not_in_constants(trees: dict[str, ast.Module]) -> None:
    lab = {name: tree for name, tree in trees.items() if name.split(".")[0] == "dpr_lab"}
    constants = house.numeric_constants(lab)
    assert len(constants) <= CONSTANTS, (
        f"{len(constants)} constants hold a number, {CONSTANTS} may. Make the new one a field of a frozen settings"
        f" dataclass, with its meaning and origin as docstring (CONTRIBUTING.md, Packages): {', '.join(constants)}"
    )


def test_a_folder_can_be_overlooked() -> None:
    large = {folder: size for folder, size in house.folder_sizes().items() if size > FILES_IN_A_FOLDER}
    unexpected = {folder: size for folder, size in large.items() if folder not in TABLES}
    assert unexpected == {}, f"at most {FILES_IN_A_FOLDER} files: move those of one topic to a folder of their own"


def test_a_file_can_be_read_at_once() -> None:
    assert house.long_files(LINES_OF_A_FILE) == {}, f"at most {LINES_OF_A_FILE} lines: move one concept to a new file"


def test_the_folders_of_extensions_may_grow() -> None:
    assert {"dpr_lab/effects", "dpr_lab/exports", "dpr_lab/gap/advice", "dpr_lab/tui/steps"} < TABLES
    assert all((ROOT / folder).is_dir() for folder in TABLES)


def test_effects_are_named_in_their_own_files_only(trees: dict[str, ast.Module]) -> None:
    elsewhere = {name: tree for name, tree in trees.items() if not name.startswith(house.EFFECTS_ROOM)}
    named = house.effects_named(elsewhere, EFFECTS)
    assert named == [], "test a field of `Effect` instead of the name, or import the effect and use its `name`"


def test_the_counts_see_what_they_should() -> None:
    source = 'A, B = 1.0, 2\nC = {"x": 1}\nD = (3 * 4.0) ** 2\nE = True\nf = 5\nG = dict\nH: int = 6\nI = call(7)\n'
    assert house.numeric_constants({"m": ast.parse(source)}) == ["m.A", "m.B", "m.D", "m.H", "m.I"]
    graph = {"a": {"b"}, "b": {"c"}, "c": {"b", "d"}, "d": set[str]()}
    assert house.circles(graph) == [["b", "c"]]
    named = ast.parse('"""The `dry` one; dry weather."""\nx = {"dry": 1}\ndryer = "dryers"\n')
    assert house.effects_named({"m": named}, ["dry"]) == ["m:1 dry", "m:2 dry"]
