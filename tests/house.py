"""Structure of the code in numbers: import chains and cycles, ambiguous names, numeric constants, folders.

python tests/house.py            a table of all figures
python tests/house.py --list     and what they are made of
"""

import ast
import re
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path

from dpr_lab.effects import EFFECTS

ROOT = Path(__file__).parents[1]
PACKAGES = ("dpr_lab", "firmware_protocol", "sim_device")
EFFECTS_ROOM = "dpr_lab.effects"


def modules(package: str) -> dict[str, ast.Module]:
    """Syntax tree of every module of a package, by dotted name."""
    result = {}
    for path in sorted((ROOT / package.replace(".", "/")).rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        result[name] = tree_of(path)
    return result


@cache
def tree_of(path: Path) -> ast.Module:
    """Syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes_of(tree: ast.Module) -> list[ast.AST]:
    """All nodes of a syntax tree."""
    return list(ast.walk(tree))


def imports(trees: Mapping[str, ast.Module], *, deferred: bool = False) -> dict[str, set[str]]:
    """Modules among `trees` that each module imports; `deferred` also counts imports inside functions."""
    return {name: set(_imported(tree, trees, deferred)) - {name} for name, tree in trees.items()}


def _imported(tree: ast.Module, trees: Mapping[str, ast.Module], deferred: bool) -> Iterator[str]:
    for node in nodes_of(tree) if deferred else tree.body:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in trees)
        elif isinstance(node, ast.ImportFrom) and node.module:
            inner = [f"{node.module}.{alias.name}" for alias in node.names]
            yield from (name for name in inner if name in trees)
            if node.module in trees and any(name not in trees for name in inner):
                yield node.module


def circles(graph: Mapping[str, set[str]]) -> list[list[str]]:
    """Groups of two or more modules that import one another (Tarjan's algorithm)."""
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    result: list[list[str]] = []

    def visit(name: str) -> None:
        order[name] = low[name] = len(order)
        stack.append(name)
        for other in graph[name]:
            if other not in order:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], order[other])
        if low[name] == order[name]:
            group = stack[stack.index(name) :]
            del stack[stack.index(name) :]
            if len(group) > 1:
                result.append(sorted(group))

    for name in graph:
        if name not in order:
            visit(name)
    return result


def longest_chain(graph: Mapping[str, set[str]]) -> list[str]:
    """Longest path of imports; the graph must be acyclic."""

    @cache
    def below(name: str) -> tuple[str, ...]:
        return (name, *max((below(other) for other in graph[name]), key=len, default=()))

    return list(max((below(name) for name in graph), key=len, default=()))


def within(graph: Mapping[str, set[str]], *packages: str) -> dict[str, set[str]]:
    """Part of a graph inside some packages."""
    mine = {name for name in graph if any(name == p or name.startswith(p + ".") for p in packages)}
    return {name: graph[name] & mine for name in mine}


def class_names(trees: Mapping[str, ast.Module]) -> dict[str, list[str]]:
    """Modules that define each public class name."""
    result: dict[str, list[str]] = defaultdict(list)
    for name, tree in trees.items():
        for node in nodes_of(tree):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                result[node.name].append(name)
    return result


def numeric_constants(trees: Mapping[str, ast.Module]) -> list[str]:
    """Names module.NAME of all module-level UPPERCASE constants that contain a number and no text."""
    result = []
    for name, tree in trees.items():
        for node in tree.body:
            if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None or not _numeric(node.value):
                continue
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = [t.id for target in targets for t in ast.walk(target) if isinstance(t, ast.Name)]
            result += [f"{name}.{n}" for n in names if n.upper() == n]
    return result


def _numeric(value: ast.expr) -> bool:
    """Whether an expression contains a number and no text."""
    constants = [node.value for node in ast.walk(value) if isinstance(node, ast.Constant)]
    numbers = [c for c in constants if isinstance(c, int | float) and not isinstance(c, bool)]
    return bool(numbers) and not any(isinstance(c, str | bytes) for c in constants)


def effects_named(trees: Mapping[str, ast.Module], effects: Iterable[str]) -> list[str]:
    """module:line name of every effect that a text names; in docstrings only what stands in quotes counts."""
    words = "|".join(sorted(effects))
    anywhere, quoted = re.compile(rf"(?<!\w)({words})(?!\w)"), re.compile(rf"[`'\"]({words})[`'\"]")
    result = []
    for name, tree in trees.items():
        expressions = {id(node.value) for node in nodes_of(tree) if isinstance(node, ast.Expr)}
        for node in nodes_of(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                match = (quoted if id(node) in expressions else anywhere).findall(node.value)
                result += [f"{name}:{node.lineno} {effect}" for effect in match]
    return result


def folder_sizes() -> dict[str, int]:
    """Python files of each folder, except `__init__` and `__main__`."""
    result: dict[str, int] = defaultdict(int)
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            if path.name not in ("__init__.py", "__main__.py"):
                result[path.parent.relative_to(ROOT).as_posix()] += 1
    return result


def long_files(most: int) -> dict[str, int]:
    """Return the number of lines of each Python file of the repository that has more than `most` lines."""
    folders = (*PACKAGES, "tests", "benchmarks", "docs")
    sizes = {
        path.relative_to(ROOT).as_posix(): len(path.read_text(encoding="utf-8").splitlines())
        for folder in folders
        for path in (ROOT / folder).rglob("*.py")
    }
    return {name: lines for name, lines in sizes.items() if lines > most}


def main() -> None:
    """Print all figures."""
    trees = {name: tree for package in PACKAGES for name, tree in modules(package).items()}
    graph, deferred = imports(trees), imports(trees, deferred=True)
    twice = {name: where for name, where in class_names(trees).items() if len(where) > 1}
    constants = numeric_constants({name: tree for name, tree in trees.items() if name.startswith("dpr_lab")})
    gap = within(graph, "dpr_lab.gap")
    named = effects_named({name: tree for name, tree in trees.items() if not name.startswith(EFFECTS_ROOM)}, EFFECTS)
    print(f"circles, imports in functions too   {len(circles(graph))}, {len(circles(deferred))}")
    if not circles(gap):
        print(f"longest chain in gap                {len(longest_chain(gap))}")
    print(f"class names with two meanings       {len(twice)}")
    print(f"numeric module constants            {len(constants)}")
    print(f"effects named outside their room    {len(named)}")
    print(f"files in a folder, largest          {sorted(folder_sizes().items(), key=lambda kv: -kv[1])[:6]}")
    print(f"files of more than 400 lines        {len(long_files(400))}")
    if "--list" in sys.argv:
        print(*circles(graph), *circles(deferred), sep="\n")
        print(*longest_chain(gap), sep="\n  ")
        print(*(f"{name}: {', '.join(where)}" for name, where in sorted(twice.items())), sep="\n")
        print(*constants, *named, *long_files(400), sep="\n")


if __name__ == "__main__":
    main()
