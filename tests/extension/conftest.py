"""Copy of the packages that tests extend and run."""

import ast
import json
import os
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


class Copy:
    """Copy of the packages in a separate folder, which tests extend and run."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name in ("dpr_lab", "firmware_protocol", "sim_device", "configs"):
            shutil.copytree(ROOT / name, folder / name)  # with its bytecode: nothing is compiled again

    def add(self, file: str, text: str) -> None:
        """Add a file."""
        path = self.folder / file
        assert not path.exists(), f"{file} is there already"
        path.write_text(textwrap.dedent(text), encoding="utf-8")

    def row(self, file: str, table: str, row: str, imported: str = "") -> None:
        """Add an entry at the end of a table, and the import that it needs."""
        path = self.folder / file
        text = path.read_text(encoding="utf-8")
        tree = ast.parse(text)
        rows = table_of(tree, table)
        assert rows.end_lineno is not None
        assert rows.end_col_offset is not None
        lines = text.splitlines(keepends=True)
        end = sum(map(len, lines[: rows.end_lineno - 1])) + rows.end_col_offset - 1
        before = text[:end].rstrip()
        text = f"{before}{'' if before.endswith(',') else ','} {row},{text[end:]}"
        last = max(node.end_lineno or 0 for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom))
        lines = text.splitlines(keepends=True)
        path.write_text("".join([*lines[:last], f"{imported}\n" if imported else "", *lines[last:]]), encoding="utf-8")

    def run(self, code: str, timeout: float = 600.0, *, cache: bool = False) -> str:
        """Run a program with this copy and return its output; `cache`: with a separate kernel cache."""
        program = textwrap.dedent(code)
        environment = {**os.environ, "PYTHONPATH": str(self.folder)}
        environment |= {"NUMBA_CACHE_DIR": str(self.folder / "cache")} if cache else {}
        done = subprocess.run(
            [sys.executable, "-c", program],
            cwd=self.folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=timeout,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout


def outputs(copy: Copy, extensions: dict[str, Callable[[Copy], str]]) -> dict[str, str]:
    """Make several extensions, and run the program of each, all in one process; the output of each.

    An extension that does not load makes all programs fail. An exit code other than 0 is part of the output.

    Args:
        copy: the packages
        extensions: functions that add files and rows and return a program
    """
    programs = {name: textwrap.dedent(extend(copy)) for name, extend in extensions.items()}
    return json.loads(copy.run(ONE_AFTER_THE_OTHER.format(programs)).splitlines()[-1])


ONE_AFTER_THE_OTHER = """
import contextlib, io, json, traceback

def output_of(program):
    with contextlib.redirect_stdout(io.StringIO()) as output:
        try:
            exec(program, {{"__name__": "program"}})
        except SystemExit as end:
            if end.code:
                print("exit code", end.code, file=output)
        except BaseException:
            traceback.print_exc(file=output)
    return output.getvalue()

print(json.dumps({{name: output_of(program) for name, program in {!r}.items()}}))
"""


def table_of(tree: ast.Module, name: str) -> ast.Tuple | ast.Dict:
    """Entries of a module-level table: a tuple or a dict, possibly inside the expression that creates it."""
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        if any(isinstance(target, ast.Name) and target.id == name for target in targets):
            value = node.iter if isinstance(node, ast.For) else getattr(node, "value", None)
            assert isinstance(value, ast.AST)
            return next(part for part in ast.walk(value) if isinstance(part, ast.Tuple | ast.Dict))
    raise AssertionError(f"no table {name}")


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Copy:
    """One for all tests of a file: each adds another row."""
    return Copy(tmp_path_factory.mktemp("copy"))
