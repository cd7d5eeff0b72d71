"""The README is run, not believed."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_the_quickstart_and_the_python_example_run(tmp_path: Path) -> None:
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    steps = "\n".join(blocks("sh"))
    subprocess.run(["sh", "-e", "-c", steps], cwd=tmp_path, env=environment, check=True, timeout=280)
    assert (tmp_path / "report" / "report.html").is_file()
    shutil.copy(next((tmp_path / "runs").glob("*.mcap")), tmp_path / "runs" / "first.mcap")
    (example,) = blocks("python")
    done = subprocess.run(
        [sys.executable, "-c", example], cwd=tmp_path, check=True, timeout=120, capture_output=True, text=True
    )
    value, interval = done.stdout.split(maxsplit=1)
    low, high = numbers_in(interval)
    assert low < float(value) < high


def numbers_in(text: str) -> tuple[float, float]:
    low, high = re.findall(r"[-+0-9.e]+", text)
    return float(low), float(high)


def test_every_file_the_readme_names_exists() -> None:
    for target in re.findall(r"\]\((?!https?:)([^)]+)\)", README):
        assert (ROOT / target).exists(), target


def test_every_make_target_the_readme_names_exists() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"`make (\w+)`", README) + re.findall(r"^ +make (\w+)", README, flags=re.MULTILINE):
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), target
