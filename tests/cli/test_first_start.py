"""A command that compiles kernels announces it once and shows that it continues."""

import re
import sys
from pathlib import Path

import pytest

from dpr_lab.cli.listener import Listener
from dpr_lab.kernel_cache import COMPILING
from dpr_lab.progress import compiling
from dpr_lab.workflows.events import RunRead

CLI = Path(__file__).parents[2] / "dpr_lab" / "cli"
CAPTURE = ("capture", "--rig", "paper", "--pose", "X1", "--duration", "1", "--link", "sim://?clock=fast&seed=3")


def test_the_compilation_is_announced_once(capsys: pytest.CaptureFixture[str]) -> None:
    with Listener():
        compiling()
        compiling()
    compiling()
    assert capsys.readouterr().err == f"{COMPILING}\n"
    assert "at most three minutes" in COMPILING


def test_a_note_of_several_runs_is_printed_once(capsys: pytest.CaptureFixture[str]) -> None:
    with Listener() as listener:
        for number in range(6):
            listener(RunRead(Path("r"), f"X{number}", ("uses the measured torques",)))
        listener(RunRead(Path("s"), "S", ("starts at 1 s",)))
    assert capsys.readouterr().err.splitlines() == [
        "X0, X1, X2 and 3 more: uses the measured torques",
        "S: starts at 1 s",
    ]


def test_every_command_that_may_compile_listens() -> None:
    for path in set(CLI.glob("*.py")) - {
        CLI / name
        for name in ("listener.py", "import_table.py", "checks.py", "rigs.py", "new_rig.py", "option_groups.py")
    }:
        code = path.read_text()
        assert "with Listener()" in code or not re.search(r"from dpr_lab\.(workflows|transports)\S* import", code), path


@pytest.mark.long
@pytest.mark.timeout(900)
def test_the_compilation_is_announced_at_the_first_start_only(tmp_path: Path, on_terminal) -> None:
    def shown(*words: str) -> str:
        program = [sys.executable, "-m", "dpr_lab", *words]
        code, text = on_terminal(program, {"NUMBA_CACHE_DIR": str(tmp_path / "cache")})
        assert code == 0, text
        return text

    capture = (*CAPTURE, "--out", str(tmp_path / "runs"))
    first = shown(*capture)  # the device compiles
    assert first.index(COMPILING) < first.index("firmware 1.0.0")
    assert "first start" in first
    assert COMPILING not in shown(*capture)
