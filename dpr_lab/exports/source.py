"""Extract the source of compiled functions with dependencies, for other programs.

The functions are those that dpr-lab itself runs. Decorators and annotations are removed, and names are made unique. A
division by zero gives the same result as in compiled code.
"""

import ast
import inspect
import textwrap
import types
from collections.abc import Callable, Mapping
from typing import Any

PREAMBLE = '''def divided(x, y):
    """x / y; inf or nan if y is zero."""
    return x / y if y else (math.copysign(math.inf, x) * math.copysign(1.0, y) if x * x > 0.0 else math.nan)
'''
"""Preamble of the sources, in addition to `import math`, `import numpy as np`, `namedtuple`."""

Rewrite = Callable[[ast.FunctionDef], ast.FunctionDef]


def sources(roots: Mapping[str, Any], rewritten: Mapping[str, Rewrite] | None = None) -> str:
    """Collect the definitions that the roots need, in executable order.

    Args:
        roots: functions (compiled or not), named tuples or numbers, by their name in the source
        rewritten: transformations of definitions, by the name of the root; they precede the search for dependencies

    Raises:
        TypeError: a root uses an object without a source, such as a closure or an array.
    """
    writer = _Writer(rewritten or {})
    for name, root in roots.items():
        writer.names.setdefault(_identity(root), name)
    for name, root in roots.items():
        if writer.write(root) != name:  # the same function with another transformation
            writer.written.append(writer.definition(name, root))
    return "\n\n\n".join(writer.written)


class _Writer:
    def __init__(self, rewritten: Mapping[str, Rewrite]) -> None:
        self.rewritten = rewritten
        self.names: dict[Any, str] = {}
        self.started: set[Any] = set()
        self.written: list[str] = []

    def write(self, value: Any) -> str:
        """Write the definitions of a value and its dependencies once; return its name."""
        key = _identity(value)
        if key not in self.names:
            self.names[key] = self._free_name(value)
        name = self.names[key]
        if key not in self.started:
            self.started.add(key)
            self.written.append(self.definition(name, value))
        return name

    def _free_name(self, value: Any) -> str:
        """Return the name of a function.

        If this name is already used, the name of the module is added as a prefix.
        """
        function = _plain(value)
        name, taken = function.__name__, set(self.names.values())
        return name if name not in taken else f"{function.__module__.rsplit('.', 1)[-1]}_{name}"

    def definition(self, name: str, value: Any) -> str:
        function = _plain(value)
        if isinstance(function, type):
            return f"{name} = namedtuple({name!r}, {' '.join(function._fields)!r})"
        (node,) = ast.parse(textwrap.dedent(inspect.getsource(function))).body
        if not isinstance(node, ast.FunctionDef):
            raise TypeError(f"{name} is not a function with a source")
        node.name, node.decorator_list, node.returns = name, [], None
        node = self.rewritten.get(name, lambda same: same)(node)
        return ast.unparse(ast.fix_missing_locations(_Names(self, function).visit(node)))

    def expression(self, value: Any, name: str = "") -> ast.expr:
        """Return an expression that refers to a value in the written source."""
        if isinstance(value, types.FunctionType) or hasattr(value, "py_func") or _is_record(value):
            return ast.Name(self.write(value), ast.Load())
        if isinstance(value, tuple) and _is_record(type(value)):
            if id(value) not in self.names:
                called = ast.Call(self.expression(type(value)), [self.expression(element) for element in value], [])
                self.names[id(value)] = name
                self.written.append(f"{name} = {ast.unparse(called)}")
            return ast.Name(self.names[id(value)], ast.Load())
        if isinstance(value, tuple):
            return ast.Tuple([self.expression(element) for element in value], ast.Load())
        if isinstance(value, types.BuiltinFunctionType) and value.__module__ == "math":
            return ast.Attribute(ast.Name("math", ast.Load()), value.__name__, ast.Load())
        if isinstance(value, bool | int | float):
            return ast.Constant(value) if value - value == 0 else ast.parse(f"math.{value}", mode="eval").body
        raise TypeError(f"{value!r} has no self-contained source")


class _Names(ast.NodeTransformer):
    """Transformer of a syntax tree.

    It replaces the global names in a function by the names in the written source.
    """

    def __init__(self, writer: _Writer, function: types.FunctionType) -> None:
        self.writer, self.globals = writer, function.__globals__
        self.local = set(function.__code__.co_varnames)

    def visit_arg(self, node: ast.arg) -> ast.arg:
        return ast.arg(node.arg)

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id in self.local or node.id not in self.globals or node.id in ("math", "np"):
            return node
        return self.writer.expression(self.globals[node.id], node.id)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        return self.generic_visit(ast.Assign([node.target], node.value or ast.Constant(None)))

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        node = ast.BinOp(self.visit(node.left), node.op, self.visit(node.right))
        if isinstance(node.op, ast.Div) and not isinstance(node.right, ast.Constant):
            return ast.Call(ast.Name("divided", ast.Load()), [node.left, node.right], [])
        return node


def _plain(value: Any) -> Any:
    """Return the Python function from which a function was compiled."""
    return getattr(value, "py_func", value)


def _identity(value: Any) -> Any:
    return id(_plain(value))


def _is_record(value: Any) -> bool:
    """Check whether a value is the class of a named tuple."""
    return isinstance(value, type) and issubclass(value, tuple) and hasattr(value, "_fields")
