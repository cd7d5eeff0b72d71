"""Mutation test of the numerical core and of the protocol: share of artificial faults that the tests detect.

    python benchmarks/mutants.py [--only AREA ...] [--seed N] [--quick] [--json] [--compare OLD.json]

Each mutant is the program with one change: an operator, a comparison, a constant, or a dropped statement. The choice is
random, and the same for the same seed and sources. A mutant runs in a copy of the repository against the tests of its
area until one fails; tests that name its module run first, and fast tests before slow ones. A mutant survives if all
tests pass. A survivor shows a missing test, or a change without effect. With --compare, each mutant of an earlier table
(--json) runs against the current tests.

The tests are collected once, and each mutant runs in a forked process (`_forked_mutants.py`). Mutants of compiled
functions and of values outside functions need a process of their own, which runs the fast tests only. So do mutants
that survive, because their code may run only when a module is imported. Compiled functions are compiled again for each
mutant, which takes one to two minutes; --uncompiled leaves them out.
"""

import ast
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from _bars import Bar, options, show
from _forked_mutants import MUTANTS, changed_function

ROOT = Path(__file__).parents[1]
KILLED = 0.8
TIMEOUT_S = 3600.0
TEST_TIMEOUT_S = 300
SEED = 20261123
MOST_FILES = 5
"""Number of test files against which a forked mutant runs."""
COMPILED = {"njit", "subroutine", "inlined"}
OPERATORS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.And: ast.Or,
    ast.Or: ast.And,
}


@dataclass(frozen=True, slots=True)
class Area:
    """A package, and the tests that cover it."""

    package: str
    tests: tuple[str, ...]
    """Patterns of test files."""
    mutants: int


