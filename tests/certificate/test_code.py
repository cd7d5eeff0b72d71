"""The hash of the code in a certificate depends on every source file."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import dpr_lab
from dpr_lab.certificate.code import made_with


def hash_of(folder: Path) -> str:
    """Hash of the package in a folder, computed by a process that imports it from there."""
    program = "from dpr_lab.certificate.code import made_with; print(made_with()['code'])"
    done = subprocess.run([sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout.strip()


@pytest.mark.slow
def test_one_changed_byte_of_one_source_changes_the_hash_and_a_copy_does_not(tmp_path: Path) -> None:
    copies = [tmp_path / "copy", tmp_path / "changed"]
    for copy in copies:
        shutil.copytree(Path(dpr_lab.__file__).parent, copy / "dpr_lab", ignore=shutil.ignore_patterns("__pycache__"))
    source = copies[1] / "dpr_lab" / "gap" / "hypothesis" / "thresholds.py"
    text = source.read_text(encoding="utf-8")
    source.write_text(text.replace("chance: float = 30.0", "chance: float = 31.0"), encoding="utf-8")
    assert source.read_text(encoding="utf-8") != text
    original, changed = map(hash_of, copies)
    assert original != changed
    assert original == made_with()["code"]
