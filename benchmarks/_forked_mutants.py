"""pytest plugin of `mutants.py`: each mutant runs in a process that is forked after the tests were collected.

The process replaces the code of the changed function, so nothing is imported or collected again. The changed file is
also on the disk, for the commands and devices that tests start. The fast tests of a mutant run first, the slow ones
only if all fast tests pass.
"""

import ast
import gc
import json
import os
import signal
import sys
import traceback
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

import pytest

MUTANTS = "DPR_LAB_MUTANTS"
"""Variable with the path of the mutants, a JSON list.

Each result is appended as one line to the file with the suffix `.done`.
"""
FAST_S, SLOW_S = 8.0, 12.0
"""Processor time after which no further fast or slow test of a mutant starts, s."""


def changed_function(source: str, line: int) -> str | None:
    """Qualified name of the outermost function around a line; None outside functions."""

    def inside(node: ast.AST, names: tuple[str, ...]) -> Iterator[str]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef) and child.lineno <= line <= (child.end_lineno or line):
                yield ".".join((*names, child.name))
            elif isinstance(child, ast.ClassDef):
                yield from inside(child, (*names, child.name))

    return next(inside(ast.parse(source), ()), None)


def all_codes(code: CodeType) -> Iterator[CodeType]:
    """Code of all functions and classes in a code object."""
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield constant
            yield from all_codes(constant)


def replace_code(file: str, name: str) -> None:
    """Give all functions of this name in a module the code of its changed file.

    Raises:
        ValueError: the change removes the only use of a variable of an enclosing scope, such as `super()`.
    """
    import_module(file.removesuffix(".py").removesuffix("/__init__").replace("/", "."))
    new = [code for code in all_codes(compile(Path(file).read_bytes(), file, "exec")) if code.co_qualname == name]
    gc.unfreeze()  # frozen objects are not listed
    functions = [each for each in gc.get_objects() if type(each) is FunctionType and each.__qualname__ == name]
    old = [each for each in functions if each.__code__.co_filename.endswith(file)]
    assert old, f"{file} has no function {name}"
    for function in old:
        line = function.__code__.co_firstlineno
        function.__code__ = min(new, key=lambda code: abs(code.co_firstlineno - line))


class Failures:
    """Plugin that collects the names of the tests that fail."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add the test of a report."""
        if report.failed:
            self.names.append(report.nodeid)


def first_failure(session: pytest.Session, files: list[str]) -> tuple[str, bool]:
    """First test of some files that fails and whether it is slow; empty if none fails within the limits."""
    failures = Failures()
    session.config.pluginmanager.register(failures)
    tests = [test for test in session.items if test.nodeid.partition("::")[0] in files]
    tests.sort(key=lambda test: files.index(test.nodeid.partition("::")[0]))
    for slow, limit in ((False, FAST_S), (True, SLOW_S)):
        chosen = [test for test in tests if (test.get_closest_marker("slow") is not None) is slow]
        end = sum(os.times()[:4]) + limit
        for test, following in zip(chosen, [*chosen[1:], None], strict=False):
            session.ihook.pytest_runtest_protocol(item=test, nextitem=following)
            if failures.names:
                return failures.names[0], slow
            if sum(os.times()[:4]) > end:
                break
    return "", False


def run_mutant(session: pytest.Session, mutant: dict[str, Any], name: str, answer: int) -> None:
    """Run the tests of a mutant in this forked process, and write the result to a pipe."""
    from tests import warm_process

    os.setsid()
    sys.dont_write_bytecode = True
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    os.dup2(nothing, 2)
    os.environ.pop(warm_process.SERVER, None)  # its process has the unchanged code
    warm_process.start_server()
    before = sum(os.times()[:4])
    try:
        replace_code(mutant["file"], name)
    except ValueError:  # survivors get a process of their own
        killer, slow = "", False
    else:
        killer, slow = first_failure(session, mutant["tests"])
    result = {"killer": killer, "slow": slow, "seconds": round(sum(os.times()[:4]) - before, 1)}
    os.write(answer, json.dumps(result).encode())


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop(session: pytest.Session) -> bool:
    """Instead of the tests, run the mutants."""
    place = Path(os.environ[MUTANTS])
    done = place.with_suffix(".done")
    for mutant in json.loads(place.read_text(encoding="utf-8")):
        path = Path.cwd() / mutant["file"]
        source, stamp = path.read_bytes(), path.stat()
        name = changed_function(source.decode(), mutant["line"])
        assert name is not None, f"{mutant['file']}:{mutant['line']} is outside functions"
        end = mutant["start"] + len(mutant["before"].encode())
        path.write_bytes(source[: mutant["start"]] + mutant["after"].encode() + source[end:])
        reading, writing = os.pipe()
        if (child := os.fork()) == 0:
            try:
                run_mutant(session, mutant, name, writing)
            except BaseException:
                os.write(writing, json.dumps({"error": traceback.format_exc()[-3000:]}).encode())
            finally:
                os._exit(0)
        os.close(writing)
        answer = os.read(reading, 1 << 16)
        os.close(reading)
        os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)
        path.write_bytes(source)
        os.utime(path, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
        result = json.loads(answer) if answer else {"killer": "the process of the tests ended"}
        if "error" in result:
            raise RuntimeError(result["error"])
        with done.open("a", encoding="utf-8") as lines:
            lines.write(json.dumps(mutant | result) + "\n")
    return True
