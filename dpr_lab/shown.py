"""Display of public objects at a Python prompt.

Results are shown as a heading and a table, and `help()` uses short type names.
"""

import ast
import inspect
import shlex
import textwrap
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import is_dataclass
from functools import cache
from html import escape
from itertools import pairwise
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, ForwardRef, Literal, Union, get_args, get_origin

Row = Sequence[str]

FIXED_BY = {"data": "the recordings", "measured": "a measured value", "bound": "only its bounds"}
"""Descriptions of the sources of a value, by the word for the source in files."""


class Shown(ABC):
    """Base class of results that are displayed as a heading and a table."""

    __slots__ = ()

    @abstractmethod
    def _heading(self) -> str:
        """Return the heading, one line."""

    def _rows(self) -> Sequence[Row]:
        """Return the rows of the table, first the column names; empty by default."""
        return []

    def __repr__(self) -> str:
        rows = [[str(cell) for cell in row] for row in self._rows()]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
        return "\n".join([self._heading(), *(f"  {line}" for line in lines)])

    def __str__(self) -> str:
        return repr(self)

    def _repr_html_(self) -> str:
        """Return HTML for a notebook."""
        heading, rows = f"<p>{escape(self._heading())}</p>", self._rows()
        table = "".join(_row(row, "td" if i else "th") for i, row in enumerate(rows))
        return f"{heading}<table>{table}</table>" if table else heading


def listed(names: Sequence[str]) -> str:
    """Join names with commas and `and`, for example `a, b and c`."""
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def in_command(path: Path | str) -> str:
    """Quote a path for a command that the user can copy to a shell."""
    return shlex.quote(str(path))


def counted(number: int, noun: str) -> str:
    """Format a number with its noun, for example `1 run` or `2 runs`."""
    return f"{number} {noun}{'s' * (number != 1)}"


def percent(share: float, digits: int = 0) -> str:
    """Format a fraction as a percentage, for example `98 %` or `97.6 %`."""
    return f"{round(100 * share, digits) + 0.0:.{digits}f} %"  # -0.0 + 0.0 is 0.0


def _row(cells: Row, tag: str) -> str:
    return "<tr>" + "".join(f"<{tag}>{escape(str(cell))}</{tag}>" for cell in cells) + "</tr>"


class _Plain(str):
    """String whose `repr` has no quotes, for annotations and default values in signatures."""

    __slots__ = ()
    __repr__ = str.__str__


@cache
def explain(value: Any, name: str) -> Any:
    """Give a public function or class its public name and a readable help text.

    Args:
        value: a function or a class
        name: public name
    """
    _sign_methods(value)
    if inspect.isfunction(value):
        value.__name__ = name
        _sign(value)
    elif hasattr(value, "model_rebuild"):
        value.model_rebuild()  # a model is built on first use; only then does it have a signature
        _sign(value)
    elif is_dataclass(value):
        _sign(value)
        _sign(value.__init__)
        _explain_fields(value)
    return value


def _sign(value: Any) -> None:
    value.__signature__ = readable(inspect.signature(value))


def _sign_methods(value: Any) -> None:
    for name, method in vars(value).items():
        if inspect.isfunction(method) and not name.startswith("_"):
            _sign(method)


def _explain_fields(cls: Any) -> None:
    """Store the docstrings of the fields as slot descriptions, which `help` prints."""
    cls.__slots__ = {**dict.fromkeys(cls.__slots__), **field_docs(cls)}


def readable(signature: inspect.Signature) -> inspect.Signature:
    """Shorten type names in a signature and remove long default values."""
    parameters = [
        parameter.replace(annotation=_annotated(parameter.annotation), default=_short(parameter.default))
        for parameter in signature.parameters.values()
    ]
    return signature.replace(parameters=parameters, return_annotation=_annotated(signature.return_annotation))


def plain_type(annotation: Any) -> str:
    """Return the short name of a type, without modules and metadata: `Mapping[str, float] | None`."""
    origin, parts = get_origin(annotation), get_args(annotation)
    match annotation:
        case str():
            return annotation
        case ForwardRef():
            return annotation.__forward_arg__
        case list():
            return f"[{', '.join(map(plain_type, annotation))}]"
        case _ if annotation in (None, NoneType):
            return "None"
        case _ if annotation is ...:
            return "..."
    if origin is Annotated:
        return plain_type(parts[0])
    if origin in (Union, UnionType):
        from numpy.typing import ArrayLike  # a union of many types, whose alias is not available

        if annotation == ArrayLike:
            return "ArrayLike"
        return " | ".join(map(plain_type, parts))
    if origin is Literal:
        return f"Literal[{', '.join(map(repr, parts))}]"
    if getattr(origin, "__name__", "") == "ndarray":
        (scalar,) = get_args(parts[1])
        return f"NDArray[np.{scalar.__name__}]"
    if parts:
        return f"{origin.__name__}[{', '.join(map(plain_type, parts))}]"
    return getattr(annotation, "__name__", str(annotation))


def field_docs(cls: type) -> dict[str, str]:
    """Return the docstrings of the fields of a dataclass, from its source.

    The result is empty if the source is not available.
    """
    try:
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
    except (OSError, SyntaxError):
        return {}
    body = tree.body if isinstance(tree, ast.ClassDef) else []
    return {
        field.target.id: inspect.cleandoc(below.value.value)
        for field, below in pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) and isinstance(below.value.value, str)
    }


def _annotated(annotation: Any) -> Any:
    return annotation if annotation is inspect.Signature.empty else _Plain(plain_type(annotation))


def _short(default: Any, longest: int = 30) -> Any:
    """Return a default value, or `...` if its text is too long for a signature."""
    return default if default is inspect.Parameter.empty or len(repr(default)) <= longest else _Plain("...")
