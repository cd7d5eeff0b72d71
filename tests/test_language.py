"""Texts and names use plain English and the terms of the field."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from tests.house import nodes_of, tree_of

ROOT = Path(__file__).parents[1]
SOURCES = sorted(path for top in ("dpr_lab", "firmware_protocol", "sim_device") for path in (ROOT / top).rglob("*.py"))
OTHERS = [path for top in ("benchmarks", "docs", "fuzz", "tests") for path in sorted((ROOT / top).rglob("*.py"))]

WORDS = re.compile(
    r"(?<![.\w])(told|foretold|foretells?|foretelling|beside|begun|likeness|whatever|anew|unsaid|lest|whoever|whence|wherein"
    r"|mended|surest|took no part|as asked for)\b"
)
"""Words for which the field has a term, or English a plainer word."""

PARTS = re.compile(
    WORDS.pattern.replace(r"(?<![.\w])", r"(?:(?<!\w)|(?<=\\[a-z]))").replace("took no part|as asked for", "took|asked")
)
"""A part of each of them that no line break divides, also behind an escape: other files need not be parsed."""

TEST = re.compile(r"^\s*(?:async )?def (test_\w+)", re.MULTILINE)
"""The name of a test."""

SPOKEN = re.compile(r"\b(said|tells?|nobody|obeys?|feels?|the lab|is none)\b")
"""Words of speech and riddles in the name of a test, for which `reported`, `determines`, `invalid` are plainer."""

PROSE, CODE = re.compile(r"[A-Za-z][A-Za-z'-]+"), re.compile(r"`[^`]*`")
"""A word of prose, and code that contains none: symbols and numbers are not counted."""

VAGUE = {"found", "item", "told", "said", "it", "begun", "beside", "foretell", "foretold", "laid"}
"""Names of values that do not say what they hold."""

BOUND = re.compile(rf"\b({'|'.join(sorted(VAGUE - {'it'}))})(?= ?[:=,)(]| in )", re.IGNORECASE)
"""One of them, but for `it`, where a name may be bound: other tests and benchmarks need not be parsed."""

VAGUE_LOCALS = {
    "own",
    "one",
    "each",
    "both",
    "at",
    "seen",
    "kept",
    "here",
    "there",
    "way",
    "mine",
    "some",
    "many",
    "how",
}
"""Names of variables and arguments that do not say what they hold; a field or a method may have them."""


def test_texts_and_docstrings_are_in_plain_words() -> None:
    used = [
        f"{path.relative_to(ROOT)}:{line}: {match[0]}"
        for path in (*SOURCES, *OTHERS)
        if path != Path(__file__) and PARTS.search(path.read_text(encoding="utf-8"))
        for line, text in _texts(path)
        for match in WORDS.finditer(text)
    ]
    assert used == [], "use the terms of docs/glossary.md"


def test_names_of_tests_are_in_plain_words() -> None:
    names = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in sorted((ROOT / "tests").rglob("test_*.py"))
        for name in TEST.findall(path.read_text(encoding="utf-8"))
    ]
    archaic = [name for name in names if WORDS.search(words := name.replace("_", " ")) or SPOKEN.search(words)]
    assert archaic == [], "state what is tested in the terms of docs/glossary.md"


def test_values_have_names_that_say_what_they_hold() -> None:
    others = [path for path in OTHERS if BOUND.search(path.read_text(encoding="utf-8"))]
    vague = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in (*SOURCES, *others)
        for name in _defined(path)
        if name.strip("_").lower() in VAGUE
    ]
    assert vague == []


def test_local_variables_say_what_they_hold() -> None:
    vague = [f"{path.relative_to(ROOT)}: {name}" for path in SOURCES for name in _locals(path) if name in VAGUE_LOCALS]
    assert vague == []


def test_the_first_sentence_of_a_docstring_has_at_most_nineteen_words() -> None:
    long = [
        f"{path.relative_to(ROOT)}: {getattr(node, 'name', 'module')}"
        for path in SOURCES
        for node in nodes_of(tree_of(path))
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        if len(PROSE.findall(CODE.sub("", (ast.get_docstring(node) or "").split("\n")[0].split(". ")[0]))) > 19
    ]
    assert long == [], "state conditions and exceptions in sentences of their own"


def test_shares_are_written_with_a_space_before_the_percent_sign() -> None:
    formatted = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in SOURCES
        for node in nodes_of(tree_of(path))
        if isinstance(node, ast.FormattedValue) and node.format_spec and ast.unparse(node.format_spec).endswith("%'")
    ]
    assert formatted == [], "use dpr_lab.shown.percent"


def _texts(path: Path) -> Iterator[tuple[int, str]]:
    for node in nodes_of(tree_of(path)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            yield node.lineno, node.value


def _defined(path: Path) -> Iterator[str]:
    """Names of variables, arguments, attributes, functions and classes."""
    for node in nodes_of(tree_of(path)):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg


def _locals(path: Path) -> Iterator[str]:
    """Names that functions bind: arguments, and variables of loops and comprehensions too."""
    for function in nodes_of(tree_of(path)):
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            for node in ast.walk(function):
                if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                    yield node.id
                elif isinstance(node, ast.arg):
                    yield node.arg
