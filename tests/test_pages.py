"""Every code block of every page is run, read by its own tool, or clearly not a command."""

import json
import re
import shutil
import subprocess
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from dpr_lab.dynamics.base import RATIOS, base_parameters, ratios
from dpr_lab.rig import PARAMETERS, load_rig
from dpr_lab.tui.app import STEPS, DprApp
from dpr_lab.tui.keys import load_keymap
from sim_device.plant.config import load_plant
from tests.pages import FOLLOWED, NOT_COMMANDS, PAGES, READ, RECORD, ROOT, STAND_INS, blocks, follow, name, to_follow

QUICK = (
    "docs/reference/python.md",
    "docs/tutorials/your-hardware.md",
    "docs/tutorials/your-table.md",
)
"""Pages that take seconds. The other pages record and diagnose for minutes."""

VERDICTS = {
    "README.md": {"diagnosis/diagnosis.json": {}},
    "docs/tutorials/simulated-rig.md": {"diagnosis/diagnosis.json": {}},
    "docs/tutorials/your-table.md": {"diagnosis/diagnosis.json": {"coulomb_joint2": ("torque_Nm", 0.9e-3)}},
    "docs/how-to/video.md": {"film/diagnosis/diagnosis.json": {"coulomb_joint2": ("torque_Nm", 0.9e-3)}},
}
"""By page and file: the effects of the plant that was recorded, and the true size of one parameter of each."""

IDENTIFIED = {"README.md": "model.json", "docs/tutorials/simulated-rig.md": "model.json"}
"""By page: a model that was identified from releases of the simulated rig `paper`."""

AROUND = """
#include "device.h"
bool next_byte(uint8_t *byte);
bool can_write(uint16_t id, uint8_t length, const uint8_t *data);
"""
BOARD = """
extern const dpr_identity_t IDENTITY;
void board(void);
void board(void) { uint8_t byte; dpr_frame_t frame;
"""
"""Code that the sketches of the porting guide omit."""


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_block_says_what_it_is(page: Path) -> None:
    for block in blocks(page):
        assert block.language in (*FOLLOWED, *READ, *NOT_COMMANDS), f"{name(page)}:{block.line}"
        if block.language in NOT_COMMANDS[:2]:
            assert not re.search(r"^[$ ]*(dpr-lab|make|pip|python|dask) ", block.text, re.MULTILINE), block.line
    prose = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert not re.findall(r"(?<=\n\n) {4}\S.*", prose), "a block without a fence says not what it is"


def test_every_stand_in_is_needed() -> None:
    written = "\n".join(block.text for page in PAGES for block in blocks(page) if block.language == "sh")
    for stand_in in STAND_INS:
        assert re.search(stand_in.written, written, flags=re.MULTILINE), stand_in


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_what_a_page_shows_of_a_file_is_read_by_what_reads_it(page: Path, tmp_path: Path) -> None:
    for number, block in enumerate(block for block in blocks(page) if block.language in READ):
        file = tmp_path / f"{number}.{block.language}"
        file.write_text(block.text, encoding="utf-8")
        READERS[block.language](file)


def compiled(file: Path) -> None:
    """Compile a sketch: complete functions unchanged, statements inside a function."""
    if not (compiler := shutil.which("cc")):
        pytest.skip("no C compiler")
    sketch = file.read_text(encoding="utf-8")
    around = f"{AROUND}{sketch}" if "hal_" in sketch else f"{AROUND}{BOARD}{sketch}}}"
    file.write_text(around, encoding="utf-8")
    sources = ROOT / "firmware_protocol" / "c"
    words = [compiler, "-std=c99", "-Wall", "-Werror", "-fsyntax-only", f"-I{sources}", f"-I{sources / 'generated'}"]
    done = subprocess.run([*words, str(file)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def settings_read(file: Path) -> None:
    """Read a rig file, a part of a project file, or key bindings."""
    if "[project" in file.read_text(encoding="utf-8"):
        assert tomllib.loads(file.read_text(encoding="utf-8"))["project"]
        return
    if "[rig]" in file.read_text(encoding="utf-8"):
        load_rig(file)
    else:
        load_keymap(file, DprApp, STEPS)


READERS: dict[str, Callable[[Path], object]] = {
    "c": compiled,
    "json": lambda file: json.loads(file.read_text(encoding="utf-8")),
    "toml": settings_read,
}


def check_ratios(file: Path) -> None:
    """Compare the ratios of an identified model with those of the simulated rig that was recorded."""
    model, rig, plant = json.loads(file.read_text(encoding="utf-8")), load_rig("paper"), load_plant("paper", 1)
    truth = ratios(base_parameters([plant.parameters[name] for name in PARAMETERS], rig.L1, rig.g))
    for ratio, value in zip(RATIOS, truth.tolist(), strict=True):
        estimate = model["ratios"][ratio]
        assert abs(estimate["value"] - value) < 5 * estimate["std"], ratio


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize(
    "page", [pytest.param(page, marks=() if page in QUICK else pytest.mark.long) for page in to_follow()]
)
def test_a_page_can_be_followed(page: str, tmp_path: Path) -> None:
    if page == "docs/worked-example.md" and not RECORD.is_file():
        pytest.skip(f"no real record at {RECORD}")
    follow(ROOT / page, tmp_path, patience_s=3000, forked=page in QUICK)
    if page in IDENTIFIED:
        check_ratios(tmp_path / IDENTIFIED[page])
    for file, truth in VERDICTS.get(page, {}).items():
        diagnosis = json.loads((tmp_path / file).read_text(encoding="utf-8"))
        named = {one["name"]: one for one in diagnosis["effects"]}
        assert named.keys() == truth.keys(), diagnosis["sentence"]
        for effect, (parameter, value) in truth.items():
            lower, upper = named[effect]["parameters"][parameter]["interval90"]
            assert named[effect]["probability"] > 0.9, diagnosis["sentence"]
            assert lower - (upper - lower) < value < upper + (upper - lower), diagnosis["sentence"]
