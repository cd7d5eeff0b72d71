"""Generated C files agree with dpr.dbc, and hand-written ones use no other names."""

import importlib.util
import re
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

import pytest

import firmware_protocol
from firmware_protocol.definition import SCHEMA_HASH

SOURCES = Path(firmware_protocol.__file__).parent / "c"


def generator() -> ModuleType:
    spec = importlib.util.spec_from_file_location("generate", SOURCES / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["dpr.h", "dpr.c", "dpr_schema.h"])
def test_generated_files_are_current(name):
    committed = (SOURCES / "generated" / name).read_text(encoding="utf-8")
    made_by = re.search(r"by cantools version ([\d.]+)\.\n", committed)
    if made_by and made_by[1] != version("cantools"):
        pytest.skip(
            f"{name} is of cantools {made_by[1]}, {version('cantools')} is installed and may write it otherwise"
        )
    assert committed == generator().generated()[name], "run: make -C firmware_protocol/c generate"


def test_only_what_differs_is_written(tmp_path, monkeypatch, capsys):
    module = generator()
    monkeypatch.setattr(module, "GENERATED", tmp_path)
    made = module.generated()
    for name, text in made.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    (tmp_path / "dpr.c").write_text("of an earlier version", encoding="utf-8")
    (tmp_path / "dpr.h").unlink()
    module.main()
    assert capsys.readouterr().out.split("\n") == ["dpr.h written", "dpr.c written", ""]
    assert {path.name: path.read_text(encoding="utf-8") for path in tmp_path.iterdir()} == made


def test_the_schema_is_this_one():
    assert f"0x{SCHEMA_HASH:08X}u" in (SOURCES / "generated" / "dpr_schema.h").read_text(encoding="utf-8")


def test_the_core_takes_no_memory_and_calls_nothing_but_memcpy_and_memset():
    core = "".join(path.read_text(encoding="utf-8") for path in SOURCES.glob("*.[ch]"))
    assert set(re.findall(r"#include <(\w+)\.h>", core)) == {"stdbool", "stddef", "stdint", "string"}
    assert not re.search(r"\b(malloc|calloc|realloc|free|alloca|printf|memmove|str\w+)\s*\(", core)
    assert len(re.findall(r"\bhal_\w+\(void \*port", (SOURCES / "hal.h").read_text(encoding="utf-8"))) <= 12
