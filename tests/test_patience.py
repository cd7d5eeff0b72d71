"""No test depends on the speed of the machine: waiting times are at least a minute, and durations have no upper limit.

A hang ends by the time limit of its test. Processor time may have a bound: a busy machine leaves work what it is.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
PATIENCE_S = 60.0
WALL_CLOCKS = {"time.monotonic()", "time.perf_counter()", "time.time()"}
WAITS = {"wait", "join", "communicate", "run", "check_output", "result", "timeout"}
"""Of processes, threads and futures, and a test's own time limit."""
PARTS = re.compile(r"timeout|\.(?:wait|join|result)\(\s*\w|monotonic|perf_counter|time\.time")
"""A part of each of them where it has a limit or is compared: other files need not be parsed."""


def number(node: ast.expr | None, constants: dict[str, float]) -> float | None:
    """Value of a numeric expression, or of the constant that it names."""
    if isinstance(node, ast.Name):
        return constants.get(node.id)
    value = node.value if isinstance(node, ast.Constant) else None
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def reads_clock(node: ast.AST) -> bool:
    """Whether an expression reads the time of day or a clock of the machine."""
    return any(isinstance(part, ast.Call) and ast.unparse(part) in WALL_CLOCKS for part in ast.walk(node))


def impatience(source: str) -> Iterator[int]:
    """Lines that wait less than a minute for another process, or fail if an action takes long."""
    tree = ast.parse(source)
    assigned = [(node.targets[0], node.value) for node in tree.body if isinstance(node, ast.Assign)]
    constants = {
        target.id: value
        for target, value_node in assigned
        if isinstance(target, ast.Name) and (value := number(value_node, {}))
    }

    def short(node: ast.expr | None) -> bool:
        value = number(node, constants)
        return value is not None and 0 < value < PATIENCE_S

    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in WAITS:
            limits = [keyword.value for keyword in node.keywords if keyword.arg == "timeout"]
            first = node.args[:1] if node.func.attr in ("wait", "join", "timeout", "result") else []
            if any(map(short, [*limits, *first])):
                yield node.lineno
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add) and ast.unparse(node.left) in WALL_CLOCKS:
            if short(node.right):
                yield node.lineno
        elif isinstance(node, ast.Assert):
            for compared in (part for part in ast.walk(node.test) if isinstance(part, ast.Compare)):
                sides = [compared.left, *compared.comparators]
                for left, order, right in zip(sides, compared.ops, sides[1:], strict=False):
                    above = right if isinstance(order, ast.Lt | ast.LtE) else left
                    if reads_clock(compared) and isinstance(above, ast.Constant) and short(above):
                        if not isinstance(order, ast.Eq) and reads_clock(left if above is right else right):
                            yield node.lineno


@pytest.mark.parametrize(
    ("line", "impatient"),
    [
        ("process.wait(5)", True),
        ("process.wait(PATIENCE_S)", False),
        ("SHORT_S = 5.0\nthread.join(SHORT_S)", True),
        ("process.communicate(timeout=30)", True),
        ("process.communicate(timeout=400)", False),
        ("deadline = time.monotonic() + 10", True),
        ("deadline = time.monotonic() + 120", False),
        ("assert time.monotonic() - began < 30", True),
        ("assert 0.1 < time.monotonic() - began < 0.4", True),
        ("assert time.monotonic() - began > 0.1", False),
        ("assert time.monotonic() < deadline", False),
        ("assert time.process_time() - began < 1", False),
    ],
)
def test_what_depends_on_speed_is_seen(line: str, impatient: bool) -> None:
    assert PARTS.search(line) or not impatient
    assert bool(list(impatience(line))) == impatient


def test_no_test_depends_on_the_speed_of_the_machine() -> None:
    result = [
        f"{path.relative_to(TESTS)}:{line}"
        for path in sorted(TESTS.rglob("*.py"))
        if PARTS.search(source := path.read_text(encoding="utf-8"))
        for line in impatience(source)
    ]
    assert result == []