AREAS = {
    "dynamics": Area("dpr_lab/dynamics", ("tests/dynamics/test_*.py",), 10),
    "estimation": Area("dpr_lab/estimation", ("tests/estimation/test_*.py",), 10),
    "fitting": Area("dpr_lab/fitting", ("tests/fitting/test_*.py",), 10),
    "effects": Area("dpr_lab/effects", ("tests/effects/test_*.py", "tests/dynamics/test_dr*.py"), 12),
    "search": Area("dpr_lab/search", ("tests/search/test_*.py",), 6),
    "protocol": Area(
        "firmware_protocol", ("tests/firmware_protocol/test_*.py", "tests/firmware_c/test_c_generated.py"), 12
    ),
    "transports": Area("dpr_lab/transports", ("tests/transports/test_*.py",), 8),
    "acquisition": Area("dpr_lab/acquisition", ("tests/acquisition/test_*.py", "tests/faults/test_*.py"), 10),
    "sim_device": Area("sim_device", ("tests/sim_device/test_*.py",), 6),
    "identification": Area("dpr_lab/identification", ("tests/identification/test_*.py",), 10),
    "gap": Area("dpr_lab/gap", ("tests/gap/test_*.py",), 12),
}


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change of the program."""

    area: str
    file: str
    function: str
    line: int
    before: str
    after: str
    start: int
    """Position of the changed text in the file, bytes."""
    compiled: bool
    killer: str = ""
    """First test that fails; empty for a survivor."""
    slow: bool = False
    """Whether this test is slow."""
    seconds: float = 0.0
    tests: tuple[str, ...] = ()
    """Test files that run; empty: those of the area."""


def sites(area: str, path: Path) -> Iterator[Mutant]:
    """Yield all possible mutants of one file."""
    source = path.read_bytes()
    tree = ast.parse(source)
    calls = (
        node for node in ast.walk(tree) if isinstance(node, ast.Call) and "behind_pointer" in ast.unparse(node.func)
    )
    pointed = {name.id for call in calls for name in call.args if isinstance(name, ast.Name)}
    starts = [0, *(match.end() for match in re.finditer(b"\n", source))]

    def offset(line: int, column: int) -> int:
        return starts[line - 1] + column

    def mutants(node: ast.AST, function: str, compiled: bool) -> Iterator[Mutant]:
        if isinstance(node, ast.FunctionDef):
            names = {name.id for each in node.decorator_list for name in ast.walk(each) if isinstance(name, ast.Name)}
            compiled = compiled or bool(names & COMPILED) or node.name in pointed
            function = f"{function}.{node.name}".strip(".")
            children: list[ast.AST] = list(node.body)
        elif isinstance(node, ast.AnnAssign):
            children = [node.value] if node.value else []
        elif isinstance(node, ast.ClassDef):
            function, children = node.name, list(node.body)
        elif isinstance(node, ast.Raise | ast.JoinedStr | ast.Assert):
            return  # texts for people
        else:
            children = list(ast.iter_child_nodes(node))
        if function and isinstance(node, ast.expr | ast.stmt) and (new := mutated(node)) is not None:
            begin = offset(node.lineno, node.col_offset)
            end = offset(node.end_lineno or node.lineno, node.end_col_offset or 0)
            name = path.relative_to(ROOT).as_posix()
            yield Mutant(area, name, function, node.lineno, source[begin:end].decode(), new, begin, compiled)
        for child in children:
            yield from mutants(child, function, compiled)

    yield from mutants(tree, "", False)


def mutated(node: ast.expr | ast.stmt) -> str | None:
    """Text of the changed expression or statement; None if it cannot be changed."""
    match node:
        case ast.Constant(value=bool() as value):
            return str(not value)
        case ast.Constant(value=int() as value):
            return str(value + 1)
        case ast.Constant(value=float() as value):
            return str(value * 1.5 if value else 1.0)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
            return f"({ast.unparse(ast.BinOp(left, OPERATORS[type(op)](), right))})"  # pyright: ignore[reportArgumentType]
        case ast.Compare(left=left, ops=[op, *ops], comparators=others):
            return f"({ast.unparse(ast.Compare(left, [OPERATORS[type(op)](), *ops], others))})"  # pyright: ignore[reportArgumentType]
        case ast.BoolOp(op=op, values=values):
            return f"({ast.unparse(ast.BoolOp(OPERATORS[type(op)](), values))})"  # pyright: ignore[reportArgumentType]
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            return f"({ast.unparse(operand)})"
        case ast.AugAssign() | ast.Expr(value=ast.Call()):
            return "pass"
        case ast.Assign(targets=[ast.Attribute() | ast.Subscript()]):
            return "pass"
        case _:
            return None


def chosen(seed: int, area: str, number: int) -> list[Mutant]:
    """Select random mutants of an area.

    Each round selects one mutant from every file, in random order, until there are enough.
    """
    draw = random.Random(f"{seed} {area}")
    files = {path: list(sites(area, path)) for path in sorted((ROOT / AREAS[area].package).rglob("*.py"))}
    pools = [pool for pool in files.values() if pool]
    for pool in pools:
        draw.shuffle(pool)
    draw.shuffle(pools)
    most = max(map(len, pools))
    return [pool[turn] for turn in range(most) for pool in pools if turn < len(pool)][:number]


def copy_of_the_repository(folder: Path) -> Path:
    """Copy the repository, with a kernel cache that does not depend on the sources.

    Only mutants of compiled functions need a separate cache.
    """
    copy = folder / "copy"
    listed = ("git", "ls-files", "-z", "--cached", "--others", "--exclude-standard")
    names = subprocess.run(listed, cwd=ROOT, check=True, capture_output=True, text=True).stdout.split("\0")
    for name in filter(None, names):
        if (ROOT / name).is_file():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, copy / name)
    cache = copy / "dpr_lab/kernel_cache.py"
    text = cache.read_text(encoding="utf-8")
    fixed = text.replace("cache_name(Path(__file__).parent))", '"mutants")')
    assert fixed != text
    cache.write_text(fixed, encoding="utf-8")
    return copy


def tests_of(area: str, file: str) -> list[str]:
    """Test files of an area. Those that mention the module come first."""
    module = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    tests = sorted(path for pattern in AREAS[area].tests for path in ROOT.glob(pattern))
    tests.sort(key=lambda path: module not in path.read_text(encoding="utf-8"))
    return [path.relative_to(ROOT).as_posix() for path in tests]


def failed_test(copy: Path, tests: list[str], cache: Path) -> str:
    """First test that fails; empty if all pass."""
    options = ("-x", "-q", "-m", "not slow and not hardware", "-p", "no:cacheprovider", f"--timeout={TEST_TIMEOUT_S}")
    environment = os.environ | {"PYTHONPATH": str(copy), "NUMBA_CACHE_DIR": str(cache), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", *options, *tests]
    try:
        done = subprocess.run(
            command, cwd=copy, env=environment, capture_output=True, text=True, errors="replace", timeout=TIMEOUT_S
        )
    except subprocess.TimeoutExpired:
        return "no end"
    if done.returncode == 0:
        return ""
    named = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", done.stdout, re.MULTILINE)
    return named[1] if named else "no test could run" if done.returncode != 1 else "one test did not end"


def forked(mutants: list[Mutant], copy: Path, cache: Path) -> list[Mutant]:
    """Mutants with the tests that detect them; the tests are collected once."""
    if not mutants:
        return []
    place = copy.with_name("mutants.json")
    files_of = [list(m.tests) or tests_of(m.area, m.file)[:MOST_FILES] for m in mutants]
    rows = [asdict(mutant) | {"tests": files} for mutant, files in zip(mutants, files_of, strict=True)]
    place.write_text(json.dumps(rows), encoding="utf-8")
    place.with_suffix(".done").unlink(missing_ok=True)
    path = os.pathsep.join((str(copy), str(ROOT / "benchmarks")))
    environment = os.environ | {"PYTHONPATH": path, "NUMBA_CACHE_DIR": str(cache), MUTANTS: str(place)}
    options = ("-q", "-n0", "-m", "not long and not hardware", f"--timeout={TEST_TIMEOUT_S}")
    plugins = ("-p", "_forked_mutants", "-p", "no:cacheprovider")
    files = sorted({test for row in rows for test in row["tests"]})
    command = [sys.executable, "-m", "pytest", *options, *plugins, *files]
    subprocess.run(command, cwd=copy, env=environment, check=True, stdout=sys.stderr)
    lines = place.with_suffix(".done").read_text(encoding="utf-8").splitlines()
    results = [
        {name: row[name] for name in ("killer", "slow", "seconds") if name in row} for row in map(json.loads, lines)
    ]
    return [replace(mutant, **result) for mutant, result in zip(mutants, results, strict=True)]


def can_fork(mutant: Mutant) -> bool:
    """Whether the code of a running function contains the change."""
    return not mutant.compiled and changed_function((ROOT / mutant.file).read_text("utf-8"), mutant.line) is not None


def tried(mutant: Mutant, copy: Path, cache: Path) -> Mutant:
    """Run the tests on a mutant, and return it with the first test that fails."""
    path = copy / mutant.file
    source, stamp = path.read_bytes(), path.stat()
    end = mutant.start + len(mutant.before.encode())
    assert source[mutant.start : end].decode() == mutant.before, f"{mutant.file} has changed: choose other mutants"
    began = time.monotonic()
    try:
        path.write_bytes(source[: mutant.start] + mutant.after.encode() + source[end:])
        with tempfile.TemporaryDirectory() as fresh:
            used = Path(fresh) if mutant.compiled else cache
            killer = failed_test(copy, list(mutant.tests) or tests_of(mutant.area, mutant.file), used)
    finally:
        path.write_bytes(source)
        os.utime(path, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    return replace(mutant, killer=killer, seconds=round(time.monotonic() - began, 1))


def main() -> None:
    """Run the mutants, print one line for each, and then the results."""
    parser = options(__doc__)
    parser.add_argument("--only", nargs="+", choices=AREAS, default=list(AREAS), help="areas")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--uncompiled", action="store_true", help="without mutants of compiled functions")
    parser.add_argument("--compare", type=Path, help="earlier table: the same mutants again")
    arguments = parser.parse_args()
    if arguments.compare:
        table = json.loads(arguments.compare.read_text(encoding="utf-8"))["mutants"]
        earlier = [Mutant(**{**row, "killer": "", "slow": False}) for row in table]
        mutants = [each for each in earlier if each.area in arguments.only]
    else:
        share = 3 if arguments.quick else 1
        mutants = [m for name in arguments.only for m in chosen(arguments.seed, name, AREAS[name].mutants // share)]
    mutants = [mutant for mutant in mutants if not (arguments.uncompiled and mutant.compiled)]
    with tempfile.TemporaryDirectory() as folder:
        copy, cache = copy_of_the_repository(Path(folder)), Path(folder) / "cache"
        for area in arguments.only:
            if broken := failed_test(copy, tests_of(area, ""), cache):
                sys.exit(f"The tests of {area} fail without any mutant: {broken}. Repair them first.")
        first = forked(list(filter(can_fork, mutants)), copy, cache)
        first += [mutant for mutant in mutants if not can_fork(mutant)]
        done = [mutant if mutant.killer else tried(mutant, copy, cache) for mutant in first]
    for mutant in done:
        change = f"{' '.join(mutant.before.split())} -> {' '.join(mutant.after.split())}"
        state = f"killed by {mutant.killer}" if mutant.killer else "SURVIVED"
        where = f"{mutant.file}:{mutant.line} {mutant.function}"
        print(f"{where}: {change[:120]}: {state} ({mutant.seconds:.0f} s)", file=sys.stderr, flush=True)
    bars: list[Bar] = []
    for area in arguments.only:
        mine = [bool(each.killer) for each in done if each.area == area]
        bars.append(Bar(f"killed in {area}, of {len(mine)}", "-", sum(mine), None))
    bars.append(Bar("killed by slow tests only", "-", sum(each.slow for each in done), None))
    killed = sum(bool(each.killer) for each in done)
    share = killed / len(done)
    bars.append(Bar(f"killed of all {len(done)}", f">= {KILLED * len(done):.0f}", killed, share >= KILLED))
    show("Mutants", bars, arguments.json, mutants=[asdict(each) for each in done])


if __name__ == "__main__":
    main()
